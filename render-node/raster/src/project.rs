//! From Gaussians to ellipses on the picture: EWA splatting (Zwicker et al. 2001) as 3DGS does it.
//!
//! In f64 throughout. Positions become relative to the camera before anything is narrowed. The determinant that decides the
//! thinness of an ellipse is a sum of squares.

use std::ops::Range;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use sg_scene::appearance::{Appearance, PixelFilter};
use sg_scene::camera::Camera;
use sg_scene::model::{BaseUnit, Scene};

use crate::cut::{Cutter, Shape};
use crate::report::{Culled, Report};
use crate::shading::{Look, UnitShader};

/// Variance in px² that is added to each picture axis, so that nothing is thinner than a pixel (3DGS).
pub const DILATION: f64 = 0.3;

/// The dilation of a camera's picture in px², and the share of it whose area the opacity keeps.
///
/// A preview of s times the edge shows the means of blocks of 1/s² pixels. In its pixels their dilation is s²·[`DILATION`], and
/// the mean over a block adds (1 − s²)/12: the variance of 1/s even places along a pixel. The first part alone stays in the
/// opacity, since a mean adds no light.
#[must_use]
pub fn dilation(camera: &Camera) -> (f64, f64) {
    let share = camera.preview_scale.powi(2);
    let kept = DILATION * share;
    let variance = kept + (1.0 - share) / 12.0;
    (variance, kept / variance)
}

/// Centres at this view depth or nearer are not drawn, in the scene's length unit.
pub const NEAR: f64 = 1e-6;

/// A Gaussian on the picture: α(x, y) = opacity·exp(−½(u² + v²)) with v = (y − my)/σ and
/// u = (x − mx − slope·(y − my))/ρ.
///
/// That is the Cholesky form of dᵀΣ⁻¹d for Σ = ((a, b), (b, c)): σ² = c, slope = b/c, ρ² = det Σ/c. The matrix form subtracts
/// squares of the distance; this form subtracts distances. A needle of 10⁴ : 1 needs that in f32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ellipse {
    /// Centre in pixels.
    pub(crate) center: DVec2,
    /// Shift of the row's centre per pixel of y.
    pub(crate) slope: f64,
    /// Standard deviation along a row, ρ, in pixels.
    pub(crate) along_row: f64,
    /// Standard deviation over the rows, σ, in pixels.
    pub(crate) over_rows: f64,
}

impl Ellipse {
    /// The ellipse of the rows of the 2 × 3 matrix m. Its covariance is m·mᵀ + dilation; `None` if it overflows.
    fn of(center: DVec2, m: [DVec3; 2], dilation: Dilation) -> Option<Self> {
        let [m0, m1] = m;
        let Dilation { variance, slope } = dilation;
        let c = m1.length_squared() + variance * (1.0 + slope.y * slope.y);
        let det = dilation.determinant(m);
        let shared = m0.dot(m1) + variance * slope.x * slope.y;
        let ellipse = Self { center, slope: shared / c, along_row: (det / c).sqrt(), over_rows: c.sqrt() };
        let finite = center.is_finite()
            && det.is_finite()
            && ellipse.slope.is_finite()
            && ellipse.along_row.is_finite()
            && ellipse.over_rows.is_finite();
        finite.then_some(ellipse)
    }

    /// Half the size of the bounding box of the ellipse's level at `radius` standard deviations, in pixels.
    pub(crate) fn half_size(&self, radius: f64) -> DVec2 {
        DVec2::new(radius * self.along_row.hypot(self.slope * self.over_rows), radius * self.over_rows)
    }

    /// Whether that level reaches the pixel centres of a picture of this size.
    pub(crate) fn reaches(&self, radius: f64, size: DVec2) -> bool {
        let half = self.half_size(radius);
        (self.center + half).cmpge(DVec2::ZERO).all() && (self.center - half).cmple(size).all()
    }
}

