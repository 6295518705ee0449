//! A calibration file that a fuzzer has made up, and what must hold whatever that is.

use glam::{DVec2, UVec2};
use lantern_calibration::formats::from_bytes;
use lantern_calibration::{Calibration, Frustum};
use lantern_config::{Calibration as Configured, Config};
use std::path::Path;

/// The projector's.
const SIZE_PX: UVec2 = UVec2::new(64, 40);

/// Reads a file of a format; `keys` are the others of `[projector.calibration]`.
///
/// # Panics
/// Where one is taken whose rays are none, or one is refused without saying what to do.
pub fn read(format: &str, keys: &str, data: &[u8]) {
    let text = format!(
        "[[projector]]\nname = \"any\"\nresolution_px = [{}, {}]\n[projector.calibration]\nfile = \"any\"\n\
         format = \"{format}\"\n{keys}\n",
        SIZE_PX.x, SIZE_PX.y
    );
    let config = Config::parse(&text, "fuzz.toml", Path::new("/")).expect("the fuzzer's own configuration");
    let Configured::File(file) = &config.projectors[0].calibration else { panic!("a file was configured") };
    match from_bytes(data, file, SIZE_PX) {
        Ok(calibration) => look(calibration),
        Err(error) => assert!(error.to_string().contains("hint:"), "{error}"),
    }
}

/// The rays of a calibration that was taken are rays.
fn look(calibration: Calibration) {
    let frustum = Frustum::new(calibration);
    let size_px = SIZE_PX.as_dvec2();
    for share in [DVec2::ZERO, DVec2::new(0.5, 0.5), DVec2::new(0.99, 0.01), DVec2::ONE] {
        if let Some(ray) = frustum.ray(share * size_px) {
            assert!(ray.origin_m.is_finite(), "a ray from {}", ray.origin_m);
            assert!((ray.direction.length() - 1.0).abs() < 1e-6, "a ray along {}", ray.direction);
        }
    }
}
