//! What the labeling service knows: the units that a text means, and the best views of a unit or of the selection.

use egui::{
    Align, Button, Color32, Label, Layout, Rect, Response, RichText, Role, ScrollArea, Sense, Stroke, StrokeKind,
    TextureHandle, Ui, Vec2, WidgetInfo, pos2, vec2,
};
use sg_edit::{EditState, UnitRef};
use sg_proto::labeling::{Candidate, FindReply, Outcome, State};
use sg_proto::language::TourStep;
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{Select, SelectionStep, SetOperation, SetView, Target, set_view};
use sg_proto::selection::StrokesRequest;

use super::control::{button_width, capital, cell, scale, section};
use super::label_questions::Thumbnails;
use super::output::Output;
use super::state::Panels;
use super::text_input::{Field, FieldEvent};
use crate::display::number_format::{count, percent};
use crate::display::{PicturedView, REGION_VIEWS, Request, ViewState};

/// Longest text that the service takes, bytes.
const MAX_TEXT_BYTES: usize = 512;

/// Most candidates of an answer that are listed.
const CANDIDATES: usize = 64;

/// Height of the list of candidates, beyond which it scrolls, points at the usual size of text.
const LIST: f32 = 190.0;

/// Width of a score, likewise.
const SCORE: f32 = 54.0;

/// Least and greatest side of a view's picture, likewise.
const SIDE: (f32, f32) = (48.0, 128.0);

/// The text that asks for units like the selection.
const LIKE_THIS: &str = "things like this";

/// A region whose best views can be asked for.
struct Region {
    /// Name of the unit; empty for the selection.
    unit: String,
    /// The region for a person.
    about: String,
}

impl Panels {
    /// Finds units by a text, and shows the best views of one. Nothing is drawn without the labeling service.
    pub(super) fn labels(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        if !state.services.labeling {
            self.text_input.forget(Field::Find);
            self.labels.give_up();
            return;
        }
        let drawn = section(ui, "Find", true, |ui| {
            self.find_field(ui, state, output);
            self.find_buttons(ui, state, output);
            self.found(ui, state, output);
            self.best_views(ui, state, output);
            if let Some(known) = state.labeling.state.as_deref() {
                knowledge(ui, known);
            }
        });
        if drawn.is_none() {
            self.text_input.forget(Field::Find);
        }
    }

    fn find_field(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let mut asks = false;
        ui.horizontal(|ui| {
            let width = ui.available_width() - button_width(ui, "find") - ui.spacing().item_spacing.x;
            let hint = "the largest vessel, things like this …";
            asks = self.text_input.edit(ui, Field::Find, hint, width, MAX_TEXT_BYTES) == FieldEvent::Entered;
            let text = self.text_input.text(Field::Find).trim();
            let ready = !text.is_empty() && text.len() <= MAX_TEXT_BYTES;
            let why = if text.is_empty() { "type some words first" } else { "the text is too long" };
            let button = ui.add_enabled(ready, Button::new("find")).on_hover_text("the units that these words mean");
            let pressed = button.on_disabled_hover_text(why).clicked();
            asks = ready && (pressed || asks);
        });
        if asks {
            let text = self.text_input.text(Field::Find).trim().to_owned();
            self.find(text, state, output);
        }
    }

    fn find(&mut self, text: String, state: &ViewState, output: &mut Output) {
        let question = self.labels.next(state, text.clone());
        output.requests.push(Request::Find { number: question.number, text });
        self.labels.find = Some(question);
    }

    fn find_buttons(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        // The service knows the selection that the scene has stored.
        let is_selected = !state.scene.selection().mask().is_none();
        let chosen = self.chosen.and_then(|unit| state.scene.name_of(unit));
        let region = match chosen {
            Some(name) => Some(Region { unit: name.to_owned(), about: name.to_owned() }),
            None if is_selected => Some(Region { unit: String::new(), about: "the selection".to_owned() }),
            None => None,
        };
        // A tour that is under way has a bar of its own.
        let offers_tour = state.services.agents && state.tour.is_none();
        if !is_selected && region.is_none() && !offers_tour {
            return;
        }
        ui.horizontal_wrapped(|ui| {
            if is_selected && ui.button("like this").on_hover_text("finds units like the selection").clicked() {
                self.find(LIKE_THIS.to_owned(), state, output);
            }
            if let Some(Region { unit, about }) = region {
                let does = format!("pictures of {about} from where most of it is seen");
                if ui.button("best views").on_hover_text(does).clicked() {
                    let question = self.labels.next(state, about);
                    output.requests.push(Request::Views { number: question.number, unit });
                    self.labels.views = Some(question);
                }
            }
            let does = "shows each unit from its best side, with a sentence about it";
            if offers_tour && ui.button("begin a tour").on_hover_text(does).clicked() {
                output.requests.push(Request::Tour(TourStep::Start));
            }
        });
    }

