//! How panels look: text that can be read, nothing beyond the panel's edge, no empty picture.

use std::path::Path;
use std::sync::Arc;

use egui::{Color32, FontId, Role, Shape, TextStyle};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable};
use sg_proto::scene::command::Action;
use sg_proto::scene::{LightMode, SetLight};
use sg_raster::attributes::{Attribute, Legend};
use sg_raster::color_map::ColorMap;
use sg_viewer::display::{Conversation, DisplayMode, Entry, Tools};
use sg_viewer::panels::{DisplayAction, NARROWEST, Panel, PanelHost, theme};

use crate::picture::{Canvas, Picture};
use crate::stage::{Stage, after, harness, press, save, scene, select};

#[test]
fn text_stands_out_from_what_it_stands_on() {
    for light in [false, true] {
        let style = theme::style(light, 1.0);
        for (what, text, on) in theme::text_colors(&style.visuals) {
            let ratio = theme::contrast(text, on);
            println!("light {light}: {what}: {ratio:.2}");
            assert!(ratio >= theme::CONTRAST, "light {light}: {what}: {ratio:.2}");
        }
    }
    let known = theme::contrast(Color32::BLACK, Color32::WHITE);
    assert!((known - 21.0).abs() < 1e-9);
}

#[test]
fn a_line_takes_its_angle_before_the_eyes() {
    let ctx = egui::Context::default();
    theme::apply(&ctx, &Tools::default());
    let mut least = f32::INFINITY;
    let _ = ctx.run_ui(egui::RawInput::default(), |ui| {
        for style in [TextStyle::Small, TextStyle::Body, TextStyle::Button, TextStyle::Heading, TextStyle::Monospace] {
            let font: FontId = style.resolve(ui.style());
            least = least.min(ui.fonts_mut(|f| f.row_height(&font)));
        }
    });
    println!("smallest line: {least} points");
    assert!(f64::from(least) >= theme::LINE);
    for distance in [0.4, 0.8, 2.0] {
        let line = theme::LINE * theme::metres_per_point(distance);
        let degrees = 2.0 * (0.5 * line / distance).atan().to_degrees();
        assert!((degrees - theme::LINE_DEGREES).abs() < 1e-9);
        for panel in Panel::ALL {
            let [width, height] = panel.least_metres(distance);
            let across = theme::points_across(width, distance);
            assert!((across - f64::from(panel.size().x)).abs() < 1e-6);
            println!("{} at {distance} m: {width:.2} × {height:.2} m", panel.name());
        }
    }
}

/// A panel in the middle of work, with as much of it open as there is.
fn busy(panel: Panel, light: bool, pixels_per_point: f32) -> Harness<'static, Stage> {
    let mut stage = Stage::new(panel);
    stage.tools.light_panels = light;
    stage.pixels_per_point = pixels_per_point;
    if panel == Panel::Keyboard {
        stage.show.insert(0, Panel::Select);
    }
    if panel == Panel::Select {
        stage.walk();
        stage.panels.supported_actions = (0..3).map(DisplayAction::Proposal).collect();
    }
    if panel == Panel::Wrist {
        stage.panels.supported_actions = vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Panels];
    }
    let mut harness = harness(stage);
    match panel {
        Panel::Scene => press(&mut harness, "vessel"),
        Panel::Select | Panel::Keyboard => press(&mut harness, "name of the new unit"),
        Panel::Language | Panel::Wrist => {}
    }
    if panel == Panel::Keyboard {
        for key in ["shift", "a", "n", "e", "u", "r", "y", "s", "m"] {
            press(&mut harness, if key == "a" { "A" } else { key });
        }
        harness.state_mut().show = vec![Panel::Keyboard];
        harness.set_size(Panel::Keyboard.size());
        harness.run();
    }
    harness
}

