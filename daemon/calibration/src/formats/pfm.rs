//! Portable float maps as MPCDI has them: three floats a pixel, and the first pixel is the top left one.

use glam::{UVec2, Vec3};

use super::text::malformed;
use super::{FileError, limits};

const FORMAT: &str = "a PFM map";

/// A map of vectors; NaN is unknown.
pub(crate) struct Pfm {
    pub(crate) size: UVec2,
    /// Row 0 on top.
    pub(crate) pixels: Vec<Vec3>,
}

/// Longest file of a map that is taken in.
pub(super) const BYTES: u64 = limits::MAP_PX * 12 + 256;

/// Reads a file.
pub(super) fn parse(bytes: &[u8]) -> Result<Pfm, FileError> {
    let mut rest = bytes;
    let magic = word(&mut rest)?;
    if magic != "PF" {
        return Err(malformed(FORMAT, "it does not start with PF: three floats a pixel".to_owned()));
    }
    let mut side = || -> Result<u32, FileError> {
        let text = word(&mut rest)?;
        text.parse().ok().filter(|side| *side > 0).ok_or_else(|| malformed(FORMAT, format!("a side of it is {text:?}")))
    };
    let size = UVec2::new(side()?, side()?);
    let scale: Option<f32> = word(&mut rest)?.parse().ok().filter(|scale: &f32| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| malformed(FORMAT, "its scale is no number".to_owned()))?;

    let count = u64::from(size.x) * u64::from(size.y);
    if count > limits::MAP_PX {
        return Err(malformed(FORMAT, format!("it is {} × {} pixels, more than {}", size.x, size.y, limits::MAP_PX)));
    }
    if rest.len() as u64 != count * 12 {
        let message = format!("{} × {} pixels are {} bytes, and it has {}", size.x, size.y, count * 12, rest.len());
        return Err(malformed(FORMAT, message));
    }
    // The sign tells the order of bytes, and the size, which everyone writes as 1, nothing here.
    let float = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let (floats, _) = rest.as_chunks::<4>();
    let (pixels, _) = floats.as_chunks::<3>();
    Ok(Pfm { size, pixels: pixels.iter().map(|pixel| Vec3::from_array(pixel.map(float))).collect() })
}

/// Writes one.
pub(crate) fn write(pfm: &Pfm) -> Vec<u8> {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", pfm.size.x, pfm.size.y).into_bytes();
    bytes.extend(pfm.pixels.iter().flat_map(|pixel| pixel.to_array()).flat_map(f32::to_le_bytes));
    bytes
}

/// The next word of the header, and the one blank after it.
fn word<'a>(rest: &mut &'a [u8]) -> Result<&'a str, FileError> {
    const LONGEST: usize = 40;
    let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
    let after = &rest[start..];
    let length = after.iter().take(LONGEST).position(u8::is_ascii_whitespace);
    let length = length.ok_or_else(|| malformed(FORMAT, "its header is cut off".to_owned()))?;
    let word = std::str::from_utf8(&after[..length]).map_err(|error| malformed(FORMAT, error.to_string()))?;
    *rest = &after[length + 1..];
    Ok(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_of_bytes_and_the_way_back() {
        let pixels = vec![Vec3::new(0.0, 0.25, 1.0), Vec3::NAN];
        let pfm = Pfm { size: UVec2::new(2, 1), pixels };
        let little = write(&pfm);
        let mut big = b"PF 2 1 1.0\n".to_vec();
        big.extend(pfm.pixels.iter().flat_map(|pixel| pixel.to_array()).flat_map(f32::to_be_bytes));
        for bytes in [&little, &big] {
            let read = parse(bytes).unwrap();
            assert_eq!((read.size, read.pixels[0]), (pfm.size, pfm.pixels[0]));
            assert!(read.pixels[1].is_nan());
            for end in 0..bytes.len() {
                assert!(parse(&bytes[..end]).is_err(), "{end} bytes");
            }
        }
        let mut longer = little.clone();
        longer.push(0);
        assert!(parse(&longer).is_err());
        for header in
            ["Pf\n2 1\n-1\n", "PF\n0 1\n-1\n", "PF\n4294967295 4294967295\n-1\n", "PF\n2 1\n0\n", "PF\n2 1\nnan\n"]
        {
            assert!(parse(header.as_bytes()).is_err(), "{header}");
        }
    }
}
