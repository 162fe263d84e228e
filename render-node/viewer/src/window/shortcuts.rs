//! Keyboard actions in a window: one table for the actions and for the list that `?` shows.

use egui::{Event, InputState, Key, Modifiers};

/// The action of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Shows or hides the list of shortcuts.
    Help,
    /// The mouse moves the eye.
    Navigate,
    /// The mouse brushes.
    Brush,
    /// The mouse draws a lasso.
    Lasso,
    /// The mouse draws a rectangle.
    Rectangle,
    /// The mouse sets the corners of a polygon.
    Polygon,
    /// The mouse draws a sphere.
    Sphere,
    /// The mouse draws a box.
    Box,
    /// The mouse moves, turns and scales the selection.
    Move,
    /// Strokes grow to the whole structure.
    Walk,
    /// Strokes change whole Super-Gaussians.
    Cluster,
    /// Strokes change single Gaussians.
    Point,
    /// A wider brush.
    Wider,
    /// A narrower brush.
    Narrower,
    /// Limits the brush to the front, or not.
    Depth,
    /// Selects less: a narrower answer to the Region strokes, or a smaller number of the last walk.
    Less,
    /// Selects more.
    More,
    /// The next of these.
    NextParameter,
    /// Takes back.
    Undo,
    /// Brings back.
    Redo,
    /// Selects everything visible.
    All,
    /// Selects nothing.
    Clear,
    /// Inverts the selection.
    Invert,
    /// Deletes the selected Gaussians.
    Delete,
    /// Copies the selected Gaussians, to move the copy.
    Duplicate,
    /// Deletes everything but the selected Gaussians.
    Crop,
    /// Letters go to the name of a new unit.
    Name,
    /// Moves the focus to the sentence for the agents.
    Say,
    /// Frames the scene.
    Fit,
    /// Frames the selection.
    FrameSelection,
    /// Turns the next axis up.
    NextUp,
    /// Turns the scene upside down.
    Flip,
    /// The next manner of moving the eye.
    NavigationMode,
    /// Keeps a picture.
    Picture,
    /// Keeps a turn around the scene as pictures.
    Turntable,
    /// Asks for a file to open.
    Open,
    /// Saves the project or everything in it under another name.
    SaveCopy,
    /// Saves the selected Gaussians, or the visible ones, as a file.
    ExportSplats,
    /// A picture for each eye, side by side.
    Stereo,
    /// Shows or hides panels.
    Panels,
    /// Dark or light panels.
    Theme,
    /// Shows or hides the ground grid and the box of what is visible.
    Grid,
    /// The next view of the structure.
    NextDisplayMode,
    /// Moves the eye about its target, or looks elsewhere where it flies.
    Turn(Way),
    /// Moves eye and target in the plane of the picture.
    Slide(Way),
    /// Goes nearer.
    Nearer,
    /// Goes further away.
    Further,
    /// Cancels the stroke, lasso, polygon, shape, move or turntable under way.
    Abandon,
    /// Closes the window.
    Close,
}

/// Where an arrow key points, as seen in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// To the left.
    Left,
    /// To the right.
    Right,
    /// Upwards.
    Up,
    /// Downwards.
    Down,
}

/// A subject of the list of shortcuts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Tools of the mouse and their settings.
    Tools,
    /// What is selected, and edits of it.
    Selection,
    /// The eye and what is shown.
    View,
    /// Files that are written.
    Files,
    /// All else.
    Other,
}

impl Group {
    /// All, in the order of the list.
    pub const ALL: [Self; 5] = [Self::Tools, Self::Selection, Self::View, Self::Files, Self::Other];

    /// Heading in the list.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Tools => "Tools",
            Self::Selection => "Selection",
            Self::View => "View",
            Self::Files => "Files",
            Self::Other => "Other",
        }
    }
}

impl Action {
    /// Whether a text field gets the next letters.
    fn leads_to_field(self) -> bool {
        matches!(self, Self::Say | Self::Name)
    }

