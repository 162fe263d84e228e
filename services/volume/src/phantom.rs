//! A synthetic volume with exact ground truth: a vessel tree with a saccular aneurysm.
//!
//! The shape is an analytic union of tapered tubes, a neck and a sphere in the unit cube. The rasterizer sets resolution
//! and noise. Points of the unit cube are the normalized box coordinates of the volume. A stroke therefore hits the sac
//! at every resolution and seed.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::grid::{Grid, GridError};
use crate::scalars::Scalars;
use crate::transfer::{BaseUnitRange, ControlPoint, Scale, TransferFunction, Units};
use crate::volume::{ValueCount, Volume};

/// Label of voxels outside every vessel.
pub const LABEL_BACKGROUND: u8 = 0;
/// Label of the sac, its neck included.
pub const LABEL_SAC: u8 = 1;
/// Label of the vessels.
pub const LABEL_VESSEL: u8 = 2;

/// Mean intensity outside.
const BACKGROUND: f32 = 20.0;
/// Mean intensity inside.
const BLOOD: f32 = 200.0;
/// Radius of the blend between tubes.
const BLEND: f64 = 0.012;
/// Width in voxels of the labelled margin outside the surface: faintly visible voxels there need a label.
const LABEL_MARGIN: f64 = 2.0;

/// Centre of the sac.
const SAC_CENTER: DVec3 = DVec3::new(0.735, 0.465, 0.435);
/// Radius of the sac.
const SAC_RADIUS: f64 = 0.135;
/// Radius of the neck.
const NECK_RADIUS: f64 = 0.055;

/// Control points (Catmull–Rom) and end radii of the tubes; the first one is the parent vessel.
const TUBES: &[(&[[f64; 3]], f64, f64)] = &[
    (
        &[[0.50, 0.50, 0.02], [0.46, 0.47, 0.15], [0.50, 0.50, 0.30], [0.51, 0.52, 0.45], [0.50, 0.50, 0.62]],
        0.068,
        0.055,
    ),
    (&[[0.50, 0.50, 0.62], [0.40, 0.48, 0.72], [0.27, 0.40, 0.78], [0.16, 0.36, 0.92]], 0.046, 0.030),
    (&[[0.50, 0.50, 0.62], [0.60, 0.54, 0.71], [0.71, 0.62, 0.79], [0.80, 0.60, 0.94]], 0.046, 0.030),
    (&[[0.27, 0.40, 0.78], [0.30, 0.26, 0.84], [0.26, 0.14, 0.90]], 0.028, 0.018),
    (&[[0.33, 0.44, 0.75], [0.24, 0.56, 0.80], [0.22, 0.70, 0.90]], 0.028, 0.018),
    (&[[0.71, 0.62, 0.79], [0.73, 0.76, 0.82], [0.68, 0.88, 0.90]], 0.028, 0.018),
    (&[[0.76, 0.61, 0.86], [0.84, 0.48, 0.88], [0.90, 0.34, 0.92]], 0.026, 0.018),
    (&[[0.48, 0.49, 0.22], [0.36, 0.60, 0.26], [0.24, 0.72, 0.34], [0.14, 0.80, 0.48]], 0.034, 0.020),
    (&[[0.24, 0.72, 0.34], [0.14, 0.66, 0.30], [0.06, 0.60, 0.22]], 0.022, 0.016),
    (&[[0.50, 0.51, 0.38], [0.40, 0.38, 0.44], [0.28, 0.26, 0.48], [0.16, 0.20, 0.56]], 0.032, 0.020),
    (&[[0.28, 0.26, 0.48], [0.26, 0.14, 0.42], [0.22, 0.06, 0.34]], 0.020, 0.015),
];
/// Straight pieces per span between two control points.
const PIECES: usize = 6;

/// A capsule whose radius changes linearly from one end to the other.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Capsule {
    a: DVec3,
    b: DVec3,
    radius_a: f64,
    radius_b: f64,
}

impl Capsule {
    /// Distance to the surface, negative inside. It is exact on the axis' normal plane. Elsewhere it is a close lower bound,
    /// since the radii change slowly.
    fn distance(&self, p: DVec3) -> f64 {
        let axis = self.b - self.a;
        let t = ((p - self.a).dot(axis) / axis.length_squared().max(1e-30)).clamp(0.0, 1.0);
        (p - self.a - axis * t).length() - (self.radius_a + t * (self.radius_b - self.radius_a))
    }
}

/// The analytic shape, in the unit cube.
#[derive(Debug, Clone, PartialEq)]
pub struct VesselTree {
    /// The pieces of each tube; the first tube is the parent vessel.
    vessels: Vec<Vec<Capsule>>,
    neck: Capsule,
    /// Start of the neck on the axis of the parent vessel.
    parent_point: DVec3,
    /// Unit vector from `parent_point` to the sac's centre.
    neck_axis: DVec3,
    parent_radius: f64,
}

