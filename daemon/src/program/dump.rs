//! `lanternd bench --dump`: the rays that a frame traces and what they hit, for another tracer to be measured on (CONTRACT, Bench).
//!
//! Rays are those of the real passes, written down by the shaders. `triangles.f32` has the physical things (props and masks) first
//! and the virtual ones last, each in the order of the scene's instances and of their meshes' triangles, so that what a kind of ray
//! can meet is a range of it; `dump.json` says which.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use lantern_gpu::Device;
use lantern_render::stale::Stale;
use lantern_render::{RayKind, Recorded, RecordedRay, RenderError, Renderer, Settings};
use lantern_scene::{Role, Scene};
use serde_json::{Map, Value, json};

use super::progress::Progress;
use crate::service::setup::Loaded;

/// Frames in which a kind is recorded at most: far more than any scene's rays need.
const MOST_PARTS: u32 = 1024;

/// Why there is no dump.
#[derive(Debug, thiserror::Error)]
pub(super) enum DumpError {
    /// A file of the dump could not be written.
    #[error("writing {path}: {source}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The renderer failed.
    #[error("rendering what is dumped: {0}")]
    Render(#[from] RenderError),
    /// A kind of ray of which one frame has more than many buffers hold.
    #[error("there are too many {0} rays to record\nhint: set fewer render.samples or a lower render.max_depth")]
    TooMany(&'static str),
    /// What was recorded names no triangle of the scene, which is a fault of ours.
    #[error("a {0} ray has hit a triangle that the scene lacks")]
    NoTriangle(&'static str),
}

/// The triangles of everything that rays can meet.
struct Triangles {
    /// Nine numbers a triangle: the corners, world, m, relative to the scene's origin.
    corners: Vec<f32>,
    /// How many of them are physical: they stand first.
    physical: usize,
    /// The number of an instance's first triangle, and how many it has; none for what is never traced.
    of_instance: Vec<Option<(u32, u32)>>,
}

impl Triangles {
    fn of(scene: &Scene) -> Self {
        let mut all = Self { corners: Vec::new(), physical: 0, of_instance: vec![None; scene.instances.len()] };
        for virtual_ones in [false, true] {
            let wanted = |role| role != Role::Raster && (role == Role::Virtual) == virtual_ones;
            for placed in scene.world_meshes().filter(|placed| wanted(placed.role)) {
                let (first, count) = (all.corners.len() / 9, placed.mesh.indices.len());
                all.of_instance[placed.instance] = Some((first as u32, count as u32));
                for corner in (0..count).flat_map(|triangle| placed.mesh.corners(triangle)) {
                    let at = placed.world_from_object.transform_point3(corner) - scene.origin_m;
                    all.corners.extend(at.as_vec3().to_array());
                }
            }
            if !virtual_ones {
                all.physical = all.corners.len() / 9;
            }
        }
        all
    }

    fn count(&self) -> usize {
        self.corners.len() / 9
    }

    /// What a kind of ray can meet: the first triangle and how many.
    fn met_by(&self, kind: RayKind) -> [usize; 2] {
        match kind {
            RayKind::Primary | RayKind::Blend => [0, self.physical],
            RayKind::Secondary | RayKind::Shadow => [0, self.count()],
            RayKind::Virtual => [self.physical, self.count() - self.physical],
        }
    }

    /// The number of a ray's triangle; 2³² − 1 for a miss. `None`: the scene has no such triangle.
    fn number(&self, ray: &RecordedRay) -> Option<u32> {
        if ray.instance == u32::MAX {
            return Some(u32::MAX);
        }
        let (first, count) = (*self.of_instance.get(ray.instance as usize)?)?;
        (ray.triangle < count).then_some(first + ray.triangle)
    }
}

/// Writes a dump of one frame of all projectors, everything of it traced anew; tells what `dump.json` says.
///
/// # Errors
/// [`DumpError`].
pub(super) fn dump(
    device: &Arc<Device>,
    loaded: &Loaded,
    settings: Settings,
    viewer: DVec3,
    folder: &Path,
) -> Result<Value, DumpError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| DumpError::Write { path, source }
    };
    fs::create_dir_all(folder).map_err(failed(folder))?;
    let scene = loaded.editor.current();
    let triangles = Triangles::of(&scene);
    let path = folder.join("triangles.f32");
    let bytes: Vec<u8> = triangles.corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(&path, bytes).map_err(failed(&path))?;

    let settings = Settings { record_rays: true, ..settings };
    let mut recording =
        Recording { renderer: Renderer::new(device, loaded.projectors.clone(), settings, scene.clone())?, viewer };
    let mut kinds = Map::new();
    let progress = Progress::new(RayKind::ALL.len() as u64);
    for kind in RayKind::ALL {
        progress.step(&format!("recording {} rays", kind.name()));
        let [first, count] = triangles.met_by(kind);
        let mut rays_of = Map::new();
        let [rays, hits] = ["rays", "hits"].map(|ending| folder.join(format!("{}.{ending}", kind.name())));
        let mut to_rays = BufWriter::new(File::create(&rays).map_err(failed(&rays))?);
        let mut to_hits = BufWriter::new(File::create(&hits).map_err(failed(&hits))?);
        for (index, spec) in loaded.projectors.iter().enumerate() {
            let recorded = recording.all_of(kind, index, spec.calibration.resolution_px().x)?;
            for ray in &recorded {
                let number = triangles.number(ray).ok_or(DumpError::NoTriangle(kind.name()))?;
                to_rays.write_all(&ray_bytes(ray)).map_err(failed(&rays))?;
                to_hits.write_all(&ray.t.to_le_bytes()).map_err(failed(&hits))?;
                to_hits.write_all(&number.to_le_bytes()).map_err(failed(&hits))?;
            }
            rays_of.insert(spec.name.clone(), json!(recorded.len()));
        }
        to_rays.flush().map_err(failed(&rays))?;
        to_hits.flush().map_err(failed(&hits))?;
        let ends = if kind.is_closest() { "closest" } else { "any" };
        kinds.insert(
            kind.name().to_owned(),
            json!({ "rays": rays_of, "hit": ends, "first_triangle": first, "triangles": count }),
        );
    }
    progress.finish();

    let told = json!({
        "triangles": triangles.count(),
        "physical_triangles": triangles.physical,
        "origin_m": scene.origin_m.to_array(),
        "samples": settings.samples,
        "max_depth": settings.max_depth,
        "kinds": kinds,
    });
    let path = folder.join("dump.json");
    fs::write(&path, format!("{told:#}\n")).map_err(failed(&path))?;
    Ok(told)
}

/// Origin, t_min, direction, t_max.
fn ray_bytes(ray: &RecordedRay) -> [u8; 32] {
    let ([ox, oy, oz], [dx, dy, dz]) = (ray.origin, ray.direction);
    let mut bytes = [0; 32];
    for (to, x) in bytes.chunks_exact_mut(4).zip([ox, oy, oz, ray.t_min, dx, dy, dz, ray.t_max]) {
        to.copy_from_slice(&x.to_le_bytes());
    }
    bytes
}

/// A renderer whose frames are all the same frame.
struct Recording {
    renderer: Renderer,
    viewer: DVec3,
}

impl Recording {
    fn part_of(&mut self, kind: RayKind, projector: usize, part: u32, parts: u32) -> Result<Recorded, DumpError> {
        self.renderer.record(kind, part, parts)?;
        self.renderer.make_stale(Stale::EVERYTHING);
        self.renderer.render(|| vec![self.viewer])?;
        Ok(self.renderer.recorded(projector)?)
    }

