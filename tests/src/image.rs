//! Pictures of floats, read from what the daemon writes, and how far two of them are apart.

use std::io::Cursor;

use anyhow::{Context, Result, bail, ensure};
use exr::prelude::{ReadChannels, ReadLayers, read};
use image::RgbImage;
use lantern_proto::Layer;

use crate::oracle::{self, texture::srgb_to_linear};

/// Rows of pixels, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct FloatImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1, or 3 for red, green, blue.
    pub channels: usize,
    /// `channels` a pixel, row by row.
    pub values: Vec<f32>,
}

impl FloatImage {
    /// Reads an EXR of one channel, or of R, G and B.
    ///
    /// # Errors
    /// Where it is something else.
    pub fn from_exr(bytes: &[u8]) -> Result<Self> {
        let file = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .context("reading an EXR")?;
        let layer = file.layer_data;
        let (width, height) = (layer.size.width(), layer.size.height());

        // The file has its channels in the order of their names.
        let named = |name: &str| layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
        let planes: Vec<_> = match (layer.channel_data.list.as_slice(), named("R"), named("G"), named("B")) {
            (_, Some(r), Some(g), Some(b)) => vec![r, g, b],
            ([only], ..) => vec![only],
            (list, ..) => bail!("{} channels, and not R, G and B", list.len()),
        };
        let planes: Vec<Vec<f32>> = planes.iter().map(|plane| plane.sample_data.values_as_f32().collect()).collect();
        let values = (0..width * height).flat_map(|at| planes.iter().map(move |plane| plane[at])).collect();
        Ok(Self { width, height, channels: planes.len(), values })
    }

    /// An 8-bit sRGB picture in linear light.
    pub fn from_srgb(picture: &RgbImage) -> Self {
        let values = picture.as_raw().iter().map(|&byte| srgb_to_linear(f64::from(byte) / 255.0) as f32).collect();
        Self { width: picture.width() as usize, height: picture.height() as usize, channels: 3, values }
    }

    /// A layer of the oracle's picture.
    ///
    /// # Errors
    /// For the layers that it has not.
    pub fn from_oracle(picture: &oracle::Picture, layer: Layer) -> Result<Self> {
        let pixels = picture.pixels.iter();
        let (channels, values) = match layer {
            Layer::Radiance => (3, pixels.flat_map(|pixel| pixel.radiance.as_vec3().to_array()).collect()),
            Layer::Distance => (1, pixels.map(|pixel| pixel.distance_m as f32).collect()),
            Layer::Depth => (1, pixels.map(|pixel| pixel.depth as f32).collect()),
            Layer::Node => (1, pixels.map(|pixel| pixel.node as f32).collect()),
            Layer::Color | Layer::Weight | Layer::Room => bail!("the oracle has no layer {}", layer.as_str()),
        };
        let [width, height] = picture.size_px.to_array().map(|side| side as usize);
        Ok(Self { width, height, channels, values })
    }

    /// The channels of a pixel.
    pub fn at(&self, x: usize, y: usize) -> &[f32] {
        let at = (y * self.width + x) * self.channels;
        &self.values[at..at + self.channels]
    }

    /// Every `step`-th pixel of both directions, as [`oracle::render`] leaves them out.
    #[must_use]
    pub fn every(&self, step: usize) -> Self {
        let rows = (0..self.height).step_by(step);
        let values =
            rows.flat_map(|y| (0..self.width).step_by(step).flat_map(move |x| self.at(x, y))).copied().collect();
        Self { width: self.width.div_ceil(step), height: self.height.div_ceil(step), values, ..*self }
    }

    fn ensure_like(&self, other: &Self) -> Result<()> {
        let shape = |image: &Self| (image.width, image.height, image.channels);
        ensure!(shape(self) == shape(other), "{:?} beside {:?}", shape(self), shape(other));
        Ok(())
    }

    /// Whether each pixel stands within `radius` pixels of one with another value: of a node layer, its silhouettes. Its
    /// length is that of the pixels.
    pub fn silhouettes(&self, radius: usize) -> Vec<bool> {
        self.near(radius, |a, b| a != b)
    }

    /// Whether each pixel stands within `radius` pixels of one whose first channel differs by more than this share, or of
    /// the border of what is finite: of a distance layer, its edges.
    pub fn jumps(&self, radius: usize, share: f32) -> Vec<bool> {
        self.near(radius, |a, b| a[0].is_finite() != b[0].is_finite() || (a[0] - b[0]).abs() > share * a[0].abs())
    }