/// One shaded Gaussian before the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    /// Centre relative to the eye, in view axes.
    pub(crate) center: DVec3,
    /// Rows of view · transform · rotation · scale: the covariance in view axes is this times its transpose.
    pub(crate) rows: [DVec3; 3],
    /// Colour, and opacity without any compensation of the dilation.
    pub(crate) look: Look,
    /// Share of the dilation whose area the opacity keeps, see [`compensation`].
    pub(crate) kept: f64,
}

/// A covariance that is added on the picture: `variance`·(I + `slope`·`slope`ᵀ).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dilation {
    variance: f64,
    slope: DVec2,
}

impl Dilation {
    /// The same in every direction of the picture.
    pub(crate) fn round(variance: f64) -> Self {
        Self { variance, slope: DVec2::ZERO }
    }

    /// A variance on the optical axis as an angle, seen at a slope.
    pub(crate) fn at(variance: f64, slope: DVec2) -> Self {
        Self { variance: variance * (1.0 + slope.length_squared()), slope }
    }

    /// This share of it.
    fn share(self, share: f64) -> Self {
        Self { variance: share * self.variance, ..self }
    }

    /// The determinant of m·mᵀ and this: |m₀ × m₁|² + ε(|m₀|² + |m₁|² + |s₀m₁ − s₁m₀|²) + ε²(1 + |s|²), with s the slope.
    /// However thin, it is never below its last term.
    fn determinant(self, [m0, m1]: [DVec3; 2]) -> f64 {
        let Self { variance, slope } = self;
        let turned = (slope.x * m1 - slope.y * m0).length_squared();
        m0.cross(m1).length_squared()
            + variance * (m0.length_squared() + m1.length_squared() + turned)
            + variance * variance * (1.0 + slope.length_squared())
    }
}

/// √(det(S + k·D) / det(S + D)) for S = m·mᵀ, the dilation D, and k = `kept`. Times this factor, the opacity of a Gaussian
/// dilated by D has the area that k·D would give it.
///
/// With k = 1 it is 1, as in 3DGS. With k = 0 the dilation adds no light: the 2D filter of Mip-Splatting (Yu et al. 2024). A preview
/// keeps the dilation of the picture that it stands for ([`dilation`]).
pub(crate) fn compensation(m: [DVec3; 2], dilation: Dilation, kept: f64) -> f64 {
    let dilated = dilation.determinant(m);
    if kept < 1.0 && dilated.is_finite() { (dilation.share(kept).determinant(m) / dilated).sqrt() } else { 1.0 }
}

/// The ellipse and the opacity of a Gaussian in the affine projection, for a camera of these focal lengths and this principal
/// point in pixels.
pub(crate) fn project(
    placed: &Placed,
    focal: DVec2,
    principal: DVec2,
    dilation: Dilation,
) -> Result<(Ellipse, f64), Culled> {
    let Placed { center, rows: [x, y, z], look, kept } = *placed;
    if center.z <= NEAR {
        return Err(Culled::Near);
    }
    let slope = center.truncate() / center.z;
    let pixels = focal / center.z;
    // Rows of the Jacobian times those.
    let m = [pixels.x * (x - slope.x * z), pixels.y * (y - slope.y * z)];
    let ellipse = Ellipse::of(focal * slope + principal, m, dilation).ok_or(Culled::NotFinite)?;
    let opacity = look.opacity * compensation(m, dilation, kept);
    if opacity == 0.0 {
        return Err(Culled::Transparent);
    }
    Ok((ellipse, opacity))
}

/// Gaussians handled by one task. Only the order of results matters, and they are put together in order.
const CHUNK: usize = 4096;