impl Default for VesselTree {
    fn default() -> Self {
        Self::new()
    }
}

impl VesselTree {
    /// The tree; every call returns the same one.
    #[must_use]
    pub fn new() -> Self {
        let vessels: Vec<Vec<Capsule>> = TUBES.iter().map(|(points, start, end)| tube(points, *start, *end)).collect();
        let (mut parent_point, mut parent_radius, mut nearest) = (DVec3::ZERO, 0.0, f64::INFINITY);
        for piece in vessels.iter().take(1).flatten() {
            let distance = piece.a.distance(SAC_CENTER);
            if distance < nearest {
                (parent_point, parent_radius, nearest) = (piece.a, piece.radius_a, distance);
            }
        }
        let neck = Capsule { a: parent_point, b: SAC_CENTER, radius_a: NECK_RADIUS, radius_b: NECK_RADIUS };
        let neck_axis = (SAC_CENTER - parent_point).normalize_or(DVec3::X);
        Self { vessels, neck, parent_point, neck_axis, parent_radius }
    }

    /// Distance to the surface in unit-cube lengths, negative inside. Near joints it is an estimate because of the blend.
    #[must_use]
    pub fn distance(&self, p: DVec3) -> f64 {
        // Pieces of one tube meet end to end; a blend between them would make beads.
        let vessels = self.vessels.iter().map(|tube| tube_distance(tube, p)).fold(f64::INFINITY, smooth_min);
        smooth_min(vessels, self.sac_distance(p))
    }

    /// Distance to the sac with its neck alone.
    fn sac_distance(&self, p: DVec3) -> f64 {
        smooth_min(p.distance(SAC_CENTER) - SAC_RADIUS, self.neck.distance(p))
    }

    /// Whether a point lies in a vessel or the sac.
    #[must_use]
    pub fn contains(&self, p: DVec3) -> bool {
        self.distance(p) <= 0.0
    }

    /// Whether a point of the tree is on the side of the sac. Such a point lies beyond the plane of the neck at the
    /// parent's wall, and is nearer to the sac than to any vessel.
    #[must_use]
    pub fn on_sac_side(&self, p: DVec3) -> bool {
        let beyond_wall = (p - self.parent_point).dot(self.neck_axis) > self.parent_radius;
        beyond_wall && self.vessels.iter().all(|tube| tube_distance(tube, p) > self.sac_distance(p))
    }

    /// Whether a point lies in the sac, including its neck.
    #[must_use]
    pub fn sac_contains(&self, p: DVec3) -> bool {
        self.contains(p) && self.on_sac_side(p)
    }

    /// Centre of the sac.
    #[must_use]
    pub fn sac_center(&self) -> DVec3 {
        SAC_CENTER
    }

    /// Radius of the sac.
    #[must_use]
    pub fn sac_radius(&self) -> f64 {
        SAC_RADIUS
    }

    /// Start of the neck on the axis of the parent vessel.
    #[must_use]
    pub fn parent_point(&self) -> DVec3 {
        self.parent_point
    }

    /// Radius of the parent vessel at [`VesselTree::parent_point`].
    #[must_use]
    pub fn parent_radius(&self) -> f64 {
        self.parent_radius
    }

    /// The parent vessel's axis from its inflow to its bifurcation, as a polyline.
    #[must_use]
    pub fn parent_axis(&self) -> Vec<DVec3> {
        let pieces = self.vessels.first().map_or(&[][..], Vec::as_slice);
        pieces.iter().map(|c| c.a).chain(pieces.last().map(|c| c.b)).collect()
    }

