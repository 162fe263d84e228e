//! What a frame of a panel costs the loop that draws.

use std::time::Instant;

use sg_render_node::panels::{Panel, theme};

use crate::stage::{Stage, after, save, scene, select};

/// Milliseconds of one frame of a panel, layout and triangles: the median of many.
fn frame(panel: Panel, units: usize) -> f64 {
    let mut stage = Stage::new(panel);
    if units > 0 {
        let scene = scene();
        let saved = (0..units).flat_map(|k| [select(&scene, k % 900..k % 900 + 50), save(&format!("unit {k}"))]);
        stage.shown.scene = after(&scene, saved);
    }
    let ctx = egui::Context::default();
    theme::apply(&ctx, &stage.tools);
    let mut times: Vec<f64> = (0..200)
        .map(|frame| {
            let input = egui::RawInput {
                screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, panel.size())),
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
    for panel in Panel::ALL {
        println!("{}: {:.2} ms", panel.name(), frame(panel, 0));
    }
    let many = frame(Panel::Scene, 900);
    println!("Scene control of 900 units: {many:.2} ms");
    // A frame of a headset takes 11.1 ms; a machine that does something else beside takes longer than this one.
    assert!(many < 5.0, "{many:.2} ms");
}