/// Places and shades all Gaussians in index order, including those behind the eye. `keep` gets the scene-wide index of each.
/// It narrows a Gaussian to a rasterizer's form, or culls it. The counts of the report are added up.
pub(crate) fn place<T: Send>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    keep: impl Fn(u32, Placed) -> Result<T, Culled> + Sync,
) -> (Vec<T>, Report) {
    each(scene, appearance, camera, |unit, i| unit.place(i).and_then(|p| keep(unit.index(i), p)))
}

/// Places and shades one Gaussian by its scene-wide index; `None` if it is not drawn or not there.
pub(crate) fn place_one(scene: &Scene, appearance: &Appearance, camera: &Camera, index: u32) -> Option<Placed> {
    let at = scene.units.iter().position(|unit| unit.range().contains(&(index as usize)))?;
    let (unit, base, eye) = (scene.units.get(at)?, appearance.base.get(at)?, camera.eye());
    let shader = UnitShader::new(unit, *base, appearance, eye);
    UnitProjector::new(unit, shader, appearance, camera, eye).place(index as usize - unit.first).ok()
}

/// The results of `one` for every Gaussian, in index order.
fn each<T: Send>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    one: impl Fn(&UnitProjector, usize) -> Result<T, Culled> + Sync,
) -> (Vec<T>, Report) {
    let eye = camera.eye();
    let units: Vec<UnitProjector> = scene
        .units
        .iter()
        .zip(&appearance.base)
        .map(|(unit, base)| {
            UnitProjector::new(unit, UnitShader::new(unit, *base, appearance, eye), appearance, camera, eye)
        })
        .collect();
    let tasks: Vec<(&UnitProjector, Range<usize>)> = units
        .iter()
        .flat_map(|u| {
            let n = u.unit.gaussians.len();
            (0..n).step_by(CHUNK).map(move |start| (u, start..(start + CHUNK).min(n)))
        })
        .collect();
    let parts: Vec<(Vec<T>, Report)> = tasks
        .into_par_iter()
        .map(|(unit, range)| {
            let mut kept = Vec::with_capacity(range.len());
            let mut counts = Report::default();
            for i in range {
                match one(unit, i) {
                    Ok(item) => kept.push(item),
                    Err(culled) => counts.count(culled),
                }
            }
            counts.drawn = kept.len();
            (kept, counts)
        })
        .collect();
    let mut report = Report { gaussians: scene.len(), ..Report::default() };
    let mut all = Vec::with_capacity(parts.iter().map(|(kept, _)| kept.len()).sum());
    for (kept, counts) in parts {
        all.extend(kept);
        report.add_counts(&counts);
    }
    (all, report)
}

/// The data of one base unit and the camera that projecting needs.
struct UnitProjector<'a> {
    unit: &'a BaseUnit,
    shader: UnitShader<'a>,
    eye: DVec3,
    scene_to_view: DMat3,
    local_to_view: DMat3,
    cutter: Cutter,
    kept: f64,
}

impl<'a> UnitProjector<'a> {
    fn new(unit: &'a BaseUnit, shader: UnitShader<'a>, appearance: &Appearance, camera: &Camera, eye: DVec3) -> Self {
        let scene_to_view = DMat3::from_mat4(camera.view());
        Self {
            unit,
            shader,
            eye,
            scene_to_view,
            local_to_view: scene_to_view * DMat3::from_mat4(unit.transform),
            cutter: Cutter::of(appearance, scene_to_view, eye),
            kept: match appearance.filter {
                PixelFilter::FromFile if unit.gaussians.antialiased => 0.0,
                PixelFilter::Compensated => 0.0,
                PixelFilter::FromFile | PixelFilter::Plain => dilation(camera).1,
            },
        }
    }

    /// Scene-wide index of the unit's Gaussian `i`.
    fn index(&self, i: usize) -> u32 {
        (self.unit.first + i) as u32
    }

