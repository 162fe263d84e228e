//! How panels look: text that can be read, nothing beyond the panel's edge, no empty picture.

use std::path::Path;
use std::sync::Arc;

use egui::{Color32, FontId, Role, Shape, TextStyle};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable};
use sg_proto::scene::command::Action;
use sg_proto::scene::{LightMode, SetLight, SetOpacity, Target};
use sg_raster::attributes::{Attribute, Legend};
use sg_raster::color_map::ColorMap;
use sg_viewer::display::{Conversation, DisplayMode, Entry, Tools};
use sg_viewer::panels::{DisplayAction, NARROWEST, Panel, PanelHost, theme};

use crate::labels::answered;
use crate::picture::{Canvas, Picture};
use crate::stage::{Stage, after, docked, harness, press, save, scene, select};

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
            assert!((across - f64::from(panel.size.x)).abs() < 1e-6);
            println!("{} at {distance} m: {width:.2} × {height:.2} m", panel.title);
        }
    }
}

/// A panel in the middle of work, with as much of it open as there is.
fn busy(panel: Panel, light: bool, pixels_per_point: f32) -> Harness<'static, Stage> {
    let mut stage = Stage::new(panel);
    stage.tools.light_panels = light;
    stage.pixels_per_point = pixels_per_point;
    if panel == Panel::KEYBOARD {
        stage.show.insert(0, Panel::SELECT);
    }
    if [Panel::SELECT, Panel::WRIST].contains(&panel) {
        stage.walk();
        stage.answers(1);
    }
    if panel == Panel::SELECT {
        stage.panels.supported_actions = (0..3).map(DisplayAction::Proposal).collect();
    }
    if panel == Panel::WRIST {
        stage.panels.supported_actions =
            vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Panels, DisplayAction::Screenshot];
    }
    let mut harness = harness(stage);
    if panel == Panel::SCENE {
        press(&mut harness, "vessel");
    }
    if [Panel::SELECT, Panel::KEYBOARD].contains(&panel) {
        press(&mut harness, "name of the new unit");
    }
    if panel == Panel::KEYBOARD {
        for key in ["shift", "a", "n", "e", "u", "r", "y", "s", "m"] {
            press(&mut harness, if key == "a" { "A" } else { key });
        }
        harness.state_mut().show = vec![Panel::KEYBOARD];
        harness.set_size(Panel::KEYBOARD.size);
        harness.run();
    }
    harness
}

/// Scene control with every part open and a colour being chosen.
fn all_open(light: bool, scale: f32, width: f32) -> Harness<'static, Stage> {
    let mut stage = Stage::new(Panel::SCENE);
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
    let wide = Panel::SCENE.size.x;
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

/// Text that ends in "…" because its place is too narrow.
fn shortened_text(harness: &Harness<'_, Stage>) -> Vec<String> {
    let texts =
        harness.output().shapes.iter().filter_map(|s| if let Shape::Text(t) = &s.shape { Some(t) } else { None });
    texts.filter(|text| text.galley.elided).map(|text| text.galley.text().to_owned()).collect()
}

/// Commands name their units at length. Such a name is read whole in the narrowest dock, and its opacity is still there.
#[test]
fn names_that_commands_make_are_read_whole() {
    for width in [NARROWEST, 340.0, Panel::SCENE.size.x] {
        let mut stage = Stage::new(Panel::SELECT);
        stage.panels.host = PanelHost::Window;
        (stage.width, stage.height) = (Some(width), Some(1400.0));
        let rest = Target { units: vec!["sac".to_owned()], complement: true, ..Target::default() };
        let fade = SetOpacity { target: Some(rest), factor: 0.2, relative: false };
        stage.shown.scene = Arc::new(stage.shown.scene.after(&scene(), Action::SetOpacity(fade)).unwrap());
        stage.shown.undo = [].into();
        let mut harness = harness(stage);
        harness.set_size(egui::vec2(width, 1400.0));
        press(&mut harness, "Made by commands");
        assert!(harness.query_by_label("Rest of scene").is_some(), "{width}");
        assert_eq!(shortened_text(&harness), Vec::<String>::new(), "{width}");
        assert_eq!((cut_text(&harness), beyond(&harness)), (Vec::new(), Vec::new()), "{width}");
        let slider = harness.get_by_label("opacity of Rest of scene").rect();
        assert!(slider.width() >= 36.0, "{width}: {slider}");
    }
}

