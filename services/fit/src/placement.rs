//! Where Gaussians go: evenly over the importance, then relaxed into its weighted Voronoi cells.

use std::ops::Range;

use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_volume::Field;
use sg_volume::transfer::extinction;

use crate::importance::{Candidate, Candidates};
use crate::optics::Optics;

/// Points that stand for the candidates should be at least this many times the Gaussians …
const LEAST_POINTS: usize = 6;
/// … and need not be more than this many times.
const MOST_POINTS: usize = 96;
/// A voxel is divided into at most this many parts along each axis.
const MOST_PARTS: u32 = 32;
/// A part of a voxel weighs at most this many times its even share.
const MOST_DENSER: f32 = 4.0;
/// No more points than this, whatever is asked for.
const POINT_LIMIT: usize = 1 << 26;

/// The points that Voronoi cells are made of: groups of candidates where there are many for each Gaussian, the
/// candidates themselves, or parts of them where there are few. In grid-local lengths: voxel ∘ spacing.
pub(crate) struct Points {
    position: Vec<[f32; 3]>,
    weight: Vec<f32>,
    kind: Kind,
}

enum Kind {
    /// Point `i` stands for candidates `starts[i]..starts[i + 1]`.
    Groups { starts: Vec<u32> },
    /// Each candidate has parts³ points, in its order.
    Parts { parts: u32 },
}

/// A piece of matter within a cell.
pub(crate) struct Piece {
    /// Place in voxel coordinates.
    pub(crate) voxel: DVec3,
    /// Importance.
    pub(crate) weight: f32,
    /// Share of a voxel's volume.
    pub(crate) share: f64,
}

impl Points {
    /// Chooses the points for `gaussians` cells.
    pub(crate) fn new(candidates: &Candidates, optics: &Optics<'_>, gaussians: usize) -> Self {
        let parts = parts_per_axis(candidates.list.len(), gaussians);
        if parts > 1 {
            Self::parts(&candidates.list, optics, parts)
        } else {
            Self::groups(candidates, optics.field, gaussians)
        }
    }

    fn groups(candidates: &Candidates, field: &Field, gaussians: usize) -> Self {
        let list = &candidates.list;
        let most = gaussians.saturating_mul(MOST_POINTS).max(1);
        let mut level = 0;
        let mut starts = group_starts(candidates, field, level);
        while starts.len() - 1 > most {
            level += 1;
            starts = group_starts(candidates, field, level);
        }
        let spacing = field.grid().spacing();
        let (position, weight) = starts
            .par_windows(2)
            .map(|w| {
                let members = &list[w[0] as usize..w[1] as usize];
                let weight: f32 = members.iter().map(|c| c.weight).sum();
                let mean: DVec3 = members
                    .iter()
                    .map(|c| field.grid().voxel(c.voxel as usize).as_dvec3() * f64::from(c.weight))
                    .sum::<DVec3>()
                    / f64::from(weight);
                ((mean * spacing).as_vec3().to_array(), weight)
            })
            .unzip();
        Self { position, weight, kind: Kind::Groups { starts } }
    }

    fn parts(list: &[Candidate], optics: &Optics<'_>, parts: u32) -> Self {
        let cubed = parts.pow(3) as usize;
        let field = optics.field;
        let spacing = field.grid().spacing();
        let extinction_at = |raw: f64| extinction(optics.classifier.opacity(raw), 1.0);
        let (position, weight) = (0..list.len() * cubed)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let candidate = list[i / cubed];
                let voxel = part_position(candidate, field, parts, (i % cubed) as u32);
                // A voxel on a boundary shows more on its denser side.
                let whole = extinction_at(field.raw(candidate.voxel as usize));
                let part = field.sample(voxel).map_or(0.0, extinction_at);
                let weight = candidate.weight / cubed as f32 * (part / whole).min(MOST_DENSER);
                ((voxel * spacing).as_vec3().to_array(), weight)
            })
            .unzip();
        Self { position, weight, kind: Kind::Parts { parts } }
    }

    /// Side of the volume that a piece fills, in voxels.
    pub(crate) fn piece_side(&self) -> f64 {
        match self.kind {
            Kind::Groups { .. } => 1.0,
            Kind::Parts { parts } => 1.0 / f64::from(parts),
        }
    }

    /// The pieces of point `i`.
    pub(crate) fn for_each_piece(&self, i: usize, list: &[Candidate], field: &Field, mut f: impl FnMut(Piece)) {
        match &self.kind {
            Kind::Groups { starts } => {
                for c in &list[starts[i] as usize..starts[i + 1] as usize] {
                    f(Piece { voxel: field.grid().voxel(c.voxel as usize).as_dvec3(), weight: c.weight, share: 1.0 });
                }
            }
            Kind::Parts { parts } => {
                let cubed = parts.pow(3);
                let candidate = list[i / cubed as usize];
                f(Piece {
                    voxel: part_position(candidate, field, *parts, i as u32 % cubed),
                    weight: self.weight[i],
                    share: 1.0 / f64::from(cubed),
                });
            }
        }
    }
}