    fn place(&self, i: usize) -> Result<Placed, Culled> {
        let gaussians = &self.unit.gaussians;
        let (Some(position), Some(log_scale), Some(rotation)) =
            (gaussians.position.get(i), gaussians.log_scale.get(i), gaussians.rotation.get(i))
        else {
            return Err(Culled::NotFinite);
        };
        // A scale of zero (logarithm −∞) is a point, and the dilation makes it visible. No other infinity means anything.
        let scale = log_scale.as_dvec3().exp();
        if !(position.is_finite() && scale.is_finite() && rotation.iter().all(|q| q.is_finite())) {
            return Err(Culled::NotFinite);
        }
        let in_scene = self.unit.transform.transform_point3(position.as_dvec3());
        // Relative to the eye first: far from the origin, rounding there moves all Gaussians alike and keeps their order.
        let center = self.scene_to_view * (in_scene - self.eye);
        let axes = DMat3::from_quat(gaussians.unit_rotation(i));
        let axes = DMat3::from_cols(axes.x_axis * scale.x, axes.y_axis * scale.y, axes.z_axis * scale.z);
        let DMat3 { x_axis, y_axis, z_axis } = (self.local_to_view * axes).transpose();
        let cut = self.cutter.cut(Shape { center, rows: [x_axis, y_axis, z_axis] }).ok_or(Culled::Clipped)?;
        let look = self.shader.look(i, in_scene)?;
        let look = Look { opacity: cut.opacity(look.opacity), ..look };
        Ok(Placed { center: cut.shape.center, rows: cut.shape.rows, look, kept: self.kept })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_cholesky_form_is_the_quadratic_form(
            m in proptest::array::uniform6(-30.0..30.0_f64), x in -50.0..50.0_f64, y in -50.0..50.0_f64,
            s in proptest::array::uniform2(-2.0..2.0_f64),
        ) {
            let rows = [DVec3::new(m[0], m[1], m[2]), DVec3::new(m[3], m[4], m[5])];
            let e = Ellipse::of(DVec2::ZERO, rows, Dilation::at(DILATION, DVec2::from_array(s))).unwrap();
            // 0.3 px² at the axis; elsewhere the same angle by the projection's Jacobian.
            let grown = 0.3 * (1.0 + s[0] * s[0] + s[1] * s[1]);
            let a = rows[0].length_squared() + grown * (1.0 + s[0] * s[0]);
            let b = rows[0].dot(rows[1]) + grown * s[0] * s[1];
            let c = rows[1].length_squared() + grown * (1.0 + s[1] * s[1]);
            let want = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b);
            let (u, v) = ((x - e.slope * y) / e.along_row, y / e.over_rows);
            prop_assert!((u * u + v * v - want).abs() <= 1e-9 * (1.0 + want));
            let half = e.half_size(1.0);
            prop_assert!((half.x - a.sqrt()).abs() < 1e-9 && (half.y - c.sqrt()).abs() < 1e-9);
        }
    }

    #[test]
    fn a_needle_keeps_its_thickness() {
        // 1e9 px long at 45°, no width: the textbook determinant a·c − b² loses it entirely.
        let row = DVec3::new(1e9, 0.0, 0.0);
        let e = Ellipse::of(DVec2::ZERO, [row, row], Dilation::at(DILATION, DVec2::ZERO)).unwrap();
        let (a, c) = (1e18 + 0.3, 1e18 + 0.3);
        assert_eq!(a * c - 1e18 * 1e18, 0.0);
        // Across the diagonal the variance is the dilation: ρ²·sin²45° = 0.3.
        assert!((e.along_row.powi(2) * 0.5 / DILATION - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_overflows_is_refused() {
        assert!(
            Ellipse::of(DVec2::ZERO, [DVec3::splat(1e200), DVec3::X], Dilation::at(DILATION, DVec2::ZERO)).is_none()
        );
        assert!(
            Ellipse::of(DVec2::new(f64::INFINITY, 0.0), [DVec3::Y, DVec3::X], Dilation::at(DILATION, DVec2::ZERO))
                .is_none()
        );
    }
}
