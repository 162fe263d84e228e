//! Text fields and their keyboard focus.
//!
//! A field may be in another context than its keyboard. Key events of the virtual keyboard wait here. The field takes them
//! up at its next frame, exactly as from a physical keyboard.

use egui::{Event, Id, Key, Modifiers, Rect, TextEdit, Ui};

/// Events of the virtual keyboard that may wait for their field to be drawn.
const KEYS: usize = 64;

/// Text fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Field {
    /// The name of a unit to be saved.
    SaveName,
    /// The new name of a unit.
    NewName,
    /// The sentence for the agents.
    Say,
    /// The words for units to be found.
    Find,
    /// The name of a viewpoint to be kept.
    ViewName,
}

impl Field {
    /// Label of the field.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::SaveName => "name of the new unit",
            Self::NewName => "new name",
            Self::Say => "say",
            Self::Find => "words for units",
            Self::ViewName => "name of the view",
        }
    }
}

/// Outcome of a field in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldEvent {
    /// No change, or some letters.
    Going,
    /// Enter was pressed.
    Entered,
    /// The field lost the focus.
    Left,
    /// Escape was pressed.
    GivenUp,
}

/// The text of all fields, and the focused field.
#[derive(Debug, Default)]
pub(super) struct TextInput {
    field: Option<Field>,
    texts: [String; 5],
    keys: Vec<Event>,
    leave: bool,
    wanted: Option<Field>,
    version: u64,
    /// Where each field was drawn last, until [`Self::take_place`].
    places: [Option<Rect>; 5],
}

/// Key of a context's memory for the place of its virtual keyboard.
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

    /// Focuses a field at its next frame.
    pub(super) fn turn_to(&mut self, field: Field) {
        self.wanted = Some(field);
        self.version += 1;
    }

    /// Whether some field gets the focus at its next frame.
    pub(super) fn is_awaited(&self) -> bool {
        self.wanted.is_some()
    }

    /// Whether a field gets the focus at its next frame.
    pub(super) fn wants(&self, field: Field) -> bool {
        self.wanted == Some(field)
    }

    /// Where a field was drawn since the last call.
    pub(super) fn take_place(&mut self, field: Field) -> Option<Rect> {
        self.places[field as usize].take()
    }

    /// A field is no longer drawn.
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

    /// Queues an event. A full queue means that its field no longer exists.
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

    /// Clears the focus, and that of a field that was to get it at its next frame.
    pub(super) fn leave(&mut self) {
        self.wanted = None;
        self.leave = self.field.is_some();
        self.version += 1;
    }

    /// Stores the place of the virtual keyboard in this context: a press there does not move the focus.
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
        self.places[field as usize] = Some(response.rect).filter(|rect| ui.is_rect_visible(*rect));
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
