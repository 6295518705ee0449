//! Whole pictures: jittered samples, their mean colour, and the closest of them.

use glam::{DVec3, UVec2};
use lantern_calibration::Frustum;
use lantern_scene::Role;

use super::{
    jitter::{sample_offset, seed_words},
    light::eye_independent,
    primary::{primary_hit, primary_ray},
    secondary::{Eye, Look, Sample, eye_dependent},
    world::World,
};

/// How to render.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The projector's state, a word a sample.
    pub seed_words: Vec<u32>,
    /// Secondary rays deep.
    pub max_depth: u32,
    /// Who looks.
    pub eye: Eye,
}

impl Settings {
    /// As the daemon renders a projector of this name for one viewer.
    pub fn new(projector: &str, samples: u32, max_depth: u32, eye_m: DVec3) -> Self {
        Self { seed_words: seed_words(projector, samples), max_depth, eye: Eye::Viewers(vec![eye_m]) }
    }
}

/// One pixel, as the layers of a snapshot have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Linear RGB, the mean of all samples.
    pub radiance: DVec3,
    /// Along the closest sample's ray, m; +inf = miss.
    pub distance_m: f64,
    /// Of the closest sample; −1 = miss.
    pub node: f64,
    /// Window z of the closest sample's hit; 1 = miss.
    pub depth: f64,
    /// How many samples hit anything.
    pub hits: u32,
}

/// A picture, row 0 on top.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Columns and rows.
    pub size_px: UVec2,
    /// Row by row.
    pub pixels: Vec<Pixel>,
}

impl Picture {
    /// The pixel at a place.
    pub fn at(&self, x: u32, y: u32) -> &Pixel {
        &self.pixels[(y * self.size_px.x + x) as usize]
    }
}

/// Renders one pixel.
pub fn render_pixel(world: &World, frustum: &Frustum, settings: &Settings, pixel: UVec2) -> Pixel {
    let samples = settings.seed_words.len() as u32;
    let mut shown = Pixel { radiance: DVec3::ZERO, distance_m: f64::INFINITY, node: -1.0, depth: 1.0, hits: 0 };
    for index in 0..samples {
        let offset_px = sample_offset(pixel, index, &settings.seed_words);
        let Some(ray) = primary_ray(frustum, pixel, offset_px) else { continue };
        let Some(hit) = primary_hit(world, ray) else { continue };
        shown.hits += 1;

        // The closest sample's distance, never a mean, which would lie on no surface.
        if hit.hit.t_m < shown.distance_m {
            shown.distance_m = hit.hit.t_m;
            shown.node = hit.node as f64;
            shown.depth = frustum.project(ray.at(hit.hit.t_m)).map_or(1.0, |projected| projected.window_z);
        }

        if hit.surface.role == Role::Mask {
            continue;
        }
        let sample = Sample { pixel, index, seed_words: &settings.seed_words, max_depth: settings.max_depth };
        shown.radiance += match eye_dependent(world, &hit, &settings.eye, sample) {
            Look::Add(look) => eye_independent(world, &hit.surface) + look,
            Look::Hidden(look) => look,
        } / f64::from(samples);
    }
    shown
}

/// Renders every `step`-th pixel of both directions, on all cores; `step` = 1 is the whole picture.
pub fn render(world: &World, frustum: &Frustum, settings: &Settings, step: u32) -> Picture {
    let size_px = frustum.calibration().resolution_px().map(|side| side.div_ceil(step));
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u32;
    let mut rows: Vec<(u32, Vec<Pixel>)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|thread| {
                scope.spawn(move || {
                    let mine = (thread..size_px.y).step_by(threads as usize);
                    let row = |y: u32| {
                        (0..size_px.x)
                            .map(|x| render_pixel(world, frustum, settings, UVec2::new(x, y) * step))
                            .collect()
                    };
                    mine.map(|y| (y, row(y))).collect::<Vec<_>>()
                })
            })
            .collect();
        workers
            .into_iter()
            .flat_map(|worker| worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    rows.sort_by_key(|(y, _)| *y);
    Picture { size_px, pixels: rows.into_iter().flat_map(|(_, row)| row).collect() }
}
