//! Execution of operations on the scene.

use std::sync::{Arc, OnceLock};

use glam::DVec3;
use rayon::prelude::*;
use sg_scene::camera::Camera;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Scene};

use crate::operations::{Attribute, Combine, Operation};
use sg_clusters::bvh::PointTree;
use sg_clusters::features::{Row, WIDTH, distance_squared};
use sg_clusters::geometry::{Geometry, GeometryError, GeometryOptions, UnitGeometry};
use sg_clusters::progress::Silent;

/// A scene with its neighbour graphs and features. The first operation that needs them computes them.
#[derive(Debug)]
pub struct OperationContext {
    scene: Arc<Scene>,
    options: GeometryOptions,
    geometry: OnceLock<Result<Geometry, GeometryError>>,
}

impl OperationContext {
    /// A context without geometry.
    #[must_use]
    pub fn new(scene: Arc<Scene>, options: GeometryOptions) -> Self {
        Self { scene, options, geometry: OnceLock::new() }
    }

    /// A context with the geometry of the same scene.
    #[must_use]
    pub fn with_geometry(scene: Arc<Scene>, geometry: Geometry) -> Self {
        let options = GeometryOptions { neighbours: geometry.neighbours, ..GeometryOptions::default() };
        Self { scene, options, geometry: OnceLock::from(Ok(geometry)) }
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    fn geometry(&self) -> Result<&Geometry, GeometryError> {
        let made = self.geometry.get_or_init(|| Geometry::of_scene(&self.scene, self.options, &Silent));
        made.as_ref().map_err(Clone::clone)
    }

    /// Applies a checked operation ([`Operation::check`]) to a mask over the scene's Gaussians.
    ///
    /// Most operations visit every Gaussian once. [`Operation::Grow`] and [`Operation::Shrink`] search a tree for each
    /// Gaussian. The first operation with neighbours or features computes the geometry of the whole scene.
    ///
    /// # Errors
    /// [`GeometryError`] if the geometry fails; the mask is then unchanged.
    pub fn apply(&self, operation: &Operation, mask: &mut Mask) -> Result<(), GeometryError> {
        let (bounds, longest) = (self.scene.bounds, self.scene.bounds.longest_edge());
        let place = |p: &[f64; 3]| bounds.denormalize(DVec3::from_array(*p));
        let (found, combine) = match operation {
            Operation::Invert => {
                let touched = self.touched(mask);
                let is_none = mask.is_none();
                let found = self.find(|unit, _, p| (is_none || touched[unit]) && p.is_finite());
                let mut inverted = found;
                inverted.subtract(mask);
                *mask = inverted;
                return Ok(());
            }
            Operation::Grow { distance } => {
                let grown = self.within(self.geometry()?, mask, true, distance * longest);
                mask.union_with(&grown);
                return Ok(());
            }
            Operation::Shrink { distance } => {
                let lost = self.within(self.geometry()?, mask, false, distance * longest);
                mask.subtract(&lost);
                return Ok(());
            }
            Operation::FillHoles { most } => {
                fill_holes(self.geometry()?, mask, *most);
                return Ok(());
            }
            Operation::LargestPieces { keep } => {
                let mut pieces = pieces(self.geometry()?, mask);
                pieces.sort_by_key(|p| (std::cmp::Reverse(p.len()), p.iter().min().copied()));
                *mask = of_indices(mask.len(), pieces.iter().take(*keep).flatten());
                return Ok(());
            }
            Operation::PieceAt { at } => {
                let at = place(at);
                let distance =
                    |g: u32| self.scene.position(g as usize).map_or(f64::INFINITY, |p| p.distance_squared(at));
                let pieces = pieces(self.geometry()?, mask);
                let near = |p: &Vec<u32>| {
                    p.iter().map(|g| (distance(*g), *g)).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
                };
                let nearest = pieces.iter().filter_map(|p| near(p).map(|n| (n, p)));
                let nearest = nearest.min_by(|(a, _), (b, _)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                *mask = of_indices(mask.len(), nearest.into_iter().flat_map(|(_, p)| p));
                return Ok(());
            }
            Operation::Similar { threshold, combine } => (similar(self.geometry()?, mask, *threshold), *combine),
            Operation::Box { min, max, combine } => {
                let (min, max) = (place(min), place(max));
                (self.find(|_, _, p| p.cmpge(min).all() && p.cmple(max).all()), *combine)
            }
            Operation::Sphere { centre, radius, combine } => {
                let (centre, limit) = (place(centre), (radius * longest).powi(2));
                (self.find(|_, _, p| p.distance_squared(centre) < limit), *combine)
            }
            Operation::Plane { point, normal, combine } => {
                let (point, normal) = (place(point), DVec3::from_array(*normal));
                (self.find(|_, _, p| (p - point).dot(normal) > 0.0), *combine)
            }
            Operation::Lasso { camera, polygon, near, far, combine } => {
                (self.find(|_, _, p| sees(camera, polygon, *near..=*far, p)), *combine)
            }
            Operation::Range { attribute, min, max, combine } => {
                let units = &self.scene.units;
                let value = |unit: usize, local: usize| attribute_of(&units[unit], local, *attribute, longest);
                (self.find(|unit, local, _| (*min..=*max).contains(&value(unit, local))), *combine)
            }
        };
        match combine {
            Combine::Add => mask.union_with(&found),
            Combine::Remove => mask.subtract(&found),
            Combine::Intersect => mask.intersect_with(&found),
            Combine::Replace => *mask = found,
        }
        Ok(())
    }

    /// Base units with a selected Gaussian.
    fn touched(&self, mask: &Mask) -> Vec<bool> {
        self.scene.units.iter().map(|u| u.range().any(|g| mask.get(g))).collect()
    }

    /// Gaussians that satisfy a predicate of unit, index in the unit, and centre in the scene frame.
    fn find(&self, holds: impl Fn(usize, usize, DVec3) -> bool + Sync) -> Mask {
        let mut mask = Mask::empty(self.scene.len());
        for (u, unit) in self.scene.units.iter().enumerate() {
            let (transform, positions) = (unit.transform, &unit.gaussians.position);
            let at = |i: usize| transform.transform_point3(positions[i].as_dvec3());
            let found: Vec<usize> = (0..positions.len()).into_par_iter().filter(|&i| holds(u, i, at(i))).collect();
            found.into_iter().for_each(|i| mask.set(unit.first + i, true));
        }
        mask
    }

    /// Gaussians closer than `radius` to one on the other side of the selection's boundary, in the same unit.
    ///
    /// `selected` finds unselected Gaussians near selected ones; otherwise the reverse.
    fn within(&self, geometry: &Geometry, mask: &Mask, selected: bool, radius: f64) -> Mask {
        let mut found = Mask::empty(mask.len());
        for unit in &geometry.units {
            let (indices, positions) = (&unit.vertices.gaussian, &unit.vertices.position);
            let is = |v: &usize| mask.get(indices[*v] as usize) == selected;
            let points: Vec<[f64; 3]> = (0..indices.len()).filter(is).map(|v| positions[v]).collect();
            if points.is_empty() || points.len() == indices.len() {
                continue;
            }
            let tree = PointTree::new(&points);
            let limit = radius * radius;
            let near = |v: &usize| tree.nearest_distance_squared(&positions[*v]) < limit;
            let close: Vec<usize> = (0..indices.len()).into_par_iter().filter(|v| !is(v)).filter(near).collect();
            close.into_iter().for_each(|v| found.set(indices[v] as usize, true));
        }
        found
    }
}

/// Connected pieces, over the neighbour graph, of the vertices of a unit that satisfy a predicate.
fn pieces_where(unit: &UnitGeometry, holds: impl Fn(u32) -> bool) -> Vec<Vec<u32>> {
    let n = unit.vertices.len();
    let mut seen: Vec<bool> = (0..n).map(|v| !holds(v as u32)).collect();
    let mut pieces = Vec::new();
    for start in 0..n as u32 {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        let (mut piece, mut next) = (vec![start], 0);
        while let Some(&v) = piece.get(next) {
            next += 1;
            for (w, _) in unit.graph.neighbours(v) {
                if !std::mem::replace(&mut seen[w as usize], true) {
                    piece.push(w);
                }
            }
        }
        pieces.push(piece);
    }
    pieces
}

/// The pieces of a selection, as scene-wide indices.
fn pieces(geometry: &Geometry, mask: &Mask) -> Vec<Vec<u32>> {
    let of = |unit: &UnitGeometry| {
        let index = unit.vertices.gaussian.clone();
        let pieces = pieces_where(unit, |v| mask.get(index[v as usize] as usize));
        pieces.into_iter().map(move |p| p.into_iter().map(|v| index[v as usize]).collect()).collect::<Vec<_>>()
    };
    geometry.units.iter().flat_map(of).collect()
}

fn fill_holes(geometry: &Geometry, mask: &mut Mask, most: usize) {
    for unit in &geometry.units {
        let index = &unit.vertices.gaussian;
        let selected = |v: u32| mask.get(index[v as usize] as usize);
        let touches = |piece: &[u32]| piece.iter().any(|&v| unit.graph.neighbours(v).any(|(w, _)| selected(w)));
        let unselected = pieces_where(unit, |v| !selected(v));
        let holes: Vec<_> = unselected.into_iter().filter(|p| p.len() <= most && touches(p)).collect();
        holes.into_iter().flatten().for_each(|v| mask.set(index[v as usize] as usize, true));
    }
}

fn of_indices<'a>(len: usize, indices: impl IntoIterator<Item = &'a u32>) -> Mask {
    let mut mask = Mask::empty(len);
    indices.into_iter().for_each(|&g| mask.set(g as usize, true));
    mask
}

fn similar(geometry: &Geometry, mask: &Mask, threshold: f64) -> Mask {
    let mut found = Mask::empty(mask.len());
    for unit in &geometry.units {
        let (index, rows) = (&unit.vertices.gaussian, &unit.features.rows);
        let selected: Vec<usize> = (0..index.len()).filter(|&v| mask.get(index[v] as usize)).collect();
        if selected.is_empty() {
            continue;
        }
        let count = selected.len() as f64;
        let mut sums = [0.0_f64; WIDTH];
        for &v in &selected {
            sums.iter_mut().zip(&rows[v]).for_each(|(sum, x)| *sum += f64::from(*x));
        }
        let mean: Row = sums.map(|sum| (sum / count) as f32);
        let spread = selected.iter().map(|&v| distance_squared(&rows[v], &mean)).sum::<f64>() / count;
        // The floor absorbs rounding of the mean: a selection of equal Gaussians finds all equal ones.
        let limit = (threshold * threshold * spread).max(1e-10);
        let like: Vec<usize> =
            (0..index.len()).into_par_iter().filter(|&v| distance_squared(&rows[v], &mean) <= limit).collect();
        like.into_iter().for_each(|v| found.set(index[v] as usize, true));
    }
    found
}

/// Whether a camera sees a point within a polygon and between two depths.
fn sees(camera: &Camera, polygon: &[[f64; 2]], depths: std::ops::RangeInclusive<f64>, p: DVec3) -> bool {
    let q = camera.view().transform_point3(p);
    if !(q.z > 0.0 && depths.contains(&q.z)) {
        return false;
    }
    let (x, y) = (camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
    let mut inside = false;
    for (a, b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        // Half-open in y, so that a ray through a corner crosses one of its edges.
        if (a[1] > y) != (b[1] > y) && x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) {
            inside = !inside;
        }
    }
    inside
}

fn attribute_of(unit: &BaseUnit, i: usize, attribute: Attribute, longest: f64) -> f64 {
    let channel = match attribute {
        Attribute::Opacity => return f64::from(unit.gaussians.opacity(i)),
        Attribute::Scale => {
            // Scale in the scene frame: the unit's transform may scale the Gaussian.
            let volume = unit.transform.determinant().abs().cbrt();
            let mean = unit.gaussians.log_scale[i].as_dvec3().element_sum() / 3.0;
            return mean.exp() * volume / longest;
        }
        Attribute::Red => 0,
        Attribute::Green => 1,
        Attribute::Blue => 2,
    };
    unit.unlit_color(i)[channel]
}

#[cfg(test)]
mod tests;