    /// Rasterizes the tree on `size`³ voxels of unit spacing. The intensities are anti-aliased uint8 with noise from `seed`.
    /// The uint8 labels are [`LABEL_BACKGROUND`], [`LABEL_SAC`] and [`LABEL_VESSEL`]; they reach two voxels outside the
    /// surface. The result is the same for any number of threads.
    ///
    /// # Errors
    /// [`GridError::Dims`] if `size` is 0 or too large.
    pub fn rasterize(&self, size: usize, seed: u64) -> Result<PhantomRaster, GridError> {
        let grid = Grid::unit([size; 3])?;
        let voxel = 1.0 / size as f64;
        // Capsules at a larger distance change neither intensities nor labels.
        let reach = 2.0 * BLEND + (LABEL_MARGIN + 1.0) * voxel;
        let slices: Vec<(Vec<u8>, Vec<u8>)> = (0..size)
            .into_par_iter()
            .map(|z| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(z as u64);
                let mut intensities = Vec::with_capacity(size * size);
                let mut labels = Vec::with_capacity(size * size);
                let center = |k: usize| (k as f64 + 0.5) * voxel;
                for y in 0..size {
                    let near = self.near_row(center(y), center(z), reach);
                    for x in 0..size {
                        let p = DVec3::new(center(x), center(y), center(z));
                        let distance = near.distance(p);
                        let coverage = (0.5 - distance / (1.5 * voxel)).clamp(0.0, 1.0) as f32;
                        // The sum of four uniform numbers is almost normal (σ = 2.3 grey levels).
                        let noise = (0..4).map(|_| random.random::<f32>() - 0.5).sum::<f32>() * 4.0;
                        let value = BACKGROUND + coverage * (BLOOD - BACKGROUND) + noise;
                        intensities.push(value.round().clamp(0.0, 255.0) as u8);
                        labels.push(if distance > LABEL_MARGIN * voxel {
                            LABEL_BACKGROUND
                        } else if self.on_sac_side(p) {
                            LABEL_SAC
                        } else {
                            LABEL_VESSEL
                        });
                    }
                }
                (intensities, labels)
            })
            .collect();
        let mut intensities = Vec::with_capacity(grid.len());
        let mut labels = Vec::with_capacity(grid.len());
        for (i, l) in slices {
            intensities.extend(i);
            labels.extend(l);
        }
        Ok(PhantomRaster { grid, intensities, labels })
    }

    /// The part of the tree within `reach` of a row of voxels along x.
    fn near_row(&self, y: f64, z: f64, reach: f64) -> Self {
        let close = |c: &Capsule| {
            let apart = |p: f64, a: f64, b: f64| (a.min(b) - p).max(p - a.max(b)).max(0.0);
            apart(y, c.a.y, c.b.y).hypot(apart(z, c.a.z, c.b.z)) <= c.radius_a.max(c.radius_b) + reach
        };
        let near = |tube: &Vec<Capsule>| tube.iter().copied().filter(close).collect::<Vec<_>>();
        let vessels = self.vessels.iter().map(near).filter(|tube| !tube.is_empty()).collect();
        Self { vessels, ..*self }
    }
}

/// The intensities and labels of a rasterized tree.
#[derive(Debug, Clone)]
pub struct PhantomRaster {
    grid: Grid,
    intensities: Vec<u8>,
    labels: Vec<u8>,
}

impl PhantomRaster {
    /// The intensity volume: uint8, about 20 outside and about 200 inside.
    ///
    /// # Errors
    /// Never for a result of [`VesselTree::rasterize`].
    pub fn volume(&self) -> Result<Volume, ValueCount> {
        Volume::new(self.grid.clone(), Scalars::from(self.intensities.clone()), Some("intensity".to_owned()))
    }

    /// The label volume.
    ///
    /// # Errors
    /// Never for a result of [`VesselTree::rasterize`].
    pub fn labels(&self) -> Result<Volume, ValueCount> {
        Volume::new(self.grid.clone(), Scalars::from(self.labels.clone()), Some("label".to_owned()))
    }
}

