//! Ray-consistent splatting: the color of a ray does not depend on the orientation of the picture plane.
//!
//! Let c be the center relative to the eye, Σ the covariance, r the ray's direction, all in view axes. Then α is
//! the opacity times the greatest value exp(−½d²) of the 3D Gaussian on the ray, times the share of the Gaussian that
//! the ray meets beyond the near distance. Gaussians are ordered on each ray by the place of that maximum (StopThePop,
//! Radl et al. 2024; perspective-correct splatting, Hahlbohm et al. 2025). With Σ = LLᵀ, u = L⁻¹c and w = L⁻¹r:
//!
//! - d² = |u × w|²/|w|², at t = u·w/|w|² of r; along the ray the standard deviation is σ = 1/|w|.
//! - The share is Φ((t − n)/√(σ² + (0.2n)²)), with n the near distance in units of r and a polynomial in the place of Φ
//!   ([`share_beyond`]). It is that part of the Gaussian's integral along the ray. So a Gaussian fades while the eye
//!   passes through it, and nothing pops.
//!
//! Dilation: Σ grows by 0.3·(|c|/f)²·I. On the optical axis that is the 0.3 px² of the affine projection. Elsewhere
//! it is the same angle, so that turning the head changes nothing. The part along the ray does not change d.
//!
//! Linear functions of the ray are linear in the pixel: w, a = û·w and the two components of û × w across u, with û = u/|u|. In
//! them d² = |u|²·s/(a² + s) and t = |u|·a/(a² + s) with s = U² + V². No term divides by the depth of the center. So the center
//! may lie beside or behind the eye.
//!
//! The affine projection draws Gaussians that are large in the picture in this form too ([`crate::footprint`]).

pub(crate) mod reference_f64;
pub(crate) mod splat_f32;

use glam::{DMat2, DVec2, DVec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::foveation::BLOCK;
use crate::nearness::{NEAR_BLUR, is_faded, may_fade, share_beyond, size_of};
use crate::project::{Dilation, Ellipse, Placed, compensation, dilation, place};
use crate::report::{Culled, Report};
use crate::tiles::picture_size;

/// A number that is linear in the pixel's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linear {
    /// At pixel coordinates (0, 0).
    pub(crate) at_zero: f64,
    pub(crate) per_x: f64,
    pub(crate) per_y: f64,
}

impl Linear {
    /// The component along `axis` of a vector that is `at_zero + x·per_x + y·per_y`.
    fn along(axis: DVec3, [at_zero, per_x, per_y]: [DVec3; 3]) -> Self {
        Self { at_zero: axis.dot(at_zero), per_x: axis.dot(per_x), per_y: axis.dot(per_y) }
    }

    pub(crate) fn at(&self, pixel: DVec2) -> f64 {
        self.at_zero + self.per_x * pixel.x + self.per_y * pixel.y
    }

    /// The same number by coordinates of blocks of pixels.
    fn in_blocks(&self) -> Self {
        let edge = BLOCK as f64;
        Self { at_zero: self.at_zero, per_x: edge * self.per_x, per_y: edge * self.per_y }
    }
}

/// The meeting of a ray and a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Meeting {
    /// Squared Mahalanobis distance d² of the ray from the centre.
    pub(crate) distance_squared: f64,
    /// View z of the place of the maximum, at least 0.
    pub(crate) depth: f64,
    /// Share of the Gaussian beyond the near distance, 0 to 1.
    pub(crate) share: f64,
}

/// How a Gaussian fades near the eye.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fading {
    /// |w| for rays with z = 1, over the scale of the rays.
    pub(crate) scale: f64,
    /// x of the rays' directions.
    pub(crate) right: Linear,
    /// y of the rays' directions.
    pub(crate) down: Linear,
    /// The near distance.
    pub(crate) near: f64,
}

