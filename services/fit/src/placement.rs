//! Placement of Gaussians: systematic sampling of the importance, then relaxation of weighted Voronoi cells.

use std::ops::Range;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_volume::Field;
use sg_volume::opacity::extinction;

use crate::classification::Classification;
use crate::importance::{Candidate, Candidates};
use crate::label_units::LabelPart;
use crate::pieces::{Piece, Pieces};

/// Least number of sample points for each Gaussian.
const LEAST_POINTS: usize = 6;
/// Largest useful number of sample points for each Gaussian.
const MOST_POINTS: usize = 96;
/// Largest number of parts of a voxel along each axis.
const MOST_PARTS: u32 = 32;
/// Largest number of sample points.
const POINT_LIMIT: usize = 1 << 26;

/// The tree of the nearest-neighbour search could not be built.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the nearest-neighbour tree could not be built: {reason}")]
pub struct PlacementError {
    /// The reason that the tree gives.
    pub reason: String,
}

/// The sample points of the Voronoi cells, in grid-local lengths: voxel ∘ spacing. With many candidates for each Gaussian a
/// point is a group of candidates. Otherwise it is a candidate, or a part of one.
pub(crate) struct Points {
    position: Vec<[f32; 3]>,
    weight: Vec<f32>,
    kind: Kind,
}

enum Kind {
    /// Point `i` represents candidates `starts[i]..starts[i + 1]`.
    Groups { starts: Vec<u32> },
    /// Each candidate has parts³ points, in its order.
    Parts { parts: u32 },
}

impl Points {
    /// Chooses the points for `gaussians` cells.
    pub(crate) fn new(candidates: &Candidates, classification: &Classification<'_>, gaussians: usize) -> Self {
        let parts = parts_per_axis(candidates.list.len(), gaussians);
        if parts > 1 {
            Self::parts(candidates, classification, parts)
        } else {
            Self::groups(candidates, classification.field, gaussians)
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

    /// The emphasis of a part is interpolated between voxels, and its opacity is its own. With one value for each voxel, the centres follow the lattice of
    /// the voxels: faded surfaces then show terraces and a weave.
    fn parts(candidates: &Candidates, classification: &Classification<'_>, parts: u32) -> Self {
        let cubed = parts.pow(3) as usize;
        let field = classification.field;
        let spacing = field.grid().spacing();
        let reference = field.grid().reference_length();
        let extinction_at = |raw: f64| extinction(classification.classifier.opacity(raw), reference);
        let (position, weight) = (0..candidates.list.len() * cubed)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let voxel = part_position(candidates.list[i / cubed], field, parts, (i % cubed) as u32);
                let sigma = field.sample(voxel).map_or(0.0, extinction_at);
                let least = candidates.list[i / cubed].least;
                let weight = candidates.importance_at(voxel, sigma).max(least) / cubed as f32;
                ((voxel * spacing).as_vec3().to_array(), weight)
            })
            .unzip();
        Self { position, weight, kind: Kind::Parts { parts } }
    }
}

/// The voxels of one base unit, or parts of them, at its sample points.
pub(crate) struct VoxelPieces<'a> {
    pub(crate) points: &'a Points,
    pub(crate) list: &'a [Candidate],
    pub(crate) field: &'a Field,
    /// The smoothed field for gradients.
    pub(crate) smooth: &'a Field,
    /// The label of these voxels, where base units are labels.
    pub(crate) label: Option<LabelPart<'a>>,
}

impl Pieces for VoxelPieces<'_> {
    fn for_each(&self, point: u32, mut f: impl FnMut(Piece)) {
        let i = point as usize;
        match &self.points.kind {
            Kind::Groups { starts } => {
                for c in &self.list[starts[i] as usize..starts[i + 1] as usize] {
                    let place = self.field.grid().voxel(c.voxel as usize).as_dvec3();
                    f(Piece { place, weight: c.weight, share: 1.0, point });
                }
            }
            Kind::Parts { parts } => {
                let cubed = parts.pow(3);
                let place = part_position(self.list[i / cubed as usize], self.field, *parts, point % cubed);
                f(Piece { place, weight: self.points.weight[i], share: 1.0 / f64::from(cubed), point });
            }
        }
    }

    fn value_and_gradient(&self, piece: &Piece) -> (f64, Vec3) {
        let v = piece.place;
        let (raw, gradient) = match self.points.kind {
            Kind::Groups { .. } => {
                let (x, y, z) = (v.x as usize, v.y as usize, v.z as usize);
                (self.field.raw(self.field.grid().index(x, y, z)), self.smooth.gradient_at(x, y, z))
            }
            Kind::Parts { .. } => (self.field.sample(v).unwrap_or(f64::NAN), self.smooth.gradient(v)),
        };
        (raw, self.label.as_ref().map_or(gradient, |label| label.gradient(v, gradient)))
    }

    fn holds(&self, place: DVec3) -> bool {
        self.label.as_ref().is_none_or(|label| label.holds(self.field.grid(), place))
    }

    fn extent(&self, _piece: &Piece) -> DMat3 {
        let side = match self.points.kind {
            Kind::Groups { .. } => 1.0,
            Kind::Parts { parts } => 1.0 / f64::from(parts),
        };
        DMat3::from_diagonal(DVec3::splat(side * side / 12.0))
    }

    fn to_world(&self) -> DAffine3 {
        let grid = self.field.grid();
        let matrix = grid.direction() * DMat3::from_diagonal(grid.spacing());
        DAffine3::from_mat3_translation(matrix, grid.origin())
    }

    fn unit_volume(&self) -> f64 {
        self.field.grid().voxel_volume()
    }

    fn reference_length(&self) -> f64 {
        self.field.grid().reference_length()
    }
}

