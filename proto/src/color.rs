//! Colours on the wire.

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Linear RGB.
///
/// Written as an array of three; read from that or from `"#rrggbb"`, which is sRGB and is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Color(pub [f64; 3]);

/// Linear RGB and alpha.
///
/// Written as an array of four; read from that, from an array of three or from `"#rrggbb"` (alpha 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ColorAlpha(pub [f64; 4]);

impl Color {
    /// Reads `#rrggbb` (sRGB, IEC 61966-2-1) as linear RGB; `None` for any other text.
    pub fn from_hex(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#')?;
        if digits.len() != 6 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let packed = u32::from_str_radix(digits, 16).ok()?;
        let channel = |shift: u32| linear_from_srgb(f64::from((packed >> shift) & 0xff) / 255.0);
        Some(Self([channel(16), channel(8), channel(0)]))
    }
}

fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Three or four channels, as read.
struct Channels {
    values: [f64; 4],
    count: usize,
}

struct ChannelsVisitor {
    most: usize,
}

impl<'de> Visitor<'de> for ChannelsVisitor {
    type Value = Channels;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = if self.most == 4 { "3 or 4" } else { "3" };
        write!(f, "an array of {numbers} numbers (linear) or \"#rrggbb\" (sRGB)")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Channels, E> {
        let Color([r, g, b]) =
            Color::from_hex(text).ok_or_else(|| E::invalid_value(serde::de::Unexpected::Str(text), &self))?;
        Ok(Channels { values: [r, g, b, 1.0], count: 3 })
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Channels, A::Error> {
        let mut channels = Channels { values: [0.0, 0.0, 0.0, 1.0], count: 0 };
        while let Some(value) = seq.next_element::<f64>()? {
            if channels.count == self.most {
                return Err(A::Error::invalid_length(channels.count + 1, &self));
            }
            channels.values[channels.count] = value;
            channels.count += 1;
        }
        if channels.count < 3 {
            return Err(A::Error::invalid_length(channels.count, &self));
        }
        Ok(channels)
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let [r, g, b, _] = deserializer.deserialize_any(ChannelsVisitor { most: 3 })?.values;
        Ok(Self([r, g, b]))
    }
}

impl<'de> Deserialize<'de> for ColorAlpha {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Self(deserializer.deserialize_any(ChannelsVisitor { most: 4 })?.values))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hex_is_srgb() {
        let Color(grey) = Color::from_hex("#808080").unwrap();
        // 0x80 = 128/255 decodes to 0.2158605 (IEC 61966-2-1).
        assert!((grey[0] - 0.215_860_5).abs() < 1e-6, "{grey:?}");
        assert_eq!(Color::from_hex("#ff0000"), Some(Color([1.0, 0.0, 0.0])));
        for bad in ["ff0000", "#ff000", "#ff00000", "#gg0000", "#+f0000", "#é000"] {
            assert_eq!(Color::from_hex(bad), None, "{bad}");
        }
    }

    #[test]
    fn arrays_of_the_right_length_alone_are_read() {
        assert_eq!(serde_json::from_str::<Color>("[1, 0.5, 0]").unwrap(), Color([1.0, 0.5, 0.0]));
        assert_eq!(serde_json::from_str::<ColorAlpha>("[1, 0.5, 0]").unwrap(), ColorAlpha([1.0, 0.5, 0.0, 1.0]));
        assert_eq!(serde_json::from_str::<ColorAlpha>("[1, 0.5, 0, 0.2]").unwrap(), ColorAlpha([1.0, 0.5, 0.0, 0.2]));
        for bad in ["[1, 2]", "[1, 2, 3, 4]", "\"red\"", "1", "[1, 2, \"x\"]"] {
            assert!(serde_json::from_str::<Color>(bad).is_err(), "{bad}");
        }
        assert!(serde_json::from_str::<ColorAlpha>("[1, 2, 3, 4, 5]").is_err());
    }
}
