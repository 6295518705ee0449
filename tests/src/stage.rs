//! Small scenes and projectors to test with.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{DVec3, UVec2};
use lantern_calibration::{Calibration, Convention, Frustum, Matrix4};
use lantern_config::{Config, DEMO_TOML};
use lantern_scene::{Edit, Editor, Limits, Scene};
use serde_json::json;

/// The scene that a list of edits, as the socket takes them, makes out of an empty one.
///
/// # Panics
/// Where they are not edits, or are refused.
pub fn scene_of(edits: serde_json::Value) -> Arc<Scene> {
    editor_of(edits, Vec::new()).current()
}

/// As [`scene_of`], with the editor that goes on from there, and the folders from which files may be read.
///
/// # Panics
/// As [`scene_of`].
#[expect(clippy::panic, reason = "a test that cannot build its scene has failed")]
pub fn editor_of(edits: serde_json::Value, asset_roots: Vec<PathBuf>) -> Editor {
    let mut editor = Editor::new(Limits::default(), asset_roots);
    editor.apply(&edits_of(edits)).unwrap_or_else(|error| panic!("refused: {error:?}"));
    editor
}

/// Edits as the socket takes them.
///
/// # Panics
/// Where they are none.
#[expect(clippy::panic, reason = "a test that cannot say what it wants has failed")]
pub fn edits_of(edits: serde_json::Value) -> Vec<Edit> {
    serde_json::from_value(edits).unwrap_or_else(|error| panic!("no edits: {error}"))
}

/// The folder of real models beside the checkout; where it is not, says what is skipped.
pub fn shared_data(skipped: &str) -> Option<PathBuf> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    let there = folder.is_dir().then(|| folder.to_owned());
    if there.is_none() {
        println!("skipped, since there is no folder shared/data beside the checkout: {skipped}");
    }
    there
}

/// The demo at another resolution: its scene, its named projectors, and where its viewer stands, m.
///
/// # Panics
/// Where the embedded configuration is broken.
#[expect(clippy::panic, reason = "a test without the demo has failed")]
pub fn demo(resolution_px: UVec2) -> (Arc<Scene>, Vec<(String, Calibration)>, DVec3) {
    let nowhere = Path::new(".");
    let config = Config::parse(DEMO_TOML, "demo.toml", nowhere).unwrap_or_else(|problems| panic!("{problems:?}"));
    let editor = Editor::from_config(&config.scene, nowhere, Limits::default(), Vec::new());
    let projector = |p: &lantern_config::Projector| {
        let smaller = lantern_config::Projector { resolution_px: resolution_px.to_array(), ..p.clone() };
        let calibration = Calibration::from_config(&smaller).unwrap_or_else(|error| panic!("{error}"));
        (p.name.clone(), calibration)
    };
    let projectors = config.projectors.iter().map(projector).collect();
    let eye_m = config.viewer().map_or(DVec3::ZERO, |body| body.position_m.into());
    (editor.unwrap_or_else(|problems| panic!("{problems:?}")).current(), projectors, eye_m)
}

/// Where a projector stands and what it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// Metres.
    pub position_m: DVec3,
    /// The middle of its image, m.
    pub target_m: DVec3,
    /// The upright field of view.
    pub fov_y_rad: f64,
    /// Columns and rows.
    pub resolution_px: UVec2,
    /// Its clip space.
    pub convention: Convention,
}

impl Stand {
    /// An OpenGL projector of 40° at a place.
    pub fn new(position_m: DVec3, target_m: DVec3, resolution_px: UVec2) -> Self {
        Self { position_m, target_m, fov_y_rad: 40f64.to_radians(), resolution_px, convention: Convention::OpenGl }
    }

    /// Clip from view, rows; 0.1 m to 50 m.
    pub fn projection(&self) -> Matrix4 {
        let (near, far) = (0.1, 50.0);
        let aspect = f64::from(self.resolution_px.x) / f64::from(self.resolution_px.y);
        let focal = 1.0 / (self.fov_y_rad / 2.0).tan();
        let [first, second] = self.convention.depth_limits();
        let b = (first - second) * near * far / (far - near);
        [
            [focal / aspect, 0.0, 0.0, 0.0],
            [0.0, -focal * self.convention.y_sign(), 0.0, 0.0],
            [0.0, 0.0, b / far - second, b],
            [0.0, 0.0, -1.0, 0.0],
        ]
    }