/// One shaded Gaussian as the rays of a camera meet it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RaySplat {
    /// Scene-wide index.
    pub(crate) index: u32,
    /// a, up to the scale of the rays.
    pub(crate) toward: Linear,
    /// U, in that scale.
    pub(crate) across: Linear,
    /// V, in that scale; no part per x.
    pub(crate) over: Linear,
    /// |u|², the squared Mahalanobis distance of the eye.
    pub(crate) eye_squared: f64,
    /// |u| over the scale of the rays: the factor from a/(a² + s) to view z.
    pub(crate) depth_scale: f64,
    /// Only where a ray may see less than all of it.
    pub(crate) fading: Option<Fading>,
    /// RGB, at least 0.
    pub(crate) color: DVec3,
    /// Above 0, at most 1.
    pub(crate) opacity: f64,
    /// Covariance in view axes with the dilation: xx, xy, yy, xz, yz, zz.
    covariance: [f64; 6],
    center: DVec3,
    /// Share of the perspective within it.
    perspective: f64,
}

/// A pinhole camera as rays need it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pinhole {
    pub(crate) focal: DVec2,
    pub(crate) principal: DVec2,
    pub(crate) size: DVec2,
    /// The near distance.
    pub(crate) near: f64,
    /// Variance of the dilation on the optical axis, px².
    pub(crate) dilation: f64,
    /// Variance that the dilation adds at unit distance.
    spread: f64,
}

impl Pinhole {
    pub(crate) fn of(camera: &Camera) -> Self {
        let (dilation, _) = dilation(camera);
        Self {
            near: camera.near,
            focal: DVec2::new(camera.fx, camera.fy),
            principal: DVec2::new(camera.cx, camera.cy),
            size: picture_size(camera.width, camera.height),
            dilation,
            spread: dilation / (camera.fx * camera.fy).abs(),
        }
    }

    /// x and y of the rays, with z = 1, through the picture's first and last corner.
    pub(crate) fn slopes(&self) -> [DVec2; 2] {
        [DVec2::ZERO, self.size].map(|corner| (corner - self.principal) / self.focal)
    }

    /// Direction of the ray through pixel coordinates, with z = 1.
    fn ray(&self, pixel: DVec2) -> DVec3 {
        ((pixel - self.principal) / self.focal).extend(1.0)
    }
}

/// Direction in view axes, with z = 1, of the ray through pixel coordinates.
pub(crate) fn ray(camera: &Camera, pixel: DVec2) -> DVec3 {
    Pinhole::of(camera).ray(pixel)
}

/// All Gaussians that are drawn, in index order.
pub(crate) fn splats<T: Send>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    keep: impl Fn(RaySplat) -> Result<T, Culled> + Sync,
) -> (Vec<T>, Report) {
    let pinhole = Pinhole::of(camera);
    place(scene, appearance, camera, |index, placed| keep(RaySplat::of(index, &placed, &pinhole, 1.0)?))
}

/// One Gaussian as the rays of a camera meet it.
pub(crate) fn splat(index: u32, placed: &Placed, camera: &Camera) -> Option<RaySplat> {
    RaySplat::of(index, placed, &Pinhole::of(camera), 1.0).ok()
}

/// The columns of L with LLᵀ = rows·rowsᵀ + dilation·I, lower triangular, by Gram and Schmidt on the rows extended
/// by √dilation. Products of the covariance's entries would lose thin Gaussians.
fn cholesky(rows: [DVec3; 3], dilation: f64) -> [[f64; 3]; 3] {
    let root = dilation.sqrt();
    let mut vectors = [(rows[0], root * DVec3::X), (rows[1], root * DVec3::Y), (rows[2], root * DVec3::Z)];
    let mut lower = [[0.0; 3]; 3];
    for k in 0..3 {
        let (a, b) = vectors[k];
        let length = (a.length_squared() + b.length_squared()).sqrt();
        lower[k][k] = length;
        let unit = (a / length, b / length);
        for j in k + 1..3 {
            let (a, b) = vectors[j];
            let shared = unit.0.dot(a) + unit.1.dot(b);
            lower[j][k] = shared;
            vectors[j] = (a - shared * unit.0, b - shared * unit.1);
        }
    }
    lower
}

