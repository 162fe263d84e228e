//! Extent and volume of a set of Gaussians, in the scene's length unit.
//!
//! Take a ray that crosses all Gaussians at their densities at a point. The point is inside where they hide at least half of its
//! light: 1 − Π(1 − αᵢ·exp(−dᵢ²/2)) ≥ ½, with the opacity αᵢ of the file and the Mahalanobis distance dᵢ. A fit puts its
//! Gaussians on surfaces, so the volume that they enclose counts too.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f32::consts::LN_2;
use std::ops::Range;

use glam::{DMat3, DVec3, Mat3, UVec3, Vec3};
use rayon::prelude::*;

use crate::mask::Mask;
use crate::model::{Scene, SceneBox};

/// Cells of the grid that volumes are counted on. A cell is then about 1 % of a cube's edge.
const CELLS: f64 = 1e6;

/// Most cells along an edge of the grid.
const LONGEST: f64 = 400.0;

/// Greatest opacity that counts, so that its logarithm is finite.
const OPAQUE: f64 = 0.999;

/// Least share of light hidden by one Gaussian that is added up.
const LEAST: f64 = 1e-3;

/// Least share of light that a cell of a closed surface hides. Between the Gaussians of a surface it is less than half.
const BARRIER: f32 = 0.05;

/// Least density on a way up the outer side of a surface, as a share of the highest one before. Between cells of one side the
/// density wavers by less; beyond the crest of a thin surface it falls further.
const RISING: f32 = 0.9;

/// Gaussians that are added at a time.
const PART: usize = 1 << 18;

/// Layers of cells that one task fills.
const LAYERS: usize = 4;

/// Extent and volume of a set of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Edges of the box of all Gaussians along the scene's axes. A Gaussian reaches as far as it alone hides half of the light; one
    /// that never does counts with its centre.
    pub extent: DVec3,
    /// Volume of the points inside, cubic length units.
    pub occupied: f64,
    /// The same with all places that no way leads to from outside: the inside of a closed surface.
    pub enclosed: f64,
}

/// A Gaussian, relative to the grid's origin.
struct Body {
    center: Vec3,
    /// Inverse covariance, widened by a cell.
    precision: Mat3,
    opacity: f32,
    /// Half of the box in which it hides more than [`LEAST`].
    reach: Vec3,
}

/// Cells in rows along x, then y, then z.
struct Cells {
    origin: DVec3,
    edge: f64,
    count: UVec3,
}

/// Extent and volume of the Gaussians of a mask, whatever their visibility and edits. Those with a centre or covariance that is
/// not finite do not count. `None` if none is left.
#[must_use]
pub fn size(scene: &Scene, members: &Mask) -> Option<Size> {
    let ellipsoids = || members.ones().filter_map(|i| ellipsoid(scene, i));
    let mut boxes = [(DVec3::INFINITY, DVec3::NEG_INFINITY); 2];
    for (center, covariance, opacity) in ellipsoids() {
        let deviations = deviations(&covariance);
        for ((min, max), least) in boxes.iter_mut().zip([0.5, LEAST]) {
            let half = deviations * radius(opacity, least);
            (*min, *max) = (min.min(center - half), max.max(center + half));
        }
    }
    let [(min, max), reached] = boxes;
    if !min.is_finite() || !max.is_finite() {
        return None;
    }
    let cells = Cells::around(reached);
    let depths = cells.optical_depths(ellipsoids());
    let inside = depths.iter().filter(|depth| **depth >= LN_2).count();
    let enclosed = depths.len() - cells.outside(&depths, &cells.within(scene.bounds));
    let cell = cells.edge.powi(3);
    Some(Size { extent: max - min, occupied: cell * inside as f64, enclosed: cell * enclosed as f64 })
}

/// Centre, covariance and opacity in the scene's frame.
fn ellipsoid(scene: &Scene, i: usize) -> Option<(DVec3, DMat3, f64)> {
    let (unit, local) = scene.locate(i)?;
    let center = scene.position(i)?;
    let turned = DMat3::from_mat4(unit.transform);
    let covariance = turned * unit.gaussians.covariance(local) * turned.transpose();
    let opacity = f64::from(unit.gaussians.opacity(local)).min(OPAQUE);
    let finite = center.is_finite() && covariance.is_finite() && opacity > LEAST;
    finite.then_some((center, covariance, opacity))
}

