//! Typed reading of buffer views (glTF 2.0, section 3.6), every offset checked.

use std::borrow::Cow;

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, buffer};

use super::error::{Located, Problem, bad, here, item};
use crate::limits::Limits;

/// A document with the bytes of its buffers.
pub(super) struct Reader<'a> {
    pub(super) root: &'a Root,
    pub(super) buffers: &'a [Cow<'a, [u8]>],
    pub(super) limits: &'a Limits,
}

/// The elements of one accessor, or of one half of a sparse one.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn get(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..][..self.size]
    }
}

impl<'a> Reader<'a> {
    /// The bytes of a buffer view, and its stride.
    pub(super) fn view(&self, index: Index<buffer::View>, object: &str) -> Result<(&'a [u8], Option<usize>), Located> {
        let view = item(&self.root.buffer_views, "buffer view", index.value(), object)?;
        let object = format!("buffer view {}", index.value());
        let buffer = item(self.buffers, "buffer", view.buffer.value(), &object)?;
        let offset = view.byte_offset.map_or(0, |offset| offset.0);
        let end = offset.checked_add(view.byte_length.0).ok_or_else(|| here(&object, Problem::Overflow))?;
        if end > buffer.len() as u64 {
            let of = format!("buffer {}", view.buffer.value());
            return Err(here(object, Problem::Truncated { of, needed: end, available: buffer.len() as u64 }));
        }
        let stride = view.byte_stride.map(|stride| stride.0).filter(|&stride| stride != 0);
        Ok((&buffer[offset as usize..end as usize], stride))
    }

    /// `count` elements of `size` bytes from `offset` on in a view.
    fn elements(
        &self,
        view: Index<buffer::View>,
        offset: u64,
        count: u64,
        size: usize,
        object: &str,
    ) -> Result<Elements<'a>, Located> {
        let (bytes, stride) = self.view(view, object)?;
        let stride = stride.unwrap_or(size);
        if stride < size {
            return Err(bad(object, format!("steps by {stride} bytes through elements of {size}")));
        }
        // The last element need not be followed by a whole stride.
        let span = count.saturating_sub(1).checked_mul(stride as u64);
        let end = span.and_then(|span| span.checked_add(size as u64)).and_then(|span| span.checked_add(offset));
        let end = end.ok_or_else(|| here(object, Problem::Overflow))?;
        if end > bytes.len() as u64 && count > 0 {
            let of = format!("buffer view {}", view.value());
            return Err(here(object, Problem::Truncated { of, needed: end, available: bytes.len() as u64 }));
        }
        let start = (offset as usize).min(bytes.len());
        Ok(Elements { bytes: &bytes[start..], stride, size })
    }

    /// The accessor of a number, with its component type and count.
    fn accessor(&self, index: Index<Accessor>, expected: Type, object: &str) -> Result<Opened<'a>, Located> {
        let json = item(&self.root.accessors, "accessor", index.value(), object)?;
        let object = format!("{object}, accessor {}", index.value());
        let (Checked::Valid(component), Checked::Valid(dimensions)) = (json.component_type, json.type_) else {
            return Err(bad(object, "has a component type or type that glTF does not know"));
        };
        if dimensions != expected {
            return Err(bad(object, format!("holds {dimensions:?} where {expected:?} belongs")));
        }
        let limit = self.limits.max_triangles as u64 * 3;
        let count = json.count.0;
        if count > limit {
            let key = "three for each triangle that limits.max_triangles leaves";
            return Err(here(object, Problem::TooMany { what: "elements", count, limit, key }));
        }
        Ok(Opened { json, component: component.0, count: count as usize, object })
    }

    /// Vectors of N numbers, normalised integers brought to −1 … 1 or 0 … 1.
    pub(super) fn vectors<const N: usize>(
        &self,
        index: Index<Accessor>,
        dimensions: Type,
        object: &str,
    ) -> Result<Vec<[f32; N]>, Located> {
        let opened = self.accessor(index, dimensions, object)?;
        let Opened { json, component, count, ref object } = opened;
        let width = component.size();
        let decode = |bytes: &[u8]| -> [f32; N] {
            std::array::from_fn(|i| number(component, json.normalized, &bytes[i * width..]))
        };

        // Without a view all are zero, for a sparse half to replace.
        let mut vectors = match json.buffer_view {
            Some(view) => {
                let offset = json.byte_offset.map_or(0, |offset| offset.0);
                let elements = self.elements(view, offset, count as u64, width * N, object)?;
                (0..count).map(|i| decode(elements.get(i))).collect()
            }
            None => vec![[0.0; N]; count],
        };
        if let Some(sparse) = &json.sparse {
            let many = sparse.count.0;
            if many > count as u64 {
                return Err(bad(object, format!("replaces {many} of {count} elements")));
            }
            let Checked::Valid(index_type) = sparse.indices.component_type else {
                return Err(bad(object, "has sparse indices of a type that glTF does not know"));
            };
            let (at, of) = (sparse.indices.byte_offset.0, sparse.values.byte_offset.0);
            let indices = self.elements(sparse.indices.buffer_view, at, many, index_type.0.size(), object)?;
            let values = self.elements(sparse.values.buffer_view, of, many, width * N, object)?;
            for i in 0..many as usize {
                let place = unsigned(index_type.0, indices.get(i)) as usize;
                let slot = vectors.get_mut(place);
                *slot.ok_or_else(|| here(object, Problem::Index { what: "element", index: place, count }))? =
                    decode(values.get(i));
            }
        }
        Ok(vectors)
    }

    /// Vertex numbers.
    pub(super) fn indices(&self, index: Index<Accessor>, object: &str) -> Result<Vec<u32>, Located> {
        let Opened { json, component, count, object } = self.accessor(index, Type::Scalar, object)?;
        if !matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(bad(object, format!("holds indices of type {component:?}; they are unsigned integers")));
        }
        let Some(view) = json.buffer_view.filter(|_| json.sparse.is_none()) else {
            return Err(bad(object, "holds sparse indices, or none; they need a plain buffer view"));
        };
        let offset = json.byte_offset.map_or(0, |offset| offset.0);
        let elements = self.elements(view, offset, count as u64, component.size(), &object)?;
        Ok((0..count).map(|i| unsigned(component, elements.get(i))).collect())
    }

    /// The corners that a float accessor declares for its elements.
    pub(super) fn declared_bounds(&self, index: Index<Accessor>) -> Option<[[f64; 3]; 2]> {
        let json = self.root.accessors.get(index.value())?;
        let float = matches!(json.component_type, Checked::Valid(component) if component.0 == ComponentType::F32);
        let corner =
            |value: &Option<gltf::json::Value>| gltf::json::deserialize::from_value::<[f64; 3]>(value.clone()?).ok();
        if float { Some([corner(&json.min)?, corner(&json.max)?]) } else { None }
    }
}

struct Opened<'a> {
    json: &'a Accessor,
    component: ComponentType,
    count: usize,
    object: String,
}

/// The first component of some bytes (glTF 2.0, section 3.6.2.2, and 3.11 for normalised integers).
fn number(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let (value, largest) = match component {
        ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f32::from(bytes[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        ComponentType::U32 => (unsigned(component, bytes) as f32, u32::MAX as f32),
        ComponentType::F32 => return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

fn unsigned(component: ComponentType, bytes: &[u8]) -> u32 {
    match component.size() {
        1 => bytes[0].into(),
        2 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}
