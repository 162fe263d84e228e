//! Ambient occlusion from the Gaussians themselves: the share of the ambient light that reaches each of them.
//!
//! The scene's opacity goes into a coarse grid, once for an edit of what is visible. A Gaussian of peak opacity o and standard
//! deviations s₁, s₂, s₃ stops light like an area of C = −2π·ln(1 − o)·(s₁s₂ + s₂s₃ + s₃s₁)/3. That is the integral of its optical
//! depth over a plane, averaged over its three axes. Six points spread C over its extent. A cell of volume h³ has the extinction
//! σ = ΣC/h³ (Max 1995, "Optical models for direct volume rendering").
//!
//! Directions over the hemisphere about the normal n then sample the grid in steps that grow with the distance, as voxel cones do
//! (Crassin et al. 2011). The factor is Σ cos θ·exp(−∫σ) / Σ cos θ. Rays begin a cell and a half and two standard deviations above the
//! centre, and the most grazing ones are left out. So a flat surface, spread by the grid, does not occlude itself. Of a two-sided
//! surface the more open side counts. A Gaussian without a normal keeps all light, and one of little diffuse reflection most: the
//! factor is 1 − min(kd / ka, 1)·(1 − share).

use std::sync::Arc;

use glam::{DMat3, DVec3, UVec3};
use rayon::prelude::*;
use sg_scene::affine::NormalTransform;
use sg_scene::appearance::Appearance;
use sg_scene::model::{BaseUnit, Scene, ShadingModel};

/// Cells along the longest edge of what is visible.
const CELLS: u32 = 96;

/// Cells, and standard deviations along the normal, from the centre of a Gaussian to the start of its rays.
const START: [f64; 2] = [1.5, 2.0];

/// Middles and lengths of the steps of a ray, cells.
const STEPS: [[f64; 2]; 6] = [[0.5, 1.0], [1.5, 1.0], [3.0, 2.0], [5.0, 2.0], [8.0, 4.0], [12.0, 4.0]];

/// Cosines of the rings of directions to the normal, and directions of a ring.
const RINGS: [(f64, u32); 3] = [(1.0, 1), (0.8, 5), (0.5, 7)];

/// Greatest peak opacity that counts: no Gaussian is infinitely thick.
const OPAQUE: f64 = 0.99;

/// Extinction of the scene in cubic cells.
struct Grid {
    low: DVec3,
    /// Edge of a cell.
    cell: f64,
    size: UVec3,
    /// Extinction times the edge of a cell: optical depth across a cell.
    depths: Vec<f32>,
}

/// What one visible Gaussian adds to the grid.
struct Blocker {
    center: DVec3,
    /// Standard deviations along its axes, scene frame.
    axes: DMat3,
    /// C.
    area: f64,
}

/// Standard deviations of a Gaussian along its axes, scene frame.
fn axes_of(unit: &BaseUnit, i: usize) -> DMat3 {
    let turned = DMat3::from_quat(unit.gaussians.unit_rotation(i));
    DMat3::from_mat4(unit.transform) * turned * DMat3::from_diagonal(unit.gaussians.scale(i).as_dvec3())
}

impl Blocker {
    fn of(unit: &BaseUnit, i: usize, opacity: f64) -> Option<Self> {
        let center = unit.transform.transform_point3(unit.gaussians.position.get(i)?.as_dvec3());
        let axes = axes_of(unit, i);
        let [a, b, c] = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length);
        let depth = -(-opacity.min(OPAQUE)).ln_1p();
        let area = std::f64::consts::TAU * depth * (a * b + b * c + c * a) / 3.0;
        (center.is_finite() && area.is_finite() && area > 0.0).then_some(Self { center, axes, area })
    }

    /// Six points of equal weight, √3 standard deviations along each axis: they have its mean and covariance.
    fn points(&self) -> [DVec3; 6] {
        let [a, b, c] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(|axis| 3.0_f64.sqrt() * axis);
        let at = self.center;
        [at + a, at - a, at + b, at - b, at + c, at - c]
    }
}

impl Grid {
    /// The grid of what is visible; `None` where nothing is.
    fn of(blockers: &[Blocker]) -> Option<Self> {
        let (low, high) = bounds(blockers)?;
        let cell = (high - low).max_element() / f64::from(CELLS);
        if cell.is_nan() || cell <= 0.0 {
            return None;
        }
        // A cell to spare on every side: each point lies between eight of them.
        let low = low - cell;
        let size = ((high - low) / cell).ceil().as_uvec3() + UVec3::splat(2);
        let count = size.x as usize * size.y as usize * size.z as usize;
        let mut grid = Self { low, cell, size, depths: vec![0.0; count] };
        let mut sums = vec![0.0_f64; count];
        for blocker in blockers {
            let share = blocker.area / (6.0 * cell * cell);
            for point in blocker.points() {
                grid.around(point, |at, part| {
                    if let Some(sum) = sums.get_mut(at) {
                        *sum += part * share;
                    }
                });
            }
        }
        grid.depths = sums.into_iter().map(|sum| sum as f32).collect();
        Some(grid)
    }

