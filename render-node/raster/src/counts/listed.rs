//! The Gaussians that a device lists: the twin of `cull.wgsl`.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use sg_scene::appearance::{Appearance, BaseAppearance};
use sg_scene::camera::Camera;
use sg_scene::model::{BaseUnit, Scene};

use crate::cut::REACH;
use crate::cutoffs::Limits;
use crate::nearness::{AFFINE_SIZE, dilation_slope, may_fade};
use crate::project::NEAR;
use crate::ray_consistent::Pinhole;

/// Number of Gaussians that may reach a picture.
pub(super) fn listed(scene: &Scene, appearance: &Appearance, cameras: &[Camera], limits: Limits) -> u64 {
    let views: Vec<View> = cameras.iter().map(View::of).collect();
    // Edits may raise the opacity to 1 at most.
    let radius = (2.0 * (1.0 / limits.cut).max(limits.ratio).ln()).sqrt();
    let units = scene.units.iter().zip(&appearance.base).filter(|(_, base)| base.visible);
    units.map(|(unit, base)| of_unit(unit, base, appearance, &views, radius)).sum()
}

fn of_unit(unit: &BaseUnit, base: &BaseAppearance, appearance: &Appearance, views: &[View], radius: f64) -> u64 {
    let g = &unit.gaussians;
    let linear = DMat3::from_mat4(unit.transform);
    let axes = [linear.x_axis, linear.y_axis, linear.z_axis];
    let stretch =
        if linear == DMat3::IDENTITY { 1.0 } else { axes.iter().map(|a| a.length_squared()).sum::<f64>().sqrt() };
    let is_listed = |i: &usize| {
        let (Some(position), Some(log_scale), Some(logit)) =
            (g.position.get(*i), g.log_scale.get(*i), g.opacity_logit.get(*i))
        else {
            return false;
        };
        let scale = log_scale.as_dvec3().exp();
        let turned = g.rotation.get(*i).is_some_and(|q| q.iter().all(|x| x.is_finite()));
        let opacity = f64::from(base.opacity) / (1.0 + (-f64::from(*logit)).exp());
        if !(position.is_finite() && scale.is_finite() && turned && opacity > 0.0) {
            return false;
        }
        let global = unit.first + *i;
        if appearance.units.iter().any(|edit| !edit.visible && edit.mask.get(global)) {
            return false;
        }
        let at = unit.transform.transform_point3(position.as_dvec3());
        let size = stretch * scale.max_element();
        if appearance.clips.iter().any(|clip| !clip.may_keep(at, REACH * size)) {
            return false;
        }
        views.iter().any(|view| view.may_reach(at, size, radius))
    };
    (0..g.len()).into_par_iter().filter(is_listed).count() as u64
}

/// One camera.
struct View {
    pinhole: Pinhole,
    eye: DVec3,
    turn: DMat3,
}

impl View {
    fn of(camera: &Camera) -> Self {
        Self { pinhole: Pinhole::of(camera), eye: camera.eye(), turn: DMat3::from_mat4(camera.view()) }
    }

    /// `may_reach` of the shader for one view.
    fn may_reach(&self, center: DVec3, size: f64, radius: f64) -> bool {
        let at = self.turn * (center - self.eye);
        // At least its size, the root of the covariance's trace.
        let most = 3.0_f64.sqrt() * size;
        if may_fade(at.length(), most, self.pinhole.near) || most >= AFFINE_SIZE * at.z {
            if self.may_meet_rays(at, radius * size, radius) {
                return true;
            }
            if most >= AFFINE_SIZE * at.z {
                return false;
            }
        }
        if at.z <= NEAR {
            return false;
        }
        let slope = at.truncate() / at.z;
        let stretch = self.pinhole.focal / at.z * (DVec2::ONE + slope * slope).map(f64::sqrt);
        let dilated = dilation_slope(at, self.pinhole.slopes(), self.pinhole.near).length_squared();
        let half = radius * (stretch * size + 0.55 * (1.0 + dilated)) + 0.5;
        let pixel = self.pinhole.focal * slope + self.pinhole.principal;
        !((pixel + half).cmplt(DVec2::ZERO).any() || (pixel - half).cmpgt(self.pinhole.size).any())
    }

    /// `may_meet_rays` of the shader.
    fn may_meet_rays(&self, at: DVec3, half: f64, radius: f64) -> bool {
        let Pinhole { focal, principal, size, .. } = self.pinhole;
        let most = at.abs().max_element().max(1e-30);
        let c = at / most;
        let dilated = 0.5478 * c.length() / (focal.x * focal.y).abs().sqrt();
        let reached = 1.001 * (half / most + radius * dilated);
        let edge = size - principal;
        let outside = [
            -(focal.x * c.x + principal.x * c.z) / focal.x.hypot(principal.x),
            (focal.x * c.x - edge.x * c.z) / focal.x.hypot(edge.x),
            -(focal.y * c.y + principal.y * c.z) / focal.y.hypot(principal.y),
            (focal.y * c.y - edge.y * c.z) / focal.y.hypot(edge.y),
        ];
        // What is not a number stays.
        !outside.iter().any(|beyond| *beyond > reached)
    }
}
