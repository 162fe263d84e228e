//! Motion of what is visible from one time step to the next: the optical flow of Lucas and Kanade (1981, "An iterative image
//! registration technique") in three dimensions, from coarse to fine (Bouguet 2001).
//!
//! The pictures are two numbers at each place: the opacity under the transfer function, and that times the brightness of the colour.
//! So noise in what is hidden moves nothing. Equal steps have no motion at all.

use glam::{DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;
use sg_volume::{Classifier, Field, Grid};

/// Most places of the lattice along an axis.
const EDGE: usize = 96;
/// Places along the longest axis of the coarsest lattice, at most.
const COARSEST: usize = 12;
/// Steps of Newton's method on each lattice.
const STEPS: usize = 3;
/// Standard deviation of the window, in places of the lattice.
const WINDOW: f32 = 2.0;
/// Longest step on a lattice, in its places.
const LONGEST: f32 = 1.0;
/// What is added to the squares of the gradients, as a share of their greatest. Where there is less to see, nothing moves.
const DAMPING: f32 = 1e-3;

/// The way of each place from one step to the next.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    lattice: Lattice<Vec3>,
    /// From voxels of the earlier grid to places of the lattice: both are centres.
    per_place: f64,
    grid: Grid,
    /// From ways in places of the lattice to the world.
    to_world: DMat3,
}

/// Numbers at the places of a lattice, x fastest.
#[derive(Debug, Clone)]
struct Lattice<T> {
    dims: [usize; 3],
    values: Vec<T>,
}

impl Motion {
    /// The motion from `before` to `after`, which fill the same box.
    pub(super) fn between(before: &Field, after: &Field, classifier: &Classifier) -> Self {
        let grid = before.grid().clone();
        let longest = grid.dims().into_iter().max().unwrap_or(1);
        let per_place = longest.div_ceil(EDGE).max(1);
        let [first, second] = [before, after].map(|field| signals(field, &grid, per_place, classifier));
        let flow = flow(first, second);
        let axes = grid.direction() * DMat3::from_diagonal(grid.spacing());
        Self { lattice: flow, per_place: per_place as f64, grid, to_world: axes * per_place as f64 }
    }

    /// The way of a place in the world.
    pub(super) fn at(&self, world: DVec3) -> DVec3 {
        let place = (self.grid.to_voxel(world) + 0.5) / self.per_place - 0.5;
        self.to_world * self.lattice.at(place.as_vec3()).as_dvec3()
    }
}

impl<T: Copy + Default + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>> Lattice<T> {
    fn index(&self, x: usize, y: usize, z: usize) -> usize {
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Trilinear between places, constant beyond the outer ones.
    fn at(&self, place: Vec3) -> T {
        let axis = |x: f32, n: usize| {
            let x = x.clamp(0.0, n as f32 - 1.0);
            let low = x as usize;
            (low, (low + 1).min(n - 1), x - low as f32)
        };
        let [(x0, x1, tx), (y0, y1, ty), (z0, z1, tz)] = [0, 1, 2].map(|k| axis(place[k], self.dims[k]));
        let mix = |a: T, b: T, t: f32| a * (1.0 - t) + b * t;
        let row = |y, z| mix(self.values[self.index(x0, y, z)], self.values[self.index(x1, y, z)], tx);
        let plane = |z| mix(row(y0, z), row(y1, z), ty);
        mix(plane(z0), plane(z1), tz)
    }

    /// The numbers of each place, in parallel.
    fn filled(dims: [usize; 3], of: impl Fn([usize; 3]) -> T + Sync) -> Self
    where
        T: Send,
    {
        let place = |i: usize| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
        let values = (0..dims.iter().product()).into_par_iter().with_min_len(512).map(|i| of(place(i))).collect();
        Self { dims, values }
    }

    /// Means under a Gaussian window along each axis, with the outer numbers continued.
    fn blurred(&self, sigma: f32) -> Self
    where
        T: Send + Sync,
    {
        let reach = (2.5 * sigma).ceil() as i64;
        let taps: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
        let sum: f32 = taps.iter().sum();
        let along = |from: &Self, axis: usize| {
            Self::filled(from.dims, |place| {
                taps.iter().enumerate().fold(T::default(), |total, (k, tap)| {
                    let mut at = place;
                    let moved = place[axis] as i64 + k as i64 - reach;
                    at[axis] = moved.clamp(0, from.dims[axis] as i64 - 1) as usize;
                    total + from.values[from.index(at[0], at[1], at[2])] * (tap / sum)
                })
            })
        };
        (0..3)
            .filter(|axis| self.dims[*axis] > 1)
            .fold(None, |done: Option<Self>, axis| Some(along(done.as_ref().unwrap_or(self), axis)))
            .unwrap_or_else(|| self.clone())
    }
}

/// Opacity, and opacity times brightness.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Signal([f32; 2]);

impl std::ops::Add for Signal {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl std::ops::Mul<f32> for Signal {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self(self.0.map(|x| x * factor))
    }
}

/// Squares and products of gradients, and their products with the change: the normal equations of one window.
#[derive(Debug, Clone, Copy, Default)]
struct Equations {
    /// xx, yy, zz, xy, xz, yz.
    squares: [f32; 6],
    change: Vec3,
    /// Square of the change.
    error: f32,
}

impl std::ops::Add for Equations {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            squares: std::array::from_fn(|k| self.squares[k] + other.squares[k]),
            change: self.change + other.change,
            error: self.error + other.error,
        }
    }
}

