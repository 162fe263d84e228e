//! Text fields, and which of them letters go to.
//!
//! A field may be in another context than the keyboard that types into it. What the keyboard's keys mean waits here as events,
//! and the field takes them up when it is drawn next, exactly as if they came from a keyboard of the machine.

use egui::{Event, Id, Key, Modifiers, Rect, TextEdit, Ui};

/// Events of the virtual keyboard that may wait for their field to be drawn.
const KEYS: usize = 64;

/// Where text can be typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Field {
    /// The name of a unit to be saved.
    SaveName,
    /// The new name of a unit.
    NewName,
    /// The sentence for the agents.
    Say,
}

impl Field {
    /// Label of the field.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::SaveName => "name of the new unit",
            Self::NewName => "new name",
            Self::Say => "say",
        }
    }
}

/// Outcome of a field in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldEvent {
    /// Nothing, or some letters.
    Going,
    /// Enter was pressed.
    Entered,
    /// The field lost the focus.
    Left,
    /// Escape was pressed.
    GivenUp,
}

/// The text of all fields and which one is being typed into.
#[derive(Debug, Default)]
pub(super) struct TextInput {
    field: Option<Field>,
    texts: [String; 3],
    keys: Vec<Event>,
    leave: bool,
    wanted: Option<Field>,
    version: u64,
}

/// Where a context remembers the place of its virtual keyboard.
fn keyboard_place() -> Id {
    Id::unique("place of the virtual keyboard")
}

impl TextInput {
    /// The field that letters go to.
    pub(super) fn field(&self) -> Option<Field> {
        self.field
    }

    /// Counts changes of text and focus.
    pub(super) fn version(&self) -> u64 {
        self.version
    }

    /// Text of a field.
    pub(super) fn text(&self, field: Field) -> &str {
        &self.texts[field as usize]
    }

    /// Puts a text in place.
    pub(super) fn set(&mut self, field: Field, text: impl Into<String>) {
        self.texts[field as usize] = text.into();
        self.version += 1;
    }

    /// Has letters go to a field as soon as it is drawn.
    pub(super) fn turn_to(&mut self, field: Field) {
        self.wanted = Some(field);
        self.version += 1;
    }

    /// Whether letters go to a field as soon as it is drawn.
    pub(super) fn wants(&self, field: Field) -> bool {
        self.wanted == Some(field)
    }

    /// A field is not drawn any more.
    pub(super) fn forget(&mut self, field: Field) {
        if self.field == Some(field) {
            self.field = None;
            self.keys.clear();
            self.version += 1;
        }
        self.wanted.take_if(|f| *f == field);
    }

    /// Letters of the virtual keyboard.
    pub(super) fn letters(&mut self, text: &str) {
        self.add(Event::Text(text.to_owned()));
    }

    /// A field that takes nothing is not there any more.
    fn add(&mut self, event: Event) {
        self.version += 1;
        if self.keys.len() < KEYS {
            self.keys.push(event);
        } else if let Some(field) = self.field {
            self.forget(field);
        }
    }

    /// A key of the virtual keyboard that is no letter.
    pub(super) fn key(&mut self, key: Key) {
        for pressed in [true, false] {
            self.add(Event::Key { key, physical_key: None, pressed, repeat: false, modifiers: Modifiers::NONE });
        }
    }

    /// Letters go nowhere any more.
    pub(super) fn leave(&mut self) {
        self.leave = self.field.is_some();
        self.version += 1;
    }

    /// Says where in this context the virtual keyboard is: pressing there turns to nothing else.
    pub(super) fn keyboard_at(ui: &Ui, place: Rect) {
        ui.data_mut(|d| d.insert_temp(keyboard_place(), place));
    }

    /// Draws a field over the given width.
    pub(super) fn edit(&mut self, ui: &mut Ui, field: Field, hint: &str, width: f32, most: usize) -> FieldEvent {
        let id = Id::unique(("text field of the panels", field));
        let mine = self.field == Some(field);
        let elsewhere = !mine && self.field.is_some();
        let ousted = elsewhere && ui.memory(|m| m.has_focus(id) && m.had_focus_last_frame(id));
        let wanted = self.wanted.take_if(|f| *f == field).is_some();
        if wanted {
            ui.memory_mut(|m| m.request_focus(id));
        } else if mine && std::mem::take(&mut self.leave) {
            ui.memory_mut(|m| m.surrender_focus(id));
        } else if ousted {
            // A field of another context has the focus.
            ui.memory_mut(|m| m.surrender_focus(id));
        }
        let had = ui.input(|i| i.events.len());
        if mine && !self.keys.is_empty() {
            let keys = std::mem::take(&mut self.keys);
            ui.memory_mut(|m| m.request_focus(id));
            ui.input_mut(|i| i.events.extend(keys));
        }
        let text = &mut self.texts[field as usize];
        let edit = TextEdit::singleline(text).id(id).hint_text(hint).desired_width(width).char_limit(most);
        let response = edit.show(ui).response.response;
        ui.ctx().accesskit_node_builder(id, |node| node.set_label(field.name()));
        let (entered, given) = ui.input(|i| (i.key_pressed(Key::Enter), i.key_pressed(Key::Escape)));
        ui.input_mut(|i| i.events.truncate(had));
        if wanted {
            response.scroll_to_me(None);
        }
        self.version += u64::from(response.changed());
        if response.has_focus() {
            self.version += u64::from(!mine);
            self.field = Some(field);
            return FieldEvent::Going;
        }
        if !mine {
            return if ousted { FieldEvent::Left } else { FieldEvent::Going };
        }
        let place = ui.data(|d| d.get_temp::<Rect>(keyboard_place()));
        let pointed = ui.input(|i| i.pointer.interact_pos());
        if !entered && !given && place.zip(pointed).is_some_and(|(place, at)| place.contains(at)) {
            ui.memory_mut(|m| m.request_focus(id));
            return FieldEvent::Going;
        }
        self.field = None;
        self.keys.clear();
        self.version += 1;
        match (entered, given) {
            (true, _) => FieldEvent::Entered,
            (_, true) => FieldEvent::GivenUp,
            _ => FieldEvent::Left,
        }
    }
}
