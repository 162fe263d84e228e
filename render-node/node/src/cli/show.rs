//! Meaningful colours: Super-Gaussians and attributes, with their legend; and the frontmost surface.

use std::fmt;
use std::path::Path;

use clap::ValueEnum;
use serde::Serialize;
use sg_raster::attributes::{Attribute, AttributeColors, Legend, attribute_colors};
use sg_raster::color_map::ColorMap;
use sg_raster::pick::Hit;
use sg_raster::structure::{ClusterColoring, cluster_colors, labels_of};
use sg_scene::appearance::Appearance;
use sg_scene::model::Scene;

use super::failure::Failure;

/// Attributes that `--show` draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Shown {
    /// Super-Gaussians in random colours, neighbours in different ones
    Clusters,
    /// Super-Gaussians along the first principal axis of their centres
    FirstComponent,
    /// Mean standard deviation, logarithmic
    Scale,
    /// Elongation: longest over shortest standard deviation, logarithmic
    Anisotropy,
    /// Opacity of each Gaussian by itself
    Opacity,
    /// Offset colour itself
    OffsetColor,
    /// Normal, as colour
    Normal,
    /// Longest axis: red along x, green along y, blue along z
    PrincipalAxis,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum MapName {
    Viridis,
    Cividis,
}

impl From<MapName> for ColorMap {
    fn from(name: MapName) -> Self {
        match name {
            MapName::Viridis => Self::Viridis,
            MapName::Cividis => Self::Cividis,
        }
    }
}

/// Legend of the colours.
#[derive(Debug, Serialize)]
pub(super) struct LegendReport {
    attribute: &'static str,
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl fmt::Display for LegendReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { attribute, low, high, logarithmic } = self;
        let scale = if *logarithmic { ", logarithmic" } else { "" };
        write!(f, "legend: {attribute} from {low:.4} (dark) to {high:.4} (bright){scale}")
    }
}

/// The front Gaussian at a pixel.
#[derive(Debug, Serialize)]
pub(super) struct HitReport {
    gaussian: u32,
    depth: f64,
    point: [f64; 3],
}

impl From<Hit> for HitReport {
    fn from(hit: Hit) -> Self {
        Self { gaussian: hit.gaussian, depth: hit.depth, point: hit.point.to_array() }
    }
}

impl HitReport {
    /// The line on standard error.
    pub(super) fn line(hit: Option<&Hit>) -> String {
        match hit {
            Some(Hit { gaussian, depth, point }) => {
                format!(
                    "in front: Gaussian {gaussian} at ({:.4}, {:.4}, {:.4}), depth {depth:.4}",
                    point.x, point.y, point.z
                )
            }
            None => "in front: nothing that covers half of the ray".to_owned(),
        }
    }
}

/// Labels of a scene.
pub(super) fn read_labels(path: &Path, scene: &Scene) -> Result<Vec<u32>, Failure> {
    let labels = sg_formats::npy::read_labels(path).map_err(Failure::input)?;
    labels_of(labels, scene.len()).map_err(|e| Failure::input(format!("{}: {e}", path.display())))
}

/// Options of `--show`.
pub(super) struct ColorOptions {
    pub(super) map: MapName,
    /// Numbers at the ends of the colour map.
    pub(super) range: Option<[f64; 2]>,
    /// Seed of random colours.
    pub(super) seed: u64,
}

/// Applies the requested colours to the scene's look.
pub(super) fn colors(
    shown: Shown,
    options: &ColorOptions,
    (scene, labels): (&Scene, Option<&[u32]>),
    appearance: &mut Appearance,
) -> Result<Option<LegendReport>, Failure> {
    let map = ColorMap::from(options.map);
    let attribute = match shown {
        Shown::Clusters | Shown::FirstComponent => {
            let labels = labels.ok_or_else(|| {
                Failure::input(
                    "--show of Super-Gaussians needs --clusters LABELS.npy, from `supergaussian selection cluster`",
                )
            })?;
            if options.range.is_some() {
                return Err(Failure::input("--range goes with numbers; Super-Gaussians have none"));
            }
            let coloring = match shown {
                Shown::FirstComponent => ClusterColoring::FirstComponent(map),
                _ => ClusterColoring::Random { seed: options.seed },
            };
            appearance.colors = Some(cluster_colors(scene, labels, coloring).map_err(Failure::input)?);
            return Ok(None);
        }
        Shown::Scale => Attribute::Scale,
        Shown::Anisotropy => Attribute::Anisotropy,
        Shown::Opacity => Attribute::Opacity,
        Shown::OffsetColor => Attribute::OffsetColor,
        Shown::Normal => Attribute::Normal,
        Shown::PrincipalAxis => Attribute::PrincipalAxis,
    };
    let range = options.range.map(|[low, high]| (low, high));
    let AttributeColors { colors, legend } = attribute_colors(scene, attribute, map, range).map_err(Failure::input)?;
    appearance.colors = Some(colors);
    let report =
        |Legend { low, high, logarithmic, .. }| LegendReport { attribute: attribute.name(), low, high, logarithmic };
    Ok(legend.map(report))
}
