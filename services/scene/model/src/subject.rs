//! The subject of a picture: the extents of what is visible, and the nearest view that shows all of it.
//!
//! A camera that looks along a fixed direction sees a point where it lies on the inner side of the four side planes of its
//! frustum. Each pair of opposite planes has one apex at which both touch the subject: the nearest place from which that
//! axis of the picture shows all. The farther one of both apexes is the eye; the other axis is centred.

use glam::{DMat3, DVec3};

use crate::appearance::Appearance;
use crate::model::{Scene, SceneBox};
use crate::view::{MARGIN, View};

/// Share of the weight at either end that may be strays. Trained scenes have some, which would make all else tiny.
const STRAYS: f64 = 0.005;

/// Share of the extent of all else by which a stray lies beyond it at least. What is nearer is the tip of a structure.
const APART: f64 = 0.15;

/// Least distance of the eye from the subject, as a share of the subject's depth.
const CLEAR: f64 = 0.05;

/// Standard deviations of a Gaussian that count as its extent.
const REACH: f64 = 2.0;

/// Least peak opacity of a visible Gaussian: half a step of an 8-bit picture.
const VISIBLE: f64 = 0.5 / 255.0;

/// Most Gaussians that are looked at, and most that are measured; of more, a regular subset.
const MOST: [usize; 2] = [1 << 20, 1 << 17];

/// A place that a picture shows, scene coordinates.
#[derive(Debug, Clone, Copy)]
struct Extent {
    center: DVec3,
    /// Half axes of an ellipsoid.
    axes: DMat3,
    /// Weight against strays, above 0: the opacity. In a scene from a volume it is 1: there the transfer function makes whole
    /// structures faint.
    weight: f64,
}

impl Extent {
    /// Half its width along `direction` times that vector's length.
    fn reach(&self, direction: DVec3) -> f64 {
        (self.axes.transpose() * direction).length()
    }
}

/// What a picture is of.
#[derive(Debug, Clone, Default)]
pub struct Subject {
    extents: Vec<Extent>,
}

impl Subject {
    /// All Gaussians that `appearance` draws: not those that are hidden, clipped away or fainter than a step of an 8-bit
    /// picture. An appearance of another scene hides what it does not know.
    #[must_use]
    pub fn of(scene: &Scene, appearance: &Appearance) -> Self {
        let mut visible = Vec::new();
        let stride = scene.len().div_ceil(MOST[0]).max(1);
        for (unit, base) in scene.units.iter().zip(&appearance.base).filter(|(_, base)| base.visible) {
            for local in (0..unit.gaussians.len()).step_by(stride) {
                let global = unit.first + local;
                let mut opacity = f64::from(base.opacity) * f64::from(unit.gaussians.opacity(local));
                for edit in appearance.units.iter().filter(|edit| edit.mask.get(global)) {
                    opacity *= if edit.visible { f64::from(edit.opacity) } else { 0.0 };
                }
                if opacity >= VISIBLE {
                    let weight = if unit.gaussians.shading.is_some() { 1.0 } else { opacity.min(1.0) };
                    visible.push((unit, local, weight));
                }
            }
        }
        let extent = |(unit, local, weight): (&crate::model::BaseUnit, usize, f64)| {
            let center = unit.transform.transform_point3(unit.gaussians.position.get(local)?.as_dvec3());
            let turned = DMat3::from_quat(unit.gaussians.unit_rotation(local));
            let scaled = DMat3::from_diagonal(REACH * unit.gaussians.scale(local).as_dvec3());
            let axes = DMat3::from_mat4(unit.transform) * turned * scaled;
            let finite = center.is_finite() && axes.to_cols_array().iter().all(|x| x.is_finite());
            let kept = finite && appearance.clips.iter().all(|clip| clip.keeps(center));
            kept.then_some(Extent { center, axes, weight })
        };
        let stride = visible.len().div_ceil(MOST[1]).max(1);
        Self { extents: visible.into_iter().step_by(stride).filter_map(extent).collect() }
    }

    /// A box. Without extent it counts as a unit cube about its place.
    #[must_use]
    pub fn of_box(bounds: SceneBox) -> Self {
        let middle = 0.5 * (bounds.min + bounds.max);
        let half = 0.5 * bounds.size();
        let half = if half.max_element() > 0.0 { half } else { DVec3::splat(0.5) };
        let corner = |k: u32| {
            let sign = |bit: u32| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let center = middle + half * DVec3::new(sign(0), sign(1), sign(2));
            Extent { center, axes: DMat3::ZERO, weight: 1.0 }
        };
        Self { extents: (0..8).map(corner).collect() }
    }