    /// The answer to the newest text.
    fn found(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let Some(question) = &self.labels.find else { return };
        let Some(answer) = question.answer(state.labeling.found.as_ref()) else {
            ui.label(RichText::new(format!("“{}” …", question.about)).weak());
            return;
        };
        let reply = match &answer.result {
            Ok(reply) => reply,
            Err(problem) => return show_problem(ui, problem),
        };
        ui.label(RichText::new(format!("“{}”: {}", question.about, verdict(reply))).strong());
        if reply.units.is_empty() || !reply.regions.is_empty() {
            return proposed_regions(ui, state, reply, output);
        }
        let mut pressed = None;
        let list = ScrollArea::vertical().id_salt("candidates").max_height(LIST * scale(ui)).auto_shrink([false, true]);
        list.show(ui, |ui| {
            for (k, candidate) in reply.units.iter().take(CANDIDATES).enumerate() {
                let unit = unit_named(&state.scene, &candidate.unit);
                let shown = ui.push_id(k, |ui| candidate_row(ui, candidate, unit.is_some()));
                if shown.inner {
                    pressed = unit.map(|unit| (unit, candidate));
                }
            }
        });
        if reply.units.len() > CANDIDATES {
            ui.label(RichText::new(format!("and {} more", count(reply.units.len() - CANDIDATES))).weak());
        }
        self.select_all_found(ui, state, reply, output);
        if let Some((unit, candidate)) = pressed {
            self.choose(Some(unit));
            // Nothing of a locked unit is selected.
            if state.services.scene && !state.scene.is_locked(unit) {
                output.change(select(vec![candidate.unit.clone()]));
            }
        }
    }

    /// A button that selects all units of a match of several.
    fn select_all_found(&self, ui: &mut Ui, state: &ViewState, reply: &FindReply, output: &mut Output) {
        let is_free = |candidate: &&Candidate| {
            unit_named(&state.scene, &candidate.unit).is_some_and(|unit| !state.scene.is_locked(unit))
        };
        if !state.services.scene || reply.outcome() != Outcome::Match || reply.units.len() < 2 {
            return;
        }
        let free: Vec<String> =
            reply.units.iter().take(CANDIDATES).filter(is_free).map(|candidate| candidate.unit.clone()).collect();
        if free.len() > 1 {
            let button = ui.button(format!("select all {}", count(free.len())));
            if button.on_hover_text("their splats become the selection").clicked() {
                output.change(select(free));
            }
        }
    }

    /// The pictures of the best views: pressing one goes there.
    fn best_views(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let Some(question) = &self.labels.views else { return };
        let Some(answer) = question.answer(state.labeling.views.as_ref()) else {
            // A texture of an earlier answer is of no more use.
            self.labels.thumbnails = None;
            ui.label(RichText::new(format!("Drawing views of {} …", question.about)).weak());
            return;
        };
        let views = match &answer.result {
            Ok(found) => found.views.as_slice(),
            Err(problem) => {
                self.labels.thumbnails = None;
                return show_problem(ui, problem);
            }
        };
        let title = if views.is_empty() { "Nothing is seen of" } else { "Best views of" };
        ui.label(RichText::new(format!("{title} {}", question.about)).weak());
        let context = ui.ctx().clone();
        if self.labels.thumbnails.as_ref().is_none_or(|kept| !kept.are_of(&context, answer)) {
            self.labels.thumbnails = Some(Thumbnails::new(&context, answer, views));
        }
        let textures =
            self.labels.thumbnails.as_ref().map_or::<&[Option<TextureHandle>], _>(&[], |kept| kept.textures.as_slice());
        let mut going = None;
        ui.horizontal_wrapped(|ui| {
            let gap = ui.spacing().item_spacing.x;
            let room = (ui.available_width() - gap * (REGION_VIEWS as f32 - 1.0)) / REGION_VIEWS as f32;
            let side = room.clamp(SIDE.0 * scale(ui), SIDE.1 * scale(ui));
            for (k, (view, texture)) in views.iter().zip(textures).enumerate() {
                if thumbnail(ui, (k, view, texture.as_ref()), side, state.services.scene) {
                    going = view.view;
                }
            }
        });
        if let Some(Err(error)) = views.iter().map(|view| &view.picture).find(|picture| picture.is_err()) {
            show_problem(ui, &error.to_string());
        }
        if let Some(view) = going {
            output.change(Action::SetView(SetView { change: Some(set_view::Change::View(view)) }));
        }
    }
}

/// One view's picture, `side` points wide and high; returns whether it was pressed.
fn thumbnail(
    ui: &mut Ui,
    (k, view, texture): (usize, &PicturedView, Option<&TextureHandle>),
    side: f32,
    is_enabled: bool,
) -> bool {
    let sense = if is_enabled { Sense::click() } else { Sense::hover() };
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(side), sense);
    response.widget_info(|| WidgetInfo::labeled(Role::Button, is_enabled, format!("view {}", k + 1)));
    if let Some(texture) = texture {
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    }
    let look = *ui.style().interact(&response);
    let edge = if response.hovered() || response.has_focus() { 2.0 } else { 1.0 };
    let stroke = Stroke::new(edge * scale(ui), look.bg_stroke.color);
    ui.painter().rect_stroke(rect, 0.0, stroke, StrokeKind::Inside);
    let mut does = format!("entropy {}, unhidden {}", share(view.entropy), share(view.unhidden));
    if is_enabled {
        does.push_str("; a press goes there");
    }
    response.on_hover_text(does).clicked()
}

