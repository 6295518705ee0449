//! Images: found, measured, and only then decoded.

use std::io::Cursor;
use std::sync::Arc;

use gltf::json::texture::{MagFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked;
use image::{ImageFormat, ImageReader};

use super::accessor::Reader;
use super::error::{Located, Problem, bad, here, item};
use super::source::Sources;
use crate::limits::Limits;
use crate::texture::{Image, Texture, Wrap};

/// Decodes a document's images, each once and only when a texture asks for it.
pub(super) struct Images<'a, 'b> {
    reader: &'a Reader<'a>,
    sources: &'a mut Sources<'b>,
    decoded: Vec<Option<Arc<Image>>>,
    /// Texels that may still be decoded.
    left: u64,
    limit: u64,
}

impl<'a, 'b> Images<'a, 'b> {
    pub(super) fn new(reader: &'a Reader<'a>, sources: &'a mut Sources<'b>, limits: &Limits) -> Self {
        let limit = limits.max_texels as u64;
        Self { reader, sources, decoded: vec![None; reader.root.images.len()], left: limit, limit }
    }

    /// A texture: its image, and how it is read.
    pub(super) fn texture(&mut self, index: usize, srgb: bool, object: &str) -> Result<Texture, Located> {
        let root = self.reader.root;
        let texture = item(&root.textures, "texture", index, object)?;
        let object = format!("texture {index}");
        // The crate's mark for a texture without a source.
        if texture.source.value() == u32::MAX as usize {
            return Err(bad(object, "names no image"));
        }
        item(&root.images, "image", texture.source.value(), &object)?;
        let default = Sampler::default();
        let sampler = match texture.sampler {
            Some(sampler) => item(&root.samplers, "sampler", sampler.value(), &object)?,
            None => &default,
        };
        let wrap = |mode: &Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
            Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
            Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
            Checked::Invalid => Err(bad(&object, "has a sampler that wraps in a way glTF does not know")),
        };
        Ok(Texture {
            wrap: [wrap(&sampler.wrap_s)?, wrap(&sampler.wrap_t)?],
            srgb,
            nearest: matches!(sampler.mag_filter, Some(Checked::Valid(MagFilter::Nearest))),
            image: self.image(texture.source.value())?,
        })
    }

    fn image(&mut self, index: usize) -> Result<Arc<Image>, Located> {
        if let Some(image) = &self.decoded[index] {
            return Ok(image.clone());
        }
        let object = format!("image {index}");
        let json = &self.reader.root.images[index];
        let image = match (&json.uri, json.buffer_view) {
            (Some(uri), _) => {
                let bytes = self.sources.read(uri, &object)?;
                self.decode(&bytes, object)?
            }
            (None, Some(view)) => {
                let (bytes, _) = self.reader.view(view, &object)?;
                self.decode(bytes, object)?
            }
            (None, None) => return Err(bad(object, "has neither a uri nor a buffer view")),
        };
        let image = Arc::new(image);
        self.decoded[index] = Some(image.clone());
        Ok(image)
    }

    fn decode(&mut self, bytes: &[u8], object: String) -> Result<Image, Located> {
        let guessed = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let format = guessed.ok().and_then(|reader| reader.format());
        let Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) = format else {
            return Err(bad(object, "is neither PNG nor JPEG"));
        };
        let reader = || ImageReader::with_format(Cursor::new(bytes), format);
        let failed = |error| here(&object, Problem::Image(error));

        // The header says how large it is; what that takes is bounded before anything is decoded.
        let (width, height) = reader().into_dimensions().map_err(failed)?;
        let texels = u64::from(width) * u64::from(height);
        if texels > self.left {
            let count = self.limit - self.left + texels;
            let (what, key) = ("texels so far", "what limits.max_texels leaves");
            return Err(here(object, Problem::TooMany { what, count, limit: self.limit, key }));
        }
        if texels == 0 {
            return Err(bad(object, "has no texels"));
        }
        let mut memory = image::Limits::default();
        memory.max_alloc = Some(texels * 32 + (1 << 20));
        let mut reader = reader();
        reader.limits(memory);
        let rgba = reader.decode().map_err(failed)?.into_rgba8();
        self.left -= texels;
        Ok(Image { width, height, texels: rgba.pixels().map(|pixel| pixel.0).collect() })
    }
}
