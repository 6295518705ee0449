//! Textures of an asset: decoded images, and how each is read.

use std::sync::Arc;

use crate::pack::{GpuTexture, GpuTextures};

/// Wrapping of one axis, as [`GpuTexture::flags`] numbers it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat = 0,
    /// Tiles, every other one mirrored.
    Mirror = 1,
    /// Goes on with the border's texel.
    Clamp = 2,
}

/// A decoded image, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA8, row by row.
    pub texels: Vec<[u8; 4]>,
}

/// One way of reading an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Shared where several textures read it.
    pub image: Arc<Image>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// True: RGB is sRGB and must be decoded; false: it is linear.
    pub srgb: bool,
    /// True: the nearest texel; false: four of them, interpolated.
    pub nearest: bool,
}

impl Texture {
    fn flags(&self) -> u32 {
        let [s, t] = self.wrap.map(|wrap| wrap as u32);
        s | t << 2 | u32::from(self.srgb) << 4 | u32::from(self.nearest) << 5
    }
}

/// Concatenates textures; an image that several of them read is stored once.
pub(crate) fn pack<'a>(textures: impl Iterator<Item = &'a Texture>) -> GpuTextures {
    let mut packed = GpuTextures::default();
    let mut stored: Vec<(*const Image, u32)> = vec![];
    for texture in textures {
        let image = &texture.image;
        let known = stored.iter().find(|(stored, _)| *stored == Arc::as_ptr(image)).map(|&(_, first)| first);
        let first_texel = known.unwrap_or_else(|| {
            let first = packed.texels.len() as u32;
            packed.texels.extend_from_slice(&image.texels);
            stored.push((Arc::as_ptr(image), first));
            first
        });
        packed.headers.push(GpuTexture {
            first_texel,
            width: image.width,
            height: image.height,
            flags: texture.flags(),
        });
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shared_image_is_stored_once_and_flags_hold_their_bits() {
        let image = Arc::new(Image { width: 2, height: 1, texels: vec![[1, 2, 3, 4]; 2] });
        let textures = [
            Texture { image: image.clone(), wrap: [Wrap::Repeat, Wrap::Clamp], srgb: true, nearest: false },
            Texture { image, wrap: [Wrap::Mirror, Wrap::Repeat], srgb: false, nearest: true },
        ];
        let packed = pack(textures.iter());
        assert_eq!(packed.texels.len(), 2);
        assert_eq!(packed.headers.iter().map(|h| h.first_texel).collect::<Vec<_>>(), [0, 0]);
        assert_eq!(packed.headers.iter().map(|h| h.flags).collect::<Vec<_>>(), [0b01_10_00, 0b10_00_01]);
    }
}