/// Number of parts of a voxel along each axis that gives enough points.
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

/// Start indices of the groups of candidates in one cube of 2^level voxels. The cubes are aligned to the Morton curve, so
/// the candidates of a cube are adjacent in the list.
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

/// Draws `n` positions in grid-local lengths from the importance, by systematic sampling along the Morton curve. Each part
/// of the curve, and so each octant, gets its share to within one. Each position is jittered within its voxel or part.
fn scatter(
    candidates: &Candidates,
    points: &Points,
    field: &Field,
    n: usize,
    random: &mut ChaCha8Rng,
) -> Vec<[f32; 3]> {
    let spacing = field.grid().spacing();
    let jitter = |size: DVec3| {
        move |_: usize, random: &mut ChaCha8Rng| {
            (DVec3::new(random.random(), random.random(), random.random()) - 0.5) * size
        }
    };
    match points.kind {
        Kind::Groups { .. } => {
            let voxels = candidates.list.iter().map(|c| {
                let voxel = field.grid().voxel(c.voxel as usize).as_dvec3();
                (voxel * spacing, c.weight)
            });
            systematic_sample(voxels, jitter(spacing), n, random)
        }
        Kind::Parts { parts } => {
            let points = points.position.iter().zip(&points.weight);
            let points = points.map(|(&p, &weight)| (Vec3::from_array(p).as_dvec3(), weight));
            systematic_sample(points, jitter(spacing / f64::from(parts)), n, random)
        }
    }
}

/// Systematic sampling of weighted boxes: `n` positions at equal steps of the summed weight, from a random start. `boxes` gives
/// middle and weight; `jitter` gives a random way from the middle of a box, by its place in the list.
pub(crate) fn systematic_sample(
    boxes: impl Iterator<Item = (DVec3, f32)> + Clone,
    jitter: impl Fn(usize, &mut ChaCha8Rng) -> DVec3,
    n: usize,
    random: &mut ChaCha8Rng,
) -> Vec<[f32; 3]> {
    let total: f64 = boxes.clone().map(|b| f64::from(b.1)).sum();
    let step = total / n as f64;
    let start: f64 = random.random();
    let mut places = Vec::with_capacity(n);
    let mut reached = 0.0;
    let mut boxes = boxes.enumerate().filter(|(_, b)| b.1 > 0.0);
    let mut current = None;
    for k in 0..n {
        let at = (k as f64 + start) * step;
        while reached <= at {
            // Rounding may put the last position just after the end of the last box.
            let Some((place, (center, weight))) = boxes.next() else { break };
            reached += f64::from(weight);
            current = Some((place, center));
        }
        if let Some((place, center)) = current {
            places.push((center + jitter(place, random)).as_vec3().to_array());
        }
    }
    places
}

/// Voronoi cells: the sample points nearest to each centre.
pub(crate) struct Cells {
    /// Points in the order of their cells.
    order: Vec<u32>,
    /// Start of each cell in `order`, then the end of the last one.
    starts: Vec<u32>,
}

impl Cells {
    /// Assigns every point to its nearest centre.
    pub(crate) fn new(positions: &[[f32; 3]], places: &[[f32; 3]]) -> Result<Self, PlacementError> {
        let tree: ImmutableKdTree<f32, 3> =
            ImmutableKdTree::new_from_slice(places).map_err(|e| PlacementError { reason: e.to_string() })?;
        let nearest: Vec<u32> = positions
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

/// Places the centres of `n` Gaussians and returns their cells ([`relaxed_cells`]). The centres are samples of the importance.
pub(crate) fn place(
    candidates: &Candidates,
    points: &Points,
    field: &Field,
    n: usize,
    rounds: usize,
    seed: u64,
) -> Result<Cells, PlacementError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let places = scatter(candidates, points, field, n, &mut random);
    relaxed_cells(&points.position, &points.weight, places, rounds)
}

/// The cells of centres that move `rounds` times to the weighted centroids of their cells (Lloyd 1982). Centres of empty cells do
/// not move.
pub(crate) fn relaxed_cells(
    positions: &[[f32; 3]],
    weights: &[f32],
    mut places: Vec<[f32; 3]>,
    rounds: usize,
) -> Result<Cells, PlacementError> {
    for _ in 0..rounds {
        let cells = Cells::new(positions, &places)?;
        places.par_iter_mut().enumerate().for_each(|(i, place)| {
            let (mut sum, mut weight) = (DVec3::ZERO, 0.0_f64);
            for &p in cells.points(i) {
                let w = f64::from(weights[p as usize]);
                sum += Vec3::from_array(positions[p as usize]).as_dvec3() * w;
                weight += w;
            }
            if weight > 0.0 {
                *place = (sum / weight).as_vec3().to_array();
            }
        });
    }
    Cells::new(positions, &places)
}
