//! What a miss sees: one colour, or an equirectangular panorama with its mip chain and its irradiance.
//!
//! Direction d is at u = ½ + atan2(d.x, −d.z)/2π, v = acos(d.y)/π, row 0 on top (CONTRACT, "Config").

use std::io::Cursor;
use std::path::Path;

use glam::DVec3;
use image::{ImageFormat, ImageReader};

use crate::irradiance::irradiance;
use crate::limits::Limits;
use crate::pack::GpuEnvironment;

/// The largest panorama that is taken, texels: 8192 × 4096, half a gigabyte on the device.
pub const MAX_TEXELS: usize = 1 << 25;

/// Radiance above this is held to it: brighter than the sun's disc on this scale, and no square of it leaves f32.
const MAX_RADIANCE: f32 = 1e9;

/// A panorama that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EnvironmentError {
    /// Neither of the formats that the contract names.
    #[error("{file}: is none of .hdr, .exr and .png; hint: convert it, Radiance .hdr is the most common")]
    Format {
        /// As given.
        file: String,
    },
    /// Broken, or not what its name says.
    #[error("{file}: cannot be decoded as a panorama: {source}; hint: open it in an image viewer, or fetch it again")]
    Decode {
        /// As given.
        file: String,
        /// What the decoder says.
        source: image::ImageError,
    },
    /// Beyond the limits.
    #[error(
        "{file}: {width} × {height} texels are above the limit of {limit}; hint: scale it down, 4096 × 2048 is plenty"
    )]
    TooLarge {
        /// As given.
        file: String,
        /// Texels a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Texels.
        limit: usize,
    },
}

/// The same linear colour everywhere.
pub fn constant(color: [f64; 3]) -> GpuEnvironment {
    let [r, g, b] = color.map(|c| c as f32);
    from_texels(1, 1, vec![[r, g, b, 0.0]])
}

/// A panorama from level 0: linear RGB, `width` × `height`, row 0 on top.
pub fn from_texels(width: u32, height: u32, mut texels: Vec<[f32; 4]>) -> GpuEnvironment {
    for texel in &mut texels {
        *texel = texel.map(|c| if c.is_nan() { 0.0 } else { c.clamp(0.0, MAX_RADIANCE) });
        texel[3] = 0.0;
    }
    let irradiance = irradiance(width as usize, height as usize, &texels);
    append_mips(width as usize, height as usize, &mut texels);
    GpuEnvironment { width, height, texels, irradiance }
}

/// Each level out of the one before by a 2 × 2 box, down to 1 × 1. Of an odd side the last row or column has no part in
/// the next level.
fn append_mips(mut width: usize, mut height: usize, texels: &mut Vec<[f32; 4]>) {
    let mut level = 0;
    while width > 1 || height > 1 {
        let (half_width, half_height) = ((width / 2).max(1), (height / 2).max(1));
        let next = texels.len();
        for y in 0..half_height {
            for x in 0..half_width {
                let mut sum = [0f32; 4];
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = ((2 * x + dx).min(width - 1), (2 * y + dy).min(height - 1));
                    let texel = texels[level + y * width + x];
                    sum = std::array::from_fn(|c| sum[c] + 0.25 * texel[c]);
                }
                texels.push(sum);
            }
        }
        (level, width, height) = (next, half_width, half_height);
    }
}