/// Controls that lie beyond their panel, sideways.
pub(crate) fn beyond(harness: &Harness<'_, Stage>) -> Vec<String> {
    let panel = harness.ctx.content_rect().expand(0.5);
    let inside = |rect: egui::Rect| rect.left() >= panel.left() && rect.right() <= panel.right();
    let all = harness.query_all(By::new().predicate(|n| n.role() != Role::TextRun && n.bounding_box().is_some()));
    all.filter(|n| !inside(n.rect())).map(|n| format!("{:?} at {}", n.accesskit_node().label(), n.rect())).collect()
}

#[test]
fn the_longest_names_and_words_have_room() {
    let scene = scene();
    let long = "Aneurysma".repeat(14);
    for panel in docked() {
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
        if panel == Panel::SCENE {
            press(&mut harness, &long);
            press(&mut harness, "History");
            press(&mut harness, "rename");
        } else if panel == Panel::SELECT {
            press(&mut harness, "name of the new unit");
            harness.get_by_label("name of the new unit").type_text(&long);
            press(&mut harness, "save");
            harness.run();
            // The question is brought into view, however long the name.
            let answer = harness.get_by_label("replace it").rect();
            assert!(answer.bottom() <= panel.size.y, "{answer}");
        }
        assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
        if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
            canvas.draw(&harness).write(&Path::new(&folder).join(format!("long-{}.png", panel.title)));
        }
    }
}

#[test]
fn a_narrow_dock_has_room_for_everything() {
    for panel in docked() {
        let mut stage = Stage::new(panel);
        stage.panels.host = PanelHost::Window;
        (stage.width, stage.height) = (Some(NARROWEST), Some(1000.0));
        if panel == Panel::SELECT {
            stage.walk();
        }
        let mut harness = harness(stage);
        harness.set_size(egui::vec2(NARROWEST, 1000.0));
        harness.run();
        if panel == Panel::SELECT {
            press(&mut harness, "sac");
            press(&mut harness, "Brush");
            press(&mut harness, "name of the new unit");
        }
        assert_eq!(cut_text(&harness), Vec::<String>::new(), "{panel:?}");
        assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
        if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
            canvas.draw(&harness).write(&Path::new(&folder).join(format!("narrow-{}.png", panel.title)));
        }
    }
}

#[test]
fn panels_are_drawn_whole_in_dark_and_light_at_one_and_two_pixels_a_point() {
    let Some(canvas) = Canvas::open() else { return };
    for &panel in Panel::ALL {
        for (light, pixels_per_point) in [(false, 1.0), (false, 2.0), (true, 1.0), (true, 2.0)] {
            let harness = busy(panel, light, pixels_per_point);
            assert_eq!(cut_text(&harness), Vec::<String>::new(), "{panel:?}");
            assert_eq!(beyond(&harness), Vec::<String>::new(), "{panel:?}");
            let picture = canvas.draw(&harness);
            assert_eq!(faint_text(&harness, &picture), Vec::<String>::new(), "{panel:?} light {light}");
            let want = panel.size * pixels_per_point;
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
    for panel in Panel::ALL {
        canvas.draw(&busy(*panel, false, 1.5)).write(&folder.join(format!("panel-{}.png", panel.name)));
    }
    canvas.draw(&busy(Panel::SCENE, true, 1.5)).write(&folder.join("panel-scene-light.png"));
    canvas.draw(&answered(1.5)).write(&folder.join("panel-find.png"));
}

#[test]
fn the_documents_describe_each_panel_with_its_picture() {
    let documents = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let text = std::fs::read_to_string(documents.join("panels.md")).unwrap();
    for panel in Panel::ALL {
        let picture = format!("pictures/panel-{}.png", panel.name);
        assert!(text.lines().any(|line| line == format!("## {}", panel.title)), "no section `{}`", panel.title);
        assert!(text.contains(&format!("]({picture})")), "{picture} is not shown");
        assert!(documents.join(&picture).is_file(), "{picture} is missing: make it by `pictures_for_the_documents`");
    }
}