/// How finely voxels must be divided so that there are enough points.
fn parts_per_axis(candidates: usize, gaussians: usize) -> u32 {
    let wanted = gaussians.saturating_mul(LEAST_POINTS).min(POINT_LIMIT);
    let enough = |p: u32| candidates.saturating_mul(p.pow(3) as usize) >= wanted;
    let fits = |p: u32| candidates.saturating_mul(p.pow(3) as usize) <= POINT_LIMIT;
    let parts = (1..=MOST_PARTS).find(|&p| enough(p)).unwrap_or(MOST_PARTS);
    (1..=parts).rev().find(|&p| fits(p)).unwrap_or(1)
}

/// Centre of part `k` of a candidate's voxel, in voxel coordinates.
fn part_position(candidate: Candidate, field: &Field, parts: u32, k: u32) -> DVec3 {
    let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(parts) - 0.5;
    let within = DVec3::new(offset(k % parts), offset(k / parts % parts), offset(k / parts / parts));
    field.grid().voxel(candidate.voxel as usize).as_dvec3() + within
}

/// Where groups of candidates begin that share a cube of 2^level voxels, aligned to the curve they are ordered along: a
/// cube's candidates stand together.
fn group_starts(candidates: &Candidates, field: &Field, level: u32) -> Vec<u32> {
    let list = &candidates.list;
    let cube = |c: &Candidate| {
        let v = field.grid().voxel(c.voxel as usize).as_uvec3() - candidates.first;
        [v.x >> level, v.y >> level, v.z >> level]
    };
    let mut starts = vec![0];
    if level == 0 {
        starts.extend(1..=list.len() as u32);
        return starts;
    }
    for (i, w) in list.windows(2).enumerate() {
        if cube(&w[0]) != cube(&w[1]) {
            starts.push(i as u32 + 1);
        }
    }
    starts.push(list.len() as u32);
    starts
}

/// `n` places drawn from the importance by systematic sampling along the candidates' curve: every stretch of the curve,
/// and so every octant of space, gets its share to within one. Each place is jittered within its voxel. Grid-local
/// lengths.
pub(crate) fn scatter(candidates: &Candidates, field: &Field, n: usize, random: &mut ChaCha8Rng) -> Vec<[f32; 3]> {
    let spacing = field.grid().spacing();
    let step = candidates.total / n as f64;
    let start: f64 = random.random();
    let mut places = Vec::with_capacity(n);
    let mut reached = 0.0;
    let mut list = candidates.list.iter();
    let mut current = None;
    for k in 0..n {
        let at = (k as f64 + start) * step;
        while reached <= at {
            // Rounding may leave the last place a hair behind the last candidate's end.
            let Some(c) = list.next() else { break };
            reached += f64::from(c.weight);
            current = Some(c);
        }
        if let Some(c) = current {
            let jitter = DVec3::new(random.random(), random.random(), random.random()) - 0.5;
            let voxel = field.grid().voxel(c.voxel as usize).as_dvec3() + jitter;
            places.push((voxel * spacing).as_vec3().to_array());
        }
    }
    places
}

/// Voronoi cells: which points are nearest to which place.
pub(crate) struct Cells {
    /// Points, cell by cell.
    order: Vec<u32>,
    /// Where each cell begins in `order`; one more than there are cells.
    starts: Vec<u32>,
}

impl Cells {
    /// Assigns every point to its nearest place.
    pub(crate) fn new(points: &Points, places: &[[f32; 3]]) -> Result<Self, String> {
        let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(places).map_err(|e| e.to_string())?;
        let nearest: Vec<u32> = points
            .position
            .par_iter()
            .with_min_len(1024)
            .map(|p| tree.query(p).nearest_one::<SquaredEuclidean<f32>>().execute().item)
            .collect();
        let mut starts = vec![0_u32; places.len() + 1];
        for &cell in &nearest {
            starts[cell as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut order = vec![0_u32; nearest.len()];
        let mut next = starts.clone();
        for (point, &cell) in nearest.iter().enumerate() {
            let at = &mut next[cell as usize];
            order[*at as usize] = point as u32;
            *at += 1;
        }
        Ok(Self { order, starts })
    }

    /// Number of cells.
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The points of cell `i`, by increasing index.
    pub(crate) fn points(&self, i: usize) -> &[u32] {
        let Range { start, end } = self.starts[i] as usize..self.starts[i + 1] as usize;
        &self.order[start..end]
    }
}

/// Places `n` Gaussians' centres and returns the cells of matter they stand for: scattered over the importance, then
/// `rounds` times moved to the weighted centroids of their cells (Lloyd 1982). Places without a cell stay where they are.
pub(crate) fn place(
    candidates: &Candidates,
    points: &Points,
    field: &Field,
    n: usize,
    rounds: usize,
    seed: u64,
) -> Result<Cells, String> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut places = scatter(candidates, field, n, &mut random);
    for _ in 0..rounds {
        let cells = Cells::new(points, &places)?;
        places.par_iter_mut().enumerate().for_each(|(i, place)| {
            let (mut sum, mut weight) = (DVec3::ZERO, 0.0_f64);
            for &p in cells.points(i) {
                let w = f64::from(points.weight[p as usize]);
                sum += Vec3::from_array(points.position[p as usize]).as_dvec3() * w;
                weight += w;
            }
            if weight > 0.0 {
                *place = (sum / weight).as_vec3().to_array();
            }
        });
    }
    Cells::new(points, &places)
}