    fn near(&self, radius: usize, differ: impl Fn(&[f32], &[f32]) -> bool) -> Vec<bool> {
        let around = |at: usize, size: usize| at.saturating_sub(radius)..(at + radius + 1).min(size);
        (0..self.width * self.height)
            .map(|at| {
                let (x, y) = (at % self.width, at / self.width);
                let mut beside = around(y, self.height).flat_map(|y| around(x, self.width).map(move |x| (x, y)));
                beside.any(|(bx, by)| differ(self.at(x, y), self.at(bx, by)))
            })
            .collect()
    }
}

/// The mean over all values of |a − b|.
///
/// # Errors
/// Where the two are not of one shape.
pub fn mean_absolute_error(a: &FloatImage, b: &FloatImage) -> Result<f64> {
    a.ensure_like(b)?;
    let sum: f64 = a.values.iter().zip(&b.values).map(|(a, b)| f64::from((a - b).abs())).sum();
    Ok(sum / a.values.len() as f64)
}

/// The share of pixels of which any channel differs at all.
///
/// # Errors
/// Where the two are not of one shape.
pub fn share_differing(a: &FloatImage, b: &FloatImage) -> Result<f64> {
    a.ensure_like(b)?;
    let differing = a.values.chunks(a.channels).zip(b.values.chunks(b.channels)).filter(|(a, b)| a != b).count();
    Ok(differing as f64 / (a.width * a.height) as f64)
}

/// Relative errors |found − expected| / |expected|, ascending, where both are finite and `counts` is true of the pixel.
///
/// # Errors
/// Where the two are not of one shape.
pub fn relative_errors(found: &FloatImage, expected: &FloatImage, counts: impl Fn(usize) -> bool) -> Result<Vec<f64>> {
    found.ensure_like(expected)?;
    let mut errors: Vec<f64> = found
        .values
        .iter()
        .zip(&expected.values)
        .enumerate()
        .filter(|(at, (a, b))| a.is_finite() && b.is_finite() && **b != 0.0 && counts(at / found.channels))
        .map(|(_, (a, b))| (f64::from(*a) - f64::from(*b)).abs() / f64::from(b.abs()))
        .collect();
    errors.sort_by(f64::total_cmp);
    Ok(errors)
}

/// The value below which a share of an ascending list lies; NaN for an empty list, which fails every comparison.
pub fn percentile(ascending: &[f64], share: f64) -> f64 {
    let at = (share * ascending.len() as f64) as usize;
    ascending.get(at.min(ascending.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::*;

    fn single(width: usize, values: &[f32]) -> FloatImage {
        FloatImage { width, height: values.len() / width, channels: 1, values: values.to_vec() }
    }

    #[test]
    fn exr_comes_back_in_its_order() {
        let mut file = Cursor::new(Vec::new());
        let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, f32::INFINITY));
        Image::from_channels((3, 2), channels).write().to_buffered(&mut file).unwrap();
        let read = FloatImage::from_exr(file.get_ref()).unwrap();
        assert_eq!((read.width, read.height, read.channels), (3, 2, 3));
        assert_eq!(read.at(2, 1), [2.0, 1.0, f32::INFINITY]);
        assert_eq!(read.every(2).values.len(), 2 * 3);
        assert!(FloatImage::from_exr(b"no EXR").is_err());
    }

    #[test]
    fn measures_measure() {
        let a = single(2, &[1.0, 2.0, 3.0, f32::INFINITY]);
        let b = single(2, &[1.0, 2.5, 3.0, f32::INFINITY]);
        assert_eq!(share_differing(&a, &b).unwrap(), 0.25);
        assert_eq!(relative_errors(&a, &b, |_| true).unwrap(), [0.0, 0.0, 0.2]);
        assert_eq!(relative_errors(&a, &b, |at| at != 1).unwrap(), [0.0, 0.0]);
        assert!(mean_absolute_error(&a, &single(4, &[0.0; 4])).is_err());
        assert_eq!(mean_absolute_error(&single(2, &[0.0, 1.0]), &single(2, &[1.0, 1.0])).unwrap(), 0.5);
        assert_eq!(percentile(&[1.0, 2.0, 3.0, 4.0], 0.5), 3.0);
        assert_eq!(percentile(&[1.0, 2.0], 1.0), 2.0);
        assert!(percentile(&[], 0.5).is_nan());
    }

    #[test]
    fn silhouettes_are_around_where_nodes_change() {
        let nodes = single(5, &[0.0, 0.0, 0.0, 1.0, 1.0]);
        assert_eq!(nodes.silhouettes(1), [false, false, true, true, false]);
        let distance = single(4, &[1.0, 1.001, f32::INFINITY, f32::INFINITY]);
        assert_eq!(distance.jumps(1, 0.01), [false, true, true, false]);
    }
}