impl std::ops::Mul<f32> for Equations {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { squares: self.squares.map(|x| x * factor), change: self.change * factor, error: self.error * factor }
    }
}

/// The signal of a field at the places of a lattice over a grid: means over cubes of voxels.
fn signals(field: &Field, grid: &Grid, per_place: usize, classifier: &Classifier) -> Lattice<Signal> {
    let dims = grid.dims().map(|n| n.div_ceil(per_place));
    let is_same = field.grid() == grid;
    let of_voxel = |voxel: [usize; 3]| {
        let raw = if is_same {
            field.raw(grid.index(voxel[0], voxel[1], voxel[2]))
        } else {
            let world = grid.to_world(DVec3::from_array(voxel.map(|x| x as f64)));
            field.sample(field.grid().to_voxel(world)).unwrap_or(f64::NAN)
        };
        let (color, opacity) = classifier.evaluate(raw);
        [opacity, opacity * color.element_sum() / 3.0]
    };
    Lattice::filled(dims, |place| {
        let ends = [0, 1, 2].map(|k| (place[k] * per_place, ((place[k] + 1) * per_place).min(grid.dims()[k])));
        let (mut sum, mut count) = (Signal::default(), 0.0_f32);
        for z in ends[2].0..ends[2].1 {
            for y in ends[1].0..ends[1].1 {
                for x in ends[0].0..ends[0].1 {
                    sum = sum + Signal(of_voxel([x, y, z]));
                    count += 1.0;
                }
            }
        }
        sum * (1.0 / count.max(1.0))
    })
}

/// Half as many places along each axis.
fn halved(fine: &Lattice<Signal>) -> Lattice<Signal> {
    Lattice::filled(fine.dims.map(|n| n.div_ceil(2)), |place| {
        let mut sum = Signal::default();
        for corner in 0..8 {
            let at = [0, 1, 2].map(|k| (2 * place[k] + (corner >> k & 1)).min(fine.dims[k] - 1));
            sum = sum + fine.values[fine.index(at[0], at[1], at[2])];
        }
        sum * 0.125
    })
}

/// The way of each place of `first` to its counterpart in `second`, in places.
fn flow(first: Lattice<Signal>, second: Lattice<Signal>) -> Lattice<Vec3> {
    let mut levels = vec![(first, second)];
    while let Some((first, second)) = levels.last() {
        if first.dims.into_iter().max().unwrap_or(1) <= COARSEST {
            break;
        }
        let next = (halved(first), halved(second));
        levels.push(next);
    }
    let mut found: Option<Lattice<Vec3>> = None;
    for (first, second) in levels.iter().rev() {
        let mut ways = match found.take() {
            None => Lattice::filled(first.dims, |_| Vec3::ZERO),
            Some(coarse) => Lattice::filled(first.dims, |place| {
                coarse.at((Vec3::from_array(place.map(|x| x as f32)) + 0.5) * 0.5 - 0.5) * 2.0
            }),
        };
        for _ in 0..STEPS {
            ways = stepped(first, second, &ways);
        }
        found = Some(checked(first, second, &ways));
    }
    found.unwrap_or(Lattice { dims: [1; 3], values: vec![Vec3::ZERO] })
}

/// One step of Newton's method for every window.
fn stepped(first: &Lattice<Signal>, second: &Lattice<Signal>, ways: &Lattice<Vec3>) -> Lattice<Vec3> {
    let at = |place: [usize; 3]| {
        Vec3::from_array(place.map(|x| x as f32)) + ways.values[ways.index(place[0], place[1], place[2])]
    };
    let moved = Lattice::filled(first.dims, |place| second.at(at(place)));
    let slope = |of: &Lattice<Signal>, place: [usize; 3], axis: usize| {
        let (mut low, mut high) = (place, place);
        low[axis] = place[axis].saturating_sub(1);
        high[axis] = (place[axis] + 1).min(of.dims[axis] - 1);
        let value = |p: [usize; 3]| of.values[of.index(p[0], p[1], p[2])].0;
        let (low, high) = (value(low), value(high));
        [0, 1].map(|k| 0.5 * (high[k] - low[k]))
    };
    let equations = Lattice::filled(first.dims, |place| {
        let i = first.index(place[0], place[1], place[2]);
        // The mean gradient of both: symmetric in time.
        let slopes = [0, 1, 2].map(|axis| {
            let (a, b) = (slope(first, place, axis), slope(&moved, place, axis));
            [0, 1].map(|k| 0.5 * (a[k] + b[k]))
        });
        let mut sum = Equations::default();
        for k in 0..2 {
            let g = Vec3::from_array(slopes.map(|slope| slope[k]));
            let change = moved.values[i].0[k] - first.values[i].0[k];
            sum = sum
                + Equations {
                    squares: [g.x * g.x, g.y * g.y, g.z * g.z, g.x * g.y, g.x * g.z, g.y * g.z],
                    change: g * change,
                    error: change * change,
                };
        }
        sum
    });
    let windows = equations.blurred(WINDOW);
    let greatest = windows.values.iter().map(|of| of.squares[0] + of.squares[1] + of.squares[2]).fold(0.0, f32::max);
    let damping = DAMPING * greatest;
    if damping <= 0.0 {
        return ways.clone();
    }
    let steps: Vec<Vec3> = windows
        .values
        .par_iter()
        .with_min_len(512)
        .map(|of| {
            let [xx, yy, zz, xy, xz, yz] = of.squares;
            let matrix = Mat3::from_cols(
                Vec3::new(xx + damping, xy, xz),
                Vec3::new(xy, yy + damping, yz),
                Vec3::new(xz, yz, zz + damping),
            );
            let step = -(matrix.inverse() * of.change);
            if step.is_finite() { step.clamp_length_max(LONGEST) } else { Vec3::ZERO }
        })
        .collect();
    let values = ways.values.iter().zip(steps).map(|(way, step)| *way + step).collect();
    Lattice { dims: ways.dims, values }
}

