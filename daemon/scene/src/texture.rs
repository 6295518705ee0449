//! Textures of an asset: decoded images, and how each is read.

use std::sync::Arc;

use crate::pack::GpuTexture;

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

/// All textures, and the images that they read.
#[derive(Clone, Debug, Default)]
pub struct GpuTextures {
    /// One header a texture.
    pub headers: Vec<GpuTexture>,
    /// For each texture, the number of its image.
    pub image_of: Vec<usize>,
    /// Each image once, however many textures read it.
    pub images: Vec<Arc<Image>>,
}

impl GpuTextures {
    /// Whether these are the same readings of the same images.
    pub(crate) fn same_as(&self, other: &Self) -> bool {
        let images = |of: &Self| of.images.iter().map(Arc::as_ptr).collect::<Vec<_>>();
        self.headers == other.headers && self.image_of == other.image_of && images(self) == images(other)
    }
}

/// Lists textures; an image that several of them read is there once.
pub(crate) fn pack<'a>(textures: impl Iterator<Item = &'a Texture>) -> GpuTextures {
    let mut packed = GpuTextures::default();
    for texture in textures {
        let image = &texture.image;
        let known = packed.images.iter().position(|known| Arc::ptr_eq(known, image));
        packed.image_of.push(known.unwrap_or(packed.images.len()));
        if known.is_none() {
            packed.images.push(image.clone());
        }
        packed.headers.push(GpuTexture {
            first_texel: 0,
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
        assert_eq!((packed.images.len(), packed.image_of.as_slice()), (1, [0, 0].as_slice()));
        assert_eq!(packed.headers.iter().map(|h| h.flags).collect::<Vec<_>>(), [0b01_10_00, 0b10_00_01]);
    }
}