    /// The eight cells about a point with their shares. Outside there are none.
    fn around(&self, point: DVec3, mut each: impl FnMut(usize, f64)) {
        let at = (point - self.low) / self.cell - 0.5;
        let floor = at.floor();
        let part = at - floor;
        let most = self.size.as_dvec3() - 2.0;
        if floor.cmplt(DVec3::ZERO).any() || floor.cmpgt(most).any() || !floor.is_finite() {
            return;
        }
        let [x, y, z] = floor.as_uvec3().to_array().map(|k| k as usize);
        let [row, slice] = [self.size.x as usize, self.size.x as usize * self.size.y as usize];
        for k in 0..8_usize {
            let [i, j, l] = [k & 1, k >> 1 & 1, k >> 2];
            let share = |bit: usize, part: f64| if bit == 1 { part } else { 1.0 - part };
            each(x + i + row * (y + j) + slice * (z + l), share(i, part.x) * share(j, part.y) * share(l, part.z));
        }
    }

    /// Optical depth across a cell's edge at a point.
    fn depth(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        self.around(point, |at, share| sum += share * f64::from(self.depths.get(at).copied().unwrap_or_default()));
        sum
    }

    /// Where the rays begin of a Gaussian with this extent along its normal.
    fn start(&self, point: DVec3, normal: DVec3, deviation: f64) -> DVec3 {
        point + (START[0] * self.cell + START[1] * deviation) * normal
    }

    /// The share of the light over the hemisphere about `normal` that reaches `start`.
    fn open(&self, start: DVec3, normal: DVec3) -> f64 {
        let (s, t) = normal.any_orthonormal_pair();
        let (mut light, mut all) = (0.0, 0.0);
        for (k, (cosine, count)) in RINGS.into_iter().enumerate() {
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            for j in 0..count {
                // Rings are turned against each other.
                let angle = std::f64::consts::TAU * (f64::from(j) + 0.5 * k as f64) / f64::from(count);
                let direction = cosine * normal + sine * (angle.cos() * s + angle.sin() * t);
                let depth: f64 =
                    STEPS.iter().map(|[at, length]| length * self.depth(start + at * self.cell * direction)).sum();
                light += cosine * (-depth).exp();
                all += cosine;
            }
        }
        light / all
    }
}

/// The box of all points of the blockers without the outermost thousandth on each side: strays must not make cells large.
fn bounds(blockers: &[Blocker]) -> Option<(DVec3, DVec3)> {
    let end = |axis: usize| {
        let mut values: Vec<f64> = blockers.iter().map(|b| b.center.to_array()[axis]).collect();
        let stray = values.len() / 1000;
        values.sort_unstable_by(f64::total_cmp);
        Some([*values.get(stray)?, *values.iter().rev().nth(stray)?])
    };
    let [x, y, z] = [end(0)?, end(1)?, end(2)?];
    Some((DVec3::new(x[0], y[0], z[0]), DVec3::new(x[1], y[1], z[1])))
}

/// How much of a surface a Gaussian is, 0 to 1: the haze of a volume has no diffuse part, and its normals mean nothing.
fn surface_share(ambient: f64, diffuse: f64) -> f64 {
    if diffuse > 0.0 { (diffuse / ambient.max(f64::MIN_POSITIVE)).min(1.0) } else { 0.0 }
}

