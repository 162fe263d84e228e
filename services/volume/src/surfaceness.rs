//! How clearly the values around a place are a boundary.

use crate::classifier::Classifier;
use crate::field::Field;

/// Rise across one voxel up to which a gradient counts as noise, relative to the range of values.
const NOISE: f32 = 0.004;
/// Rise across one voxel from which a gradient counts as a clear boundary.
const BOUNDARY: f32 = 0.03;

/// Consistency up to which gradients point anywhere, and from which they point to one side.
const CONSISTENT: [f64; 2] = [0.2, 0.7];

/// From gradients of one field to surfaceness under one transfer function: 0 for homogeneous values and noise, 1 for a clear
/// boundary. Normalised gradients of noise point anywhere, so shading by them glitters. Kniss et al. (2003, "A model for volume
/// lighting and modeling", section 3.1) mix shaded and unshaded colours by such a weight.
#[derive(Debug, Clone)]
pub struct Surfaceness {
    slope: Slope,
}

/// Relative rise across one voxel for a gradient of length 1.
#[derive(Debug, Clone)]
enum Slope {
    /// For a linear scale: the same for all values.
    Constant(f32),
    /// For others: this factor times the slope of the scale at the value.
    OfScale(Classifier, f64),
}

impl Surfaceness {
    /// The values of the field on the scale of the transfer function, within its domain, are the range that rises refer to.
    #[must_use]
    pub fn new(field: &Field, classifier: &Classifier) -> Self {
        Self::of_range([field.range().low, field.range().high], field.grid().voxel_volume().cbrt(), classifier)
    }

    /// That of a field with these least and greatest raw values and voxels of this edge. With an edge of 1, gradients are in raw
    /// units per voxel.
    #[must_use]
    pub fn of_range(values: [f64; 2], edge: f64, classifier: &Classifier) -> Self {
        let [low, high] = values.map(|raw| classifier.scaled(raw));
        let factor = if high > low { edge / (high - low) } else { 0.0 };
        let slope = match classifier.linear() {
            Some((_, slope)) => Slope::Constant((factor * slope) as f32),
            None => Slope::OfScale(classifier.clone(), factor),
        };
        Self { slope }
    }

    /// The rise of the scaled value across one voxel, relative to its range, where the gradient has this length (raw units per
    /// world length). The edge of a cube of a voxel's volume stands for the voxel.
    #[must_use]
    pub fn rise(&self, raw: f64, gradient_length: f32) -> f32 {
        gradient_length
            * match &self.slope {
                Slope::Constant(slope) => *slope,
                Slope::OfScale(classifier, factor) => (factor * classifier.slope(raw)) as f32,
            }
    }

    /// The surfaceness of a rise; 0 for NaN.
    #[must_use]
    pub fn of_rise(rise: f32) -> f32 {
        if rise.is_nan() {
            return 0.0;
        }
        let t = ((rise - NOISE) / (BOUNDARY - NOISE)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// The surfaceness of a part of the volume. `consistency` is the length of its mean gradient over the mean length, and `rise`
    /// is that of the mean gradient. A surface has gradients that point to one side and are strong.
    #[must_use]
    pub fn of_part(consistency: f64, rise: f64) -> f64 {
        let t = ((consistency - CONSISTENT[0]) / (CONSISTENT[1] - CONSISTENT[0])).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t) * f64::from(Self::of_rise(rise as f32))
    }

    /// The surfaceness at a place with this value and this length of the gradient.
    #[must_use]
    pub fn at(&self, raw: f64, gradient_length: f32) -> f32 {
        Self::of_rise(self.rise(raw, gradient_length))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::grid::Grid;
    use crate::transfer::{ControlPoint, Scale, TransferFunction, Units};
    use crate::volume::Volume;

    /// Values from 1 to 1000 along x, and a function over all of them.
    fn ramp(scale: Scale, units: Units, of: impl Fn(f64) -> f64) -> (Field, Surfaceness) {
        let grid = Grid::new([101, 3, 3], DVec3::splat(0.5), DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(|i| of(grid.voxel(i).as_dvec3().x / 100.0) as f32).collect();
        let field = Volume::new(grid, values.into(), None).unwrap().to_field();
        let domain = if units == Units::Raw { [1.0, 1000.0] } else { [0.0, 1.0] };
        let point = ControlPoint { value: domain[1], color: [1.0; 3], opacity: 1.0 };
        let function =
            TransferFunction { domain, units, scale, variable: None, points: vec![point], base_units: Vec::new() };
        let surfaceness = Surfaceness::new(&field, &function.classifier(field.range()).unwrap());
        (field, surfaceness)
    }

    #[test]
    fn even_rises_on_the_scale_of_the_function_count_alike() {
        let linear = |t: f64| 1.0 + 999.0 * t;
        let powers = |t: f64| 1000.0_f64.powf(t);
        for (scale, units, of) in [
            (Scale::Linear, Units::Raw, &linear as &dyn Fn(f64) -> f64),
            (Scale::Linear, Units::Normalized, &linear),
            (Scale::Log10, Units::Raw, &powers),
        ] {
            let (field, surfaceness) = ramp(scale, units, of);
            for x in [10, 50, 90] {
                let value = field.raw(field.grid().index(x, 1, 1));
                let rise = surfaceness.rise(value, field.gradient_at(x, 1, 1).length());
                assert!((rise - 0.01).abs() < 1e-5, "{scale:?}, {units:?}, {x}: {rise}");
            }
        }
        // The signed logarithm is near the logarithm for values far above 1.
        let (field, surfaceness) = ramp(Scale::Symlog, Units::Raw, powers);
        let rise = surfaceness.rise(field.raw(field.grid().index(90, 1, 1)), field.gradient_at(90, 1, 1).length());
        assert!((rise - 0.011).abs() < 1e-3, "{rise}");
    }

    #[test]
    fn constant_fields_and_nan_have_none() {
        let (field, surfaceness) = ramp(Scale::Linear, Units::Raw, |_| 5.0);
        assert_eq!(surfaceness.at(field.raw(0), 1.0), 0.0);
        assert_eq!(Surfaceness::of_rise(f32::NAN), 0.0);
        assert_eq!([0.0, NOISE, BOUNDARY, 1.0].map(Surfaceness::of_rise), [0.0, 0.0, 1.0, 1.0]);
    }
}