    /// All rays of a kind of a projector, in the order in which a tracer on the CPU would have them: along a Morton curve over the
    /// image, then by sample, then as they were traced. What one buffer does not hold comes in several frames.
    fn all_of(&mut self, kind: RayKind, projector: usize, width_px: u32) -> Result<Vec<RecordedRay>, DumpError> {
        let mut parts = 1;
        let mut all: Vec<RecordedRay> = Vec::new();
        let mut part = 0;
        while part < parts {
            let recorded = self.part_of(kind, projector, part, parts)?;
            if recorded.rays.len() == recorded.wanted as usize {
                all.extend(recorded.rays);
                part += 1;
                continue;
            }
            // As many parts as there is room for in each, and a few more, since no hash parts evenly.
            let held = recorded.rays.len().max(1) as u32;
            parts *= recorded.wanted.div_ceil(held - held / 16).max(2);
            if parts > MOST_PARTS {
                return Err(DumpError::TooMany(kind.name()));
            }
            all.clear();
            part = 0;
        }
        let place = |ray: &RecordedRay| {
            (spread(ray.pixel % width_px) | spread(ray.pixel / width_px) << 1, ray.sample_index, ray.turn)
        };
        all.sort_unstable_by(|a, b| place(a).cmp(&place(b)).then_with(|| ray_bytes(a).cmp(&ray_bytes(b))));
        Ok(all)
    }
}

/// The bits of a number with a zero before each.
fn spread(x: u32) -> u64 {
    [
        (16, 0x0000_ffff_0000_ffff),
        (8, 0x00ff_00ff_00ff_00ff),
        (4, 0x0f0f_0f0f_0f0f_0f0f),
        (2, 0x3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555),
    ]
    .into_iter()
    .fold(u64::from(x), |all, (shift, mask)| (all | all << shift) & mask)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_morton_curve_goes_through_squares() {
        let place = |x: u32, y: u32| spread(x) | spread(y) << 1;
        let mut square: Vec<u64> = (0..4).flat_map(|y| (0..4).map(move |x| place(x, y))).collect();
        square.sort_unstable();
        assert_eq!(square, (0..16).collect::<Vec<_>>());
        assert_eq!(place(u32::MAX, u32::MAX), u64::MAX);
    }
}
