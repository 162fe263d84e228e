//! Labels of Gaussians from a label volume in the same world frame, and scores of base units against labels.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;
use sg_scene::model::Scene;
use sg_volume::{Bounds, Classifier, Field, Volume};

/// Largest number of base units.
pub(crate) const MAX_UNITS: usize = 255;

/// The label volume does not fit the scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LabelError {
    /// The label volume fills another box.
    #[error(
        "the labels fill the box {} to {}, the scene's volume {} to {}: give a label volume of the same place and spacing",
        .labels.min, .labels.max, .scene.min, .scene.max
    )]
    BoxMismatch {
        /// Box of the labels.
        labels: Bounds,
        /// Box of the scene.
        scene: Bounds,
    },
    /// A value is not an integer of 32 bits.
    #[error("voxel {voxel} has the value {value}: labels are whole numbers within 32 bits")]
    NotInteger {
        /// Index of the voxel.
        voxel: usize,
        /// Its value.
        value: f64,
    },
    /// The label map has another grid than the volume.
    #[error("the label map has {labels}, and the volume has {volume}: give labels on the grid of the volume")]
    GridMismatch {
        /// The grid of the labels, in words.
        labels: String,
        /// The grid of the volume, in words.
        volume: String,
    },
    /// More labels than a scene can have base units.
    #[error(
        "the label map has {found} labels; at most {MAX_UNITS} base units are possible, the rest included; join some labels"
    )]
    TooMany {
        /// The number of labels.
        found: String,
    },
    /// Every voxel is 0.
    #[error("no voxel has a label: all are 0; give a label map")]
    NoLabel,
}

/// The label of the nearest voxel to each Gaussian's centre, in scene order. The label volume must fill the scene's box to
/// within one of its voxels. Its resolution may differ from that of the scene's volume.
///
/// # Errors
/// [`LabelError`].
pub fn labels_of(scene: &Scene, labels: &Volume) -> Result<Vec<i32>, LabelError> {
    let grid = labels.grid();
    let (found, wanted) = (grid.bounds(), Bounds { min: scene.bounds.min, max: scene.bounds.max });
    let slack = grid.spacing().max_element();
    let apart = |a: DVec3, b: DVec3| (a - b).abs().max_element();
    if apart(found.min, wanted.min) > slack || apart(found.max, wanted.max) > slack {
        return Err(LabelError::BoxMismatch { labels: found, scene: wanted });
    }
    (0..scene.len())
        .map(|i| {
            let voxel = grid.nearest(scene.position(i).unwrap_or(wanted.min));
            label_at(labels, voxel)
        })
        .collect()
}

/// The label of a voxel.
pub(crate) fn label_at(labels: &Volume, voxel: usize) -> Result<i32, LabelError> {
    let value = labels.scalars().get(voxel).unwrap_or(f64::NAN);
    let whole = value.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&value);
    if whole { Ok(value as i32) } else { Err(LabelError::NotInteger { voxel, value }) }
}

/// The base unit that is most like a label.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LabelScore {
    /// The label, above 0.
    pub label: i32,
    /// Its voxels.
    pub voxels: u64,
    /// Index of the base unit.
    pub unit: usize,
    /// Voxels of both over voxels of either.
    pub iou: f64,
    /// Largest share of the label within one base unit, or within what is transparent: 1 where values do not divide it.
    pub purity: f64,
}

/// Scores the visible voxels of each base unit against each label above 0. Labels are those of the same voxels; `None` for a label
/// volume of another size.
#[must_use]
pub fn label_scores(field: &Field, classifier: &Classifier, labels: &Volume) -> Option<Vec<LabelScore>> {
    if labels.grid().dims() != field.grid().dims() {
        return None;
    }
    let units = classifier.unit_count();
    let mut by_label: BTreeMap<i32, Vec<u64>> = BTreeMap::new();
    let mut by_unit = vec![0_u64; units];
    for i in 0..field.grid().len() {
        let raw = field.raw(i);
        // Transparent voxels come last.
        let unit = if classifier.opacity(raw) > 0.0 { classifier.unit(raw).unit } else { units };
        if let Some(count) = by_unit.get_mut(unit) {
            *count += 1;
        }
        let label = labels.scalars().get(i).filter(|x| *x > 0.0 && *x <= f64::from(i32::MAX));
        if let Some(label) = label {
            by_label.entry(label as i32).or_insert_with(|| vec![0; units + 1])[unit] += 1;
        }
    }
    let score = |(label, counts): (i32, Vec<u64>)| {
        let voxels: u64 = counts.iter().sum();
        let most = counts.iter().copied().max().unwrap_or(0);
        let ious = by_unit.iter().zip(&counts).map(|(all, both)| *both as f64 / (all + voxels - both).max(1) as f64);
        let (unit, iou) = ious.enumerate().fold((0, 0.0), |best, one| if one.1 > best.1 { one } else { best });
        LabelScore { label, voxels, unit, iou, purity: most as f64 / voxels.max(1) as f64 }
    };
    Some(by_label.into_iter().map(score).collect())
}

#[cfg(test)]
mod tests {
    use sg_volume::Grid;
    use sg_volume::transfer::{BaseUnitRange, ControlPoint, Scale, TransferFunction, Units};

    use super::*;

    #[test]
    fn labels_are_scored_against_the_unit_that_is_most_like_them() {
        let grid = Grid::unit([10, 2, 1]).unwrap();
        let volume = |of: &dyn Fn(usize) -> f32| {
            let values: Vec<f32> = (0..20).map(of).collect();
            Volume::new(grid.clone(), values.into(), None).unwrap()
        };
        // Values 0 (transparent), 10 and 20 in each row of ten: 4, 3 and 3.
        let field = volume(&|i| [0.0, 0.0, 0.0, 0.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0][i % 10]).to_field();
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        let unit = |name: &str, low, high| BaseUnitRange { name: name.to_owned(), range: [low, high] };
        let function = TransferFunction {
            domain: [0.0, 20.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![point(5.0, 0.0), point(6.0, 1.0)],
            base_units: vec![unit("low", 5.0, 15.0), unit("high", 15.0, 20.0)],
        };
        let classifier = function.classifier(field.range()).unwrap();
        // Label 1 has the first row's 20s, label 7 all 10s and one of the second row's 20s; negative ones do not count.
        let labels = volume(&|i| match i {
            7..=9 => 1.0,
            4..=6 | 14..=17 => 7.0,
            0 => -3.0,
            _ => 0.0,
        });
        let scores = label_scores(&field, &classifier, &labels).unwrap();
        let want = |label, voxels, unit, iou, purity| LabelScore { label, voxels, unit, iou, purity };
        assert_eq!(scores, [want(1, 3, 1, 0.5, 1.0), want(7, 7, 0, 6.0 / 7.0, 6.0 / 7.0)]);
        let other = Volume::new(Grid::unit([2; 3]).unwrap(), vec![0.0_f32; 8].into(), None).unwrap();
        assert_eq!(label_scores(&field, &classifier, &other), None);
    }
}