    /// Its subject.
    #[must_use]
    pub fn group(self) -> Group {
        match self {
            Self::Navigate
            | Self::Brush
            | Self::Lasso
            | Self::Rectangle
            | Self::Polygon
            | Self::Sphere
            | Self::Box
            | Self::Move
            | Self::Walk
            | Self::Cluster
            | Self::Point
            | Self::Wider
            | Self::Narrower
            | Self::Depth
            | Self::Less
            | Self::More
            | Self::NextParameter => Group::Tools,
            Self::All
            | Self::Clear
            | Self::Invert
            | Self::Delete
            | Self::Duplicate
            | Self::Crop
            | Self::Name
            | Self::FrameSelection => Group::Selection,
            Self::Fit
            | Self::NextUp
            | Self::Flip
            | Self::NavigationMode
            | Self::Turn(_)
            | Self::Slide(_)
            | Self::Nearer
            | Self::Further
            | Self::NextDisplayMode
            | Self::Grid
            | Self::Stereo => Group::View,
            Self::Open | Self::SaveCopy | Self::Picture | Self::Turntable | Self::ExportSplats => Group::Files,
            _ => Group::Other,
        }
    }
}

/// A key and its action.
#[derive(Debug, Clone, Copy)]
pub struct Shortcut {
    /// Its modifiers.
    pub modifiers: Modifiers,
    /// The key.
    pub key: Key,
    /// Its label.
    pub written: &'static str,
    /// Its action.
    pub action: Action,
    /// Its description.
    pub does: &'static str,
}

const fn plain(key: Key, written: &'static str, action: Action, does: &'static str) -> Shortcut {
    Shortcut { modifiers: Modifiers::NONE, key, written, action, does }
}

const fn with(modifiers: Modifiers, key: Key, written: &'static str, action: Action, does: &'static str) -> Shortcut {
    Shortcut { modifiers, key, written, action, does }
}

