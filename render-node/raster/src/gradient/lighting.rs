//! Derivatives of the shading of one Gaussian ([`shade`](crate::shading::shade)).

use glam::DVec3;
use sg_scene::model::ShadingModel;

use crate::shading::Surface;

/// Derivatives of the loss by the attributes of a surface and its directions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct SurfaceGradient {
    pub(super) diffuse_color: DVec3,
    pub(super) normal: DVec3,
    pub(super) ambient: f64,
    pub(super) diffuse: f64,
    pub(super) specular: f64,
    pub(super) shininess: f64,
    /// By the unit vector to the eye.
    pub(super) to_eye: DVec3,
    /// By the unit vector to the light.
    pub(super) to_light: DVec3,
}

/// Derivatives of the loss by all that [`shade`](crate::shading::shade) takes. `by_color` has those by the shaded colour. A channel
/// that the clamp to `[0, 1]` holds has none. At a kink, such as n·l = 0, the value is that of the dark side.
pub(super) fn by_surface(
    model: ShadingModel,
    surface: &Surface,
    to_eye: DVec3,
    to_light: DVec3,
    by_color: DVec3,
) -> SurfaceGradient {
    let Surface { diffuse_color, normal, ambient, diffuse, specular, shininess } = *surface;
    // max(x, 0) or |x|, and its derivative.
    let side = |x: f64| match model {
        ShadingModel::Paper => (x.max(0.0), if x > 0.0 { 1.0 } else { 0.0 }),
        ShadingModel::IvrgsTrain | ShadingModel::IvrgsViewer if x == 0.0 => (0.0, 0.0),
        ShadingModel::IvrgsTrain | ShadingModel::IvrgsViewer => (x.abs(), x.signum()),
    };
    let sum = to_light + to_eye;
    let half = sum.normalize_or_zero();
    let (facing, facing_slope) = side(normal.dot(to_light));
    let (shine, shine_slope) = side(normal.dot(half));
    let is_lit = model == ShadingModel::Paper || facing > 0.0;
    let power = if is_lit { shine.powf(shininess) } else { 0.0 };
    let by_viewer = if model == ShadingModel::IvrgsViewer { diffuse } else { 1.0 };
    let color = (ambient + diffuse * facing) * diffuse_color + specular * by_viewer * power;
    let open = color.cmpge(DVec3::ZERO) & color.cmple(DVec3::ONE);
    let by_color = DVec3::select(open, by_color, DVec3::ZERO);

    let by_brightness = by_color.dot(diffuse_color);
    let by_highlight = by_color.element_sum();
    let by_facing = by_brightness * diffuse * facing_slope;
    let by_power = by_highlight * specular * by_viewer;
    let by_shine = if shine > 0.0 && is_lit { by_power * shininess * shine.powf(shininess - 1.0) } else { 0.0 };
    let by_shine = by_shine * shine_slope;
    let by_half = by_shine * normal;
    // Of a sum of two unit vectors, normalized.
    let length = sum.length();
    let by_sum = if length > 0.0 { (by_half - half * half.dot(by_half)) / length } else { DVec3::ZERO };
    let viewer_part = if model == ShadingModel::IvrgsViewer { by_highlight * specular * power } else { 0.0 };
    SurfaceGradient {
        diffuse_color: (ambient + diffuse * facing) * by_color,
        normal: by_facing * to_light + by_shine * half,
        ambient: by_brightness,
        diffuse: by_brightness * facing + viewer_part,
        specular: by_highlight * by_viewer * power,
        shininess: if shine > 0.0 { by_power * power * shine.ln() } else { 0.0 },
        to_eye: by_sum,
        to_light: by_facing * normal + by_sum,
    }
}
