//! Values of options by name.

use clap::ValueEnum;
use serde::Serialize;
use sg_gpu::Rasterizer;
use sg_gpu::backend::Backend;
use sg_proto::light_presets::LightPreset;
use sg_raster::render::{Projection, Quality};
use sg_scene::appearance::{PixelFilter, ShadingTerm};
use sg_scene::model::{Convention, ShadingModel};

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum BackendName {
    /// A graphics card if there is one, otherwise the cores.
    Auto,
    /// All cores of this machine.
    Cpu,
    /// A graphics device of any kind, including software devices.
    Gpu,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum RasterizerName {
    /// Lists for each 16 × 16 tile, in compute shaders.
    Tiles,
    /// A quadrilateral for each Gaussian, in the fixed function.
    Quads,
    /// The same in bands; between bands, almost opaque pixels are closed.
    Bands,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum QualityName {
    /// No error: the reference itself.
    Exact,
    /// At least 50 dB.
    Standard,
    /// At least 40 dB.
    Fast,
}

#[derive(Debug, Clone, Copy, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ProjectionName {
    /// To an ellipse, as 3DGS does.
    Affine,
    /// For each pixel's ray; the same however the camera turns.
    PerRay,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum FilterName {
    /// As the scene was trained, from its file.
    FromFile,
    /// Unchanged.
    Plain,
    /// Reduced by the growth (Mip-Splatting).
    Compensated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum TermName {
    /// All terms together.
    Full,
    /// The normals as colours.
    Normal,
    /// The ambient term alone.
    Ambient,
    /// The diffuse term alone.
    Diffuse,
    /// The specular term alone.
    Specular,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum LightName {
    /// From the eye.
    Headlight,
    /// From the upper left, with highlights.
    Studio,
    /// From above behind the scene: bright edges.
    Rim,
    /// Ambient light only.
    Flat,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum ShadingName {
    /// One-sided, clamped to 0 to 1.
    Paper,
    /// Two-sided, as iVR-GS trains.
    IvrgsTrain,
    /// Two-sided, as the viewer of iVR-GS draws.
    IvrgsViewer,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum ConventionName {
    /// Stored as used: files of this program.
    Ours,
    /// Checkpoints of iVR-GS before January 2025.
    Legacy,
    /// Float files of iVR-GS since January 2025.
    HeadRaw,
    /// Quantised files of iVR-GS since January 2025.
    HeadActivated,
}

impl From<BackendName> for Backend {
    fn from(name: BackendName) -> Self {
        match name {
            BackendName::Auto => Self::Auto,
            BackendName::Cpu => Self::Cpu,
            BackendName::Gpu => Self::Gpu,
        }
    }
}

impl From<RasterizerName> for Rasterizer {
    fn from(name: RasterizerName) -> Self {
        match name {
            RasterizerName::Tiles => Self::Tiles,
            RasterizerName::Quads => Self::Quads,
            RasterizerName::Bands => Self::Bands,
        }
    }
}

impl From<QualityName> for Quality {
    fn from(name: QualityName) -> Self {
        match name {
            QualityName::Exact => Self::Exact,
            QualityName::Standard => Self::Standard,
            QualityName::Fast => Self::Fast,
        }
    }
}

impl From<ProjectionName> for Projection {
    fn from(name: ProjectionName) -> Self {
        match name {
            ProjectionName::Affine => Self::Affine,
            ProjectionName::PerRay => Self::PerRay,
        }
    }
}

impl From<FilterName> for PixelFilter {
    fn from(name: FilterName) -> Self {
        match name {
            FilterName::FromFile => Self::FromFile,
            FilterName::Plain => Self::Plain,
            FilterName::Compensated => Self::Compensated,
        }
    }
}

impl From<TermName> for ShadingTerm {
    fn from(name: TermName) -> Self {
        match name {
            TermName::Full => Self::Full,
            TermName::Normal => Self::Normal,
            TermName::Ambient => Self::Ambient,
            TermName::Diffuse => Self::Diffuse,
            TermName::Specular => Self::Specular,
        }
    }
}

impl From<LightName> for LightPreset {
    fn from(name: LightName) -> Self {
        match name {
            LightName::Headlight => Self::Headlight,
            LightName::Studio => Self::Studio,
            LightName::Rim => Self::Rim,
            LightName::Flat => Self::Flat,
        }
    }
}

impl From<ShadingName> for ShadingModel {
    fn from(name: ShadingName) -> Self {
        match name {
            ShadingName::Paper => Self::Paper,
            ShadingName::IvrgsTrain => Self::IvrgsTrain,
            ShadingName::IvrgsViewer => Self::IvrgsViewer,
        }
    }
}

impl From<ConventionName> for Convention {
    fn from(name: ConventionName) -> Self {
        match name {
            ConventionName::Ours => Self::Ours,
            ConventionName::Legacy => Self::Legacy,
            ConventionName::HeadRaw => Self::HeadRaw,
            ConventionName::HeadActivated => Self::HeadActivated,
        }
    }
}
