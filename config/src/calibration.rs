//! `[projector.calibration]` in memory: matrices, or a file with what it leaves unsaid.

use std::path::PathBuf;

/// A 4 × 4 matrix as rows.
pub type Matrix4 = [[f64; 4]; 4];

/// From the world to a projector's image.
#[derive(Clone, Debug, PartialEq)]
pub enum Calibration {
    /// Written out.
    Matrices(Matrices),
    /// As another program has stored it.
    File(CalibrationFile),
}

/// A projector's matrices; each is finite and invertible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matrices {
    /// The clip space that `projection` leads to.
    pub convention: Convention,
    /// Clip from eye, as rows, whatever the order in the text.
    pub projection: Matrix4,
    /// Eye from world, as rows, whatever the order in the text.
    pub view: Matrix4,
    /// How the text has them.
    pub order: Order,
}

/// Clip spaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// y up, z from −1 to 1.
    OpenGl,
    /// y down, z from 0 to 1.
    Vulkan,
}

/// How a matrix is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// Row after row: a translation stands in the last column.
    #[default]
    Row,
    /// Column after column: a translation stands in the last row of what one reads.
    Column,
}

/// A calibration file, and what the configuration says of it because the file may not.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFile {
    /// Where it is.
    pub path: PathBuf,
    /// What it is.
    pub format: Format,
    /// Which of several projectors in it; `None`: the only one.
    pub entry: Option<String>,
    /// The length that its numbers count.
    pub unit: Option<Unit>,
    /// The image that it was made for; `None`: the one that it states, else the projector's own.
    pub resolution_px: Option<[u32; 2]>,
    /// Distance of the near plane, m.
    pub near_m: Option<f64>,
    /// Distance of the far plane, m.
    pub far_m: Option<f64>,
    /// The clip space in which depth is told.
    pub convention: Convention,
    /// How matrices in it are stored, where the format leaves that to its writer.
    pub order: Order,
    /// The pose, where the file has none: x right, y down, z forward, from the file's world in metres.
    pub view: Option<Matrix4>,
    /// A rotation or mirroring, a translation and a uniform scale, from metres to metres.
    pub world_from_file: Matrix4,
}

/// Formats of calibration files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// FileStorage of OpenCV: YAML, XML or JSON.
    OpenCv,
    /// VESA's interchange format: a zip or its bare XML.
    Mpcdi,
    /// The ensemble of the RoomAlive Toolkit: XML.
    RoomAlive,
    /// The configuration of Splash: JSON with comments.
    Splash,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 4] = [Self::OpenCv, Self::Mpcdi, Self::RoomAlive, Self::Splash];

    /// The name in the configuration.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::OpenCv => "opencv",
            Self::Mpcdi => "mpcdi",
            Self::RoomAlive => "roomalive",
            Self::Splash => "splash",
        }
    }
}

/// Units of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// 0.001 m.
    Millimetre,
    /// 0.01 m.
    Centimetre,
    /// 0.1 m.
    Decimetre,
    /// 1 m.
    Metre,
    /// 0.0254 m.
    Inch,
    /// 0.3048 m.
    Foot,
    /// 0.9144 m.
    Yard,
}

impl Unit {
    /// Every unit.
    pub const ALL: [Self; 7] =
        [Self::Millimetre, Self::Centimetre, Self::Decimetre, Self::Metre, Self::Inch, Self::Foot, Self::Yard];

    /// The name in the configuration, and in MPCDI.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Decimetre => "dm",
            Self::Metre => "m",
            Self::Inch => "in",
            Self::Foot => "ft",
            Self::Yard => "yd",
        }
    }

    /// Its length, m.
    pub fn metres(self) -> f64 {
        match self {
            Self::Millimetre => 0.001,
            Self::Centimetre => 0.01,
            Self::Decimetre => 0.1,
            Self::Metre => 1.0,
            Self::Inch => 0.0254,
            Self::Foot => 0.3048,
            Self::Yard => 0.9144,
        }
    }
}
