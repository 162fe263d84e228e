//! The cost of a panel's frame for the loop that draws.

use std::sync::Arc;
use std::time::Instant;

use sg_viewer::display::{Conversation, Entry};
use sg_viewer::panels::{Panel, theme};

use crate::stage::{Stage, after, save, scene, select};

/// Milliseconds of one frame of a panel, layout and triangles: the median of many.
fn frame(mut stage: Stage) -> f64 {
    let panel = stage.show[0];
    let ctx = egui::Context::default();
    theme::apply(&ctx, &stage.tools);
    let mut times: Vec<f64> = (0..200)
        .map(|frame| {
            let input = egui::RawInput {
                screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, panel.size)),
                time: Some(f64::from(frame) / 90.0),
                ..egui::RawInput::default()
            };
            let began = Instant::now();
            let output = ctx.run_ui(input, |ui| stage.show(ui));
            let triangles = ctx.tessellate(output.shapes, 2.0);
            assert!(!triangles.is_empty());
            1e3 * began.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

#[test]
fn a_panel_takes_a_small_part_of_a_headsets_frame() {
    for &panel in Panel::ALL {
        println!("{}: {:.2} ms", panel.title, frame(Stage::new(panel)));
    }
    let (mut units, scene) = (Stage::new(Panel::SCENE), scene());
    let saved = (0..900).flat_map(|k| [select(&scene, k..k + 50), save(&format!("unit {k}"))]);
    units.shown.scene = after(&scene, saved);
    let mut long = Stage::new(Panel::LANGUAGE);
    let mut talk = Conversation::default();
    for turn in 0..64 {
        talk.say(turn.to_string(), "fade all units one after the other");
        for entry in 0..128 {
            talk.turn(&turn.to_string()).unwrap().add(Entry::Result(format!("faded unit {entry}"), true));
        }
    }
    long.shown.conversation = Arc::new(talk);
    let (units, long) = (frame(units), frame(long));
    println!("Scene control of 900 units: {units:.2} ms; a conversation of 8192 lines: {long:.2} ms");
    // A frame of a headset takes 11.1 ms; a machine that does something else beside takes longer than this one.
    assert!(units < 5.0 && long < 5.0, "{units:.2} ms, {long:.2} ms");
}