/// Scene control with every part open and a colour being chosen.
fn all_open(light: bool, scale: f32, width: f32) -> Harness<'static, Stage> {
    let mut stage = Stage::new(Panel::Scene);
    stage.width = Some(width);
    stage.tools.light_panels = light;
    stage.tools.scale = scale;
    stage.tools.display_mode = DisplayMode::Attribute(Attribute::Scale);
    stage.panels.numbers = Some(Legend { low: 0.013, high: 4.5, logarithmic: true, map: ColorMap::default() });
    stage.panels.supported_actions =
        vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Place(1), DisplayAction::Screenshot];
    let lit = SetLight { mode: LightMode::Direction.into(), ..SetLight::default() };
    stage.shown.scene = Arc::new(stage.shown.scene.after(&scene(), Action::SetLight(lit)).unwrap());
    stage.height = Some(1900.0);
    let mut harness = harness(stage);
    harness.set_size(egui::vec2(width, 1900.0));
    for part in
        ["What is shown", "Light and background", "Viewpoint", "History", "This display", "sac", "colour of sac"]
    {
        press(&mut harness, part);
    }
    harness
}

#[test]
fn every_part_of_scene_control_has_room_at_every_size() {
    let canvas = Canvas::open();
    let wide = Panel::Scene.size().x;
    for (light, scale, width) in
        [(false, 1.0, wide), (true, 1.0, wide), (false, 1.5, 1.5 * wide), (false, 1.0, NARROWEST)]
    {
        let harness = all_open(light, scale, width);
        assert_eq!(cut_text(&harness), Vec::<String>::new(), "×{scale}");
        assert_eq!(beyond(&harness), Vec::<String>::new(), "×{scale}");
        if let Some(canvas) = &canvas {
            let picture = canvas.draw(&harness);
            assert_eq!(faint_text(&harness, &picture), Vec::<String>::new(), "light {light}");
            if let Some(folder) = std::env::var_os("PANEL_PICTURES") {
                picture.write(&Path::new(&folder).join(format!("all-open-{light}-{scale}-{width}.png")));
            }
        }
    }
}

/// Text that is cut off or lies beyond its panel, sideways.
pub(crate) fn cut_text(harness: &Harness<'_, Stage>) -> Vec<String> {
    let panel = harness.ctx.content_rect();
    let mut cut = Vec::new();
    for shape in &harness.output().shapes {
        if let Shape::Text(text) = &shape.shape {
            let rect = text.visual_bounding_rect();
            let room = shape.clip_rect.intersect(panel).expand(1.0);
            let hidden = !rect.intersects(room);
            if !hidden && (rect.left() < room.left() || rect.right() > room.right()) {
                cut.push(format!("{} at {rect} in {room}", text.galley.text()));
            }
        }
    }
    cut
}

/// Text whose colour does not stand out from its background. Text of a disabled control may be fainter.
pub(crate) fn faint_text(harness: &Harness<'_, Stage>, picture: &Picture) -> Vec<String> {
    let mut faint = Vec::new();
    for shape in &harness.output().shapes {
        let Shape::Text(text) = &shape.shape else { continue };
        let rect = text.visual_bounding_rect().intersect(shape.clip_rect).intersect(harness.ctx.content_rect());
        let words = text.galley.text();
        if rect.width() < 2.0 || rect.height() < 8.0 || ["send", "save"].contains(&words) {
            continue;
        }
        let of = text.galley.job.sections.first().map_or(Color32::PLACEHOLDER, |s| s.format.color);
        let own = if of == Color32::PLACEHOLDER { text.fallback_color } else { of };
        let color = text.override_text_color.unwrap_or(own);
        let ground = picture.ground(rect * picture.pixels_per_point);
        let ratio = theme::contrast(color, ground);
        if ratio < theme::CONTRAST {
            faint.push(format!("{words}: {color:?} on {ground:?}, {ratio:.2}"));
        }
    }
    faint
}

/// Controls that lie beyond their panel, sideways.
fn beyond(harness: &Harness<'_, Stage>) -> Vec<String> {
    let panel = harness.ctx.content_rect().expand(0.5);
    let inside = |rect: egui::Rect| rect.left() >= panel.left() && rect.right() <= panel.right();
    let all = harness.query_all(By::new().predicate(|n| n.role() != Role::TextRun && n.bounding_box().is_some()));
    all.filter(|n| !inside(n.rect())).map(|n| format!("{:?} at {}", n.accesskit_node().label(), n.rect())).collect()
}

