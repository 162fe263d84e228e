//! Strokes of a hand: the feedback in the same frame, and the messages sent.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use sg_proto::scene::StrokeKind;
use sg_raster::structure::NO_CLUSTER;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Gaussians, Scene};
use sg_selection::brush::Brush;
use sg_viewer::display::{BrushController, BrushMode, BrushSample, BrushSign, Clusters, Request, Tools};

/// Gaussians at x = 0, 1, 2, … of one base unit `row`.
pub(crate) fn row_of_gaussians(n: usize) -> Scene {
    let gaussians = Gaussians {
        position: (0..n).map(|k| Vec3::new(k as f32, 0.0, 0.0)).collect(),
        log_scale: vec![Vec3::splat(-2.0); n],
        rotation: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logit: vec![0.0; n],
        ..Gaussians::default()
    };
    Scene::compose(vec![BaseUnit::new("row", gaussians)], None)
}

fn hand(scene: &Scene) -> BrushController {
    BrushController::new(scene, Arc::new(Brush::of_scene(scene)), "right")
}

fn tip(x: f64) -> BrushSample {
    BrushSample { at: DVec3::new(x, 0.0, 0.0), pressure: 1.0 }
}

fn ones(mask: &Mask) -> Vec<usize> {
    mask.ones().collect()
}

/// A brush that reaches 0.6 of the way from one Gaussian to the next.
fn tools(scene: &Scene, mode: BrushMode) -> Tools {
    Tools { mode, radius: 0.6 / scene.bounds.longest_edge(), ..Tools::default() }
}

#[test]
fn a_surface_brush_has_a_depth_limit() {
    // Seen along the row: Gaussians behind are further along.
    let scene = row_of_gaussians(10);
    let mut hand = hand(&scene);
    let radius = 3.5 / scene.bounds.longest_edge();
    let tools = Tools { mode: BrushMode::Point, radius, front_only: true, brush_depth: 0.3, ..Tools::default() };
    let seen = |hand: &BrushController, tools: &Tools| {
        ones(&hand.would_select(tools, tip(4.0), BrushSign::Add, &Mask::empty(10), None))
    };
    assert_eq!(seen(&hand, &tools), [1, 2, 3, 4, 5, 6, 7], "seen from nowhere");
    hand.eye = Some(DVec3::new(-20.0, 0.0, 0.0));
    assert_eq!(seen(&hand, &tools), [1, 2, 3, 4, 5]);
    assert_eq!(seen(&hand, &Tools { front_only: false, ..tools.clone() }), [1, 2, 3, 4, 5, 6, 7]);
    hand.press(&tools, tip(4.0), BrushSign::Add);
    assert_eq!(ones(&hand.selects(&Arc::new(Mask::empty(10)), None)), [1, 2, 3, 4, 5]);
    let Some(Request::Sample(told)) = hand.pending_samples() else { panic!("nothing is told") };
    let depth = told.samples.unwrap().depth.unwrap();
    assert!((depth.reach - 0.3 * radius).abs() < 1e-12 && (depth.eye[0] + 20.0 / 9.0).abs() < 1e-9, "{depth:?}");
    let Some(Request::Select(stroke)) = hand.release() else { panic!("nothing is selected") };
    assert_eq!(stroke.strokes[0].depth, Some(depth));
}

#[test]
fn a_hovering_brush_previews_its_change() {
    let scene = row_of_gaussians(10);
    let (hand, none) = (hand(&scene), Mask::empty(10));
    let clusters = Clusters::new([0, 0, 0, 1, 1, 1, NO_CLUSTER, NO_CLUSTER, 2, 2].into());
    let seen = |mode, at, sign, selected: &Mask| {
        ones(&hand.would_select(&tools(&scene, mode), tip(at), sign, selected, Some(&clusters)))
    };
    assert_eq!(seen(BrushMode::Point, 4.5, BrushSign::Add, &none), [4, 5]);
    assert_eq!(seen(BrushMode::Cluster, 4.5, BrushSign::Add, &none), [3, 4, 5]);
    assert_eq!(seen(BrushMode::Cluster, 2.5, BrushSign::Add, &none), [0, 1, 2, 3, 4, 5]);
    assert_eq!(seen(BrushMode::Cluster, 6.0, BrushSign::Add, &none), [6], "what is in no cluster stands for itself");
    assert_eq!(seen(BrushMode::Walk, 4.5, BrushSign::Add, &none), [4, 5], "what the walk would be seeded with");
    let all = Mask::full(10);
    assert_eq!(seen(BrushMode::Cluster, 9.0, BrushSign::Remove, &all), [0, 1, 2, 3, 4, 5, 6, 7]);
    let wide = BrushSample { pressure: 3.0, ..tip(4.5) };
    let wide = hand.would_select(&tools(&scene, BrushMode::Point), wide, BrushSign::Add, &none, None);
    assert_eq!(ones(&wide), [3, 4, 5, 6], "pressure widens it");
}

#[test]
fn a_growing_stroke_sends_each_sample_once_and_the_whole_at_its_end() {
    let scene = row_of_gaussians(10);
    let (mut hand, tools) = (hand(&scene), tools(&scene, BrushMode::Point));
    let none = Arc::new(Mask::empty(10));
    hand.press(&tools, tip(2.0), BrushSign::Add);
    let Some(Request::Sample(first)) = hand.pending_samples() else { panic!("the first sample is told at once") };
    assert_eq!(first.samples.as_ref().unwrap().points.len(), 3);
    assert!(hand.pending_samples().is_none());
    // Closer than a quarter of the radius: nothing new.
    hand.sample(tip(2.1));
    assert!(hand.pending_samples().is_none());
    hand.sample(tip(3.0));
    hand.sample(BrushSample { at: DVec3::NAN, pressure: 1.0 });
    hand.sample(tip(4.0));
    assert_eq!(ones(&hand.selects(&none, None)), [2, 3, 4]);
    let Some(Request::Sample(more)) = hand.pending_samples() else { panic!("more was drawn") };
    assert_eq!((more.stroke.as_str(), more.samples.unwrap().points.len()), (first.stroke.as_str(), 6));
    let Some(Request::Select(whole)) = hand.release() else { panic!("a stroke ended") };
    let stroke = &whole.strokes[0];
    assert_eq!((whole.strokes.len(), stroke.points.len(), stroke.kind()), (1, 9, StrokeKind::Foreground));
    assert!(stroke.pressure.is_empty());
    let x: Vec<f64> = stroke.points.chunks(3).map(|p| scene.bounds.denormalize(DVec3::from_slice(p)).x).collect();
    assert!(x.iter().zip([2.0, 3.0, 4.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{x:?}");
    assert!(!hand.is_drawing() && hand.release().is_none());
    // The next stroke has another name.
    hand.press(&tools, tip(5.0), BrushSign::Remove);
    let Some(Request::Sample(next)) = hand.pending_samples() else { panic!("the first sample is told at once") };
    assert_ne!(next.stroke, first.stroke);
    hand.abandon();
    assert!(hand.release().is_none());
}

#[test]
fn pressure_is_reported_only_where_it_is_an_option() {
    let scene = row_of_gaussians(10);
    let mut hand = hand(&scene);
    let tools = Tools { pressure: true, ..tools(&scene, BrushMode::Point) };
    hand.press(&tools, BrushSample { pressure: 0.5, ..tip(2.0) }, BrushSign::Add);
    hand.sample(BrushSample { pressure: f64::NAN, ..tip(3.0) });
    let Some(Request::Select(whole)) = hand.release() else { panic!("a stroke ended") };
    assert_eq!(whole.strokes[0].pressure, [0.5, 1.0]);
}
