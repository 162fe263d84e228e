//! A scene with fixed colours as an editable one.

use glam::{DMat3, Vec3};
use rayon::prelude::*;

use crate::splat::columns::C0;
use crate::splat::columns::is_normal;
use crate::splat::problem::{Warning, WarningCode};
use sg_scene::model::{BaseUnit, Convention, ShadingColumns, ShadingModel};

/// Adds shading columns to a unit that has none, with the same picture for its constant harmonic. Palette 0, offset
/// colour ½ + C₀·dc, ka = 1, kd = ks = 0, β = 1. The normal is the Gaussian's shortest axis, of no particular side.
///
/// Light then reaches it once ka, kd and ks are changed. View-dependent harmonics are not kept.
pub(crate) fn make_editable(unit: &mut BaseUnit, warnings: &mut Vec<Warning>) {
    let g = &mut unit.gaussians;
    if g.shading.is_some() {
        return;
    }
    let n = g.len();
    let harmonics = g.harmonics.take().unwrap_or_default();
    let mut offset_color: Vec<Vec3> =
        harmonics.dc.par_iter().map(|dc| (Vec3::from_array(*dc).as_dvec3() * C0 + 0.5).as_vec3()).collect();
    offset_color.resize(n, Vec3::splat(0.5));
    let shortest_axis = |i: usize| {
        let axes = DMat3::from_quat(g.unit_rotation(i));
        let scale = g.log_scale.get(i).copied().unwrap_or_default();
        let least = if scale.z <= scale.x && scale.z <= scale.y {
            axes.z_axis
        } else if scale.y <= scale.x {
            axes.y_axis
        } else {
            axes.x_axis
        };
        least.as_vec3()
    };
    let normal = (0..n).into_par_iter().map(shortest_axis).collect();
    g.shading = Some(ShadingColumns {
        offset_color,
        normal,
        ambient: vec![1.0; n],
        diffuse: vec![0.0; n],
        specular: vec![0.0; n],
        shininess: vec![1.0; n],
    });
    g.extra.retain(|e| !is_normal(&e.name));
    unit.palette = Vec3::ZERO;
    unit.convention = Convention::Ours;
    unit.shading = ShadingModel::Paper;
    unit.oriented_normals = false;
    let mut message = format!(
        "unit `{}` had no shading columns: it is unlit (ka 1, kd 0, ks 0), its palette is 0, its normals are the shortest axes",
        unit.name
    );
    if harmonics.degree > 0 {
        message.push_str(", its view-dependent colours are not kept");
    }
    warnings.push(Warning::new(WarningCode::Lossy, message));
}
