//! Commands as people say them aloud, for recognizers that expect certain sentences.
//!
//! Each row is a command of the table with its templates. `{name}` stands for a value of a slot, `(a | b)` for one of several
//! texts, and `[a]` for a text that may be missing. Every sentence of a template is a clause that [`grammar`](crate::grammar)
//! understands as the command of its row.

use sg_proto::language::{Act, Intent};
use sg_proto::scene::State;

use crate::unit_names;

/// Names of units that the scene has.
pub const UNIT: &str = "unit";
/// The same, for a second unit of a sentence.
pub const OTHER: &str = "other";
/// Colours.
pub const COLOR: &str = "color";
/// Percentages without the word "percent".
pub const PERCENT: &str = "percent";
/// Angles in degrees.
pub const DEGREES: &str = "degrees";
/// Names of viewpoints that are kept.
pub const VIEW: &str = "view";
/// Names that a unit or a viewpoint may get.
pub const NEW_NAME: &str = "new_name";

/// Most names of units in a slot: more are hard to tell apart by ear.
pub const MAX_UNITS: usize = 200;

const COLORS: [&str; 22] = [
    "red",
    "green",
    "blue",
    "yellow",
    "orange",
    "purple",
    "pink",
    "brown",
    "white",
    "black",
    "grey",
    "cyan",
    "magenta",
    "violet",
    "turquoise",
    "gold",
    "beige",
    "light blue",
    "dark blue",
    "light green",
    "dark green",
    "dark red",
];

const PERCENTS: [&str; 12] = ["5", "10", "20", "25", "30", "40", "50", "60", "70", "75", "80", "90"];

const ANGLES: [&str; 7] = ["10", "15", "30", "45", "60", "90", "180"];

/// Words that people give as names of structures.
const NEW_NAMES: [&str; 20] = [
    "aneurysm", "artery", "bladder", "bone", "brain", "branch", "dome", "filament", "halo", "heart", "kidney", "liver",
    "lung", "neck", "root", "skin", "skull", "tumour", "vein", "vessel",
];

/// Templates of one command.
#[derive(Debug, Clone, Copy)]
pub struct Spoken {
    /// The act of its clause.
    pub act: Act,
    /// Its templates.
    pub templates: &'static [&'static str],
}

const fn row(act: Act, templates: &'static [&'static str]) -> Spoken {
    Spoken { act, templates }
}