#[test]
fn the_longest_names_and_words_have_room() {
    let scene = scene();
    let long = "Aneurysma".repeat(14);
    for panel in [Panel::Scene, Panel::Select, Panel::Language] {
        let mut stage = Stage::new(panel);
        stage.shown.scene = after(&scene, [select(&scene, 10..70), save(&long)]);
        stage.shown.selected = Arc::clone(stage.shown.scene.selection().mask());
        stage.shown.undo = [long.repeat(3)].into();
        let mut talk = Conversation::default();
        talk.say("1", long.repeat(4));
        let turn = talk.turn("1").unwrap();
        turn.add(Entry::Command(long.repeat(2)));
        turn.add(Entry::Result(long.repeat(5), false));
        turn.answer = Some((long.repeat(9), false));
        stage.shown.conversation = Arc::new(talk);
        let mut harness = harness(stage);
        match panel {
            Panel::Scene => {
                press(&mut harness, &long);
                press(&mut harness, "History");
                press(&mut harness, "rename");
            }
            Panel::Select => {
                press(&mut harness, "name of the new unit");
                harness.get_by_label("name of the new unit").type_text(&long);
                press(&mut harness, "save");
                harness.run();
                // The question is brought into view, however long the name.
                let answer = harness.get_by_label("replace it").rect();
                assert!(answer.bottom() <= panel.size().y, "{answer}");
            }
            _ => {}
        }
        assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
        if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
            canvas.draw(&harness).write(&Path::new(&folder).join(format!("long-{}.png", panel.name())));
        }
    }
}

#[test]
fn a_narrow_dock_has_room_for_everything() {
    for panel in [Panel::Scene, Panel::Select, Panel::Language] {
        let mut stage = Stage::new(panel);
        stage.panels.host = PanelHost::Window;
        (stage.width, stage.height) = (Some(NARROWEST), Some(1000.0));
        if panel == Panel::Select {
            stage.walk();
        }
        let mut harness = harness(stage);
        harness.set_size(egui::vec2(NARROWEST, 1000.0));
        harness.run();
        match panel {
            Panel::Scene => press(&mut harness, "sac"),
            Panel::Select => press(&mut harness, "name of the new unit"),
            _ => {}
        }
        assert_eq!(cut_text(&harness), Vec::<String>::new(), "{panel:?}");
        assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
        if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
            canvas.draw(&harness).write(&Path::new(&folder).join(format!("narrow-{}.png", panel.name())));
        }
    }
}

#[test]
fn panels_are_drawn_whole_in_dark_and_light_at_one_and_two_pixels_a_point() {
    let Some(canvas) = Canvas::open() else { return };
    for panel in Panel::ALL {
        for (light, pixels_per_point) in [(false, 1.0), (false, 2.0), (true, 1.0), (true, 2.0)] {
            let harness = busy(panel, light, pixels_per_point);
            assert_eq!(cut_text(&harness), Vec::<String>::new(), "{panel:?}");
            assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
            let picture = canvas.draw(&harness);
            assert_eq!(faint_text(&harness, &picture), Vec::<String>::new(), "{panel:?} light {light}");
            let want = panel.size() * pixels_per_point;
            assert_eq!(picture.size, [want.x as u32, want.y as u32]);
            let style = theme::style(light, 1.0);
            let ground = style.visuals.panel_fill;
            let text = style.visuals.text_color();
            let near = |p: [u8; 3], c: Color32| [c.r(), c.g(), c.b()].iter().zip(p).all(|(a, b)| a.abs_diff(b) <= 8);
            let all = picture.pixels().count() as f64;
            let share = |c| picture.pixels().filter(|p| near(*p, c)).count() as f64 / all;
            println!(
                "{panel:?} light {light} ×{pixels_per_point}: ground {:.3}, text {:.4}",
                share(ground),
                share(text)
            );
            assert!(share(ground) > 0.05 && share(text) > 0.0005, "{panel:?} light {light} ×{pixels_per_point}");
        }
    }
}

/// The pictures in the documents; not run by itself, since it writes into the tree.
#[test]
#[ignore = "writes docs/pictures"]
fn pictures_for_the_documents() {
    let Some(canvas) = Canvas::open() else { return };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/pictures");
    for (panel, light, name) in [
        (Panel::Scene, false, "scene"),
        (Panel::Scene, true, "scene-light"),
        (Panel::Select, false, "prompt"),
        (Panel::Language, false, "language"),
        (Panel::Keyboard, false, "keyboard"),
        (Panel::Wrist, false, "wrist"),
    ] {
        canvas.draw(&busy(panel, light, 1.5)).write(&folder.join(format!("panel-{name}.png")));
    }
}