/// L⁻¹v.
fn solve(lower: &[[f64; 3]; 3], v: DVec3) -> DVec3 {
    let x = v.x / lower[0][0];
    let y = (v.y - lower[1][0] * x) / lower[1][1];
    let z = (v.z - lower[2][0] * x - lower[2][1] * y) / lower[2][2];
    DVec3::new(x, y, z)
}

impl RaySplat {
    /// `perspective` between 0 and 1 is the share of the perspective within the Gaussian. With 1 the meetings are exact. With 0
    /// they are those of the affine projection, but for the dilation. Below 1 the center must lie in front of the eye.
    pub(crate) fn of(index: u32, placed: &Placed, pinhole: &Pinhole, perspective: f64) -> Result<Self, Culled> {
        let Placed { center, rows, look, kept } = *placed;
        // A center in the eye has no pixel size: any dilation that keeps L regular works.
        let dilation = (pinhole.spread * center.length_squared()).max(f64::MIN_POSITIVE.sqrt());
        let (distance, size) = (center.length(), size_of(&rows).hypot(dilation.sqrt()));
        if is_faded(distance, size, pinhole.near) {
            return Err(Culled::Near);
        }
        let lower = cholesky(rows, dilation);
        let u = solve(&lower, center);
        let per_x = solve(&lower, DVec3::X) / pinhole.focal.x;
        let per_y = solve(&lower, DVec3::Y) / pinhole.focal.y;
        let at_zero = solve(&lower, DVec3::Z) - pinhole.principal.x * per_x - pinhole.principal.y * per_y;
        // d² does not depend on the length of w: take a length that f32 holds.
        let middle = at_zero + 0.5 * (pinhole.size.x * per_x + pinhole.size.y * per_y);
        let scale = middle.length() + pinhole.size.x * per_x.length() + pinhole.size.y * per_y.length();
        let rays = [at_zero / scale, per_x / scale, per_y / scale];
        let eye = u.length();
        let toward = u.try_normalize().unwrap_or(DVec3::Z);
        let turned = toward.cross(rays[1]);
        let first = turned.try_normalize().unwrap_or_else(|| toward.any_orthonormal_vector());
        let second = toward.cross(first);
        // In components across u, û × w.
        let crossed = rays.map(|w| toward.cross(w));
        let over = Linear { per_x: 0.0, ..Linear::along(second, crossed) };
        let opacity = if kept < 1.0 {
            let (e, f) = center.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
            let seen = |axis: DVec3| rows[0] * axis.x + rows[1] * axis.y + rows[2] * axis.z;
            look.opacity * compensation([seen(e), seen(f)], Dilation::round(dilation), kept)
        } else {
            look.opacity
        };
        let [x, y, z] = rows;
        let linear = |axis: usize| {
            let per_pixel = 1.0 / pinhole.focal[axis];
            let along = |k: usize| if k == axis { per_pixel } else { 0.0 };
            Linear { at_zero: -pinhole.principal[axis] * per_pixel, per_x: along(0), per_y: along(1) }
        };
        let fading = may_fade(distance, size, pinhole.near).then(|| Fading {
            scale,
            right: linear(0),
            down: linear(1),
            near: pinhole.near,
        });
        let mut splat = Self {
            index,
            toward: Linear::along(toward, rays),
            across: Linear::along(first, crossed),
            over,
            eye_squared: eye * eye,
            depth_scale: eye / scale,
            fading,
            color: look.color,
            opacity,
            covariance: [
                x.length_squared() + dilation,
                x.dot(y),
                y.length_squared() + dilation,
                x.dot(z),
                y.dot(z),
                z.length_squared() + dilation,
            ],
            center,
            perspective,
        };
        if perspective < 1.0 {
            splat.lessen(perspective, pinhole);
        }
        let linear = [splat.toward, splat.across, splat.over];
        let finite = linear.iter().all(|l| l.at_zero.is_finite() && l.per_x.is_finite() && l.per_y.is_finite())
            && splat.covariance.iter().all(|x| x.is_finite())
            && splat.eye_squared.is_finite()
            && splat.depth_scale.is_finite();
        if !finite {
            Err(Culled::NotFinite)
        } else if opacity == 0.0 {
            Err(Culled::Transparent)
        } else {
            Ok(splat)
        }
    }

