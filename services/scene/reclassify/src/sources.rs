//! Values of the volume that Gaussians keep, as columns of their file.

use glam::Vec3;
use sg_scene::mask::Mask;
use sg_scene::model::{ExtraColumn, ExtraValues, Gaussians, SOURCE_PREFIX, Scene};
use sg_volume::Classifier;
use sg_volume::averages::{Average, Averages};

use crate::optical_depth::dilogarithm;

/// Mean value of the Gaussian's part of the volume, raw, as the nearest f32.
const VALUE: &str = "source_value";
/// The rest of that value, where f32 does not hold it. All columns are f32, since some readers of PLY files know no other type.
const REST: &str = "source_value_rest";
/// Standard deviation of the values, raw.
const SPREAD: &str = "source_spread";
/// Change of the value across one voxel along the mean gradient, raw.
const GRADIENT: &str = "source_gradient";
/// Length of the mean gradient over the mean length, 0 to 1.
const CONSISTENCY: &str = "source_consistency";
/// Surfaceness that the shading of the file is made for.
const SURFACENESS: &str = "source_surfaceness";
/// Li₂ of the opacity where each reference length (1/256 of the volume's diagonal) has an optical depth of 1.
const DEPTH: &str = "source_depth";
/// Colour of the file minus that of its transfer function, where training changed it.
const OFFSETS: [&str; 3] = ["source_red", "source_green", "source_blue"];

/// Logit of 1/8192, the least opacity that a picture of quality `standard` shows.
const HIDDEN_LOGIT: f32 = -9.010_791;

/// Half the width of an even spread over its standard deviation, √3.
const HALF_WIDTH: f64 = 1.732_050_807_568_877_2;

/// Least mean optical depth of a reference length at which a trained opacity tells how dense a Gaussian is.
const LEAST_DEPTH: f64 = 1e-4;

/// Greatest factor of training on the depth of a Gaussian. What is nearly transparent could get any.
const GREATEST_FACTOR: f64 = 4.0;

/// What one Gaussian has of its volume.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Source {
    /// Mean value of its part of the volume, raw.
    pub value: f64,
    /// Standard deviation of the values, raw.
    pub spread: f64,
    /// Change of the value across one voxel along the mean gradient, raw.
    pub gradient: f64,
    /// Length of the mean gradient over the mean length, 0 to 1: 1 where all gradients point to one side.
    pub consistency: f64,
    /// Surfaceness that its shading is made for.
    pub surfaceness: f64,
    /// Li₂ of its opacity where each reference length (1/256 of the volume's diagonal) has an optical depth of 1.
    pub depth: f64,
}

/// The columns of Gaussians with values of their volume.
pub(crate) struct Columns<'a> {
    value: &'a [f32],
    rest: Option<&'a [f32]>,
    spread: &'a [f32],
    pub(crate) gradient: &'a [f32],
    pub(crate) consistency: &'a [f32],
    pub(crate) surfaceness: &'a [f32],
    pub(crate) depth: &'a [f32],
    offsets: Option<[&'a [f32]; 3]>,
}

impl<'a> Columns<'a> {
    /// The columns, if all are there.
    pub(crate) fn of(extra: &'a [ExtraColumn]) -> Option<Self> {
        let column = |name: &str| extra.iter().find(|column| column.name == name).map(|column| &column.values);
        let single = |name: &str| match column(name)? {
            ExtraValues::F32(values) => Some(values.as_slice()),
            _ => None,
        };
        let [red, green, blue] = OFFSETS.map(single);
        Some(Self {
            value: single(VALUE)?,
            rest: single(REST),
            spread: single(SPREAD)?,
            gradient: single(GRADIENT)?,
            consistency: single(CONSISTENCY)?,
            surfaceness: single(SURFACENESS)?,
            depth: single(DEPTH)?,
            offsets: red.zip(green).zip(blue).map(|((red, green), blue)| [red, green, blue]),
        })
    }

