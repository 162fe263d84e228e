//! The transfer function of a scene of a volume: what a hand at its plot and its controls asks for.

use std::path::Path;
use std::sync::Arc;

use egui::{Pos2, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_edit::EditState;
use sg_proto::scene::TransferFunction;
use sg_proto::scene::command::Action;
use sg_reclassify::sources::{Source, store};
use sg_scene::model::Scene;
use sg_viewer::display::ViewState;
use sg_viewer::panels::{Draft, Panel, PanelHost};
use sg_volume::phantom;

use crate::picture::Canvas;
use crate::scene_requests::changes;
use crate::stage::{Stage, harness, press, scene};

/// A scene of which the vessel keeps values from 0 to 255.
fn volume() -> Arc<Scene> {
    let mut units = scene().units.clone();
    let value = |i: usize| 255.0 * (i as f64 / 700.0).powi(2);
    let source = |i: usize| Source { value: value(i), depth: 1.0, ..Source::default() };
    store(&(0..700).map(source).collect::<Vec<_>>(), &mut units[0].gaussians);
    units[0].values = Some([0.0, 255.0]);
    Arc::new(Scene::compose(units, None))
}

fn of_volume() -> Harness<'static, Stage> {
    let mut stage = Stage::new(Panel::SCENE);
    stage.panels.host = PanelHost::Window;
    let scene = volume();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tf.json"), phantom::transfer_function().to_json().unwrap()).unwrap();
    assert_eq!(stage.panels.behind(&scene, &folder.path().join("scene.toml")), Vec::<String>::new());
    stage.shown =
        ViewState { services: stage.shown.services, ..ViewState::of(Arc::new(EditState::of_scene(&scene, "", ""))) };
    let mut harness = harness(stage);
    harness.run();
    harness
}

/// The functions of the changes since the last call, and whether each was a draft.
fn asked(harness: &mut Harness<'_, Stage>) -> (Vec<TransferFunction>, Vec<Option<TransferFunction>>) {
    let output = std::mem::take(&mut harness.state_mut().asked);
    let function = |action: &Action| match action {
        Action::SetTransferFunction(set) => set.function.clone(),
        other => panic!("{other:?}"),
    };
    let held = output.iter().filter_map(|output| match &output.draft {
        Some(Draft::Hold(action)) => function(action),
        _ => None,
    });
    (held.collect(), changes(&output).iter().map(function).collect())
}

/// The state after the change that the panel asked for.
fn obey(harness: &mut Harness<'_, Stage>, function: &TransferFunction) {
    let set = sg_proto::scene::SetTransferFunction { function: Some(function.clone()) };
    let after = harness.state().shown.scene.after(&volume(), Action::SetTransferFunction(set)).unwrap();
    harness.state_mut().shown.scene = Arc::new(after);
    harness.run();
}

fn values(function: &TransferFunction) -> Vec<f64> {
    function.points.iter().map(|point| point.value.round()).collect()
}

/// The place of a value and an opacity in the plot.
fn place(harness: &Harness<'_, Stage>, value: f32, opacity: f32) -> Pos2 {
    let whole = harness.get_by_label_contains("transfer function, ").rect();
    let plot = egui::Rect::from_min_size(whole.min, egui::vec2(whole.width(), 132.0)).shrink(5.0);
    pos2(plot.left() + plot.width() * value / 255.0, plot.bottom() - plot.height() * opacity)
}

fn drag(harness: &mut Harness<'_, Stage>, from: Pos2, to: Pos2) {
    harness.state_mut().asked.clear();
    harness.hover_at(from);
    harness.step();
    harness.drag_at(from);
    for k in 1..=4 {
        harness.hover_at(from + (to - from) * (k as f32 / 4.0));
        harness.step();
    }
    harness.drop_at(to);
    harness.run();
}

#[test]
fn only_a_scene_that_keeps_values_has_it() {
    let mut stage = Stage::new(Panel::SCENE);
    stage.panels.host = PanelHost::Window;
    let mut plain = harness(stage);
    plain.run();
    assert!(plain.query_by_label("Transfer function").is_none());
    assert!(of_volume().query_by_label("Transfer function").is_some());
}

#[test]
fn a_point_follows_the_hand_and_is_asked_for_once() {
    let mut panel = of_volume();
    let (from, to) = (place(&panel, 70.0, 0.0), place(&panel, 100.0, 0.4));
    drag(&mut panel, from, to);
    let (held, asked_for) = asked(&mut panel);
    assert!(held.len() >= 2, "seen while it moves: {held:?}");
    let [Some(function)] = asked_for.as_slice() else { panic!("{asked_for:?}") };
    assert_eq!(values(function), [0.0, 100.0, 150.0, 255.0]);
    assert!((function.points[1].opacity - 0.4).abs() < 0.02, "{function:?}");
    obey(&mut panel, function);
    // It is chosen now: its controls are there.
    press(&mut panel, "remove point");
    let (_, fewer) = asked(&mut panel);
    assert_eq!(values(fewer[0].as_ref().unwrap()), [0.0, 150.0, 255.0]);
}

#[test]
fn a_double_click_makes_a_point_and_a_drag_beside_none() {
    let mut panel = of_volume();
    let (from, to) = (place(&panel, 40.0, 0.8), place(&panel, 60.0, 0.2));
    drag(&mut panel, from, to);
    assert_eq!(asked(&mut panel), (vec![], vec![]), "no point is there");
    let at = place(&panel, 40.0, 0.5);
    panel.hover_at(at);
    panel.step();
    // Each event takes a quarter of a second here.
    panel.ctx.options_mut(|options| options.input_options.max_double_click_delay = 2.0);
    for _ in 0..2 {
        panel.drag_at(at);
        panel.step();
        panel.drop_at(at);
        panel.step();
    }
    panel.run();
    let (_, more) = asked(&mut panel);
    let [Some(function)] = more.as_slice() else { panic!("{more:?}") };
    assert_eq!(values(function), [0.0, 40.0, 70.0, 150.0, 255.0]);
    assert!((function.points[1].opacity - 0.5).abs() < 0.02, "{function:?}");
}

#[test]
fn level_moves_all_points_and_the_file_gives_them_back() {
    let mut panel = of_volume();
    let level = panel.get_by_label("level").rect();
    drag(&mut panel, level.center(), pos2(level.left() + 0.75 * level.width(), level.center().y));
    let (held, asked_for) = asked(&mut panel);
    assert!(!held.is_empty());
    let function = asked_for[0].clone().unwrap();
    let shift = function.points[0].value;
    assert!(shift > 20.0, "{function:?}");
    assert!((function.points[2].value - 150.0 - shift).abs() < 1e-6, "{function:?}");
    obey(&mut panel, &function);
    if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
        canvas.draw(&panel).write(&Path::new(&folder).join("transfer-function.png"));
    }
    press(&mut panel, "as in the file");
    assert_eq!(asked(&mut panel).1, [None]);
}