    /// The nearest view along `direction` (from the eye to the subject) that shows the subject in a picture of this aspect,
    /// width over height, with [`MARGIN`] to spare. The target is in the middle of its depth.
    ///
    /// `up` is the scene direction that points up in the picture. The vertical field of view is in degrees, clamped to 1 to
    /// 170. A direction of no length counts as +y. `None` for a subject without extent.
    #[must_use]
    pub fn view(&self, direction: DVec3, up: DVec3, fov_y_degrees: f64, aspect: f64) -> Option<View> {
        let fov_y_degrees = fov_y_degrees.clamp(1.0, 170.0);
        let forward = direction.try_normalize().unwrap_or(DVec3::Y);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let above = right.cross(forward);
        let aspect = if aspect.is_finite() && aspect > 0.0 { aspect } else { 1.0 };
        let tangent = (1.0 - MARGIN) * (0.5 * fov_y_degrees.to_radians()).tan();
        let across = self.apex(right, forward, tangent * aspect)?;
        let upright = self.apex(above, forward, tangent)?;
        let near = |e: &Extent| e.center.dot(forward) - e.reach(forward);
        let far = |e: &Extent| e.center.dot(forward) + e.reach(forward);
        let (near, far) = (self.end(near, Side::Low)?, self.end(far, Side::High)?);
        let depth = 0.5 * (near + far);
        // A wide frustum could have its apex on a corner of the subject.
        let eye_depth = across.depth.min(upright.depth).min(near - CLEAR * (far - near));
        let in_plane = across.at * right + upright.at * above;
        let (eye, target) = (in_plane + eye_depth * forward, in_plane + depth * forward);
        let view = View { eye, target, up, fov_y_degrees };
        // A point has no distance to be seen from.
        let scale = eye.abs().max_element().max(target.abs().max_element());
        (depth - eye_depth > 1e-9 * scale && view.eye.is_finite()).then_some(view)
    }

    /// The box of the subject along the scene's axes, without strays as in [`Subject::view`]. Gaussians reach two standard
    /// deviations. `None` for a subject of nothing.
    #[must_use]
    pub fn bounds(&self) -> Option<SceneBox> {
        let ends = |axis: DVec3| {
            let low = self.end(|e| e.center.dot(axis) - e.reach(axis), Side::Low)?;
            Some((low, self.end(|e| e.center.dot(axis) + e.reach(axis), Side::High)?))
        };
        let (x, y, z) = (ends(DVec3::X)?, ends(DVec3::Y)?, ends(DVec3::Z)?);
        Some(SceneBox { min: DVec3::new(x.0, y.0, z.0), max: DVec3::new(x.1, y.1, z.1) })
    }

    /// The apex of the two planes that touch the subject and open by `tangent` about `forward`.
    fn apex(&self, axis: DVec3, forward: DVec3, tangent: f64) -> Option<Apex> {
        let (left, right) = (axis + tangent * forward, axis - tangent * forward);
        let low = self.end(|e| e.center.dot(left) - e.reach(left), Side::Low)?;
        let high = self.end(|e| e.center.dot(right) + e.reach(right), Side::High)?;
        Some(Apex { at: 0.5 * (low + high), depth: (low - high) / (2.0 * tangent) })
    }

    /// The end of the values on one side without strays.
    fn end(&self, value: impl Fn(&Extent) -> f64, side: Side) -> Option<f64> {
        let mut values: Vec<(f64, f64)> = self.extents.iter().map(|e| (value(e), e.weight)).collect();
        let total: f64 = values.iter().map(|(_, weight)| weight).sum();
        // Stable: equal values keep the order of the scene, so that sums are the same everywhere.
        values.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let beyond = |values: &mut dyn Iterator<Item = &(f64, f64)>| {
            let mut passed = 0.0;
            for (value, weight) in values {
                passed += weight;
                if passed > STRAYS * total {
                    return Some(*value);
                }
            }
            None
        };
        let (low, high) = (beyond(&mut values.iter())?, beyond(&mut values.iter().rev())?);
        let apart = APART * (high - low);
        match side {
            Side::Low => values.iter().map(|(value, _)| *value).find(|value| *value >= low - apart),
            Side::High => values.iter().rev().map(|(value, _)| *value).find(|value| *value <= high + apart),
        }
    }
}

