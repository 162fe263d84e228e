//! Operations against their definitions, one Gaussian at a time.

use glam::{DMat4, Vec3};
use proptest::prelude::*;

use super::*;
use sg_scene::synthetic::{point_scene, random_points, random_unit};

/// Whether a Gaussian of this index and centre is to be found.
type Holds = Box<dyn Fn(usize, DVec3) -> bool>;

fn operation_context(scene: Scene) -> OperationContext {
    OperationContext::new(Arc::new(scene), GeometryOptions::default())
}

/// Two units, one of them moved and shrunk, one with a Gaussian without a position.
fn two_units() -> OperationContext {
    let (mut a, mut b) = (random_unit(300, 1), random_unit(200, 2));
    a.gaussians.position[7] = Vec3::NAN;
    b.transform = DMat4::from_translation(DVec3::new(1.0, 0.0, 0.0)) * DMat4::from_scale(DVec3::splat(0.5));
    b.name = "b".into();
    operation_context(Scene::compose(vec![a, b], None))
}

fn mask_of(len: usize, indices: &[usize]) -> Mask {
    let mut mask = Mask::empty(len);
    indices.iter().for_each(|&i| mask.set(i % len, true));
    mask
}

fn done(s: &OperationContext, operation: &Operation, mask: &Mask) -> Mask {
    operation.check().unwrap();
    let mut after = mask.clone();
    s.apply(operation, &mut after).unwrap();
    after
}

fn unit_of(s: &OperationContext, g: usize) -> usize {
    usize::from(g >= s.scene().units[1].first)
}