    pub(crate) fn value(&self, i: usize) -> f64 {
        f64::from(self.value[i]) + self.rest.map_or(0.0, |rest| f64::from(rest[i]))
    }

    /// Change of its colour by training.
    pub(crate) fn offset(&self, i: usize) -> Vec3 {
        self.offsets.map_or(Vec3::ZERO, |columns| Vec3::from_array(columns.map(|column| column[i])))
    }

    /// The average of a transfer function over the values of a Gaussian.
    pub(crate) fn average(&self, averages: &Averages, i: usize) -> Average {
        let half = HALF_WIDTH * f64::from(self.spread[i]);
        averages.over(self.value(i) - half, self.value(i) + half)
    }
}

/// Whether Gaussians have values of their volume.
#[must_use]
pub fn keeps_values(gaussians: &Gaussians) -> bool {
    Columns::of(&gaussians.extra).is_some()
}

/// The mean values of Gaussians in their volume, raw; `None` for Gaussians without them.
#[must_use]
pub fn values(gaussians: &Gaussians) -> Option<Vec<f64>> {
    let columns = Columns::of(&gaussians.extra)?;
    Some((0..gaussians.len()).map(|i| columns.value(i)).collect())
}

/// What Gaussians have of their volume; `None` for Gaussians without it.
#[must_use]
pub fn stored(gaussians: &Gaussians) -> Option<Vec<Source>> {
    let columns = Columns::of(&gaussians.extra)?;
    let source = |i: usize| Source {
        value: columns.value(i),
        spread: f64::from(columns.spread[i]),
        gradient: f64::from(columns.gradient[i]),
        consistency: f64::from(columns.consistency[i]),
        surfaceness: f64::from(columns.surfaceness[i]),
        depth: f64::from(columns.depth[i]),
    };
    Some((0..gaussians.len()).map(source).collect())
}

/// The Gaussians that a transfer function hides: those with values of their volume and an opacity below 1/8192, which no picture
/// shows.
#[must_use]
pub fn hidden(scene: &Scene) -> Mask {
    let mut hidden = Mask::empty(scene.len());
    for unit in scene.units.iter().filter(|unit| keeps_values(&unit.gaussians)) {
        let logits = unit.gaussians.opacity_logit.iter().enumerate();
        logits.filter(|(_, logit)| **logit < HIDDEN_LOGIT).for_each(|(i, _)| hidden.set(unit.first + i, true));
    }
    hidden
}

/// Takes the values from Gaussians. No transfer function changes their look then.
pub fn forget(gaussians: &mut Gaussians) {
    gaussians.extra.retain(|column| !column.name.starts_with(SOURCE_PREFIX));
}

/// Adds a colour to that of Gaussians under every transfer function.
pub fn shift_colors(gaussians: &mut Gaussians, shift: Vec3) {
    let Some(columns) = Columns::of(&gaussians.extra).filter(|_| shift != Vec3::ZERO) else { return };
    let shifted = |k: usize| (0..gaussians.len()).map(|i| (columns.offset(i) + shift)[k]).collect();
    let offsets: [Vec<f32>; 3] = [0, 1, 2].map(shifted);
    OFFSETS.into_iter().zip(offsets).for_each(|(name, column)| set(gaussians, name, ExtraValues::F32(column)));
}

/// Stores the values of Gaussians with them, in place of those that they have.
pub fn store(sources: &[Source], gaussians: &mut Gaussians) {
    let single = |of: fn(&Source) -> f64| ExtraValues::F32(sources.iter().map(|source| of(source) as f32).collect());
    let columns = [
        (VALUE, single(|source| source.value)),
        (SPREAD, single(|source| source.spread)),
        (GRADIENT, single(|source| source.gradient)),
        (CONSISTENCY, single(|source| source.consistency)),
        (SURFACENESS, single(|source| source.surfaceness)),
        (DEPTH, single(|source| source.depth)),
    ];
    gaussians.extra.retain(|column| column.name != REST && !OFFSETS.contains(&column.name.as_str()));
    columns.into_iter().for_each(|(name, values)| set(gaussians, name, values));
    let rest = |source: &Source| (source.value - f64::from(source.value as f32)) as f32;
    if sources.iter().any(|source| rest(source) != 0.0) {
        set(gaussians, REST, ExtraValues::F32(sources.iter().map(rest).collect()));
    }
}