/// Decodes a panorama: .hdr and .exr are linear, .png is sRGB. `file` is for messages and, where the content does not
/// tell, for the format.
///
/// # Errors
/// Names the file, the cause and the remedy; nothing is decoded before its size was found within the limits.
pub fn decode(bytes: &[u8], file: &Path, limits: &Limits) -> Result<GpuEnvironment, EnvironmentError> {
    let name = file.display().to_string();
    let guess = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let format = guess.ok().and_then(|reader| reader.format()).or_else(|| ImageFormat::from_path(file).ok());
    let Some(format @ (ImageFormat::Hdr | ImageFormat::OpenExr | ImageFormat::Png)) = format else {
        return Err(EnvironmentError::Format { file: name });
    };
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let decode_error = |source| EnvironmentError::Decode { file: name.clone(), source };

    // The header says how large the picture is; only then is it read.
    let (width, height) = reader().into_dimensions().map_err(decode_error)?;
    let limit = limits.max_texels.min(MAX_TEXELS);
    if width as usize * height as usize > limit {
        return Err(EnvironmentError::TooLarge { file: name, width, height, limit });
    }
    if width == 0 || height == 0 {
        return Err(EnvironmentError::Format { file: name });
    }
    let mut reader = reader();
    let mut memory = image::Limits::default();
    memory.max_alloc = Some(limit as u64 * 32);
    reader.limits(memory);
    let picture = reader.decode().map_err(decode_error)?.into_rgb32f();
    let srgb = format == ImageFormat::Png;
    let texels = picture.pixels().map(|pixel| {
        let [r, g, b] = pixel.0.map(|c| if srgb { linear_from_srgb(c) } else { c });
        [r, g, b, 0.0]
    });
    Ok(from_texels(width, height, texels.collect()))
}

/// IEC 61966-2-1.
pub(crate) fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The unit direction that a panorama shows at (u, v).
pub fn direction_at(u: f64, v: f64) -> DVec3 {
    let (sin_phi, cos_phi) = ((u - 0.5) * std::f64::consts::TAU).sin_cos();
    let (sin_theta, cos_theta) = (v * std::f64::consts::PI).sin_cos();
    DVec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn the_middle_looks_along_minus_z_and_the_mapping_inverts() {
        assert!((direction_at(0.5, 0.5) - DVec3::NEG_Z).length() < 1e-12);
        assert!((direction_at(0.75, 0.5) - DVec3::X).length() < 1e-12);
        assert!((direction_at(0.3, 0.0) - DVec3::Y).length() < 1e-12);
        let d = direction_at(0.2, 0.7);
        assert!((0.5 + d.x.atan2(-d.z) / TAU - 0.2).abs() < 1e-12 && (d.y.acos() / PI - 0.7).abs() < 1e-12);
    }

    #[test]
    fn mips_halve_both_sides_down_to_one_texel_and_keep_the_mean() {
        let texels = (0..8 * 4).map(|i| [i as f32, 0.0, 0.0, 0.0]).collect();
        let environment = from_texels(8, 4, texels);
        assert_eq!(environment.texels.len(), 32 + 8 + 2 + 1);
        assert_eq!(environment.texels.last().unwrap()[0], 15.5);
    }

    #[test]
    fn broken_texels_turn_black_and_blinding_ones_are_held() {
        let environment = from_texels(2, 1, vec![[f32::NAN, -1.0, f32::INFINITY, 7.0], [0.0; 4]]);
        assert_eq!(environment.texels[0], [0.0, 0.0, MAX_RADIANCE, 0.0]);
    }

    #[test]
    fn a_png_is_srgb_and_a_hostile_size_is_refused_before_it_is_read() {
        let mut bytes = vec![];
        let grey = image::RgbImage::from_pixel(4, 2, image::Rgb([128; 3]));
        grey.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
        let path = Path::new("grey.png");
        let environment = decode(&bytes, path, &Limits::default()).unwrap();
        assert!((environment.texels[0][0] - 0.215_86).abs() < 1e-4);

        let tight = Limits { max_texels: 7, ..Limits::default() };
        assert!(matches!(decode(&bytes, path, &tight), Err(EnvironmentError::TooLarge { .. })));
        let cut = &bytes[..bytes.len() / 2];
        let message = decode(cut, path, &Limits::default()).unwrap_err().to_string();
        assert!(message.starts_with("grey.png: ") && message.contains("hint: "), "{message}");
        assert!(matches!(decode(b"GIF89a", Path::new("a.gif"), &tight), Err(EnvironmentError::Format { .. })));
    }
}