    /// View from world, rows; +Y is up, or +X where it looks straight up or down.
    pub fn view(&self) -> Matrix4 {
        let back = (self.position_m - self.target_m).normalize();
        let up = if back.y.abs() > 0.999 { DVec3::X } else { DVec3::Y };
        let right = up.cross(back).normalize();
        let up = back.cross(right);
        let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(self.position_m)];
        [row(right), row(up), row(back), [0.0, 0.0, 0.0, 1.0]]
    }

    /// Its table in a configuration, headless.
    pub fn toml(&self, name: &str) -> String {
        let convention = match self.convention {
            Convention::OpenGl => "opengl",
            Convention::Vulkan => "vulkan",
        };
        let UVec2 { x, y } = self.resolution_px;
        format!(
            "[[projector]]\nname = \"{name}\"\nresolution_px = [{x}, {y}]\noutput = {{ kind = \"headless\" }}\n\
             [projector.calibration]\nconvention = \"{convention}\"\nprojection = {:?}\nview = {:?}\n",
            self.projection(),
            self.view(),
        )
    }

    /// Its matrix.
    ///
    /// # Panics
    /// Where it stands on its own target.
    #[expect(clippy::panic, reason = "a test that cannot build its projector has failed")]
    pub fn calibration(&self) -> Calibration {
        Calibration::from_matrices(&self.projection(), &self.view(), self.convention, self.resolution_px)
            .unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }

    /// Its frustum.
    ///
    /// # Panics
    /// As [`Stand::calibration`].
    pub fn frustum(&self) -> Frustum {
        Frustum::new(self.calibration())
    }
}

/// A still life in which things stand before, behind and within each other; `raster` of them are the rasteriser's.
pub fn still_life(raster: &[&str]) -> Arc<Scene> {
    let add = |name: &str, shape: &str, at_m: [f64; 3], size: f64| {
        let role = if raster.contains(&name) { "raster" } else { "prop" };
        json!({"add": {"node": name, "uri": format!("lantern:{shape}"), "role": role,
                       "translation_m": at_m, "scale": [size, size, size], "rotation": [0, 0.2588190451, 0, 0.9659258263]}})
    };
    scene_of(json!([
        add("floor", "checker", [0.0, 0.0, 0.0], 0.25),
        add("ball", "sphere", [-0.45, 0.3, 0.1], 0.3),
        add("box", "cube", [0.35, 0.15, 0.25], 0.45),
        add("teapot", "teapot", [0.1, 0.0, 0.75], 1.2),
        add("within", "sphere", [-0.25, 0.25, 0.3], 0.2),
        add("behind", "cube", [0.1, 0.35, -0.5], 0.7),
        {"environment": {"color": [0.5, 0.5, 0.5]}},
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        for convention in [Convention::OpenGl, Convention::Vulkan] {
            let size_px = UVec2::new(640, 400);
            let target_m = DVec3::new(0.2, 0.5, -0.1);
            let stand = Stand { convention, ..Stand::new(DVec3::new(1.0, 2.0, 3.0), target_m, size_px) };
            let frustum = stand.frustum();
            let middle = frustum.project(target_m).unwrap().place_px;
            assert!((middle - DVec2::new(320.0, 200.0)).length() < 1e-9, "{middle}");
            assert!(frustum.project(target_m + DVec3::Y * 0.1).unwrap().place_px.y < 200.0);
        }
    }

    #[test]
    fn its_table_says_what_it_is() {
        let size_px = UVec2::new(64, 48);
        let stand = Stand {
            convention: Convention::Vulkan,
            ..Stand::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1e-17, 0.5, 0.0), size_px)
        };
        let config = Config::parse(&stand.toml("left"), "test.toml", Path::new(".")).unwrap();
        let calibration = Calibration::from_config(&config.projectors[0]).unwrap();
        assert_eq!(&calibration, stand.frustum().calibration());
    }
}
