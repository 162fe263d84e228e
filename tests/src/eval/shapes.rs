//! Made scenes with exact truth, in the spirit of the paper's data sets: every Gaussian knows the part it belongs to.
//!
//! Each shape is a union of solids. Gaussians are scattered over its surface by area. They are flattened along the normal and no
//! wider than the surface bends. Noise is on every quantity that a fit gets only roughly right. Five shapes are reported. Two
//! more serve to choose numbers, so that no number is chosen on a reported shape.

use std::f64::consts::TAU;

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sg_scene::model::{BaseUnit, Convention, Gaussians, Scene, ShadingColumns, ShadingModel};

use super::solid::{Ellipsoid, Sample, Sheet, Solid, Tube, direction, normal};
use super::subject::{Origin, Parametrisation, Subject};

/// The shapes that tables report.
pub const REPORTED: [&str; 5] = ["vortex", "lobster", "ionization", "chameleon", "aneurysm"];

/// The shapes that numbers are chosen on; never reported.
pub const TUNING: [&str; 2] = ["knot", "coral"];

/// More shapes that numbers of the first answer to a stroke are chosen on; never reported.
pub const STROKE_TUNING: [&str; 4] = ["hand", "grapes", "shells", "islands"];

mod tuning;

/// One solid of a shape.
struct Piece {
    part: i32,
    solid: Solid,
    /// Inside others, its surface is kept and theirs does not hide it.
    inner: bool,
}

/// The pieces of a shape, and the parts to select.
struct Plan {
    pieces: Vec<Piece>,
    target: &'static [i32],
    /// Share of the Gaussians that fill the space below the sheet as haze, and its part.
    haze: Option<(f64, i32)>,
}

/// A shape of `n` Gaussians; none for an unknown name.
#[must_use]
pub fn shape(name: &str, n: usize, seed: u64) -> Option<Subject> {
    let (stream, plan) = match name {
        "vortex" => (1, vortex as fn(&mut ChaCha8Rng) -> Plan),
        "lobster" => (2, lobster as _),
        "ionization" => (3, ionization as _),
        "chameleon" => (4, chameleon as _),
        "aneurysm" => (5, aneurysm as _),
        "knot" => (6, knot as _),
        "coral" => (7, coral as _),
        "hand" => (8, tuning::hand as _),
        "grapes" => (9, tuning::grapes as _),
        "shells" => (10, tuning::shells as _),
        "islands" => (11, tuning::islands as _),
        _ => return None,
    };
    let mut r = ChaCha8Rng::seed_from_u64(seed);
    r.set_stream(stream);
    let plan = plan(&mut r);
    let (scene, part) = scatter(&plan, n, &mut r);
    let target = part.iter().map(|p| plan.target.contains(p)).collect();
    Some(Subject {
        name: name.to_owned(),
        origin: Origin::Made,
        parametrisation: Parametrisation::Coherent,
        scene,
        part,
        target,
    })
}

fn piece(part: i32, solid: Solid) -> Piece {
    Piece { part, solid, inner: false }
}

fn tube(part: i32, points: Vec<DVec3>, radius: impl Fn(f64) -> f64) -> Piece {
    piece(part, Solid::Tube(Tube::new(points, radius)))
}

fn ball(part: i32, centre: [f64; 3], radii: [f64; 3]) -> Piece {
    piece(part, Solid::Ellipsoid(Ellipsoid::new(DVec3::from_array(centre), DVec3::from_array(radii))))
}

fn curve(pieces: usize, f: impl Fn(f64) -> DVec3) -> Vec<DVec3> {
    (0..=pieces).map(|i| f(i as f64 / pieces as f64)).collect()
}

/// A smooth curve through a start, a control point and an end.
fn arc(a: [f64; 3], control: [f64; 3], b: [f64; 3]) -> Vec<DVec3> {
    let [a, c, b] = [a, control, b].map(DVec3::from_array);
    curve(16, |t| a.lerp(c, t).lerp(c.lerp(b, t), t))
}

/// Nine vortex tubes that wind around each other without touching; one of them is wanted.
fn vortex(r: &mut ChaCha8Rng) -> Plan {
    let pieces = (0..9)
        .map(|i| {
            let base = DVec3::new(f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0, 0.0) * 0.5;
            let (phase, turns) = (r.random_range(0.0..TAU), r.random_range(0.7..1.1));
            let swing = r.random_range(0.08..0.14);
            let radius = r.random_range(0.08..0.10);
            let line = curve(48, |t| {
                let angle = phase + TAU * turns * t;
                base + DVec3::new(swing * angle.cos(), swing * angle.sin(), 2.0 * t - 1.0)
            });
            tube(i, line, move |t| radius * (1.0 + 0.25 * (TAU * 2.0 * t + phase).sin()))
        })
        .collect();
    Plan { pieces, target: &[4], haze: None }
}