    /// Takes perspective out: a varies less around its value at the center's pixel, and s counts less in a² + s.
    fn lessen(&mut self, perspective: f64, pinhole: &Pinhole) {
        let at = pinhole.focal * self.center.truncate() / self.center.z + pinhole.principal;
        let a = &mut self.toward;
        *a = Linear {
            at_zero: a.at(at) - perspective * (a.per_x * at.x + a.per_y * at.y),
            per_x: perspective * a.per_x,
            per_y: perspective * a.per_y,
        };
        // β·s in the place of s, and d² as before: |u|² grows by as much.
        let least = perspective.max(1e-6);
        for part in [&mut self.across, &mut self.over] {
            let root = least.sqrt();
            *part = Linear { at_zero: root * part.at_zero, per_x: root * part.per_x, per_y: root * part.per_y };
        }
        self.eye_squared /= least;
    }

    /// The meeting with the ray through pixel coordinates.
    pub(crate) fn meet(&self, pixel: DVec2) -> Meeting {
        let a = self.toward.at(pixel);
        if a <= 0.0 && self.fading.is_none() {
            return Meeting { distance_squared: self.eye_squared, depth: 0.0, share: 1.0 };
        }
        let (u, v) = (self.across.at(pixel), self.over.at(pixel));
        let s = u * u + v * v;
        let whole = a * a + s;
        let depth = self.depth_scale * (a / whole);
        let share = self.fading.map_or(1.0, |f| {
            let near = f.near / (1.0 + f.right.at(pixel).powi(2) + f.down.at(pixel).powi(2)).sqrt();
            let width = (1.0 / (f.scale * whole.sqrt())).hypot(NEAR_BLUR * near);
            // The eye in the center of a Gaussian of no size has neither a depth nor a width.
            share_beyond(if width > 0.0 { (depth - near) / width } else { 0.0 })
        });
        Meeting { distance_squared: self.eye_squared * (s / whole), depth: depth.max(0.0), share }
    }

    /// The opacity at a meeting.
    pub(crate) fn alpha(&self, meeting: Meeting) -> f64 {
        (self.opacity * meeting.share * (-0.5 * meeting.distance_squared).exp()).min(1.0)
    }

    /// The ellipse on the picture whose level 1 encloses all pixels with d ≤ `radius`; `None` if there is none.
    ///
    /// It is exact if the Gaussian's level lies in front of the eye's plane: the dual conic ρ²Σ − ccᵀ of its outline. If the
    /// level crosses that plane or holds the eye, it is the whole picture.
    pub(crate) fn reach(&self, radius: f64, pinhole: &Pinhole) -> Option<Ellipse> {
        let everything = Ellipse { center: 0.5 * pinhole.size, slope: 0.0, along_row: 1e12, over_rows: 1e12 };
        let square = radius * radius;
        if self.eye_squared <= square * (1.0 + 1e-9) {
            return Some(everything);
        }
        if self.perspective < 1.0 {
            return Some(self.lessened_reach(radius, pinhole).unwrap_or(everything));
        }
        if self.beside(radius, pinhole) {
            return None;
        }
        let [xx, xy, yy, xz, yz, zz] = self.covariance;
        let DVec3 { x, y, z } = self.center;
        let behind = square * zz - z * z;
        if behind >= -1e-9 * z * z {
            return Some(everything);
        }
        if z < 0.0 {
            return None;
        }
        let middle = DVec2::new(square * xz - x * z, square * yz - y * z) / behind;
        let outer = |xx: f64, mm: f64| xx / -behind + mm;
        let shape = DMat2::from_cols(
            DVec2::new(
                outer(square * xx - x * x, middle.x * middle.x),
                outer(square * xy - x * y, middle.x * middle.y),
            ),
            DVec2::new(0.0, outer(square * yy - y * y, middle.y * middle.y)),
        );
        let focal = pinhole.focal;
        // A hundredth of a pixel more, for the cancellation here.
        let (a, c) = (shape.x_axis.x * focal.x * focal.x + 1e-4, shape.y_axis.y * focal.y * focal.y + 1e-4);
        let b = shape.x_axis.y * focal.x * focal.y;
        let along = (a - b * (b / c)).max(1e-9 * a).max(1e-4);
        let ellipse = Ellipse {
            center: middle * focal + pinhole.principal,
            slope: b / c,
            along_row: along.sqrt(),
            over_rows: c.max(0.0).sqrt(),
        };
        let fine = ellipse.center.is_finite() && c > 0.0 && ellipse.slope.is_finite() && along.is_finite();
        Some(if fine { ellipse } else { everything })
    }