/// A side of an axis.
#[derive(Debug, Clone, Copy)]
enum Side {
    Low,
    High,
}

/// The place of the eye along one axis of the picture.
#[derive(Debug, Clone, Copy)]
struct Apex {
    /// Along the axis.
    at: f64,
    /// Along the view.
    depth: f64,
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DVec2, Vec3};
    use proptest::prelude::*;

    use super::*;
    use crate::appearance::{Clip, UnitAppearance};
    use crate::camera::Camera;
    use crate::mask::Mask;
    use crate::synthetic::test_scene;
    use crate::tone::Tone;

    /// How far a scene point lies from the middle of the picture, 1 at its edges.
    fn off(camera: &Camera, p: DVec3) -> DVec2 {
        let p = camera.view().transform_point3(p);
        assert!(p.z > 0.0, "behind the eye");
        let pixel = DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
        let half = 0.5 * DVec2::new(camera.width.into(), camera.height.into());
        ((pixel - half) / half).abs()
    }

    proptest! {
        #[test]
        fn a_box_touches_two_opposite_sides_of_the_picture_and_stays_inside(
            d in proptest::array::uniform3(-1.0..1.0_f64), s in proptest::array::uniform3(0.01..50.0_f64),
            c in proptest::array::uniform3(-1e4..1e4_f64), fov in 10.0..110.0_f64, width in 32_u32..2000, height in 32_u32..2000,
        ) {
            let (direction, middle, half) = (DVec3::from_array(d), DVec3::from_array(c), DVec3::from_array(s));
            prop_assume!(direction.length() > 0.01 && direction.cross(DVec3::Z).length() > 0.01);
            let bounds = SceneBox { min: middle - half, max: middle + half };
            let aspect = f64::from(width) / f64::from(height);
            let subject = Subject::of_box(bounds);
            let view = subject.view(direction, DVec3::Z, fov, aspect).unwrap();
            prop_assert!(view.check().is_ok());
            let camera = view.camera(width, height);
            let reach = subject.extents.iter().fold(DVec2::ZERO, |reach, e| reach.max(off(&camera, e.center)));
            prop_assert!(reach.max_element() <= 1.0 - MARGIN + 1e-6, "{reach}");
            let depths = subject.extents.iter().map(|e| camera.view().transform_point3(e.center).z);
            let (near, far) = depths.fold((f64::INFINITY, 0.0_f64), |(near, far), z| (near.min(z), far.max(z)));
            let close = near < 1.001 * CLEAR * (far - near);
            let filled = (reach.max_element() - (1.0 - MARGIN)).abs() < 1e-6;
            prop_assert!(filled || close, "the box reaches to {reach}, {near} from the eye");
        }
    }

    /// A cloud of unit size with its first Gaussian moved to `stray`.
    fn cloud(stray: Option<Vec3>) -> Scene {
        let mut scene = test_scene(&[("cloud", 400)]);
        if let Some(stray) = stray {
            scene.units[0].gaussians.position[0] = stray;
            scene.units[0].gaussians.position[1] = Vec3::splat(f32::NAN);
        }
        scene
    }

    fn view_of(scene: &Scene, look: &Appearance) -> Option<View> {
        Subject::of(scene, look).view(DVec3::Y, DVec3::Z, 40.0, 1.5)
    }

    #[test]
    fn a_stray_hidden_faded_or_clipped_gaussian_does_not_change_the_view() {
        let near = cloud(None);
        let first = view_of(&near, &Appearance::of(&near)).unwrap();
        let distance = first.eye.distance(first.target);
        let far = cloud(Some(Vec3::splat(1e6)));
        let look = Appearance::of(&far);
        let after = view_of(&far, &look).unwrap();
        assert!((after.eye - first.eye).length() < 0.1 * distance, "{first:?} {after:?}");

        // Half of the Gaussians far away are no strays: only what an edit leaves is framed.
        let mut split = cloud(None);
        split.units[0].gaussians.position.iter_mut().step_by(2).for_each(|p| *p += Vec3::new(500.0, 0.0, 0.0));
        let mask = Arc::new(Mask::from_fn(split.len(), |i| i % 2 == 0));
        let all = Appearance::of(&split);
        let wide = view_of(&split, &all).unwrap();
        assert!(wide.eye.distance(wide.target) > 10.0 * distance, "{wide:?}");
        let edit = |opacity, visible| UnitAppearance {
            mask: Arc::clone(&mask),
            color: None,
            opacity,
            visible,
            tone: Tone::NEUTRAL,
        };
        let clip = Clip::between(DVec3::splat(-100.0), DVec3::splat(100.0), true);
        for look in [
            Appearance { units: vec![edit(1.0, false)], ..all.clone() },
            Appearance { units: vec![edit(1e-3, true)], ..all.clone() },
            Appearance { clips: vec![clip], ..all.clone() },
        ] {
            let view = view_of(&split, &look).unwrap();
            assert!((view.eye - first.eye).length() < 0.3 * distance, "{first:?} {view:?}");
        }
    }

    #[test]
    fn the_box_holds_what_is_visible_and_no_stray() {
        let near = cloud(None);
        let bounds = |scene: &Scene, look: &Appearance| Subject::of(scene, look).bounds();
        let all = bounds(&near, &Appearance::of(&near)).unwrap();
        let reach = REACH * f64::from((-2.0_f32).exp());
        let centres = SceneBox::of_points(near.units[0].gaussians.position.iter().copied());
        assert!((all.min - (centres.min - reach)).abs().max_element() < 1e-6, "{all:?} {centres:?}");
        assert!((all.max - (centres.max + reach)).abs().max_element() < 1e-6, "{all:?} {centres:?}");
        let far = cloud(Some(Vec3::splat(1e6)));
        let without = bounds(&far, &Appearance::of(&far)).unwrap();
        assert!((without.max - all.max).abs().max_element() < 0.5, "{all:?} {without:?}");
        // What is clipped away is not in it.
        let clip = Clip::plane(DVec3::splat(5.0), DVec3::X);
        let half = bounds(&near, &Appearance { clips: vec![clip], ..Appearance::of(&near) }).unwrap();
        assert!(half.min.x > 4.0 && half.max.x == all.max.x, "{half:?}");
        let mut hidden = Appearance::of(&near);
        hidden.base[0].visible = false;
        assert_eq!(bounds(&near, &hidden), None);
        let unit = SceneBox { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) };
        assert_eq!(Subject::of_box(unit).bounds(), Some(unit));
    }

    /// A twentieth of the Gaussians, with a twentieth of the opacity, below the others: a leaf under its pot.
    #[test]
    fn a_faint_structure_of_a_volume_is_framed() {
        let mut scene = cloud(None);
        let gaussians = &mut scene.units[0].gaussians;
        let lowest = gaussians.position.iter().map(|p| p.z).fold(f32::INFINITY, f32::min);
        for i in (0..400).step_by(20) {
            gaussians.position[i].z = lowest - 1.0 - i as f32 / 20.0;
            gaussians.opacity_logit[i] = -3.0;
        }
        let camera = view_of(&scene, &Appearance::of(&scene)).unwrap().camera(300, 200);
        let reach = |scene: &Scene| {
            scene.units[0].gaussians.position.iter().map(|p| off(&camera, p.as_dvec3()).y).fold(0.0, f64::max)
        };
        assert!(reach(&scene) < 1.0, "{}", reach(&scene));
        // The same in a trained file may be strays.
        scene.units[0].gaussians.shading = None;
        let trained = view_of(&scene, &Appearance::of(&scene)).unwrap();
        assert_ne!(trained.camera(300, 200), camera);
    }

    #[test]
    fn what_is_not_there_has_no_view() {
        let scene = cloud(None);
        let mut look = Appearance::of(&scene);
        look.base[0].visible = false;
        assert_eq!(view_of(&scene, &look), None);
        let point = Extent { center: DVec3::ONE, axes: DMat3::ZERO, weight: 1.0 };
        let point = Subject { extents: vec![point] };
        assert_eq!(point.view(DVec3::Y, DVec3::Z, 40.0, 1.0), None);
        let ball = Extent { center: DVec3::ONE, axes: DMat3::IDENTITY, weight: 1.0 };
        let view = Subject { extents: vec![ball] }.view(DVec3::Y, DVec3::Z, 90.0, 1.0).unwrap();
        // Planes of slope 0.95 touch the unit ball.
        let distance = (1.0_f64 + 0.95 * 0.95).sqrt() / 0.95;
        assert!((view.eye.distance(view.target) - distance).abs() < 1e-9, "{view:?}");
        assert!((view.target - DVec3::ONE).length() < 1e-9);
    }
}