/// A body with claws, legs and feelers. One claw is wanted, and a feeler passes closely by it.
fn lobster(_: &mut ChaCha8Rng) -> Plan {
    let mut pieces =
        vec![tube(0, arc([-0.9, 0.0, 0.12], [-0.3, 0.0, -0.06], [0.35, 0.0, 0.0]), |t| 0.10 + 0.12 * (t * 2.2).sin())];
    for (k, side) in [(0, 1.0), (1, -1.0)] {
        pieces.push(tube(
            10 + k,
            arc([0.25, 0.14 * side, 0.0], [0.45, 0.50 * side, 0.10], [0.72, 0.42 * side, 0.02]),
            |t| 0.05 + 0.015 * t,
        ));
        let claw = Ellipsoid::new(DVec3::new(0.92, 0.40 * side, 0.02), DVec3::new(0.22, 0.12, 0.07));
        pieces.push(piece(2 + k, Solid::Ellipsoid(claw.turned(DMat3::from_rotation_z(-0.25 * side)))));
        pieces.push(tube(
            2 + k,
            arc([1.02, 0.46 * side, 0.02], [1.18, 0.50 * side, 0.02], [1.26, 0.36 * side, 0.02]),
            |t| 0.05 - 0.03 * t,
        ));
        pieces.push(tube(
            12 + k,
            arc([0.5, 0.08 * side, 0.08], [0.8, 0.20 * side, 0.16], [1.3, 0.34 * side, 0.14]),
            |t| 0.018 - 0.006 * t,
        ));
        for leg in 0..4 {
            let x = -0.35 + 0.18 * f64::from(leg);
            pieces.push(tube(
                20 + 4 * k + leg,
                arc([x, 0.15 * side, -0.02], [x - 0.05, 0.42 * side, 0.16], [x - 0.12, 0.55 * side, -0.25]),
                |t| 0.034 - 0.016 * t,
            ));
        }
    }
    for side in [-1.0, 0.0, 1.0_f64] {
        let fan = Ellipsoid::new(DVec3::new(-1.0, 0.13 * side, 0.13), DVec3::new(0.14, 0.06, 0.02));
        pieces.push(piece(1, Solid::Ellipsoid(fan.turned(DMat3::from_rotation_z(-0.5 * side)))));
    }
    Plan { pieces, target: &[2], haze: None }
}

/// An ionization front: a wavy sheet with gas below it and fingers that rise from it; the middle finger is wanted.
fn ionization(r: &mut ChaCha8Rng) -> Plan {
    let sheet = Sheet { half: 1.0, amplitude: 0.10 };
    let mut pieces = vec![piece(0, Solid::Sheet(sheet))];
    let places = [(0.0, 0.0, 0.55), (0.62, 0.45, 0.30), (-0.60, 0.50, 0.38), (-0.50, -0.58, 0.26), (0.55, -0.55, 0.42)];
    for (i, (x, y, rise)) in (1..).zip(places) {
        let (lean_x, lean_y) = (r.random_range(-0.12..0.12), r.random_range(-0.12..0.12));
        let foot = sheet.height(x, y) - 0.05;
        let top = [x + lean_x, y + lean_y, foot + rise];
        let stem = arc([x, y, foot], [x, y, foot + 0.5 * rise], top);
        pieces.push(tube(i, stem, |t| 0.16 - 0.09 * (t * 3.0).min(1.0) + 0.03 * t));
        let wide = 0.14 + 0.10 * rise;
        pieces.push(ball(i, top, [wide, wide, 0.6 * wide]));
    }
    Plan { pieces, target: &[1], haze: Some((0.25, 6)) }
}

