//! The values of the volume behind a scene, and their histogram.

use std::sync::Arc;

use sg_reclassify::{VolumeOfScene, sources};
use sg_scene::model::Scene;
use sg_volume::TransferFunction;
use sg_volume::transfer::{Scale, Units};

use super::transfer::Curve;

/// Bars of the histogram.
pub(super) const BARS: usize = 96;

/// The volume behind a scene: the transfer function of its file, and the values of its Gaussians.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VolumeValues {
    pub(super) file: Arc<TransferFunction>,
    /// Least and greatest value of the volume, raw.
    range: [f64; 2],
    /// Mean values of some Gaussians, raw.
    values: Vec<f64>,
}

/// Most values that the histogram is of.
const SAMPLES: usize = 200_000;

/// Heights of the bars of a histogram, 0 to 1.
pub(super) type Bars = [f32; BARS];

/// What the bars of a histogram depend on.
type Axis = ([f64; 2], Units, Scale);

/// State of the section "Transfer function" from frame to frame.
#[derive(Debug, Default)]
pub(super) struct FunctionState {
    /// Index of the chosen control point.
    pub(super) chosen: usize,
    /// Whether the pointer moves it.
    pub(super) is_dragged: bool,
    /// The newest histogram, with its axis.
    bars: Option<(Axis, Bars)>,
}

impl VolumeValues {
    /// Those of the first base unit with values. `functions` has the transfer function of each unit.
    pub(super) fn of(scene: &Scene, functions: &[Option<TransferFunction>]) -> Option<Arc<Self>> {
        let VolumeOfScene { function, range } = VolumeOfScene::of(scene, functions)?;
        let every = scene.len().div_ceil(SAMPLES).max(1);
        let all = scene.units.iter().filter_map(|unit| sources::values(&unit.gaussians)).flatten();
        let values: Vec<f64> = all.filter(|x| x.is_finite()).step_by(every).collect();
        Some(Arc::new(Self { file: function?, range, values }))
    }

    /// Values in the units of a function.
    fn in_units_of<'a>(&'a self, function: &TransferFunction) -> impl Iterator<Item = f64> + 'a {
        let [low, high] = self.range;
        let (shift, factor) = match function.units {
            Units::Normalized if high > low => (low, 1.0 / (high - low)),
            _ => (0.0, 1.0),
        };
        self.values.iter().map(move |x| (x - shift) * factor)
    }

    /// Heights of the bars, 0 to 1, by the logarithm of their numbers: rare values matter as much as frequent ones.
    fn bars(&self, curve: &Curve, function: &TransferFunction) -> Bars {
        let mut counts = [0_u32; BARS];
        for value in self.in_units_of(function) {
            if let Some(count) = counts.get_mut((curve.place(value) * BARS as f32) as usize) {
                *count += 1;
            }
        }
        let most = (counts.iter().copied().max().unwrap_or(0) as f32).ln_1p().max(1.0);
        counts.map(|count| (count as f32).ln_1p() / most)
    }
}

impl FunctionState {
    /// The bars of a function's histogram. They are counted once for each axis.
    pub(super) fn bars(&mut self, volume: &VolumeValues, curve: &Curve, function: &TransferFunction) -> Bars {
        let axis = (function.domain, function.units, function.scale);
        let known = self.bars.filter(|(of, _)| *of == axis);
        self.bars.insert(known.unwrap_or_else(|| (axis, volume.bars(curve, function)))).1
    }
}