/// All of them, in the order of the list. Those with more modifiers come before those with fewer on the same key.
pub const SHORTCUTS: &[Shortcut] = &[
    plain(Key::Questionmark, "?", Action::Help, "this list"),
    plain(Key::N, "N", Action::Navigate, "the mouse moves the eye"),
    plain(Key::B, "B", Action::Brush, "the mouse brushes"),
    plain(Key::L, "L", Action::Lasso, "the mouse draws a lasso"),
    plain(Key::R, "R", Action::Rectangle, "the mouse draws a rectangle"),
    plain(Key::J, "J", Action::Polygon, "the mouse sets the corners of a polygon"),
    with(Modifiers::COMMAND, Key::O, "Ctrl+O", Action::Open, "open a file"),
    plain(Key::O, "O", Action::Sphere, "the mouse draws a sphere"),
    plain(Key::C, "C", Action::Box, "the mouse draws a box"),
    with(Modifiers::SHIFT, Key::M, "Shift+M", Action::Move, "the mouse moves and turns the selection"),
    plain(Key::Num1, "1", Action::Walk, "Region: strokes grow to the whole structure"),
    plain(Key::Num2, "2", Action::Cluster, "Patch: strokes change whole Super-Gaussians"),
    plain(Key::Num3, "3", Action::Point, "Single: strokes change single Gaussians"),
    plain(Key::CloseBracket, "]", Action::Wider, "a wider brush"),
    plain(Key::OpenBracket, "[", Action::Narrower, "a narrower brush"),
    plain(Key::Comma, ",", Action::Less, "select less: a narrower answer to the Region strokes"),
    plain(Key::Period, ".", Action::More, "select more: a wider answer"),
    with(Modifiers::SHIFT, Key::G, "Shift+G", Action::Grid, "show or hide the ground grid and the box"),
    plain(Key::G, "G", Action::NextParameter, "these keys and the wheel change Size, Reach or Strictness"),
    with(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z, "Ctrl+Shift+Z", Action::Redo, "redo"),
    with(Modifiers::COMMAND, Key::Z, "Ctrl+Z", Action::Undo, "undo"),
    plain(Key::Z, "Z", Action::Depth, "brush and lasso only the front, or the back too"),
    with(Modifiers::COMMAND, Key::Y, "Ctrl+Y", Action::Redo, "redo"),
    with(Modifiers::COMMAND, Key::A, "Ctrl+A", Action::All, "select everything visible"),
    with(Modifiers::COMMAND, Key::D, "Ctrl+D", Action::Clear, "select nothing"),
    with(Modifiers::COMMAND, Key::I, "Ctrl+I", Action::Invert, "invert the selection"),
    with(
        Modifiers::SHIFT,
        Key::Delete,
        "Shift+Delete",
        Action::Crop,
        "crop: delete everything but the selection, hidden Gaussians too",
    ),
    with(Modifiers::SHIFT, Key::D, "Shift+D", Action::Duplicate, "duplicate the selected Gaussians, to move the copy"),
    plain(Key::Delete, "Delete", Action::Delete, "delete the selected Gaussians"),
    plain(Key::Backspace, "Backspace", Action::Delete, "delete the selected Gaussians"),
    with(
        Modifiers::COMMAND.plus(Modifiers::SHIFT),
        Key::S,
        "Ctrl+Shift+S",
        Action::SaveCopy,
        "save a copy of the project, or everything in it as a scene",
    ),
    with(Modifiers::COMMAND, Key::S, "Ctrl+S", Action::Name, "name the selection and save it"),
    plain(Key::Enter, "Enter", Action::Say, "say something to the agents"),
    with(Modifiers::SHIFT, Key::F, "Shift+F", Action::FrameSelection, "see the whole selection"),
    plain(Key::F, "F", Action::Fit, "see the whole scene"),
    with(Modifiers::SHIFT, Key::U, "Shift+U", Action::Flip, "turn the scene upside down"),
    plain(Key::U, "U", Action::NextUp, "turn the next axis up: +Z, -Z, +Y, -Y, +X, -X"),
    plain(Key::M, "M", Action::NavigationMode, "orbit, trackball, fly"),
    plain(Key::V, "V", Action::NextDisplayMode, "the next view of the structure"),
    plain(Key::P, "P", Action::Picture, "save a picture"),
    plain(Key::T, "T", Action::Turntable, "save a turn around the scene"),
    with(
        Modifiers::COMMAND,
        Key::E,
        "Ctrl+E",
        Action::ExportSplats,
        "export the selected Gaussians; without a selection, the visible ones",
    ),
    with(Modifiers::SHIFT, Key::ArrowLeft, "Shift+Left", Action::Slide(Way::Left), "slide the eye"),
    with(Modifiers::SHIFT, Key::ArrowRight, "Shift+Right", Action::Slide(Way::Right), "slide the eye"),
    with(Modifiers::SHIFT, Key::ArrowUp, "Shift+Up", Action::Slide(Way::Up), "slide the eye"),
    with(Modifiers::SHIFT, Key::ArrowDown, "Shift+Down", Action::Slide(Way::Down), "slide the eye"),
    plain(Key::ArrowLeft, "Left", Action::Turn(Way::Left), "turn the eye"),
    plain(Key::ArrowRight, "Right", Action::Turn(Way::Right), "turn the eye"),
    plain(Key::ArrowUp, "Up", Action::Turn(Way::Up), "turn the eye"),
    plain(Key::ArrowDown, "Down", Action::Turn(Way::Down), "turn the eye"),
    plain(Key::Plus, "+", Action::Nearer, "nearer"),
    plain(Key::Equals, "=", Action::Nearer, "nearer"),
    plain(Key::Minus, "-", Action::Further, "further away"),
    plain(Key::X, "X", Action::Stereo, "stereo: a picture for each eye, side by side"),
    plain(Key::H, "H", Action::Panels, "show or hide panels"),
    plain(Key::K, "K", Action::Theme, "dark or light"),
    with(Modifiers::COMMAND, Key::Q, "Ctrl+Q", Action::Close, "close the window"),
    plain(Key::Escape, "Esc", Action::Abandon, "cancel the stroke, lasso, shape, move or turntable under way"),
];