/// A body, head, legs, a backbone inside and a tail rolled up to a spiral; the tail is wanted.
fn chameleon(_: &mut ChaCha8Rng) -> Plan {
    let spiral = curve(96, |t| {
        let angle = 1.75 * TAU * t;
        let radius = 0.38 - 0.28 * t;
        DVec3::new(-0.72 - radius * angle.sin(), 0.02 * t, -0.43 + radius * angle.cos() * 1.0)
    });
    let mut pieces = vec![
        ball(0, [-0.05, 0.0, 0.0], [0.60, 0.17, 0.25]),
        ball(1, [0.62, 0.0, 0.10], [0.24, 0.13, 0.14]),
        ball(2, [0.50, 0.0, 0.24], [0.16, 0.05, 0.14]),
        tube(3, spiral, |t| 0.085 - 0.055 * t),
    ];
    for (k, (x, side)) in (4..).zip([(0.30, 1.0), (0.30, -1.0), (-0.35, 1.0), (-0.35, -1.0)]) {
        let leg = arc([x, 0.10 * side, -0.12], [x + 0.05, 0.32 * side, -0.20], [x - 0.05, 0.22 * side, -0.50]);
        pieces.push(tube(k, leg, |t| 0.055 - 0.02 * t));
    }
    let backbone = tube(8, arc([0.55, 0.0, 0.08], [0.0, 0.0, 0.22], [-0.55, 0.0, 0.02]), |_| 0.035);
    pieces.push(Piece { inner: true, ..backbone });
    Plan { pieces, target: &[3], haze: None }
}

/// A vessel that forks, with a sac on its side. Another vessel all but touches the sac. The sac is wanted.
fn aneurysm(_: &mut ChaCha8Rng) -> Plan {
    let pieces = vec![
        tube(0, arc([-1.0, -0.1, -0.2], [-0.4, 0.25, 0.0], [0.25, 0.0, 0.0]), |t| 0.11 - 0.02 * t),
        tube(1, arc([0.22, 0.0, 0.0], [0.6, 0.1, 0.1], [1.0, 0.45, 0.25]), |t| 0.085 - 0.03 * t),
        tube(2, arc([0.22, 0.0, 0.0], [0.6, -0.15, -0.05], [1.0, -0.5, 0.1]), |t| 0.08 - 0.03 * t),
        ball(3, [-0.18, 0.14, 0.33], [0.27, 0.24, 0.25]),
        tube(4, arc([-0.8, 0.6, 0.1], [-0.2, 0.40, 0.55], [0.7, 0.65, 0.4]), |_| 0.06),
        tube(5, arc([-0.7, 0.05, -0.1], [-0.6, -0.3, 0.2], [-0.9, -0.7, 0.4]), |t| 0.06 - 0.025 * t),
    ];
    Plan { pieces, target: &[3], haze: None }
}

/// A trefoil knot and a ring through it. They touch; the ring is wanted.
fn knot(_: &mut ChaCha8Rng) -> Plan {
    let trefoil = curve(120, |t| {
        let a = TAU * t;
        0.3 * DVec3::new(a.sin() + 2.0 * (2.0 * a).sin(), a.cos() - 2.0 * (2.0 * a).cos(), -(3.0 * a).sin())
    });
    let ring = curve(64, |t| {
        let a = TAU * t;
        DVec3::new(0.62 + 0.36 * a.cos(), 0.1, 0.36 * a.sin())
    });
    Plan { pieces: vec![tube(0, trefoil, |_| 0.10), tube(1, ring, |_| 0.07)], target: &[1], haze: None }
}

/// A tree whose branches fork three times; one of the first branches with all it carries is wanted.
fn coral(r: &mut ChaCha8Rng) -> Plan {
    let mut pieces = vec![tube(0, arc([0.0, 0.0, -1.0], [0.05, 0.0, -0.6], [0.0, 0.0, -0.3]), |_| 0.12)];
    let mut tips = vec![(DVec3::new(0.0, 0.0, -0.35), DVec3::Z, 0.09, 0)];
    for level in 0..3 {
        let mut next = Vec::new();
        for (from, heading, radius, part) in tips {
            for k in 0..3 {
                let lean = (heading + 0.9 * direction(r) + 0.3 * DVec3::Z).normalize();
                let to = from + lean * (0.5 - 0.1 * f64::from(level));
                let middle = from.lerp(to, 0.5) + 0.08 * direction(r);
                let own = if level == 0 { k + 1 } else { part };
                let line = arc(from.to_array(), middle.to_array(), to.to_array());
                pieces.push(tube(own, line, |t| radius * (1.0 - 0.3 * t)));
                next.push((to, lean, 0.7 * radius, own));
            }
        }
        tips = next;
    }
    Plan { pieces, target: &[1], haze: None }
}

