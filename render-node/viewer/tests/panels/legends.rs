//! The tool legend and the lines that report errors.

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_viewer::display::Tools;
use sg_viewer::panels::{Panel, Panels, legend, theme};

use crate::appearance::{cut_text, faint_text};
use crate::picture::Canvas;
use crate::stage::{Stage, shown};

#[test]
fn the_legend_says_what_each_button_does_now() {
    let panel = Harness::new_ui(|ui| legend(ui, &[("trigger", "brush, walk"), ("grip", "take hold of the scene")]));
    for text in ["trigger", "brush, walk", "grip", "take hold of the scene"] {
        assert!(panel.query_by_label(text).is_some(), "{text}");
    }
}

/// The parts of a display beside its panels, for a person to look at.
#[test]
fn the_legend_and_the_lines_fit_a_narrow_place() {
    let mut stage = Stage::new(Panel::SCENE);
    stage.show.clear();
    stage.beside = true;
    let mut panel = crate::stage::harness(stage);
    panel.set_size(egui::vec2(380.0, 330.0));
    panel.run_steps(2);
    assert_eq!(cut_text(&panel), Vec::<String>::new());
    let Some(canvas) = Canvas::open() else { return };
    let picture = canvas.draw(&panel);
    assert_eq!(faint_text(&panel, &picture), Vec::<String>::new());
    if let Some(folder) = std::env::var_os("PANEL_PICTURES") {
        picture.write(&std::path::Path::new(&folder).join("beside.png"));
    }
}

#[test]
fn lines_stay_a_while_and_go() {
    let (mut panels, shown) = (Panels::default(), shown());
    let mut panel = Harness::builder()
        .with_step_dt(0.5)
        .with_context_setup(|ctx| theme::apply(ctx, &Tools::default()))
        .build_ui(move |ui| panels.notices(ui, &shown));
    let refused = "there is no unit `sack`; did you mean `sac`?";
    assert!(panel.query_by_label(refused).is_some() && panel.query_by_label("Not done").is_some());
    assert!(panel.query_by_label("reading the scene took 1.2 s").is_some());
    panel.run_steps(13);
    assert!(panel.query_by_label("reading the scene took 1.2 s").is_none(), "gone after six seconds");
    assert!(panel.query_by_label(refused).is_some(), "what was refused stays longer");
    panel.run_steps(13);
    assert!(panel.query_by_label(refused).is_none());
}
