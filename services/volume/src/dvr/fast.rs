//! The fast twin of ray marching: the same samples in f32.

use glam::{Mat3, Vec3};

use super::stencil::Stencil;
use super::{CollectedLight, Illumination, Lighting, Material, Ray, RayMarcher};
use crate::opacity::correct_opacity;

/// Transmittance at which a ray ends.
const LEAST_TRANSMITTANCE: f32 = 5e-4;

pub(super) struct FastMarcher<'a> {
    of: &'a RayMarcher<'a>,
    stencil: Stencil<'a>,
    gradient_to_world: Mat3,
    lighting: Option<(Material, Illumination)>,
}

impl<'a> FastMarcher<'a> {
    pub(super) fn new(of: &'a RayMarcher<'a>, lighting: Lighting) -> Self {
        let lighting = match lighting {
            Lighting::Unlit => None,
            Lighting::Lit(material, light) => Some((material, light)),
        };
        let gradient_to_world = of.field.gradient_to_world();
        Self { of, stencil: Stencil::new(of.field), gradient_to_world, lighting }
    }

    /// Adds the samples of one part of a ray.
    pub(super) fn march(&self, ray: &Ray, (near, far): (f64, f64), light: &mut CollectedLight) {
        let step = self.of.step;
        // All samples but the last one stand for a whole step. The last one is in the middle of what is left.
        let whole = ((far - near) / step).ceil().max(1.0) - 1.0;
        let first = ray.start + ray.along * (near + 0.5 * step);
        let stride = ray.along * step;
        let inverse = stride.recip();
        let (origin, advance) = (first.as_vec3(), stride.as_vec3());
        let to_eye = -ray.direction.as_vec3();
        let mut color = light.color;
        let mut transmittance = light.transmittance as f32;
        let mut next = 0.0_f64;
        while next < whole {
            let at = first + stride * next;
            let around = self.of.blocks.stretch(at);
            let way = around.way_out(at, inverse);
            if !around.is_visible {
                next += way.floor().max(1.0);
                continue;
            }
            let end = (next + way.floor() + 1.0).min(whole);
            let (from, to) = (next as u32, end as u32);
            for k in from..to {
                let place = origin + advance * k as f32;
                let alpha = self.sample(place, to_eye, transmittance, &mut color, |alpha| alpha);
                transmittance *= 1.0 - alpha;
                if transmittance < LEAST_TRANSMITTANCE {
                    *light = CollectedLight { color, transmittance: f64::from(transmittance) };
                    return;
                }
            }
            next = end;
        }
        let rest = far - near - whole * step;
        let last = (ray.start + ray.along * (far - 0.5 * rest)).as_vec3();
        let alpha = self.sample(last, to_eye, transmittance, &mut color, |alpha| {
            correct_opacity(f64::from(alpha), rest, step) as f32
        });
        *light = CollectedLight { color, transmittance: f64::from(transmittance * (1.0 - alpha)) };
    }

    /// Adds one sample and returns its opacity, as `over` changes the one over a whole step.
    fn sample(
        &self,
        place: Vec3,
        to_eye: Vec3,
        transmittance: f32,
        color: &mut Vec3,
        over: impl Fn(f32) -> f32,
    ) -> f32 {
        let cell = self.stencil.cell(place);
        let mut value = cell.map_or(f32::NAN, |cell| self.stencil.value(cell));
        if value.is_nan() {
            // The border, or a NaN beside the sample, which may have no weight.
            value = self.of.field.stored(place.as_dvec3()).unwrap_or(f32::NAN);
        }
        let (own, alpha) = self.of.table.at(value);
        if alpha <= 0.0 {
            return 0.0;
        }
        let alpha = over(alpha);
        let shaded = match &self.lighting {
            None => own,
            Some((material, light)) => {
                let gradient = cell.and_then(|cell| self.stencil.gradient(cell)).filter(|g| g.is_finite());
                let gradient = gradient.map_or_else(
                    || self.of.field.gradient(place.as_dvec3()),
                    |per_voxel| self.gradient_to_world * per_voxel,
                );
                let raw = self.of.field.offset() + f64::from(value);
                material.lit(own, gradient, self.of.surfaceness.at(raw, gradient.length()), to_eye, *light)
            }
        };
        *color += transmittance * alpha * shaded;
        alpha
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DMat4, DVec3};

    use super::super::{ClipRegion, HalfSpace, Image, Pinhole, VolumeRenderer as _};
    use super::*;
    use crate::grid::Grid;
    use crate::phantom::{VesselTree, transfer_function};
    use crate::scalars::Scalars;
    use crate::transfer::{Scale, TransferFunction};
    use crate::volume::Volume;
    use crate::{Classifier, Field};

    const MATERIAL: Material =
        Material { haze_ambient: 0.6, ambient: 0.3, diffuse: 0.6, specular: 0.2, shininess: 9.0 };

