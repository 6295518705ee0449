//! How to render, and for whom: what the configuration decides.

use lantern_calibration::Calibration;

use crate::loads::Loads;

/// A projector as the configuration has it.
#[derive(Clone, Debug, PartialEq)]
pub struct ProjectorSpec {
    /// Its name; also the seed of its jitter.
    pub name: String,
    /// Its matrix, depth convention and resolution.
    pub calibration: Calibration,
}

/// When raster nodes are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RasterOrder {
    /// Before the traced image.
    Before,
    /// After it.
    #[default]
    After,
}

/// How to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Samples a pixel: 1, 4, 9, 16, … 256.
    pub samples: u32,
    /// Secondary rays deep.
    pub max_depth: u32,
    /// When raster nodes are drawn.
    pub raster: RasterOrder,
    /// Whether projectors share the light of what several of them reach.
    pub blend: bool,
    /// Whether one sample may stand for all of a pixel whose samples land on the same thing, until a neighbour differs too much.
    pub shade_once: bool,
    /// Count rays by kind.
    pub count_rays: bool,
    /// Write rays down, as [`Renderer::record`](crate::Renderer::record) asks; takes up to 128 MiB a projector.
    pub record_rays: bool,
    /// Make every frame wholly anew, as if nothing of the last one were kept. For the test that shows the keeping to be right.
    pub always_full: bool,
    /// The naive method: reflect each projector's own ray. For the test that shows it to be wrong.
    pub eye_at_projector: bool,
    /// How rays are walked.
    pub walk: Walk,
}

/// How rays are walked, and what they read the scene through. The picture is the same to the bit, so this is for the tests that show it
/// and for measurements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Walk {
    /// Whether primary rays are traced as beams of four, of a pixel's samples or of neighbouring pixels; `None`: as suits the device.
    pub beams: Option<bool>,
    /// How shaders read the scene, and no other way, with which ray queries do not go; `None`: as suits device and scene.
    pub loads: Option<Loads>,
    /// Texel buffers are taken to hold no more elements than this, where the device says more.
    pub texel_elements: Option<u64>,
    /// A buffer of hits is taken to hold no more bytes than this, where the device says more; then fewer samples of a pixel lie together.
    pub hits_bytes: Option<u64>,
}

impl Walk {
    /// As suits the device.
    pub const BY_DEVICE: Self = Self { beams: None, loads: None, texel_elements: None, hits_bytes: None };
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 4,
            max_depth: 8,
            raster: RasterOrder::After,
            blend: true,
            shade_once: true,
            count_rays: false,
            record_rays: false,
            always_full: false,
            eye_at_projector: false,
            walk: Walk::BY_DEVICE,
        }
    }
}

impl Settings {
    /// Whether any pixel may be shaded once: not where it has one sample anyway.
    pub(crate) fn shades_once(&self) -> bool {
        self.shade_once && self.samples > 1
    }
}
