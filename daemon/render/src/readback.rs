//! Layers of a frame, read back to the host.

use std::sync::Arc;

use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder};

use crate::targets::Targets;

/// What of a projector's frame (CONTRACT, Layers of a snapshot).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Exactly what the projector shows, 8-bit sRGB.
    Color,
    /// Linear colour before blending and response.
    Radiance,
    /// Along the primary ray from the near plane to the closest hit of the pixel's samples, m; +inf = miss.
    Distance,
    /// Window z of that point under the projector's own matrix; 1 = miss.
    Depth,
    /// The node whose sample is closest, in `scene.get` order; −1 = miss.
    Node,
    /// The blend weight.
    Weight,
}

/// A layer's texels, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Red, green and blue, sRGB.
    Rgb8(Vec<[u8; 3]>),
    /// Red, green and blue, linear.
    Rgb(Vec<[f32; 3]>),
    /// One number.
    Scalar(Vec<f32>),
}

/// A layer of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// A row after the other.
    pub texels: Texels,
}

/// A whole buffer as 32-bit words.
pub(crate) fn read_words(device: &Arc<Device>, from: &Arc<Buffer>) -> Result<Vec<u32>, GpuError> {
    let bytes = from.bytes();
    let to = Buffer::new(device, "readback", BufferKind::Readback, bytes)?;
    let mut recorder = Recorder::new(device, 0, "readback")?;
    recorder.copy_buffer(from, 0, &to, 0, bytes)?;
    device.submit(recorder.finish()?, &[])?.wait(device.hung_after())?;
    let raw = to.read(0, bytes)?;
    Ok(bytemuck::pod_collect_to_vec(&raw))
}

/// Reads one layer of a projector, whose depth convention may be `reversed`.
pub(crate) fn read(
    device: &Arc<Device>,
    targets: &Targets,
    reversed: bool,
    layer: Layer,
) -> Result<LayerImage, GpuError> {
    let float = f32::from_bits;
    let texels = match layer {
        Layer::Color => {
            let words = read_words(device, &targets.color)?;
            Texels::Rgb8(words.iter().map(|w| [*w as u8, (w >> 8) as u8, (w >> 16) as u8]).collect())
        }
        Layer::Radiance => {
            let words = read_words(device, &targets.shown)?;
            Texels::Rgb(words.chunks_exact(4).map(|c| [float(c[0]), float(c[1]), float(c[2])]).collect())
        }
        Layer::Weight => {
            let words = read_words(device, &targets.shown)?;
            Texels::Scalar(words.chunks_exact(4).map(|c| float(c[3])).collect())
        }
        Layer::Distance => {
            let words = read_words(device, &targets.closest)?;
            Texels::Scalar(words.chunks_exact(4).map(|c| float(c[0])).collect())
        }
        Layer::Depth => {
            let words = read_words(device, &targets.depth_and_node)?;
            let window = |c: &[u32]| if reversed && float(c[1]) >= 0.0 { 1.0 - float(c[0]) } else { float(c[0]) };
            Texels::Scalar(words.chunks_exact(2).map(window).collect())
        }
        Layer::Node => {
            let words = read_words(device, &targets.depth_and_node)?;
            Texels::Scalar(words.chunks_exact(2).map(|c| float(c[1])).collect())
        }
    };
    Ok(LayerImage { width: targets.size_px[0], height: targets.size_px[1], texels })
}
