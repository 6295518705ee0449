//! Layers as files: PNG for what eyes see, OpenEXR for numbers (CONTRACT, Layers of a snapshot).

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    WritableImage,
};
use lantern_render::{LayerImage, Texels};

/// A file in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// `png` or `exr`.
    pub format: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// Why a layer could not be written.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// PNG.
    #[error("cannot write a PNG: {0}")]
    Png(#[from] image::ImageError),
    /// OpenEXR.
    #[error("cannot write an EXR: {0}")]
    Exr(#[from] exr::error::Error),
}

/// Encodes a layer: 8-bit colour as PNG, floats as EXR (channels R, G, B, or Y).
///
/// # Errors
/// What the encoder says.
pub fn encode(layer: &LayerImage) -> Result<Encoded, EncodeError> {
    match &layer.texels {
        Texels::Rgb8(texels) => png(layer.width, layer.height, texels),
        Texels::Rgb(texels) => {
            let channel = |c: usize| texels.iter().map(|t| t[c]).collect();
            exr(layer, vec![("R", channel(0)), ("G", channel(1)), ("B", channel(2))])
        }
        Texels::Scalar(texels) => exr(layer, vec![("Y", texels.clone())]),
    }
}

/// Encodes linear colour as an eye sees it: 8-bit sRGB, values above 1 clipped, PNG.
///
/// # Errors
/// What the encoder says.
pub fn encode_seen(layer: &LayerImage) -> Result<Encoded, EncodeError> {
    png(layer.width, layer.height, &srgb8(layer))
}

/// A layer as 8-bit sRGB; scalars become grey.
pub fn srgb8(layer: &LayerImage) -> Vec<[u8; 3]> {
    match &layer.texels {
        Texels::Rgb8(texels) => texels.clone(),
        Texels::Rgb(texels) => texels.iter().map(|t| t.map(srgb8_from_linear)).collect(),
        Texels::Scalar(texels) => texels.iter().map(|t| [srgb8_from_linear(*t); 3]).collect(),
    }
}

/// IEC 61966-2-1.
fn srgb8_from_linear(c: f32) -> u8 {
    let c = c.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// An 8-bit sRGB picture as PNG.
///
/// # Errors
/// What the encoder says.
pub fn png(width: u32, height: u32, texels: &[[u8; 3]]) -> Result<Encoded, EncodeError> {
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    image::ImageEncoder::write_image(encoder, texels.as_flattened(), width, height, image::ExtendedColorType::Rgb8)?;
    Ok(Encoded { format: "png", bytes })
}

fn exr(layer: &LayerImage, channels: Vec<(&str, Vec<f32>)>) -> Result<Encoded, EncodeError> {
    let size = (layer.width as usize, layer.height as usize);
    let channels = channels.into_iter().map(|(name, data)| AnyChannel::new(name, FlatSamples::F32(data))).collect();
    let image = Image {
        attributes: ImageAttributes::new(IntegerBounds::from_dimensions(size)),
        layer_data: Layer::new(
            size,
            LayerAttributes::default(),
            Encoding::SMALL_FAST_LOSSLESS,
            AnyChannels::sort(channels),
        ),
    };
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes)?;
    Ok(Encoded { format: "exr", bytes: bytes.into_inner() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers};

    #[test]
    fn floats_come_back_exactly() {
        let values = vec![0.0, 1.5, f32::INFINITY, -1.0, 1e-20, 3.25];
        let layer = LayerImage { width: 3, height: 2, texels: Texels::Scalar(values.clone()) };
        let file = encode(&layer).unwrap();
        assert_eq!(file.format, "exr");
        let read = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes();
        let image = read.from_buffered(Cursor::new(file.bytes)).unwrap();
        let channel = &image.layer_data.channel_data.list[0];
        assert_eq!(channel.name.to_string(), "Y");
        assert_eq!(channel.sample_data.values_as_f32().collect::<Vec<_>>(), values);
    }

    #[test]
    fn srgb_is_encoded() {
        // Linear 0.2158605 is 8-bit sRGB 128.
        let layer = LayerImage { width: 1, height: 1, texels: Texels::Rgb(vec![[0.215_860_5, 2.0, -1.0]]) };
        assert_eq!(srgb8(&layer), [[128, 255, 0]]);
    }
}