fn finite(s: &OperationContext, g: usize) -> Option<DVec3> {
    s.scene().position(g).filter(|p| p.is_finite())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn growing_and_shrinking_match_their_definitions(seeds in prop::collection::vec(0..500_usize, 0..40), distance in 0.0..0.2_f64) {
        let s = two_units();
        let mask = mask_of(500, &seeds);
        let r = distance * s.scene().bounds.longest_edge();
        let close = |g: usize, to: bool| finite(&s, g).is_some_and(|p| (0..500).any(|h| {
            mask.get(h) == to && unit_of(&s, g) == unit_of(&s, h) && finite(&s, h).is_some_and(|q| p.distance_squared(q) < r * r)
        }));
        let grown = done(&s, &Operation::Grow { distance }, &mask);
        let shrunk = done(&s, &Operation::Shrink { distance }, &mask);
        for g in 0..500 {
            prop_assert_eq!(grown.get(g), mask.get(g) || close(g, true), "{}", g);
            prop_assert_eq!(shrunk.get(g), mask.get(g) && !close(g, false), "{}", g);
        }
        prop_assert!(shrunk.is_subset_of(&mask) && mask.is_subset_of(&grown));
    }

    #[test]
    fn regions_and_ranges_find_one_by_one(
        seeds in prop::collection::vec(0..500_usize, 0..200),
        a in prop::array::uniform3(-0.2..1.2_f64), b in prop::array::uniform3(-0.2..1.2_f64),
        radius in 0.0..0.6_f64, combine in 0..4_usize,
    ) {
        let s = two_units();
        let mask = mask_of(500, &seeds);
        let combine = [Combine::Add, Combine::Remove, Combine::Intersect, Combine::Replace][combine];
        let (min, max) = (std::array::from_fn(|k| a[k].min(b[k])), std::array::from_fn(|k| a[k].max(b[k])));
        let bounds = s.scene().bounds;
        let [min_at, max_at, at] = [min, max, a].map(|p| bounds.denormalize(DVec3::from_array(p)));
        let camera = Camera::look_at(DVec3::new(0.0, 0.0, -6.0), DVec3::ZERO, DVec3::Y, 50.0, 100, 100);
        let polygon = vec![[10.0, 20.0], [90.0, 15.0], [50.0, 50.0], [80.0, 95.0], [5.0, 70.0]];
        let cases: Vec<(Operation, Holds)> = vec![
            (Operation::Box { min, max, combine }, Box::new(move |_, p| p.cmpge(min_at).all() && p.cmple(max_at).all())),
            (Operation::Sphere { centre: a, radius, combine }, Box::new(move |_, p| p.distance(at) < radius * bounds.longest_edge())),
            (Operation::Plane { point: a, normal: b, combine }, Box::new(move |_, p| (p - at).dot(DVec3::from_array(b)) > 0.0)),
            (
                Operation::Lasso { camera: Box::new(camera.clone()), polygon: polygon.clone(), near: 5.0, far: 6.5, combine },
                Box::new(move |_, p| {
                    let q = camera.view().transform_point3(p);
                    let (x, y) = (camera.fx * q.x / q.z + camera.cx, camera.fy * q.y / q.z + camera.cy);
                    // The winding angle: another test of whether a point lies within.
                    let turn: f64 = (0..polygon.len()).map(|k| {
                        let (f, t) = (polygon[k], polygon[(k + 1) % polygon.len()]);
                        let (f, t) = ((f[0] - x, f[1] - y), (t[0] - x, t[1] - y));
                        (f.0 * t.1 - f.1 * t.0).atan2(f.0 * t.0 + f.1 * t.1)
                    }).sum();
                    (5.0..=6.5).contains(&q.z) && turn.abs() > 3.0
                }),
            ),
        ];
        for (operation, holds) in cases {
            if operation.check().is_err() {
                continue;
            }
            let after = done(&s, &operation, &mask);
            for g in 0..500 {
                let (was, found) = (mask.get(g), finite(&s, g).is_some_and(|p| holds(g, p)));
                let wanted = match combine {
                    Combine::Add => was || found,
                    Combine::Remove => was && !found,
                    Combine::Intersect => was && found,
                    Combine::Replace => found,
                };
                prop_assert_eq!(after.get(g), wanted, "{:?} at {}", operation, g);
            }
        }
    }

    #[test]
    fn inverting_twice_changes_nothing(seeds in prop::collection::vec(0..500_usize, 1..80)) {
        let s = two_units();
        let mut mask = mask_of(500, &seeds);
        mask.set(7, false);
        let once = done(&s, &Operation::Invert, &mask);
        prop_assert!(!once.get(7), "what has no position is not selected");
        let whole = |m: &Mask, u: usize| s.scene().units[u].range().all(|g| g == 7 || m.get(g));
        // A unit that becomes unselected as a whole is touched no more.
        if !whole(&mask, 0) && !whole(&mask, 1) {
            prop_assert_eq!(done(&s, &Operation::Invert, &once), mask);
        }
    }
}

#[test]
fn inverting_an_empty_selection_selects_all_finite_gaussians() {
    let s = two_units();
    let all = done(&s, &Operation::Invert, &Mask::empty(500));
    assert_eq!((all.count(), all.get(7)), (499, false));
}

/// A lattice of 12³ points with unit spacing.
fn lattice() -> OperationContext {
    let points: Vec<[f32; 3]> =
        (0..12 * 12 * 12).map(|i| [(i % 12) as f32, (i / 12 % 12) as f32, (i / 144) as f32]).collect();
    operation_context(point_scene(&points))
}

#[test]
fn holes_are_filled_up_to_a_size_and_pieces_are_separated() {
    let s = lattice();
    let at = |i: usize| s.scene().position(i).unwrap();
    let (centre, far) = (DVec3::splat(5.0), DVec3::splat(10.0));
    let ball = |c: DVec3, r: f64| move |p: DVec3| p.distance(c) <= r;
    // A ball with a hole of one point in it, another of seven, and a small ball elsewhere.
    let hole = ball(DVec3::new(5.0, 5.0, 8.0), 0.1);
    let cave = ball(centre, 1.0);
    let mask = Mask::from_fn(s.scene().len(), |i| {
        let p = at(i);
        (ball(centre, 4.2)(p) && !hole(p) && !cave(p)) || ball(far, 1.0)(p)
    });
    let filled = done(&s, &Operation::FillHoles { most: 1 }, &mask);
    assert_eq!(filled.count(), mask.count() + 1);
    let filled = done(&s, &Operation::FillHoles { most: 10 }, &mask);
    assert_eq!(filled.count(), mask.count() + 1 + 7);
    assert_eq!(done(&s, &Operation::FillHoles { most: 10 }, &Mask::empty(mask.len())).count(), 0, "nothing is touched");

    let small = done(&s, &Operation::PieceAt { at: s.scene().bounds.normalize(far).to_array() }, &filled);
    assert_eq!(small.count(), 7);
    let large = done(&s, &Operation::LargestPieces { keep: 1 }, &filled);
    assert_eq!(large.count(), filled.count() - 7);
    assert_eq!(done(&s, &Operation::LargestPieces { keep: 2 }, &filled), filled);
    assert!(done(&s, &Operation::PieceAt { at: [0.0; 3] }, &Mask::empty(filled.len())).is_none());
}