/// Stores the colours of Gaussians as differences from those of the transfer function. That function then gives back their colours, and
/// others change them by as much as the function changes.
pub fn store_colors(gaussians: &mut Gaussians, palette: Vec3, classifier: &Classifier) {
    let averages = Averages::new(classifier);
    let Some(columns) = Columns::of(&gaussians.extra) else { return };
    let Some(shading) = gaussians.shading.as_ref() else { return };
    let offset = |(i, own): (usize, &Vec3)| *own + palette - columns.average(&averages, i).color;
    let offsets: Vec<Vec3> = shading.offset_color.iter().enumerate().map(offset).collect();
    for (k, name) in OFFSETS.into_iter().enumerate() {
        set(gaussians, name, ExtraValues::F32(offsets.iter().map(|offset| offset[k]).collect()));
    }
}

/// Stores the surfaceness that the shading of Gaussians is made for.
pub(crate) fn set_surfaceness(gaussians: &mut Gaussians, values: Vec<f32>) {
    set(gaussians, SURFACENESS, ExtraValues::F32(values));
}

fn set(gaussians: &mut Gaussians, name: &str, values: ExtraValues) {
    match gaussians.extra.iter_mut().find(|column| column.name == name) {
        Some(column) => column.values = values,
        None => gaussians.extra.push(ExtraColumn { name: name.to_owned(), values }),
    }
}

/// Makes the values of Gaussians fit opacities, lengths and colours that a training has changed. The transfer function is that of
/// the training. So that function gives back the trained scene, and others keep what training found out about the depth of each
/// Gaussian. `start` is the scene before the training, with the same Gaussians.
pub fn follow_training(trained: &mut Scene, start: &Scene, classifier: &Classifier) {
    let averages = Averages::new(classifier);
    for (unit, start) in trained.units.iter_mut().zip(&start.units) {
        follow(&mut unit.gaussians, &start.gaussians, unit.palette, &averages);
    }
}

fn follow(trained: &mut Gaussians, start: &Gaussians, palette: Vec3, averages: &Averages) {
    let Some(columns) = Columns::of(&start.extra) else { return };
    let mut depths = Vec::with_capacity(trained.len());
    let mut offsets = [(); 3].map(|()| Vec::with_capacity(trained.len()));
    for i in 0..trained.len() {
        let average = columns.average(averages, i);
        // By the lengths alone: the same matter over another area of the picture.
        let own = f64::from(columns.depth[i]) * area(start, i) / area(trained, i);
        let found = dilogarithm(f64::from(trained.opacity(i)).clamp(0.0, 1.0)) / average.depth;
        // The columns of a damaged file can hold anything.
        let depth = if average.depth > LEAST_DEPTH && found.is_finite() && own > 0.0 {
            found.clamp(own / GREATEST_FACTOR, own * GREATEST_FACTOR)
        } else {
            own
        };
        depths.push(depth as f32);
        let color = trained.shading.as_ref().map_or(Vec3::ZERO, |shading| shading.offset_color[i]) + palette;
        let offset = if average.opacity > 0.0 { color - average.color } else { Vec3::ZERO };
        offsets.iter_mut().zip(offset.to_array()).for_each(|(column, x)| column.push(x));
    }
    set(trained, DEPTH, ExtraValues::F32(depths));
    OFFSETS.into_iter().zip(offsets).for_each(|(name, column)| set(trained, name, ExtraValues::F32(column)));
}

/// Product of the two longer standard deviations of a Gaussian.
fn area(gaussians: &Gaussians, i: usize) -> f64 {
    let mut lengths = gaussians.scale(i).as_dvec3().to_array();
    lengths.sort_by(f64::total_cmp);
    lengths[1] * lengths[2]
}
