//! How shaders load what rays read: through texel buffers or through storage buffers.

use std::sync::Arc;

use lantern_gpu::{Buffer, BufferKind, Device, DeviceInfo, GpuError, Shader, TexelFormat};

use crate::shaders;

/// A way to load.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Loads {
    /// Through texel buffers.
    Texel,
    /// Through storage buffers.
    Storage,
}

impl Loads {
    /// What suits a device, for scenes that it can hold so.
    pub fn of_device(info: &DeviceInfo) -> Self {
        if info.kind == "cpu" { Self::Texel } else { Self::Storage }
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Self::Texel => "texel buffers",
            Self::Storage => "storage buffers",
        }
    }

    /// Why a device takes this way.
    pub fn why(self) -> &'static str {
        match self {
            Self::Texel => "a driver on a CPU fetches a texel whole and reads storage buffers word by word",
            Self::Storage => "they may be longer, and a GPU needs no sampler to read them",
        }
    }

    /// The shader that loads so, and traces by ray queries where these are wanted.
    pub(crate) fn shader(self, shader: &'static Shader, ray_queries: bool) -> &'static Shader {
        match self {
            Self::Texel => shader,
            Self::Storage => shaders::by_storage(shader, ray_queries),
        }
    }
}

/// The ways that a device has, and how much they hold. The scene's buffers are made for both; which one is taken follows from their
/// lengths.
#[derive(Clone, Debug)]
pub(crate) struct Ways {
    /// The one that suits the device comes first.
    ways: Vec<Loads>,
    texel_elements: u64,
    storage_bytes: u64,
}

impl Ways {
    /// Those of a device, or the one that is asked for; of texel buffers of at most so many elements, where it says more.
    pub(crate) fn of(device: &Device, asked: Option<Loads>, most_texels: Option<u64>) -> Self {
        let limits = device.limits();
        let ways = match (asked, Loads::of_device(device.info())) {
            (Some(only), _) => vec![only],
            // Shaders that trace by ray queries are built for this way alone.
            _ if device.has_ray_queries() => vec![Loads::Storage],
            _ if limits.max_stage_storage_buffers < shaders::most_storage_buffers() => vec![Loads::Texel],
            (None, Loads::Texel) => vec![Loads::Texel, Loads::Storage],
            (None, Loads::Storage) => vec![Loads::Storage, Loads::Texel],
        };
        let texel_elements = limits.max_texel_buffer_elements.min(most_texels.unwrap_or(u64::MAX));
        Self { ways, texel_elements, storage_bytes: limits.max_storage_buffer_bytes }
    }

    /// The longest buffer of such elements, bytes.
    fn longest(&self, loads: Loads, format: TexelFormat) -> u64 {
        match loads {
            Loads::Texel => self.texel_elements.saturating_mul(format.bytes()),
            Loads::Storage => self.storage_bytes,
        }
    }

    /// How long a buffer that must have `needed` bytes may be, without its taking another way for that.
    pub(crate) fn room(&self, format: TexelFormat, needed: u64) -> u64 {
        let mut rooms = self.ways.iter().map(|loads| self.longest(*loads, format));
        rooms.find(|room| *room >= needed).unwrap_or(needed)
    }

    /// The first way that can read all of these buffers.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where there is none, for the first buffer that the way that suits the device cannot read.
    pub(crate) fn through<'a>(&self, buffers: impl Iterator<Item = &'a Arc<Buffer>>) -> Result<Loads, GpuError> {
        let texels: Vec<_> = buffers
            .filter_map(|buffer| match buffer.kind() {
                BufferKind::Texel(format) => Some((buffer.name(), buffer.bytes(), format)),
                _ => None,
            })
            .collect();
        let mut refusal = None;
        for loads in &self.ways {
            let too_long = texels.iter().find(|(_, bytes, format)| *bytes > self.longest(*loads, *format));
            let Some((name, bytes, format)) = too_long else { return Ok(*loads) };
            refusal.get_or_insert_with(|| self.refusal(*loads, name, *bytes, *format));
        }
        // There is a way at least.
        refusal.map_or(Ok(Loads::Texel), Err)
    }

    fn refusal(&self, loads: Loads, name: &str, bytes: u64, format: TexelFormat) -> GpuError {
        let (asked, limit, unit) = match loads {
            Loads::Texel => (bytes / format.bytes(), self.texel_elements, "elements of a texel buffer"),
            Loads::Storage => (bytes, self.storage_bytes, "bytes of a storage buffer"),
        };
        GpuError::TooLarge { object: name.to_owned(), asked, limit, unit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_takes_another_way_only_where_it_must() {
        let ways = |ways: &[Loads]| Ways { ways: ways.to_vec(), texel_elements: 100, storage_bytes: 1000 };
        let both = ways(&[Loads::Texel, Loads::Storage]);
        assert_eq!([400, 401, 1001].map(|needed| both.room(TexelFormat::R32Uint, needed)), [400, 1000, 1001]);
        assert_eq!([1000, 1001].map(|needed| both.room(TexelFormat::Rgba32Uint, needed)), [1600; 2]);
        let storage_first = ways(&[Loads::Storage, Loads::Texel]);
        assert_eq!([1000, 1001].map(|needed| storage_first.room(TexelFormat::Rgba32Uint, needed)), [1000, 1600]);
    }
}