    fn vessels() -> Field {
        VesselTree::new().rasterize(64, 1).unwrap().volume().unwrap().to_field()
    }

    fn camera(field: &Field, turn: f64, away: f64) -> Pinhole {
        let bounds = field.grid().bounds();
        let middle = 0.5 * (bounds.min + bounds.max);
        let out = DVec3::new(f64::cos(turn), f64::sin(turn), 0.4) * away * (bounds.max - bounds.min).max_element();
        let ahead = -out.normalize();
        let right = ahead.cross(DVec3::Z).normalize();
        let axes = DMat3::from_cols(right, ahead.cross(right), ahead).transpose();
        let world_to_camera = DMat4::from_mat3(axes) * DMat4::from_translation(-middle - out);
        Pinhole { width: 80, height: 60, focal: [80.0; 2], center: [40.0, 30.0], world_to_camera }
    }

    /// The root of the mean square, and the greatest difference.
    fn differences(a: &Image, b: &Image) -> (f32, f32) {
        let differences = || a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(|(a, b)| (a - b).abs());
        let squares: f32 = differences().map(|d| d * d).sum();
        ((squares / (4 * a.pixels.len()) as f32).sqrt(), differences().fold(0.0, f32::max))
    }

    fn assert_close(field: &Field, classifier: &Classifier, clips: Vec<ClipRegion>, seen: f32) {
        let marcher = RayMarcher::new(field, classifier.clone(), 0.5).clipped(clips);
        for (turn, away) in [(0.3, 1.6), (2.0, 0.2), (4.0, 3.0)] {
            let camera = camera(field, turn, away);
            let lit = |light| Lighting::Lit(MATERIAL, light);
            let beside = Illumination::Direction(Vec3::new(1.0, 2.0, 3.0));
            for lighting in [Lighting::Unlit, lit(Illumination::Headlight), lit(beside)] {
                let exact = marcher.picture(&camera, lighting, Vec3::ONE);
                let (root, most) = differences(&marcher.fast_picture(&camera, lighting, Vec3::ONE), &exact);
                assert!(root < 5e-4 && most < 0.01, "{turn}, {lighting:?}: {root}, {most}");
                assert!(exact.pixels.iter().any(|p| p[3] > seen), "nothing to see");
            }
        }
    }

    #[test]
    fn the_fast_picture_is_that_of_its_twin() {
        let field = vessels();
        let classifier = transfer_function().classifier(field.range()).unwrap();
        assert_close(&field, &classifier, Vec::new(), 0.5);
        for unit in 0..classifier.unit_count() {
            assert_close(&field, &classifier.only(unit), Vec::new(), 0.5);
        }
    }

    #[test]
    fn so_it_is_on_a_skewed_grid_with_holes_and_a_logarithmic_scale() {
        let whole = vessels();
        let grid = whole.grid();
        let turned = DMat3::from_rotation_y(0.4);
        let grid = Grid::new(grid.dims(), DVec3::new(0.7, 1.0, 1.9), DVec3::splat(-40.0), turned).unwrap();
        let values: Vec<f32> = whole
            .values()
            .iter()
            .enumerate()
            .map(|(i, v)| if i % 17 == 0 && grid.voxel(i).y > 30 { f32::NAN } else { v + 2.0 })
            .collect();
        let field = Volume::new(grid, Scalars::from(values), None).unwrap().to_field();
        let mut function = TransferFunction { scale: Scale::Log10, ..transfer_function() };
        function.domain = [1.0, function.domain[1].max(2.0)];
        function.points.iter_mut().for_each(|point| point.value = point.value.max(1.0));
        let classifier = function.classifier(field.range()).unwrap();
        assert_close(&field, &classifier, Vec::new(), 0.3);
    }

    #[test]
    fn and_where_planes_and_boxes_clip() {
        let field = vessels();
        let classifier = transfer_function().classifier(field.range()).unwrap();
        let bounds = field.grid().bounds();
        let middle = 0.5 * (bounds.min + bounds.max);
        let side = |normal: DVec3, at: DVec3| HalfSpace { normal, offset: normal.dot(at) };
        let plane = ClipRegion { sides: vec![side(DVec3::new(1.0, 0.3, 0.1), middle)], keeps_inside: true };
        let hole = [DVec3::X, DVec3::Y, DVec3::Z]
            .into_iter()
            .flat_map(|axis| [side(axis, middle.lerp(bounds.min, 0.3)), side(-axis, middle.lerp(bounds.max, 0.3))]);
        let hole = ClipRegion { sides: hole.collect(), keeps_inside: false };
        assert_close(&field, &classifier, vec![plane], 0.3);
        assert_close(&field, &classifier, vec![hole], 0.3);
    }
}