/// Factors on the ambient factor ka of each Gaussian, 0 to 1, for what `appearance` draws: [`Appearance::occlusion`]. `None` for a
/// scene without lit Gaussians, or where nothing is visible. Runs on the current rayon thread pool; the numbers do not depend on
/// it.
#[must_use]
pub fn ambient_occlusion(scene: &Scene, appearance: &Appearance) -> Option<Arc<[f32]>> {
    if !scene.has_shading() {
        return None;
    }
    let units = scene.units.iter().zip(&appearance.base);
    let blockers: Vec<Blocker> = units
        .filter(|(_, base)| base.visible)
        .flat_map(|(unit, base)| (0..unit.gaussians.len()).map(move |i| (unit, base, i)))
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|(unit, base, i)| {
            let mut opacity = f64::from(base.opacity) * f64::from(unit.gaussians.opacity(i));
            for edit in appearance.units.iter().filter(|edit| edit.mask.get(unit.first + i)) {
                opacity *= if edit.visible { f64::from(edit.opacity) } else { 0.0 };
            }
            let blocker = Blocker::of(unit, i, opacity)?;
            appearance.clips.iter().all(|clip| clip.keeps(blocker.center)).then_some(blocker)
        })
        .collect();
    let grid = Grid::of(&blockers)?;
    let factor = |i: usize| {
        let (unit, local) = scene.locate(i)?;
        let columns = unit.gaussians.shading.as_ref()?;
        let share = surface_share((*columns.ambient.get(local)?).into(), (*columns.diffuse.get(local)?).into());
        let normal = columns.normal.get(local).filter(|_| share > 0.0)?.as_dvec3();
        let normal = NormalTransform::of(DMat3::from_mat4(unit.transform)).apply(normal).try_normalize()?;
        let position = scene.position(i).filter(|p| p.is_finite())?;
        let deviation = (axes_of(unit, local).transpose() * normal).length();
        let start = grid.start(position, normal, deviation);
        let two_sided = unit.shading != ShadingModel::Paper;
        let other = || grid.open(grid.start(position, -normal, deviation), -normal);
        let open = |ahead: f64| if two_sided { ahead.max(other()) } else { ahead };
        start.is_finite().then(|| (1.0 - share * (1.0 - open(grid.open(start, normal)))) as f32)
    };
    Some((0..scene.len()).into_par_iter().map(|i| factor(i).unwrap_or(1.0)).collect::<Vec<f32>>().into())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use sg_scene::appearance::UnitAppearance;
    use sg_scene::mask::Mask;
    use sg_scene::synthetic::test_scene;
    use sg_scene::tone::Tone;

    use super::*;

    /// Edge of a cell of the scenes below, and the extent of their Gaussians.
    const SPACING: f64 = 0.25;

    /// Balls on a floor of 12 by 12 with a square pit in its middle: 1 wide and 1 deep, with four walls and a bottom.
    fn pit() -> Scene {
        let steps = |from: f64, to: f64| {
            let count = ((to - from) / SPACING).round() as usize;
            (0..=count).map(move |k| from + SPACING * k as f64)
        };
        let mut places: Vec<(DVec3, DVec3)> = Vec::new();
        for x in steps(-6.0, 6.0) {
            for y in steps(-6.0, 6.0) {
                let inside = x.abs() < 0.5 && y.abs() < 0.5;
                places.push((DVec3::new(x, y, if inside { -1.0 } else { 0.0 }), DVec3::Z));
            }
        }
        for along in steps(-0.5, 0.5) {
            for z in steps(-0.75, -SPACING) {
                for side in [-1.0, 1.0] {
                    places.push((DVec3::new(0.5 * side, along, z), DVec3::new(-side, 0.0, 0.0)));
                    places.push((DVec3::new(along, 0.5 * side, z), DVec3::new(0.0, -side, 0.0)));
                }
            }
        }
        let mut scene = test_scene(&[("pit", places.len())]);
        let gaussians = &mut scene.units[0].gaussians;
        for (i, (at, normal)) in places.iter().enumerate() {
            gaussians.position[i] = at.as_vec3();
            gaussians.log_scale[i] = Vec3::splat((0.3 * SPACING as f32).ln());
            gaussians.opacity_logit[i] = 3.0;
            gaussians.shading.as_mut().unwrap().normal[i] = normal.as_vec3();
        }
        scene
    }

    /// The same share without a grid: every Gaussian's extinction is a normal distribution of integral C, and 600 directions of
    /// the whole hemisphere are integrated in steps of a tenth of a cell.
    fn reference(blockers: &[Blocker], cell: f64, start: DVec3, normal: DVec3) -> f64 {
        let (s, t) = normal.any_orthonormal_pair();
        let directions = 600;
        let (reach, step) = (14.0 * cell, 0.1 * cell);
        let density = |at: DVec3| -> f64 {
            let of = |b: &Blocker| {
                let variance = b.axes.x_axis.length_squared();
                let away = (at - b.center).length_squared() / variance;
                if away > 40.0 {
                    0.0
                } else {
                    b.area * (-0.5 * away).exp() / (std::f64::consts::TAU * variance).powf(1.5)
                }
            };
            blockers.iter().map(of).sum()
        };
        let mut light = 0.0;
        for k in 0..directions {
            // Evenly over the disc below the hemisphere: each direction stands for the same cos θ·dω.
            let radius = ((f64::from(k) + 0.5) / f64::from(directions)).sqrt();
            let angle = f64::from(k) * 2.399_963_229_728_653;
            let direction = radius * (angle.cos() * s + angle.sin() * t) + (1.0 - radius * radius).sqrt() * normal;
            let steps = (reach / step) as u32;
            let depth: f64 = (0..steps).map(|m| step * density(start + (f64::from(m) + 0.5) * step * direction)).sum();
            light += (-depth).exp() / f64::from(directions);
        }
        light
    }

    #[test]
    fn a_pit_is_darker_than_the_floor_as_in_the_reference() {
        let scene = pit();
        let look = Appearance::of(&scene);
        let got = ambient_occlusion(&scene, &look).unwrap();
        assert!(got.iter().all(|f| (0.0..=1.0).contains(f)));
        let unit = &scene.units[0];
        let blocker = |i| Blocker::of(unit, i, f64::from(unit.gaussians.opacity(i))).unwrap();
        let blockers: Vec<Blocker> = (0..scene.len()).map(blocker).collect();
        let grid = Grid::of(&blockers).unwrap();
        let index = |at: Vec3| unit.gaussians.position.iter().position(|p| p.distance(at) < 1e-3).unwrap();
        let mut worst = 0.0_f64;
        for (at, low, high) in [
            (Vec3::new(-5.0, -5.0, 0.0), 0.9, 1.0),
            (Vec3::new(0.0, 4.0, 0.0), 0.9, 1.0),
            (Vec3::new(0.0, 0.0, -1.0), 0.0, 0.65),
            (Vec3::new(0.25, 0.25, -1.0), 0.0, 0.65),
            (Vec3::new(0.5, 0.0, -0.5), 0.0, 0.8),
        ] {
            let i = index(at);
            let normal = unit.gaussians.shading.as_ref().unwrap().normal[i].as_dvec3();
            let start = grid.start(at.as_dvec3(), normal, 0.3 * SPACING);
            let want = reference(&blockers, grid.cell, start, normal);
            let found = f64::from(got[i]);
            assert!((low..=high).contains(&found), "{at}: {found}, the reference {want}");
            worst = worst.max((found - want).abs());
        }
        assert!(worst < 0.15, "{worst} from the reference");
    }

    #[test]
    fn what_is_hidden_or_faded_gives_no_shadow() {
        let scene = pit();
        let all = Appearance::of(&scene);
        let floor = |i: usize| scene.position(i).is_some_and(|p| p.z < -0.9);
        let bottom: Vec<usize> = (0..scene.len()).filter(|i| floor(*i)).collect();
        let mean = |look: &Appearance| {
            let factors = ambient_occlusion(&scene, look).unwrap();
            bottom.iter().map(|i| f64::from(factors[*i])).sum::<f64>() / bottom.len() as f64
        };
        let walls = Arc::new(Mask::from_fn(scene.len(), |i| !floor(i)));
        let edit = |opacity, visible| {
            let unit = UnitAppearance { mask: Arc::clone(&walls), color: None, opacity, visible, tone: Tone::NEUTRAL };
            Appearance { units: vec![unit], ..all.clone() }
        };
        let (closed, faded, open) = (mean(&all), mean(&edit(0.1, true)), mean(&edit(1.0, false)));
        assert!(closed < 0.65 && closed < faded && faded < open && open > 0.9, "{closed} {faded} {open}");
        assert_eq!(ambient_occlusion(&scene, &all), ambient_occlusion(&scene, &all), "the same every time");

        // Without normals all light stays; without columns of shading there is nothing to occlude.
        let mut flat = scene.clone();
        flat.units[0].gaussians.shading.as_mut().unwrap().normal.fill(Vec3::ZERO);
        assert!(ambient_occlusion(&flat, &all).unwrap().iter().all(|f| *f == 1.0));
        // Haze has no surface: its normals say nothing. Two-sided surfaces count by their more open side.
        let mut haze = scene.clone();
        haze.units[0].gaussians.shading.as_mut().unwrap().diffuse.fill(0.0);
        assert!(ambient_occlusion(&haze, &all).unwrap().iter().all(|f| *f == 1.0));
        let mut two_sided = scene.clone();
        two_sided.units[0].shading = ShadingModel::IvrgsTrain;
        let [one, two] = [&scene, &two_sided].map(|scene| ambient_occlusion(scene, &all).unwrap());
        assert!(one.iter().zip(two.iter()).all(|(one, two)| two >= one) && one != two);
        flat.units[0].gaussians.shading = None;
        assert_eq!(ambient_occlusion(&flat, &all), None);
    }
}
