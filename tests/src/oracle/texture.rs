//! glTF textures: wrap modes, sRGB, bilinear filtering in linear light.

use glam::{DVec2, DVec4};
use lantern_scene::GpuTextures;

/// IEC 61966-2-1, decoding.
pub fn srgb_to_linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// IEC 61966-2-1, encoding.
pub fn linear_to_srgb(c: f64) -> f64 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

fn wrap(i: i64, size: i64, mode: u32) -> i64 {
    match mode {
        // Mirrored repeat.
        1 => {
            let within = i.rem_euclid(2 * size);
            within.min(2 * size - 1 - within)
        }
        2 => i.clamp(0, size - 1),
        _ => i.rem_euclid(size),
    }
}

fn texel(textures: &GpuTextures, index: usize, x: i64, y: i64) -> DVec4 {
    let header = &textures.headers[index];
    let x = wrap(x, i64::from(header.width), header.flags & 3);
    let y = wrap(y, i64::from(header.height), header.flags >> 2 & 3);
    let image = &textures.images[textures.image_of[index]];
    let at = y * i64::from(header.width) + x;
    let [r, g, b, a] = image.texels[at as usize].map(|byte| f64::from(byte) / 255.0);
    if header.flags & 16 != 0 {
        DVec4::new(srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a)
    } else {
        DVec4::new(r, g, b, a)
    }
}

/// A texture's value; (0, 0) is the top left corner of the top left texel.
pub fn texture_at(textures: &GpuTextures, index: u32, uv: DVec2) -> DVec4 {
    let index = index as usize;
    let header = &textures.headers[index];
    let at = uv * DVec2::new(f64::from(header.width), f64::from(header.height));
    if header.flags & 32 != 0 {
        return texel(textures, index, at.x.floor() as i64, at.y.floor() as i64);
    }
    let corner = (at - 0.5).floor();
    let f = at - 0.5 - corner;
    let (x, y) = (corner.x as i64, corner.y as i64);
    let top = texel(textures, index, x, y).lerp(texel(textures, index, x + 1, y), f.x);
    let bottom = texel(textures, index, x, y + 1).lerp(texel(textures, index, x + 1, y + 1), f.x);
    top.lerp(bottom, f.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_scene::{Image, pack::GpuTexture};

    #[test]
    fn wrapping_goes_around_back_and_stops() {
        assert_eq!([-1, 0, 3, 4, 9].map(|i| wrap(i, 4, 0)), [3, 0, 3, 0, 1]);
        assert_eq!([-1, 0, 3, 4, 8, 9].map(|i| wrap(i, 4, 1)), [0, 0, 3, 3, 0, 1]);
        assert_eq!([-1, 0, 3, 4].map(|i| wrap(i, 4, 2)), [0, 0, 3, 3]);
    }

    #[test]
    fn filtering_is_in_linear_light() {
        let header = GpuTexture { first_texel: 0, width: 2, height: 1, flags: 2 | 2 << 2 | 16 };
        let image = Image { width: 2, height: 1, texels: vec![[0, 0, 0, 255], [255, 255, 255, 255]] };
        let textures = GpuTextures { headers: vec![header], image_of: vec![0], images: vec![image.into()] };
        let middle = texture_at(&textures, 0, DVec2::new(0.5, 0.5));
        assert!((middle.x - 0.5).abs() < 1e-12, "{middle}");
        assert_eq!(texture_at(&textures, 0, DVec2::new(-3.0, 0.5)).x, 0.0);
        assert!((srgb_to_linear(linear_to_srgb(0.2)) - 0.2).abs() < 1e-6);
    }
}