/// Mouse functions, for the list.
pub const MOUSE: &[(&str, &str)] = &[
    ("left drag", "uses the tool; with Shift it takes away from the selection"),
    ("middle drag, Alt + left drag", "turn"),
    ("right drag", "slide"),
    ("wheel", "nearer, further; with Shift a wider or narrower brush; with Alt less or more of a Region"),
    ("double click, to navigate", "look at that place"),
    ("W A S D, Q E", "fly, in that manner"),
    ("hold Space", "talk to the agents, where a microphone waits for a key"),
];

/// Keys that press, or leave, a control with the keyboard focus.
const OF_FOCUS: [Key; 5] = [Key::Enter, Key::ArrowLeft, Key::ArrowRight, Key::ArrowUp, Key::ArrowDown];

/// Actions whose keys work in a text field too: no letter, and no command of editing text.
const IN_FIELDS: [Action; 5] = [Action::Open, Action::SaveCopy, Action::ExportSplats, Action::Name, Action::Close];

/// Who else takes keys.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct KeyFocus {
    /// A text field takes letters and the commands of editing text.
    pub(super) is_typing: bool,
    /// A control other than a text field has the focus. It takes [`OF_FOCUS`].
    pub(super) has_control: bool,
    /// A menu is open. Esc closes it.
    pub(super) has_menu: bool,
    /// A text field gets the focus once it is drawn, so that keys belong to it already. Esc takes them away from it.
    pub(super) expects_field: bool,
}

/// Result of the keys of one frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Pressed {
    /// Actions in the order of their keys.
    pub(super) actions: Vec<Action>,
    /// Whether Esc came before the awaited text field had the focus.
    pub(super) leaves_field: bool,
}

impl KeyFocus {
    fn takes(self, shortcut: &Shortcut) -> bool {
        (self.is_typing && !IN_FIELDS.contains(&shortcut.action))
            || (self.has_control && OF_FOCUS.contains(&shortcut.key))
            || (self.has_menu && shortcut.key == Key::Escape)
    }
}

/// Actions of the keys just pressed, in their order; each press counts once. What `focus` takes is left to it. What follows a key
/// that leads to a text field belongs to that field, until Esc: a slow frame holds all of these keys.
#[must_use]
pub(super) fn pressed(input: &mut InputState, focus: KeyFocus) -> Pressed {
    let mut result = Pressed::default();
    let mut leads_to_field = focus.expects_field;
    input.events.retain(|event| {
        let Event::Key { key, pressed: true, modifiers, .. } = event else { return true };
        if leads_to_field && *key == Key::Escape {
            leads_to_field = false;
            result.leaves_field |= focus.expects_field;
            result.actions.pop_if(|action| action.leads_to_field());
            return false;
        }
        let fits = |s: &&Shortcut| s.key == *key && modifiers.matches_logically(s.modifiers) && !focus.takes(s);
        let Some(shortcut) = SHORTCUTS.iter().find(fits).filter(|_| !leads_to_field) else { return true };
        result.actions.push(shortcut.action);
        leads_to_field = shortcut.action.leads_to_field();
        false
    });
    result
}

/// Whether the key that is held to talk is down, and belongs to no control.
#[must_use]
pub(super) fn is_talking(input: &InputState, focus: KeyFocus) -> bool {
    let is_taken = focus.is_typing || focus.has_control || focus.has_menu || focus.expects_field;
    !is_taken && input.key_down(Key::Space)
}