/// The ways that make the window of their place more alike, or none.
fn checked(first: &Lattice<Signal>, second: &Lattice<Signal>, ways: &Lattice<Vec3>) -> Lattice<Vec3> {
    let error = |moves: bool| {
        let of = Lattice::filled(first.dims, |place| {
            let i = first.index(place[0], place[1], place[2]);
            let here = Vec3::from_array(place.map(|x| x as f32));
            let there = if moves { second.at(here + ways.values[i]) } else { second.values[i] };
            (0..2).map(|k| (there.0[k] - first.values[i].0[k]).powi(2)).sum::<f32>()
        });
        of.blurred(WINDOW)
    };
    let (still, moving) = (error(false), error(true));
    let better = |i: usize| moving.values[i] < still.values[i];
    let values = ways.values.iter().enumerate().map(|(i, way)| if better(i) { *way } else { Vec3::ZERO }).collect();
    Lattice { dims: ways.dims, values }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use sg_volume::Volume;
    use sg_volume::transfer::{ControlPoint, Scale, TransferFunction, Units};

    use super::*;

    fn function() -> TransferFunction {
        let point = |value, opacity| ControlPoint { value, color: [0.9, 0.5, 0.2], opacity };
        TransferFunction {
            domain: [0.0, 1.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![point(0.2, 0.0), point(1.0, 0.8)],
            base_units: Vec::new(),
        }
    }

    fn field(size: usize, of: impl Fn(DVec3) -> f64) -> Field {
        let grid = Grid::new([size; 3], DVec3::splat(0.5), DVec3::splat(-3.0), DMat3::IDENTITY).unwrap();
        let values: Vec<f32> = (0..grid.len()).map(|i| of(grid.to_world(grid.voxel(i).as_dvec3())) as f32).collect();
        Volume::new(grid, values.into(), None).unwrap().to_field()
    }

    fn ball(at: DVec3) -> impl Fn(DVec3) -> f64 {
        move |p| (-(p - at).length_squared() / (2.0 * 2.5_f64.powi(2))).exp()
    }

    #[test]
    fn equal_steps_do_not_move() {
        let classifier = function().classifier(field(8, ball(DVec3::ZERO)).range()).unwrap();
        let one = field(24, ball(DVec3::splat(3.0)));
        let motion = Motion::between(&one, &one, &classifier);
        assert!(motion.lattice.values.iter().all(|way| *way == Vec3::ZERO));
    }

    #[test]
    fn an_expanding_shell_moves_outwards() {
        let shell = |radius: f64| {
            move |p: DVec3| (-((p - DVec3::splat(5.0)).length() - radius).powi(2) / (2.0 * 0.6_f64.powi(2))).exp()
        };
        let (before, after) = (field(34, shell(4.0)), field(34, shell(4.6)));
        let classifier = function().classifier(before.range()).unwrap();
        let motion = Motion::between(&before, &after, &classifier);
        for way in [DVec3::X, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8)] {
            let found = motion.at(DVec3::splat(5.0) + 4.0 * way);
            assert!((found - 0.6 * way).length() < 0.15, "{way}: {found}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]
        #[test]
        fn the_way_of_a_ball_is_found(shift in prop::array::uniform3(-2.0..2.0_f64)) {
            let shift = DVec3::from_array(shift);
            let at = DVec3::splat(4.0);
            let (before, after) = (field(32, ball(at)), field(32, ball(at + shift)));
            let classifier = function().classifier(before.range()).unwrap();
            let motion = Motion::between(&before, &after, &classifier);
            for way in [DVec3::ZERO, 2.0 * DVec3::X, -2.0 * DVec3::Z] {
                let found = motion.at(at + way);
                prop_assert!((found - shift).length() < 0.1 * shift.length() + 0.1, "{shift}: {found}");
            }
        }
    }
}