/// The transfer function of the tree: one pale base unit "vessels" and a transparent background.
#[must_use]
pub fn transfer_function() -> TransferFunction {
    let color = [0.93, 0.80, 0.62];
    let point = |value, opacity| ControlPoint { value, color, opacity };
    TransferFunction {
        domain: [0.0, 255.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: Some("intensity".to_owned()),
        points: vec![point(0.0, 0.0), point(70.0, 0.0), point(150.0, 0.7), point(255.0, 0.7)],
        base_units: vec![BaseUnitRange { name: "vessels".to_owned(), range: [70.0, 255.0] }],
    }
}

/// Tapered capsules along a Catmull–Rom curve through the control points.
fn tube(points: &[[f64; 3]], start: f64, end: f64) -> Vec<Capsule> {
    let at = |i: usize| DVec3::from_array(points[i.min(points.len() - 1)]);
    let spans = points.len() - 1;
    let mut axis = Vec::with_capacity(spans * PIECES + 1);
    for span in 0..spans {
        let (p0, p1, p2, p3) = (at(span.saturating_sub(1)), at(span), at(span + 1), at(span + 2));
        for piece in 0..PIECES {
            let t = piece as f64 / PIECES as f64;
            let curve = 2.0 * p1
                + (p2 - p0) * t
                + (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) * t * t
                + (3.0 * p1 - p0 - 3.0 * p2 + p3) * t * t * t;
            axis.push(0.5 * curve);
        }
    }
    axis.push(at(spans));
    let pieces = axis.len() - 1;
    let radius = |i: usize| start + (end - start) * i as f64 / pieces as f64;
    axis.windows(2)
        .enumerate()
        .map(|(i, w)| Capsule { a: w[0], b: w[1], radius_a: radius(i), radius_b: radius(i + 1) })
        .collect()
}

/// Distance to a tube; infinite for none of its pieces.
fn tube_distance(tube: &[Capsule], p: DVec3) -> f64 {
    tube.iter().map(|c| c.distance(p)).fold(f64::INFINITY, f64::min)
}

/// The minimum, with a quadratic blend if the two are within [`BLEND`] (Quilez's polynomial smooth minimum).
fn smooth_min(a: f64, b: f64) -> f64 {
    let h = (BLEND - (a - b).abs()).max(0.0) / BLEND;
    a.min(b) - 0.25 * h * h * BLEND
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sac_touches_its_parent_only_at_the_neck() {
        let tree = VesselTree::new();
        assert!(tree.sac_contains(tree.sac_center()));
        assert!(tree.contains(tree.parent_point()) && !tree.sac_contains(tree.parent_point()));
        // Along the straight line from the parent to the sac one never leaves the tree, and changes sides once.
        let line: Vec<DVec3> =
            (0..=200).map(|i| tree.parent_point().lerp(tree.sac_center(), f64::from(i) / 200.0)).collect();
        assert!(line.iter().all(|&p| tree.contains(p)));
        let changes = line.windows(2).filter(|w| tree.sac_contains(w[0]) != tree.sac_contains(w[1])).count();
        assert_eq!(changes, 1);
        // Anywhere else the sac's wall is clear of every vessel.
        let gap = 0.02;
        for i in 0..2000 {
            let (u, v) = (f64::from(i) / 2000.0, f64::from(i) * 0.618_033_988_75 % 1.0);
            let (cos, phi) = (1.0 - 2.0 * u, std::f64::consts::TAU * v);
            let sin = (1.0 - cos * cos).sqrt();
            let direction = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            if direction.dot(-tree.neck_axis) < 0.75 {
                let wall = tree.sac_center() + direction * (tree.sac_radius() + gap);
                assert!(!tree.contains(wall), "{direction}");
            }
        }
    }

    #[test]
    fn the_tree_fits_into_the_cube() {
        let tree = VesselTree::new();
        for c in tree.vessels.iter().flatten() {
            for (p, r) in [(c.a, c.radius_a), (c.b, c.radius_b)] {
                assert!(p.min_element() - r > -0.06 && p.max_element() + r < 1.0, "{p} {r}");
            }
        }
    }

    #[test]
    fn distances_near_a_row_equal_those_of_the_whole_tree() {
        let tree = VesselTree::new();
        let reach = 2.0 * BLEND + 0.03;
        for i in 0..4000_u32 {
            let f = |k: u32| f64::from(i.wrapping_mul(2_654_435_761).rotate_left(k) % 1000) / 1000.0;
            let p = DVec3::new(f(0), f(7), f(19));
            let (all, near) = (tree.distance(p), tree.near_row(p.y, p.z, reach).distance(p));
            assert!(all == near || (all > 0.03 - 1e-9 && near > 0.03 - 1e-9), "{p}: {all} {near}");
        }
    }

    #[test]
    fn the_raster_agrees_with_the_analytic_truth() {
        let tree = VesselTree::new();
        let size = 64;
        let r = tree.rasterize(size, 1).unwrap();
        let (volume, labels) = (r.volume().unwrap().to_field(), r.labels().unwrap().to_field());
        let (mut sac, mut vessel) = (0, 0);
        for i in 0..volume.grid().len() {
            let v = volume.grid().voxel(i);
            let p = (DVec3::new(v.x as f64, v.y as f64, v.z as f64) + 0.5) / size as f64;
            if tree.sac_contains(p) {
                sac += 1;
                assert_eq!(labels.raw(i), f64::from(LABEL_SAC));
            } else if tree.contains(p) {
                vessel += 1;
                assert_eq!(labels.raw(i), f64::from(LABEL_VESSEL));
            }
            let d = tree.distance(p) * size as f64;
            if d > 1.0 {
                assert!(volume.raw(i) < 40.0);
            }
            if d < -1.0 {
                assert!(volume.raw(i) > 180.0);
            }
            if transfer_function().classifier(volume.range()).unwrap().opacity(volume.raw(i)) > 0.0 {
                assert!(labels.raw(i) > 0.0, "a visible voxel has a label");
            }
        }
        // The sphere alone has 4/3·π·0.135³·64³ = 2,702 voxels.
        assert!((2600..3300).contains(&sac), "{sac}");
        assert!(vessel > sac, "{vessel}");
    }

    #[test]
    fn the_seed_moves_the_noise_alone_and_threads_nothing() {
        let tree = VesselTree::new();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let a = tree.rasterize(24, 5).unwrap();
        let b = one.install(|| tree.rasterize(24, 5)).unwrap();
        let c = tree.rasterize(24, 6).unwrap();
        assert_eq!(a.intensities, b.intensities);
        assert_ne!(a.intensities, c.intensities);
        assert_eq!(a.labels, c.labels);
    }
}
