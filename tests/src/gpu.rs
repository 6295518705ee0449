//! The renderer, used as a library on a device that the validation layer watches.
#![expect(clippy::expect_used, reason = "a test without its device, its frame or its layer has failed")]

use std::{
    path::Path,
    process::Command,
    sync::{Arc, OnceLock},
};

use glam::DVec3;
use lantern_calibration::{Calibration, Frustum};
use lantern_gpu::{Binding, Device, Instance, Shader, Stage, Validation};
use lantern_render::{FrameReport, Layer, LayerImage, ProjectorSpec, Renderer, Settings, Texels, Walk};
use lantern_scene::Scene;

use crate::image::FloatImage;

fn opened() -> &'static (Arc<Instance>, Arc<Device>) {
    static OPENED: OnceLock<(Arc<Instance>, Arc<Device>)> = OnceLock::new();
    OPENED.get_or_init(|| {
        let instance = Instance::new(Validation::On).expect("tests need a Vulkan driver and the validation layer");
        let device = Device::open(&instance, None, 2, None).expect("a device that can serve");
        (instance, device)
    })
}

/// The device that all tests of a program share.
pub fn device() -> &'static Arc<Device> {
    &opened().1
}

/// How each test of the device ends.
///
/// # Panics
/// Where the validation layer has had anything to say since the program began.
pub fn assert_validation_is_silent() {
    assert_eq!(opened().0.validation_messages(), Vec::<String>::new());
}

/// One sample a pixel, which is its centre, and no blending: what most comparisons want.
pub const ONE_SAMPLE: Settings = Settings {
    samples: 1,
    max_depth: 8,
    raster: lantern_render::RasterOrder::After,
    blend: false,
    count_rays: false,
    record_rays: false,
    shade_once: true,
    always_full: false,
    eye_at_projector: false,
    walk: Walk::BY_DEVICE,
};

/// A renderer, and what its projectors see with.
pub struct Rig {
    /// What is tested.
    pub renderer: Renderer,
    /// By projector.
    pub frusta: Vec<Frustum>,
}

impl Rig {
    /// A renderer of a scene for named projectors.
    ///
    /// # Panics
    /// Where the renderer refuses.
    pub fn new(scene: &Arc<Scene>, projectors: &[(&str, Calibration)], settings: Settings) -> Self {
        Self::on(device(), scene, projectors, settings)
    }

    /// As [`Rig::new`], on a device of one's own.
    ///
    /// # Panics
    /// Where the renderer refuses.
    pub fn on(
        device: &Arc<Device>,
        scene: &Arc<Scene>,
        projectors: &[(&str, Calibration)],
        settings: Settings,
    ) -> Self {
        let spec = |(name, calibration): &(&str, Calibration)| ProjectorSpec {
            name: (*name).to_owned(),
            calibration: calibration.clone(),
        };
        let specs = projectors.iter().map(spec).collect();
        let renderer = Renderer::new(device, specs, settings, scene.clone()).expect("a renderer");
        Self { renderer, frusta: projectors.iter().map(|(_, calibration)| Frustum::new(calibration.clone())).collect() }
    }

    /// As [`Rig::new`], and its first frame shown.
    pub fn shown(
        scene: &Arc<Scene>,
        projectors: &[(&str, Calibration)],
        settings: Settings,
        viewers_m: &[DVec3],
    ) -> Self {
        let mut rig = Self::new(scene, projectors, settings);
        rig.show(viewers_m);
        rig
    }

    /// Renders a frame; `None` where nothing was stale.
    ///
    /// # Panics
    /// Where the renderer fails.
    pub fn show(&mut self, viewers_m: &[DVec3]) -> Option<FrameReport> {
        self.renderer.render(|| viewers_m.to_vec()).expect("a frame")
    }

    /// A layer of a projector's last frame; `Color` in linear light.
    ///
    /// # Panics
    /// Where it cannot be read.
    pub fn layer(&self, projector: usize, layer: Layer) -> FloatImage {
        float_image(&self.renderer.read(projector, layer).expect("a layer"))
    }

    /// The bytes of a projector's `color` layer.
    ///
    /// # Panics
    /// Where it cannot be read.
    pub fn color(&self, projector: usize) -> Vec<[u8; 3]> {
        match self.renderer.read(projector, Layer::Color).expect("a layer").texels {
            Texels::Rgb8(texels) => texels,
            Texels::Rgb(_) | Texels::Scalar(_) => Vec::new(),
        }
    }
}

/// A layer's numbers; 8-bit sRGB becomes linear.
///
/// # Panics
/// Where a picture's sides and bytes do not fit, which is the renderer's fault.
pub fn float_image(layer: &LayerImage) -> FloatImage {
    let (width, height) = (layer.width as usize, layer.height as usize);
    let of = |channels, values| FloatImage { width, height, channels, values };
    match &layer.texels {
        Texels::Rgb8(texels) => {
            let picture = image::RgbImage::from_raw(layer.width, layer.height, texels.concat());
            FloatImage::from_srgb(&picture.expect("three bytes a pixel"))
        }
        Texels::Rgb(texels) => of(3, texels.concat()),
        Texels::Scalar(texels) => of(1, texels.clone()),
    }
}

/// Compiles a shader out of `tests/shaders`. Its table is written by hand, where the daemon's build script reflects it.
///
/// # Panics
/// Where it does not compile, or there is no compiler.
pub fn shader(file: &'static str, bindings: &'static [Binding], push_bytes: u32) -> &'static Shader {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders").join(file);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let target = folder.path().join("shader.spv");
    let output = Command::new("glslangValidator")
        .args(["-V", "--target-env", "vulkan1.2", "-o"])
        .args([&target, &source])
        .output()
        .expect("the tests need glslangValidator; hint: apt install glslang-tools");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    let bytes = std::fs::read(&target).expect("the compiler's output");
    let spirv: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
    let stage = match file.rsplit('.').next() {
        Some("vert") => Stage::Vertex,
        Some("frag") => Stage::Fragment,
        _ => Stage::Compute,
    };
    // Shaders are static in the program; a test leaks the few that it makes.
    Box::leak(Box::new(Shader { name: file, stage, spirv: spirv.leak(), bindings, push_bytes, local_size: [1; 3] }))
}