/// Standard deviations along the axes.
fn deviations(covariance: &DMat3) -> DVec3 {
    DVec3::new(covariance.x_axis.x, covariance.y_axis.y, covariance.z_axis.z).max(DVec3::ZERO).map(f64::sqrt)
}

/// The Mahalanobis distance at which a Gaussian of this peak opacity has the opacity `least`; 0 if it is nowhere above.
fn radius(opacity: f64, least: f64) -> f64 {
    (2.0 * (opacity / least).ln()).max(0.0).sqrt()
}

impl Cells {
    /// Cells over a box, with one empty layer on each side.
    fn around((min, max): (DVec3, DVec3)) -> Self {
        let size = max - min;
        let edge = (size.element_product() / CELLS).cbrt().max(size.max_element() / LONGEST);
        // A single point has a cell too.
        let edge = if edge > 0.0 && edge.is_finite() { edge } else { 1.0 };
        let count = (size / edge).ceil().as_uvec3() + UVec3::splat(2);
        Self { origin: min - DVec3::splat(edge), edge, count }
    }

    fn layer(&self) -> usize {
        (self.count.x * self.count.y) as usize
    }

    /// −ln of the light that the Gaussians let through, at the centre of each cell, f32.
    fn optical_depths(&self, ellipsoids: impl Iterator<Item = (DVec3, DMat3, f64)>) -> Vec<f32> {
        let mut depths = vec![0.0; self.layer() * self.count.z as usize];
        let mut bodies = Vec::new();
        let mut ellipsoids = ellipsoids.map(|ellipsoid| self.body(ellipsoid));
        // In parts, so that memory does not grow with the scene.
        loop {
            bodies.extend(ellipsoids.by_ref().take(PART));
            if bodies.is_empty() {
                return depths;
            }
            depths.par_chunks_mut(LAYERS * self.layer()).enumerate().for_each(|(task, depths)| {
                for body in &bodies {
                    self.add(body, LAYERS * task, depths);
                }
            });
            bodies.clear();
        }
    }

    fn body(&self, (center, covariance, opacity): (DVec3, DMat3, f64)) -> Body {
        // Flat Gaussians lie between the centres of cells. Widened by half a cell, a surface of them has no holes.
        let covariance = covariance + DMat3::from_diagonal(DVec3::splat((0.5 * self.edge).powi(2)));
        Body {
            center: (center - self.origin).as_vec3(),
            precision: covariance.inverse().as_mat3(),
            opacity: opacity as f32,
            reach: (deviations(&covariance) * radius(opacity, LEAST)).as_vec3(),
        }
    }