/// All rows, the commands that are said most often first.
pub const COMMANDS: &[Spoken] = &[
    row(
        Act::SetColor,
        &[
            "(make | paint | color | turn) (the {unit} | it | the selection) {color}",
            "give the {unit} a {color} color",
            "set the color of the {unit} to {color}",
            "restore the color of the {unit}",
        ],
    ),
    row(Act::Hide, &["hide (the {unit} | it | the selection | everything | everything else)", "switch off the {unit}"]),
    row(Act::Hide, &["hide everything (except | but) the {unit}", "hide the {unit} and the {other}"]),
    row(Act::Show, &["show (the {unit} | everything)", "bring back the {unit}", "make the {unit} visible"]),
    row(Act::ShowOnly, &["show only (the {unit} | the selection)", "isolate the {unit}", "show the {unit} alone"]),
    row(
        Act::SetOpacity,
        &[
            "fade (the {unit} | everything else | everything) to {percent} percent",
            "fade everything (but | except) the {unit} to {percent} percent",
            "set the opacity of the {unit} to {percent} percent",
            "make (the {unit} | it) [half | more | less] transparent",
            "make (the {unit} | it) opaque",
            "fade (the {unit} | it)",
        ],
    ),
    row(
        Act::Select,
        &[
            "select (the {unit} | everything)",
            "add the {unit} to the selection",
            "remove the {unit} from the selection",
        ],
    ),
    row(Act::Select, &["invert the selection"]),
    row(Act::ClearSelection, &["clear the selection", "deselect", "select nothing"]),
    row(
        Act::TakeAnswer,
        &["more", "less", "a bit more", "a bit less", "the whole thing", "only this part", "take the first answer"],
    ),
    row(Act::Label, &["call (this | it) [the] {new_name}", "label (this | it) {new_name}", "update the {unit}"]),
    row(Act::Rename, &["rename the {unit} to {new_name}"]),
    row(
        Act::SetView,
        &[
            "frame (the {unit} | the selection | it)",
            "(look at | zoom to) (the {unit} | the selection)",
            "zoom (in | out) [a bit | twice]",
            "(view | look | show it) from (above | below | behind | the left | the right | the front | the back | the top)",
            "(rotate | turn) (left | right | up | down) [[by] {degrees} degrees]",
            "reset the view",
            "(go to | go back to | show) the (bookmark | view) {view}",
            "go [back] to the {view} view",
        ],
    ),
    row(Act::KeepView, &["(remember | keep | bookmark) this view [as {new_name}]", "bookmark this"]),
    row(Act::ListViews, &["list the bookmarks", "which views are kept", "show my bookmarks"]),
    // The scene names the first viewpoint "view 1" if nobody does.
    row(Act::ForgetView, &["(forget | delete) (view 1 | the bookmark {view} | the view {view})"]),
    row(
        Act::BestView,
        &["[show me] the best view [of (the {unit} | it | the selection)]", "show the {unit} from its best side"],
    ),
    row(
        Act::Tour,
        &[
            "(give me | start) a tour",
            "(pause | stop | continue) the tour",
            "(next | previous) stop",
            "next",
            "pause",
            "go on",
        ],
    ),
    row(
        Act::SetLight,
        &[
            "light [it] from (above | below | behind | the left | the right | the front)",
            "turn (up | down) the light",
            "(more | less) light",
            "make it (brighter | darker)",
            "use a headlight",
            "studio lighting",
        ],
    ),
    row(Act::SetBackground, &["make the background {color}", "set the background to {color}", "{color} background"]),
    row(Act::Describe, &["describe (the scene | the {unit})", "what is the {unit}", "how big is the {unit}"]),
    row(Act::Describe, &["what color is the {unit}", "is the {unit} visible"]),
    row(Act::QuerySelection, &["what is selected", "how big is the selection"]),
    row(Act::List, &["list the units", "what is there", "what can I see"]),
    row(Act::Undo, &["undo [that | twice]", "take that back"]),
    row(Act::Redo, &["redo [that | twice]"]),
    row(Act::Reset, &["reset the appearance", "start over"]),
    row(Act::Help, &["help", "what can I say"]),
    row(Act::SetTerm, &["show (the normals | only the diffuse term)", "full shading"]),
    row(
        Act::SetTone,
        &["make the {unit} (more | less) saturated", "make the {unit} (warmer | cooler | brighter | darker)"],
    ),
    row(Act::Lock, &["lock the {unit}"]),
    row(Act::Unlock, &["unlock (the {unit} | everything)"]),
    row(Act::Duplicate, &["duplicate (the {unit} | the selection)"]),
    row(Act::Merge, &["merge the {unit} (and | with) the {other}"]),
    row(Act::Delete, &["forget the {unit}", "remove the name {unit}"]),
    row(Act::DeleteGaussians, &["delete (the {unit} | the selection)", "crop to the selection"]),
    row(Act::RestoreGaussians, &["restore everything deleted", "undelete everything"]),
    row(
        Act::Transform,
        &[
            "move the {unit} (up | down | left | right | to the left | to the right)",
            "rotate the {unit} by {degrees} degrees",
            "make the {unit} (twice | half) as big",
            "put the {unit} back",
        ],
    ),
    row(Act::SavePicture, &["save a picture", "take a screenshot"]),
    row(Act::SaveCopy, &["save a copy"]),
    row(Act::Export, &["export (the {unit} | the selection)"]),
    row(Act::ResetTransferFunction, &["reset the transfer function"]),
    row(Act::AdjustTransferFunction, &["bone window", "(raise | lower) the level", "(widen | narrow) the window"]),
];

/// The values of every slot, for the units of a scene.
#[must_use]
pub fn slots(state: &State) -> Vec<(&'static str, Vec<&str>)> {
    let mut units = unit_names::addressable(state);
    units.truncate(MAX_UNITS);
    vec![
        (UNIT, units.clone()),
        (OTHER, units),
        (COLOR, COLORS.to_vec()),
        (PERCENT, PERCENTS.to_vec()),
        (DEGREES, ANGLES.to_vec()),
        (VIEW, unit_names::kept_views(state)),
        (NEW_NAME, NEW_NAMES.to_vec()),
    ]
}

/// Whether a clause takes something away that a person may not notice, so that a command heard by ear needs a confirmation.
#[must_use]
pub fn needs_confirmation(intent: &Intent) -> bool {
    let takes_away = |act: Act| {
        matches!(
            act,
            Act::DeleteGaussians | Act::Delete | Act::Merge | Act::Reset | Act::ResetTransferFunction | Act::ForgetView
        )
    };
    intent.clauses.iter().any(|clause| takes_away(clause.act()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::table::TABLE;

    #[test]
    fn every_command_can_be_said() {
        for command in TABLE {
            // A file is named by its letters, and nobody says those.
            let is_file = command.act == Act::Open;
            assert!(is_file || COMMANDS.iter().any(|spoken| spoken.act == command.act), "{}", command.title);
        }
    }
}