/// Scatters Gaussians over the surface of the union, and haze below its sheet.
fn scatter(plan: &Plan, n: usize, r: &mut ChaCha8Rng) -> (Scene, Vec<i32>) {
    let hazy = plan.haze.map_or(0, |(share, _)| (share * n as f64) as usize);
    let mut areas = Vec::new();
    let mut total = 0.0;
    for piece in &plan.pieces {
        total += piece.solid.area();
        areas.push(total);
    }
    let spacing = (total / n as f64).sqrt();
    let mut columns = Columns::default();
    let mut part = Vec::with_capacity(n);
    while part.len() < n - hazy {
        let at = r.random_range(0.0..total);
        let own = areas.partition_point(|a| *a <= at).min(plan.pieces.len() - 1);
        let sample = plan.pieces[own].solid.sample(r);
        let hidden = |(k, other): (usize, &Piece)| k != own && !other.inner && other.solid.contains(sample.position);
        if plan.pieces[own].inner || !plan.pieces.iter().enumerate().any(hidden) {
            columns.push(&sample, spacing, r);
            part.push(plan.pieces[own].part);
        }
    }
    if let (Some((_, label)), Some(Solid::Sheet(sheet))) = (plan.haze, plan.pieces.first().map(|p| &p.solid)) {
        for _ in 0..hazy {
            let (x, y) = (r.random_range(-sheet.half..sheet.half), r.random_range(-sheet.half..sheet.half));
            let position = DVec3::new(x, y, sheet.height(x, y) - r.random_range(0.02..0.45));
            let normal = (DVec3::Z + 0.7 * direction(r)).normalize();
            let tangent = normal.any_orthonormal_vector();
            columns.push_haze(&Sample { position, normal, tangent, bend: 1.0 }, spacing, r);
            part.push(label);
        }
    }
    (Scene::compose(vec![columns.unit()], None), part)
}

/// Columns of a scene in the making.
#[derive(Default)]
struct Columns {
    gaussians: Gaussians,
    shading: ShadingColumns,
}

impl Columns {
    /// A flat Gaussian on a surface, x along the tangent, z along the normal.
    fn push(&mut self, s: &Sample, spacing: f64, r: &mut ChaCha8Rng) {
        let wide = 0.9 * spacing;
        let scale = DVec3::new(wide, (0.7 * wide).min(0.4 * s.bend), 0.25 * wide);
        self.add(s, scale, 0.1, 0.85, 0.06 * spacing, r);
    }

    /// A round Gaussian of no surface.
    fn push_haze(&mut self, s: &Sample, spacing: f64, r: &mut ChaCha8Rng) {
        self.add(s, DVec3::new(1.5, 1.4, 1.3) * spacing, 0.25, 0.15, 0.0, r);
    }

    fn add(&mut self, s: &Sample, scale: DVec3, noise: f64, opacity: f64, lift: f64, r: &mut ChaCha8Rng) {
        let mut shaken = |v: DVec3| (v + noise * DVec3::new(normal(r), normal(r), normal(r))).normalize_or(v);
        let (n, t) = (shaken(s.normal), shaken(s.tangent));
        let t = (t - n * t.dot(n)).normalize_or(n.any_orthonormal_vector());
        let q = DQuat::from_mat3(&DMat3::from_cols(t, n.cross(t), n));
        let g = &mut self.gaussians;
        g.position.push((s.position + s.normal * lift * normal(r)).as_vec3());
        g.rotation.push([q.w, q.x, q.y, q.z].map(|x| x as f32));
        g.log_scale.push(Vec3::from_array(scale.to_array().map(|x| (x.ln() + 0.15 * normal(r)) as f32)));
        let o = (opacity + 0.05 * normal(r)).clamp(0.02, 0.98);
        g.opacity_logit.push((o / (1.0 - o)).ln() as f32);
        let shading = &mut self.shading;
        shading.normal.push(n.as_vec3());
        shading.offset_color.push(Vec3::ZERO);
        shading.ambient.push(0.4);
        shading.diffuse.push(0.6);
        shading.specular.push(0.2);
        shading.shininess.push(20.0);
    }

    fn unit(mut self) -> BaseUnit {
        self.gaussians.shading = Some(self.shading);
        BaseUnit {
            name: "made".to_owned(),
            file: None,
            gaussians: self.gaussians,
            first: 0,
            palette: Vec3::splat(0.7),
            opacity: 1.0,
            transform: DMat4::IDENTITY,
            convention: Convention::Ours,
            shading: ShadingModel::Paper,
            oriented_normals: true,
            transfer_function: None,
            values: None,
        }
    }
}
