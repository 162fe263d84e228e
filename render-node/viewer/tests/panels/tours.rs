//! Tours in the panels and in a window: the bar with its buttons, the legend of the stops, and the button that begins a tour.

use std::sync::Arc;

use egui::{Shape, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_proto::language::{Tour, TourStep};
use sg_viewer::display::Request;
use sg_viewer::panels::{Panel, PanelHost, theme};
use sg_viewer::window::{MouseTool, Settings};

use crate::appearance::{beyond, cut_text};
use crate::stage::{Stage, harness, press};
use crate::window_ui::{clipped, desk, desk_of};

const LEGEND: [&str; 4] = ["1 vessel", "2 tissue", "3 sac", "4 neck"];

fn tour(at: u32, paused: bool) -> Option<Arc<Tour>> {
    let stops = ["vessel", "tissue", "sac", "neck"].map(str::to_owned).to_vec();
    Some(Arc::new(Tour { stops, at, paused }))
}

fn panel(of: Panel, tour: Option<Arc<Tour>>) -> Harness<'static, Stage> {
    let mut stage = Stage::new(of);
    stage.shown.tour = tour;
    let mut panel = harness(stage);
    panel.run();
    panel
}

/// The changes that were asked for since the last call.
fn asked(panel: &mut Harness<'_, Stage>) -> Vec<TourStep> {
    let outputs = std::mem::take(&mut panel.state_mut().asked);
    let step = |request| if let Request::Tour(step) = request { step } else { panic!("{request:?}") };
    outputs.into_iter().flat_map(|output| output.requests).map(step).collect()
}

fn is_there<S>(harness: &Harness<'_, S>, label: &str) -> bool {
    harness.query_by_label(label).is_some()
}

/// The stops of the legend that stand on the colour of what is chosen.
fn highlighted<S>(harness: &Harness<'_, S>) -> Vec<&'static str> {
    let chosen = theme::style(false, 1.0).visuals.selection.bg_fill;
    let fill = |shape: &Shape| match shape {
        Shape::Rect(rect) if rect.fill == chosen => Some(rect.rect),
        _ => None,
    };
    let fills: Vec<_> = harness.output().shapes.iter().filter_map(|clipped| fill(&clipped.shape)).collect();
    let is_on = |&label: &&str| fills.iter().any(|fill| fill.contains(harness.get_by_label(label).rect().center()));
    LEGEND.into_iter().filter(is_on).collect()
}

#[test]
fn the_buttons_of_the_bar_change_the_tour() {
    for of in [Panel::SCENE, Panel::WRIST] {
        let mut moving = panel(of, tour(1, false));
        for (button, step) in [
            ("go to the previous stop", TourStep::Previous),
            ("let the tour wait here", TourStep::Pause),
            ("go to the next stop", TourStep::Next),
            ("end the tour", TourStep::End),
        ] {
            press(&mut moving, button);
            assert_eq!(asked(&mut moving), [step], "{of:?}: {button}");
        }
        assert!(!is_there(&moving, "go on with the tour"));
        let mut waiting = panel(of, tour(1, true));
        assert!(!is_there(&waiting, "let the tour wait here"));
        press(&mut waiting, "go on with the tour");
        assert_eq!(asked(&mut waiting), [TourStep::Resume], "{of:?}");
        // Nobody hears a sentence while the agents are away.
        waiting.state_mut().shown.services.agents = false;
        waiting.run();
        assert!(!is_there(&waiting, "go on with the tour") && !is_there(&waiting, "end the tour"), "{of:?}");
        assert_eq!(cut_text(&moving), Vec::<String>::new(), "{of:?}");
        assert_eq!(beyond(&moving), Vec::<String>::new(), "{of:?}");
    }
}

#[test]
fn the_wrist_menu_asks_about_the_selection_where_no_tour_is_under_way() {
    let mut wrist = panel(Panel::WRIST, None);
    assert!(is_there(&wrist, "what is this?") && !is_there(&wrist, "end the tour"));
    wrist.state_mut().shown.tour = tour(0, false);
    wrist.run();
    assert!(!is_there(&wrist, "what is this?") && is_there(&wrist, "end the tour"));
}

#[test]
fn the_legend_highlights_the_present_stop_and_goes_with_the_tour() {
    let mut panel = panel(Panel::SCENE, tour(2, false));
    assert!(is_there(&panel, "3 of 4: sac"));
    assert_eq!(highlighted(&panel), ["3 sac"]);
    panel.state_mut().shown.tour = tour(3, true);
    panel.run();
    assert!(is_there(&panel, "4 of 4: neck"));
    assert_eq!(highlighted(&panel), ["4 neck"]);
    panel.state_mut().shown.tour = None;
    panel.run();
    assert!(panel.query_by_label_contains("of 4:").is_none());
    assert!(LEGEND.iter().all(|label| !is_there(&panel, label)));
}

#[test]
fn a_button_begins_a_tour_where_agents_and_views_are() {
    for host in [PanelHost::Headset, PanelHost::Window] {
        let mut stage = Stage::new(if host == PanelHost::Window { Panel::SELECT } else { Panel::SCENE });
        stage.panels.host = host;
        stage.shown.services.labeling = true;
        let mut panel = harness(stage);
        panel.run();
        press(&mut panel, "begin a tour");
        assert_eq!(asked(&mut panel), [TourStep::Start], "{host:?}");
        panel.state_mut().shown.tour = tour(0, false);
        panel.run();
        assert!(!is_there(&panel, "begin a tour"), "{host:?}: it has begun");
        panel.state_mut().shown.tour = None;
        panel.state_mut().shown.services.agents = false;
        panel.run();
        assert!(!is_there(&panel, "begin a tour"), "{host:?}: nobody hears it");
    }
}

#[test]
fn a_window_has_the_bar_and_the_legend_during_a_tour_alone() {
    let folder = tempfile::tempdir().unwrap();
    // Its panels are hidden.
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    harness.run_steps(2);
    assert!(!is_there(&harness, "end the tour"));
    service.writer.update(|state| state.tour = tour(1, false));
    harness.run_steps(4);
    assert!(is_there(&harness, "2 of 4: tissue"));
    assert_eq!(highlighted(&harness), ["2 tissue"]);
    service.requests.try_iter().for_each(drop);
    harness.get_by_label("go to the next stop").click();
    harness.run_steps(2);
    assert_eq!(service.requests.try_iter().collect::<Vec<_>>(), [Request::Tour(TourStep::Next)]);
    service.writer.update(|state| state.tour = None);
    harness.run_steps(4);
    assert!(!is_there(&harness, "2 of 4: tissue") && !is_there(&harness, "end the tour"));
    assert!(LEGEND.iter().all(|label| !is_there(&harness, label)));
}

#[test]
fn a_tour_of_long_names_has_room_in_a_small_window_and_with_large_text() {
    for (size, scale) in [(Vec2::new(640.0, 480.0), 1.0), (Vec2::new(1280.0, 800.0), 2.0)] {
        let folder = tempfile::tempdir().unwrap();
        let (mut harness, service) = desk_of(&Settings { scale, ..Settings::default() }, size, folder.path());
        let stops = (0..32).map(|k| format!("{k}{}", "Aneurysma".repeat(14))).collect();
        service.writer.update(|state| state.tour = Some(Arc::new(Tour { stops, at: 31, paused: true })));
        harness.run_steps(4);
        assert!(is_there(&harness, "go on with the tour"), "{size} at {scale}");
        assert_eq!(clipped(&harness), Vec::<String>::new(), "{size} at {scale}");
    }
}