/// What the list shows of a subject: keys with the same effect in one row.
pub(super) fn rows(group: Group) -> Vec<(String, &'static str)> {
    let mut rows: Vec<(String, &'static str)> = Vec::new();
    for shortcut in SHORTCUTS.iter().filter(|s| s.action.group() == group) {
        match rows.iter_mut().find(|(_, does)| *does == shortcut.does) {
            Some((written, _)) => *written = format!("{written}, {}", shortcut.written),
            None => rows.push((shortcut.written.to_owned(), shortcut.does)),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_key_does_two_things() {
        let keys: HashSet<_> = SHORTCUTS.iter().map(|s| (s.written, s.key)).collect();
        assert_eq!(keys.len(), SHORTCUTS.len());
        let flies = [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E];
        assert!(SHORTCUTS.iter().all(|s| s.modifiers != Modifiers::NONE || !flies.contains(&s.key)));
    }

    #[test]
    fn every_key_stands_once_in_the_list() {
        let rows: Vec<_> = Group::ALL.into_iter().flat_map(rows).collect();
        let keys: usize =
            rows.iter().map(|(written, _)| written.split(", ").filter(|key| !key.is_empty()).count()).sum();
        assert_eq!(keys, SHORTCUTS.len(), "{rows:?}");
        assert!(rows.contains(&("Delete, Backspace".to_owned(), "delete the selected Gaussians")));
    }

    #[test]
    fn letters_after_the_key_of_a_field_are_no_shortcuts() {
        let key = |key: Key, modifiers: Modifiers| Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers,
        };
        let mut input = InputState::default();
        let none = Modifiers::NONE;
        input.events =
            vec![key(Key::B, none), key(Key::Z, Modifiers::COMMAND), key(Key::Enter, none), key(Key::H, none)];
        let nobody = KeyFocus::default();
        let actions = |input: &mut InputState, focus| {
            let result = pressed(input, focus);
            assert!(!result.leaves_field);
            result.actions
        };
        assert_eq!(actions(&mut input, nobody), [Action::Brush, Action::Undo, Action::Say]);
        assert_eq!(input.events, [key(Key::H, none)]);
        input.events = vec![key(Key::Escape, none), key(Key::Enter, none), key(Key::X, none)];
        let focus = KeyFocus { has_control: true, has_menu: true, ..nobody };
        assert_eq!(actions(&mut input, focus), [Action::Stereo]);
        assert_eq!(input.events.len(), 2);
        // In a text field, only keys that edit no text.
        let command = |k: Key| key(k, Modifiers::COMMAND);
        input.events = vec![key(Key::B, none), command(Key::A), command(Key::Z), command(Key::E), command(Key::Q)];
        assert_eq!(actions(&mut input, KeyFocus { is_typing: true, ..nobody }), [Action::ExportSplats, Action::Close]);
        assert_eq!(input.events.len(), 3);
    }

    #[test]
    fn escape_takes_keys_away_from_a_field_that_is_not_drawn_yet() {
        let key = |key: Key| Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: if key == Key::Z { Modifiers::COMMAND } else { Modifiers::NONE },
        };
        // The frame after a sentence was sent: the field is to get the focus again.
        let focus = KeyFocus { expects_field: true, ..KeyFocus::default() };
        let mut input = InputState::default();
        input.events = [Key::H, Key::Escape, Key::Z].map(key).to_vec();
        assert_eq!(pressed(&mut input, focus), Pressed { actions: vec![Action::Undo], leaves_field: true });
        assert_eq!(input.events, [key(Key::H)]);
        // Without Esc, all keys are the field's.
        input.events = [Key::H, Key::Z].map(key).to_vec();
        assert_eq!(pressed(&mut input, focus), Pressed::default());
        // A field asked for and given up in one frame.
        input.events = [Key::B, Key::Enter, Key::Escape, Key::Z].map(key).to_vec();
        let result = Pressed { actions: vec![Action::Brush, Action::Undo], leaves_field: false };
        assert_eq!(pressed(&mut input, KeyFocus::default()), result);
    }

    #[test]
    fn a_key_with_more_modifiers_is_looked_at_first() {
        for (k, one) in SHORTCUTS.iter().enumerate() {
            for later in SHORTCUTS.iter().skip(k + 1).filter(|s| s.key == one.key) {
                assert!(!later.modifiers.contains(one.modifiers), "{} hides {}", one.written, later.written);
            }
        }
    }
}