    /// Adds a Gaussian to the layers from `first` on.
    fn add(&self, body: &Body, first: usize, depths: &mut [f32]) {
        let edge = self.edge as f32;
        let layers = depths.len() / self.layer();
        // Indices of the cells whose centres lie between two places.
        let range = |center: f32, reach: f32, count: u32| {
            let least = ((center - reach) / edge - 0.5).ceil().max(0.0) as usize;
            let most = ((center + reach) / edge + 0.5).floor().max(0.0) as usize;
            least..most.min(count as usize)
        };
        let rows = range(body.center.z, body.reach.z, self.count.z);
        for z in rows.start.max(first)..rows.end.min(first + layers) {
            for y in range(body.center.y, body.reach.y, self.count.y) {
                let row = ((z - first) * self.count.y as usize + y) * self.count.x as usize;
                for x in range(body.center.x, body.reach.x, self.count.x) {
                    let offset = (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * edge - body.center;
                    let hidden = body.opacity * (-0.5 * offset.dot(body.precision * offset)).exp();
                    if let Some(depth) = depths.get_mut(row + x) {
                        *depth -= (-hidden).ln_1p();
                    }
                }
            }
        }
    }

    /// Ranges of the cells along each axis whose centres lie in the scene's box.
    fn within(&self, bounds: SceneBox) -> [Range<usize>; 3] {
        std::array::from_fn(|axis| {
            let place = |end: f64| (end - self.origin[axis]) / self.edge - 0.5;
            let count = self.count[axis] as usize;
            // Of an axis without extent, all.
            let [first, last] = [bounds.min, bounds.max].map(|end| place(end[axis]));
            let range = first.ceil().max(0.0) as usize..((last.floor() + 1.0).max(0.0) as usize).min(count);
            if range.is_empty() { 0..count } else { range }
        })
    }

    /// Number of cells that lie outside. A way leads to them from the edge of the grid, over faces of cells that hide less than
    /// [`BARRIER`]: a thinner layer closes no surface. From there on the way goes up the outer side of what closes, through cells
    /// outside the Gaussians ([`RISING`]). No way leads through the sides of the scene's box, `within`: a volume cuts what it holds
    /// open there.
    fn outside(&self, depths: &[f32], within: &[Range<usize>; 3]) -> usize {
        let [width, height, layers] = self.count.to_array().map(|n| n as usize);
        let place = |at: usize| [at % width, at / width % height, at / (width * height)];
        let is_within = |at: usize| place(at).into_iter().zip(within).all(|(x, range)| range.contains(&x));
        let neighbours = |at: usize| {
            let steps = [(width, 1), (height, width), (layers, width * height)];
            place(at).into_iter().zip(steps).flat_map(move |(place, (count, step))| {
                let before = (place > 0).then(|| at - step);
                before.into_iter().chain((place + 1 < count).then_some(at + step))
            })
        };
        // The grid's own sides, which are empty, and the corners of the scene's box where its sides cut the grid.
        let ends = [width, height, layers];
        let begins = |at: usize| {
            let at_end = |axis: usize, x: usize| x == 0 || x + 1 == ends[axis];
            let at_corner = |axis: usize, x: usize| x == within[axis].start || x + 1 == within[axis].end;
            let place = place(at);
            let any = place.into_iter().enumerate().any(|(axis, x)| at_end(axis, x));
            any || place.into_iter().enumerate().all(|(axis, x)| at_corner(axis, x))
        };
        let barrier = -(-BARRIER).ln_1p();
        // Beyond the box there is no inside.
        let mut reached: Vec<bool> = (0..depths.len()).map(|at| !is_within(at) && depths[at] < LN_2).collect();
        let mut open: Vec<usize> = (0..depths.len()).filter(|at| is_within(*at) && begins(*at)).collect();
        open.retain(|at| depths[*at] < barrier);
        // Least first, by the highest density on the way: each cell is then reached by the lowest way.
        let mut climbs = BinaryHeap::new();
        let climb = |to: usize, highest: f32| Reverse((depths[to].max(highest).to_bits(), to));
        while let Some(at) = open.pop() {
            if std::mem::replace(&mut reached[at], true) {
                continue;
            }
            for to in neighbours(at).filter(|to| !reached[*to] && is_within(*to)) {
                if depths[to] < barrier { open.push(to) } else { climbs.push(climb(to, 0.0)) }
            }
        }
        while let Some(Reverse((bits, at))) = climbs.pop() {
            let highest = f32::from_bits(bits);
            if depths[at] >= LN_2 || std::mem::replace(&mut reached[at], true) {
                continue;
            }
            let rising = |to: &usize| !reached[*to] && depths[*to] >= RISING * highest;
            climbs.extend(neighbours(at).filter(rising).map(|to| climb(to, highest)));
        }
        reached.iter().filter(|is_reached| **is_reached).count()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use glam::{DMat4, DQuat};

    use super::*;
    use crate::model::Gaussians;
    use crate::synthetic::unit_of;

    /// Round Gaussians of one standard deviation and opacity.
    fn scene_of(centers: &[DVec3], deviation: f64, opacity: f64) -> Scene {
        let n = centers.len();
        let gaussians = Gaussians {
            position: centers.iter().map(|c| c.as_vec3()).collect(),
            rotation: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scale: vec![Vec3::splat(deviation.ln() as f32); n],
            opacity_logit: vec![(opacity / (1.0 - opacity)).ln() as f32; n],
            ..Gaussians::default()
        };
        Scene::compose(vec![unit_of(gaussians)], None)
    }

    fn whole(scene: &Scene) -> Size {
        size(scene, &Mask::full(scene.len())).unwrap()
    }

    fn close(a: f64, b: f64, share: f64) -> bool {
        (a - b).abs() <= share * b.abs()
    }

    /// Evenly spread directions.
    fn sphere(radius: f64, n: usize) -> Vec<DVec3> {
        let place = |i: usize| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
            radius * DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        };
        (0..n).map(place).collect()
    }

    #[test]
    fn one_gaussian_has_the_size_of_its_ellipsoid() {
        let (deviation, opacity) = (0.7, 0.9);
        let mut scene = scene_of(&[DVec3::new(3.0, -2.0, 5.0)], deviation, opacity);
        scene.units[0].gaussians.log_scale[0] =
            Vec3::new(deviation.ln() as f32, (2.0 * deviation).ln() as f32, deviation.ln() as f32);
        let turn = DQuat::from_axis_angle(DVec3::Z, PI / 2.0);
        scene.units[0].transform = DMat4::from_scale_rotation_translation(DVec3::splat(10.0), turn, DVec3::splat(1e5));
        let r = 10.0 * deviation * (2.0 * (2.0 * opacity).ln()).sqrt();
        let Size { extent, occupied, enclosed } = whole(&scene);
        assert!((extent / DVec3::new(4.0 * r, 2.0 * r, 2.0 * r) - 1.0).abs().max_element() < 1e-3, "{extent} {r}");
        // Widening by a cell adds some percent of a small body.
        let truth = 4.0 / 3.0 * PI * 2.0 * r.powi(3);
        assert!(close(occupied, truth, 0.06) && occupied == enclosed, "{occupied} {truth}");
    }

    #[test]
    fn a_closed_surface_encloses_its_inside_and_an_open_one_nothing() {
        let points = sphere(20.0, 4000);
        let Size { extent, occupied, enclosed } = whole(&scene_of(&points, 0.8, 0.9));
        let truth = 4.0 / 3.0 * PI * 20.0_f64.powi(3);
        assert!(extent.min_element() > 40.0 && extent.max_element() < 43.0, "{extent}");
        assert!(enclosed > truth && enclosed < 1.25 * truth && occupied < 0.5 * truth, "{occupied} {enclosed} {truth}");
        let mut open: Vec<DVec3> = points.into_iter().filter(|p| p.z < 12.0).collect();
        // A volume that ends where the bowl does has cut it open there.
        let cut = whole(&scene_of(&open, 0.8, 0.9));
        let missing = PI * 8.0 * 8.0 * (20.0 - 8.0 / 3.0);
        assert!(cut.enclosed > truth - missing && cut.enclosed < enclosed, "{cut:?}");
        // In a larger scene the bowl is open.
        open.push(DVec3::new(0.0, 0.0, 40.0));
        let scene = scene_of(&open, 0.8, 0.9);
        let bowl = size(&scene, &Mask::from_fn(open.len(), |i| i + 1 < open.len())).unwrap();
        assert!(close(bowl.enclosed, bowl.occupied, 0.05), "{bowl:?}");
    }

    #[test]
    fn cells_add_up_as_each_point_alone_does() {
        let points = sphere(3.0, 200);
        let scene = scene_of(&points, 0.4, 0.6);
        let ellipsoids: Vec<_> = (0..scene.len()).filter_map(|i| ellipsoid(&scene, i)).collect();
        let cells = Cells::around((DVec3::splat(-5.0), DVec3::splat(5.0)));
        let depths = cells.optical_depths(ellipsoids.iter().copied());
        for at in (0..depths.len()).step_by(9973) {
            let [x, y, z] =
                [at % cells.count.x as usize, at / cells.count.x as usize % cells.count.y as usize, at / cells.layer()];
            let place = cells.origin + (DVec3::new(x as f64, y as f64, z as f64) + 0.5) * cells.edge;
            let widened = 0.4_f64.powi(2) + (0.5 * cells.edge).powi(2);
            let light: f64 = ellipsoids
                .iter()
                .map(|(center, _, opacity)| 1.0 - opacity * (-0.5 * place.distance_squared(*center) / widened).exp())
                .product();
            // What a Gaussian hides below the least share is left out, of each.
            assert!((f64::from((-depths[at]).exp()) - light).abs() < 0.01, "{place}: {} {light}", depths[at]);
        }
    }

    #[test]
    fn what_is_not_finite_does_not_count() {
        let mut scene = scene_of(&[DVec3::ZERO, DVec3::ONE, DVec3::splat(2.0)], 0.1, 0.9);
        let whole_size = whole(&scene);
        scene.units[0].gaussians.position[1].x = f32::NAN;
        scene.units[0].gaussians.log_scale[0].y = f32::INFINITY;
        let left = whole(&scene);
        assert!(left.extent.max_element() < 0.3 && left.extent.max_element() < whole_size.extent.max_element());
        assert_eq!(size(&scene, &Mask::empty(3)), None);
        let invisible = scene_of(&[DVec3::ZERO], 0.1, 1e-6);
        assert_eq!(size(&invisible, &Mask::full(1)), None);
    }
}