/// The line of a candidate, and why it is one; returns whether it was pressed.
fn candidate_row(ui: &mut Ui, candidate: &Candidate, is_there: bool) -> bool {
    let button = scored_row(ui, &candidate.unit, &candidate.explanation, candidate.score, is_there);
    button.on_disabled_hover_text("it is no longer in the scene").clicked()
}

/// A button with a score, and the reason for it below.
fn scored_row(ui: &mut Ui, name: &str, explanation: &str, score: f64, is_enabled: bool) -> Response {
    let response = ui.horizontal(|ui| {
        let width = ui.available_width() - SCORE * scale(ui) - ui.spacing().item_spacing.x;
        let size = vec2(width.max(40.0), ui.spacing().interact_size.y);
        let button = Button::new(name).truncate().min_size(size).frame_when_inactive(false);
        let shape = Layout::left_to_right(Align::Center).with_main_justify(true).with_main_align(Align::Min);
        let pressed = ui.allocate_ui_with_layout(size, shape, |ui| ui.add_enabled(is_enabled, button)).inner;
        cell(ui, SCORE * scale(ui), Align::Max, RichText::new(share(score)));
        pressed
    });
    let button = response.inner;
    // The unit's own row has its name.
    ui.ctx().accesskit_node_builder(button.id, |node| node.set_label(format!("candidate {name}")));
    let why = capital(explanation);
    let button = if why.is_empty() { button } else { button.on_hover_text(&why) };
    if !why.is_empty() {
        ui.add(Label::new(RichText::new(why).small().weak()).truncate());
    }
    button
}

/// The regions that the text may mean although no unit is one of them. A press selects a region.
fn proposed_regions(ui: &mut Ui, state: &ViewState, reply: &FindReply, output: &mut Output) {
    for (k, region) in reply.regions.iter().enumerate() {
        let name = format!("region of {} Gaussians", count(region.gaussians as usize));
        let shown =
            ui.push_id(k, |ui| scored_row(ui, &name, &region.explanation, region.score, state.services.selection));
        if shown.inner.on_hover_text("selects it; nobody has named it").clicked() {
            let steps = vec![SelectionStep { step: region.members.clone().map(Step::Mask) }];
            let request = StrokesRequest { restart: true, steps, ..StrokesRequest::default() };
            output.requests.push(Request::Select(request));
        }
    }
}

/// What the service says about the text, for a person.
fn verdict(reply: &FindReply) -> String {
    match (reply.outcome(), reply.units.len()) {
        (Outcome::Match, 1) => "1 match".to_owned(),
        (Outcome::Match, n) => format!("{} matches", count(n)),
        (Outcome::Ambiguous, 1) => "likely, not sure".to_owned(),
        (Outcome::Ambiguous, _) => "which one?".to_owned(),
        (Outcome::NoMatch | Outcome::Unspecified, n) => {
            let reason = if reply.reason.is_empty() { "no match" } else { reply.reason.as_str() };
            if !reply.regions.is_empty() {
                format!("{reason}; it may be a part without a name")
            } else if n == 0 {
                reason.to_owned()
            } else {
                format!("{reason}; the likeliest is")
            }
        }
    }
}

/// What the service goes by, and how many units have an embedding of their pictures.
fn knowledge(ui: &mut Ui, known: &State) {
    if !known.method.is_empty() {
        ui.label(RichText::new(capital(&known.method)).small().weak());
    }
    if !known.image_encoder.is_empty() {
        let there = known.embedded.len();
        let all = known.units.max(there as u32) as usize;
        let mut text = format!("pictures: {} of {} units embedded", count(there), count(all));
        if known.embedded_regions > 0 {
            text.push_str(&format!(", and {} parts", count(known.embedded_regions as usize)));
        }
        ui.label(RichText::new(text).small().weak()).on_hover_text(&known.image_encoder);
    }
}

fn show_problem(ui: &mut Ui, problem: &str) {
    let text = RichText::new(capital(problem)).color(ui.visuals().error_fg_color);
    ui.add(Label::new(text).truncate());
}

fn unit_named(scene: &EditState, name: &str) -> Option<UnitRef> {
    scene.names().find(|(known, _)| *known == name).map(|(_, unit)| unit)
}

/// A share of an answer in percent; a dash for what is no number.
fn share(x: f64) -> String {
    if x.is_finite() { percent(x) } else { "–".to_owned() }
}

/// Makes units the selection.
fn select(units: Vec<String>) -> Action {
    let target = Some(Target { units, ..Target::default() });
    Action::Select(Select { target, operation: SetOperation::Replace.into() })
}