#[test]
fn similar_clusters_are_found_and_others_are_not() {
    // Two kinds in one unit: small and large.
    let mut unit = random_unit(400, 5);
    for (i, log_scale) in unit.gaussians.log_scale.iter_mut().enumerate() {
        *log_scale = Vec3::splat(if i % 2 == 0 { -6.0 } else { -1.0 });
    }
    let shading = unit.gaussians.shading.as_mut().unwrap();
    shading.normal.iter_mut().for_each(|n| *n = Vec3::Z);
    unit.gaussians.rotation.iter_mut().for_each(|q| *q = [1.0, 0.0, 0.0, 0.0]);
    let s = operation_context(Scene::compose(vec![unit], None));
    let mask = mask_of(400, &[0, 2, 4, 6]);
    let combine = Combine::Add;
    let found = done(&s, &Operation::Similar { threshold: 2.0, combine }, &mask);
    assert_eq!(found, Mask::from_fn(400, |i| i % 2 == 0));
    assert!(done(&s, &Operation::Similar { threshold: 2.0, combine }, &Mask::empty(400)).is_none());
    let range = Operation::Range { attribute: Attribute::Scale, min: 0.05, max: 1.0, combine: Combine::Replace };
    assert_eq!(done(&s, &range, &mask), Mask::from_fn(400, |i| i % 2 == 1));
}

#[test]
fn attributes_are_those_of_the_file() {
    let mut unit = random_unit(3, 9);
    unit.palette = Vec3::new(0.2, 0.4, 0.6);
    unit.gaussians.opacity_logit = vec![0.0, f32::NAN, -2.0];
    unit.gaussians.shading.as_mut().unwrap().offset_color[2] = Vec3::new(0.1, 0.0, 0.0);
    let s = operation_context(Scene::compose(vec![unit], None));
    let range = |attribute, min, max| {
        let range = Operation::Range { attribute, min, max, combine: Combine::Replace };
        done(&s, &range, &Mask::empty(3)).ones().collect::<Vec<_>>()
    };
    assert_eq!(range(Attribute::Opacity, 0.5, 1.0), [0]);
    assert_eq!(range(Attribute::Opacity, 0.0, 1.0), [0, 2], "what is no number is in no range");
    assert_eq!(range(Attribute::Red, 0.29, 0.31), [2]);
    assert_eq!(range(Attribute::Blue, 0.6, 0.7), [0, 1, 2]);
}

#[test]
fn operations_on_nothing_do_nothing() {
    let s = operation_context(point_scene(&[]));
    for operation in [
        Operation::Invert,
        Operation::Grow { distance: 0.1 },
        Operation::Shrink { distance: 0.1 },
        Operation::FillHoles { most: 9 },
        Operation::LargestPieces { keep: 1 },
        Operation::PieceAt { at: [0.0; 3] },
        Operation::Similar { threshold: 1.0, combine: Combine::Add },
    ] {
        assert!(done(&s, &operation, &Mask::empty(0)).is_empty());
    }
    let one = operation_context(point_scene(&random_points(1, 3)));
    assert_eq!(done(&one, &Operation::Grow { distance: 1.0 }, &Mask::full(1)).count(), 1);
}
