//! Derivatives through the cut of a Gaussian by clips, from those of its kept part: [`crate::cut`] backwards.

use glam::DVec3;

use crate::cut::{Cut, Kept, Shape, Step};

/// Derivatives by a Gaussian.
#[derive(Debug, Clone, Copy)]
pub(super) struct ByShape {
    /// By the centre in view axes.
    pub(super) center: DVec3,
    /// By the rows of the root of the covariance.
    pub(super) rows: [DVec3; 3],
    /// By the logarithm of the opacity.
    pub(super) log_opacity: f64,
}

/// The derivatives by the whole Gaussian, of this opacity, from those by its kept part.
pub(super) fn backward(cut: &Cut, opacity: f64, by: ByShape) -> ByShape {
    let Some(first) = cut.steps.first() else { return by };
    let whole = &first.before;
    // With the optical depth L = −ln(1 − o), the kept part has the opacity 1 − exp(−f·L).
    let (depth, kept_opacity, factor) = (-(-opacity).ln_1p(), cut.opacity(opacity), cut.depth_factor());
    let (mut log_opacity, mut by_log_factor) = (0.0, 0.0);
    if opacity < 1.0 && kept_opacity > 0.0 {
        let left = (-factor * depth).exp() / kept_opacity;
        log_opacity = by.log_opacity * opacity * factor * left / (1.0 - opacity);
        by_log_factor = by.log_opacity * factor * depth * left;
    }
    let mut by = ByShape { log_opacity, ..by };
    let mut by_direction = DVec3::ZERO;
    let [area, kept_area] = [whole, &cut.shape].map(|shape| shape.seen_area(whole.center));
    let has_area = kept_area.length() > 0.0 && area.length() > 0.0;
    if has_area {
        let by_area = -by_log_factor / kept_area.length_squared() * kept_area;
        by_direction += add_area(&cut.shape, whole.center, by_area, &mut by.rows);
    }
    for step in cut.steps.iter().rev() {
        by = before(step, by_log_factor, by);
    }
    if has_area {
        by_direction += add_area(whole, whole.center, by_log_factor / area.length_squared() * area, &mut by.rows);
    }
    by.center += by_direction;
    by
}

/// Adds the derivatives by the rows of [`Shape::seen_area`]; returns those by the direction.
fn add_area(shape: &Shape, direction: DVec3, by: DVec3, by_rows: &mut [DVec3; 3]) -> DVec3 {
    let [x, y, z] = shape.rows;
    let DVec3 { x: a, y: b, z: c } = direction;
    let [by_x, by_y, by_z] = by_rows;
    *by_x += b * by.cross(z) + c * y.cross(by);
    *by_y += a * z.cross(by) + c * by.cross(x);
    *by_z += a * by.cross(y) + b * x.cross(by);
    DVec3::new(by.dot(y.cross(z)), by.dot(z.cross(x)), by.dot(x.cross(y)))
}

/// The derivatives by the Gaussian before one plane.
fn before(step: &Step, by_log_mass: f64, by: ByShape) -> ByShape {
    let &Step { normal, before: Shape { rows, .. }, deviation, axis, kept } = step;
    let Kept { at, mean, variance, .. } = kept;
    let root = variance.sqrt();
    let narrowed = 1.0 - root;
    // cₖ' = cₖ + m·pₖ and rₖ' = rₖ − q·pₖ·â, with pₖ = rₖ·â and q = 1 − √v.
    let (mut by_mean, mut by_narrowed, mut by_axis) = (0.0, 0.0, DVec3::ZERO);
    let mut found = by;
    for (k, row) in rows.into_iter().enumerate() {
        let (along, by_row) = (row.dot(axis), by.rows[k]);
        let by_along = mean * by.center[k] - narrowed * by_row.dot(axis);
        by_mean += along * by.center[k];
        by_narrowed -= along * by_row.dot(axis);
        by_axis += by_along * row - narrowed * along * by_row;
        found.rows[k] += by_along * axis;
    }
    // d ln Φ/dt = m, dm/dt = v − 1, dv/dt = −(dm/dt·(2m + t) + m).
    let mean_by_at = variance - 1.0;
    let variance_by_at = -(mean_by_at * (2.0 * mean + at) + mean);
    let by_at = by_log_mass * mean + by_mean * mean_by_at - by_narrowed * variance_by_at / (2.0 * root);
    // t = (n·c − offset)/s with s = |a| and â = a/s, for a = Σ nₖ·rₖ.
    found.center += by_at / deviation * normal;
    let by_across = (by_axis - axis * axis.dot(by_axis) - by_at * at * axis) / deviation;
    for (k, by_row) in found.rows.iter_mut().enumerate() {
        *by_row += normal[k] * by_across;
    }
    found
}
