//! Gaussian file formats.
//!
//! | format | read | written | keeps |
//! | --- | --- | --- | --- |
//! | `ours` | ✓ | ✓ | everything of one base unit, bit for bit |
//! | `3dgs` | ✓ | ✓ | columns of a scene drawn from harmonics, bit for bit |
//! | `compressed` (SuperSplat, PlayCanvas) | ✓ | ✓ | the same to 8 to 11 bits a number |
//! | `ivrgs` (float) | ✓ | ✓ | one base unit; shading columns to the rounding of their activation |
//! | `ivrgs-quantised` | ✓ | ✓ | the same to 256 values a column, positions to half precision |
//! | `scene` (`scene.toml`) | ✓ | ✓ | everything, with one PLY for each base unit |
//!
//! Also read: 2D Gaussian Splatting, iVR-GS's misaligned first-stage file, iVR-GS's folder of transfer functions.

mod activation;
mod affine;
mod codebook;
mod compressed;
mod editable;
mod harmonics_rotation;
mod ivrgs;
pub(crate) mod ivrgs_folder;
mod ivrgs_quantised;
mod morton;
pub(crate) mod number;
pub(crate) mod palette;
mod pickle;
mod ply;
mod problem;
pub(crate) mod read;
#[cfg(test)]
mod round_trip;
mod three_dgs;
pub(crate) mod unit_comments;
mod unlit;
pub(crate) mod write;

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

pub use problem::{Problem, Warning, WarningCode};

/// A way to store a scene or a base unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
pub enum Format {
    /// `scene.toml` with one PLY for each base unit.
    #[serde(rename = "scene")]
    SceneToml,
    /// The 21 float columns of an editable unit, stored as used.
    #[serde(rename = "ours")]
    Ours,
    /// The PLY of 3D Gaussian Splatting.
    #[serde(rename = "3dgs")]
    ThreeDgs,
    /// The compressed PLY of SuperSplat and PlayCanvas.
    #[serde(rename = "compressed")]
    CompressedPly,
    /// iVR-GS's float PLY, or its folder of them.
    #[serde(rename = "ivrgs")]
    IvrGs,
    /// iVR-GS's quantised PLY, or its folder of them.
    #[serde(rename = "ivrgs-quantised")]
    IvrGsQuantised,
}

impl Format {
    /// All formats, in the order of the table above.
    pub const ALL: [Self; 6] =
        [Self::Ours, Self::ThreeDgs, Self::CompressedPly, Self::IvrGs, Self::IvrGsQuantised, Self::SceneToml];

    /// The name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SceneToml => "scene",
            Self::Ours => "ours",
            Self::ThreeDgs => "3dgs",
            Self::CompressedPly => "compressed",
            Self::IvrGs => "ivrgs",
            Self::IvrGsQuantised => "ivrgs-quantised",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is none of [`Format::ALL`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown format `{0}`; the formats are ours, 3dgs, compressed, ivrgs, ivrgs-quantised, scene")]
pub struct UnknownFormat(pub String);

impl FromStr for Format {
    type Err = UnknownFormat;

    fn from_str(name: &str) -> Result<Self, UnknownFormat> {
        Self::ALL.into_iter().find(|f| f.name() == name).ok_or_else(|| UnknownFormat(name.to_owned()))
    }
}
