//! What the values of one time step are around a Gaussian: samples at fixed places of its own axes.

use std::borrow::Cow;

use glam::{DVec3, Vec3};
use sg_volume::grid::GridError;
use sg_volume::opacity::extinction;
use sg_volume::{Classifier, Field, ScalarFieldRef, Surfaceness};

/// Voxels along the longest side of the grid that stands for a mesh here: for changes of values, never for the scene itself.
const MESH_EDGE: usize = 160;
/// Distance in standard deviations of the samples along the axes, and of those between them along each axis.
const REACH: [f64; 2] = [1.2, 0.8];

/// A time step as voxels.
pub(super) struct Voxels<'a> {
    field: Cow<'a, Field>,
    reference: f64,
}

/// Sums over the samples of a Gaussian. Each number is a mean.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sampled {
    /// Optical depth of one length under the transfer function, of values of its own base unit alone.
    pub(super) depth: f64,
    /// Colour, weighted by that depth; only where there is some.
    pub(super) color: Vec3,
    /// Raw value, and its standard deviation.
    pub(super) value: f64,
    pub(super) spread: f64,
    /// Raw units per voxel.
    pub(super) gradient: Vec3,
    /// Length of the mean gradient over the mean length.
    pub(super) consistency: f64,
    /// Surfaceness.
    pub(super) surfaceness: f64,
}

/// Place and axes of a Gaussian in the world: each axis has the length of a standard deviation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) middle: DVec3,
    pub(super) axes: [DVec3; 3],
}

impl<'a> Voxels<'a> {
    pub(super) fn of(field: ScalarFieldRef<'a>) -> Result<Self, GridError> {
        Ok(match field {
            ScalarFieldRef::Grid(field) => {
                Self { field: Cow::Borrowed(field), reference: field.grid().reference_length() }
            }
            ScalarFieldRef::Mesh(field) => {
                let reference = field.reference_length();
                Self { field: Cow::Owned(field.resampled(MESH_EDGE)?), reference }
            }
        })
    }

    pub(super) fn field(&self) -> &Field {
        &self.field
    }

    /// The samples of a Gaussian of a base unit. `surfaceness` is that of gradients in raw units per voxel.
    pub(super) fn around(
        &self,
        place: &Place,
        unit: usize,
        classifier: &Classifier,
        surfaceness: &Surfaceness,
    ) -> Sampled {
        let grid = self.field.grid();
        let edge = grid.voxel_volume().cbrt() as f32;
        let middle = grid.to_voxel(place.middle);
        let axes = place.axes.map(|axis| grid.vector_to_voxel(axis));
        let mut found = Sampled::default();
        let (mut color, mut lengths, mut finite, mut squares) = (DVec3::ZERO, 0.0, 0.0_f64, 0.0);
        for way in ways() {
            let at = middle + axes[0] * way.x + axes[1] * way.y + axes[2] * way.z;
            let Some(raw) = self.field.sample(at).filter(|raw| raw.is_finite()) else { continue };
            finite += 1.0;
            let step = raw - found.value;
            found.value += step / finite;
            squares += step * (raw - found.value);
            let gradient = self.field.gradient(at) * edge;
            found.gradient += gradient;
            lengths += f64::from(gradient.length());
            if classifier.unit(raw).unit == unit {
                let (own, opacity) = classifier.evaluate(raw);
                let depth = f64::from(extinction(opacity, self.reference)) * self.reference;
                found.depth += depth;
                color += own.as_dvec3() * depth;
            }
        }
        if found.depth > 0.0 {
            found.color = (color / found.depth).as_vec3();
        }
        found.depth /= COUNT as f64;
        if finite > 0.0 {
            let length = f64::from(found.gradient.length());
            found.consistency = if lengths > 0.0 { length / lengths } else { 0.0 };
            found.gradient /= finite as f32;
            found.spread = (squares / finite).sqrt();
            let rise = surfaceness.rise(found.value, (lengths / finite) as f32);
            found.surfaceness = Surfaceness::of_part(found.consistency, found.consistency * f64::from(rise));
        }
        found
    }
}

/// Samples of a Gaussian.
const COUNT: usize = 15;

/// Their places in standard deviations: the middle, both ways along each axis, and the corners between.
fn ways() -> [DVec3; COUNT] {
    let [along, between] = REACH;
    std::array::from_fn(|k| match k {
        0 => DVec3::ZERO,
        1..=6 => {
            let mut way = DVec3::ZERO;
            way[(k - 1) / 2] = if k % 2 == 1 { along } else { -along };
            way
        }
        _ => {
            let side = |bit: usize| if (k - 7) >> bit & 1 == 0 { between } else { -between };
            DVec3::new(side(0), side(1), side(2))
        }
    })
}