    /// [`Self::reach`] with less than the whole perspective.
    ///
    /// Let y be (U, V), and y = M·d for d in pixels from the center's pixel. There a is a₀ + g·d. Then d² ≤ ρ² is
    /// |y| ≤ κ(a₀ + h·y), with κ² = ρ²/(|u|² − ρ²) and Mᵀh = g: an ellipse with a focus at 0 and the eccentricity κ|h|.
    fn lessened_reach(&self, radius: f64, pinhole: &Pinhole) -> Option<Ellipse> {
        let at = pinhole.focal * self.center.truncate() / self.center.z + pinhole.principal;
        let [ux, uy, vy] = [self.across.per_x, self.across.per_y, self.over.per_y];
        let inverse = |y: DVec2| DVec2::new((y.x - uy * y.y / vy) / ux, y.y / vy);
        let steepness = radius / (self.eye_squared - radius * radius).sqrt();
        let right = self.toward.per_x / ux;
        let h = DVec2::new(right, (self.toward.per_y - uy * right) / vy);
        let eccentricity = steepness * h.length();
        if eccentricity.is_nan() || eccentricity >= 0.999 {
            return None;
        }
        let axis = h.try_normalize().unwrap_or(DVec2::X);
        let rest = 1.0 - eccentricity * eccentricity;
        let major = steepness * self.toward.at(at) / rest;
        let (a, b) = (inverse(major * axis), inverse(major * rest.sqrt() * axis.perp()));
        let over_rows = a.y.hypot(b.y);
        let ellipse = Ellipse {
            center: at + eccentricity * a,
            slope: (a.x * a.y + b.x * b.y) / (over_rows * over_rows),
            along_row: a.perp_dot(b).abs() / over_rows + 0.01,
            over_rows: over_rows + 0.01,
        };
        let finite = [ellipse.slope, ellipse.along_row, ellipse.over_rows].iter().all(|x| x.is_finite());
        (finite && ellipse.center.is_finite()).then_some(ellipse)
    }

    /// Whether the level lies wholly on the outer side of one of the four planes through the eye and the picture's edges.
    fn beside(&self, radius: f64, pinhole: &Pinhole) -> bool {
        let [xx, xy, yy, xz, yz, zz] = self.covariance;
        let corner = |x: f64, y: f64| pinhole.ray(DVec2::new(x, y) * pinhole.size);
        let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        let inside = corners.iter().sum::<DVec3>();
        (0..4).any(|k| {
            let normal = corners[k].cross(corners[(k + 1) % 4]);
            let normal = if normal.dot(inside) < 0.0 { -normal } else { normal };
            let DVec3 { x, y, z } = normal;
            let spread = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z);
            normal.dot(self.center) < -radius * spread.max(0.0).sqrt() * (1.0 + 1e-9)
        })
    }
}
