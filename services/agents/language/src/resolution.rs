//! Targets of clauses: references to names and the selection of a scene.
//!
//! | reference | resolves to |
//! | --- | --- |
//! | names | the units with these names: exact, then case-insensitive, then word by word in any inflection |
//! | focus | the units of the last command, else the selection |
//! | complement without names | all but the units of the last command, else all but the selection |

use std::fmt::Write as _;

use sg_proto::bus::Code;
use sg_proto::language::{Clause, Reference, TourStep};
use sg_proto::launch::{OpenRequest, SaveRequest};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, State, Target};
use sg_proto::selection::StrokesRequest;

use crate::query::NOTHING_KEPT;
use crate::unit_names::{self, Lookup};

/// A clause that does not fit the scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    /// The status code.
    pub code: Code,
    /// One sentence for the user: the reason and a way out.
    pub message: String,
    /// Further facts, for example the existing names.
    pub details: Vec<String>,
}

impl Refusal {
    pub(crate) fn new(code: Code, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), details: Vec::new() }
    }

    pub(crate) fn precondition(message: impl Into<String>) -> Self {
        Self::new(Code::FailedPrecondition, message)
    }

    pub(crate) fn invalid(message: impl Into<String>) -> Self {
        Self::new(Code::InvalidArgument, message)
    }
}

/// The result of resolving a clause.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// A change of the scene.
    Change {
        /// The scene command.
        action: Action,
        /// Names of the affected units in the scene.
        units: Vec<String>,
    },
    /// An answer to a question.
    Answer {
        /// The answer for the user.
        text: String,
        /// Names of the units in question.
        units: Vec<String>,
    },
    /// A file to save.
    Save {
        /// The request to the supervisor. A path without a folder is beside the opened file; an empty one is chosen there.
        request: SaveRequest,
        /// Names of the saved units in the scene.
        units: Vec<String>,
    },
    /// A picture to draw and to save.
    Picture(PictureWish),
    /// A file to open in a window of its own.
    Open(OpenRequest),
    /// Steps for the selection service.
    Strokes(StrokesRequest),
    /// The view that shows most of a target.
    BestView(Target),
    /// A tour that begins, or a change of the one that is under way.
    Tour {
        /// The change.
        step: TourStep,
        /// Names of the units in their order; empty unless the tour begins.
        stops: Vec<String>,
    },
}

/// A picture to draw and to save.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PictureWish {
    /// The path, as in [`SaveRequest`].
    pub file: String,
    /// Factor on the size of the picture in the window, 1 to 4.
    pub scale: u32,
    /// Whether its background is transparent.
    pub transparent: bool,
}

impl Step {
    /// A change of the whole scene.
    pub(crate) fn scene_wide(action: Action) -> Self {
        Self::Change { action, units: Vec::new() }
    }
}

/// Largest number of names in a message.
const LISTED_NAMES: usize = 12;

fn name_list(state: &State) -> String {
    listed(&unit_names::addressable(state))
}

fn listed(names: &[&str]) -> String {
    let shown = names.iter().take(LISTED_NAMES).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "none".to_owned(),
        n if n > LISTED_NAMES => format!("{shown} and {} more", n - LISTED_NAMES),
        _ => shown,
    }
}

fn quoted(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| format!("“{name}”")).collect()
}

/// Finds the unit with a spoken name.
///
/// # Errors
/// `NotFound` with similar names, `InvalidArgument` where several names match.
pub fn unit<'s>(spoken: &str, state: &'s State) -> Result<&'s str, Refusal> {
    match unit_names::lookup(spoken, &unit_names::all(state)) {
        Lookup::Unique(name) => Ok(name),
        Lookup::Ambiguous(names) => Err(Refusal::invalid(format!(
            "“{spoken}” matches several units: {}. Say the exact name in quotation marks.",
            quoted(&names).join(", ")
        ))),
        Lookup::Missing(similar) => {
            let mut message = if similar.is_empty() {
                format!("Nothing is named “{spoken}” yet. Brush it, press Ctrl+S, name it.")
            } else {
                format!("Nothing is named “{spoken}”. Did you mean {}?", quoted(&similar).join(" or "))
            };
            if !unit_names::addressable(state).is_empty() {
                let _ = write!(message, " Names: {}.", name_list(state));
            }
            let details = unit_names::addressable(state).into_iter().map(str::to_owned).collect();
            Err(Refusal { code: Code::NotFound, message, details })
        }
    }
}

/// Finds the kept viewpoint with a spoken name.
///
/// # Errors
/// `NotFound` with similar names, `InvalidArgument` where several names match or none is said.
pub(crate) fn kept_view<'s>(spoken: &str, state: &'s State) -> Result<&'s str, Refusal> {
    let spoken = spoken.trim();
    if spoken.is_empty() {
        return Err(missing("name of a viewpoint"));
    }
    let names = unit_names::kept_views(state);
    if names.is_empty() {
        return Err(Refusal::new(Code::NotFound, NOTHING_KEPT));
    }
    match unit_names::lookup(spoken, &names) {
        Lookup::Unique(name) => Ok(name),
        Lookup::Ambiguous(several) => Err(Refusal::invalid(format!(
            "“{spoken}” matches several viewpoints: {}. Say the exact name in quotation marks.",
            quoted(&several).join(", ")
        ))),
        Lookup::Missing(similar) => {
            let question = if similar.is_empty() {
                String::new()
            } else {
                format!(" Did you mean {}?", quoted(&similar).join(" or "))
            };
            let message = format!("No viewpoint is kept as “{spoken}”.{question} Kept: {}.", listed(&names));
            Err(Refusal { code: Code::NotFound, message, details: names.into_iter().map(str::to_owned).collect() })
        }
    }
}

/// Number of selected Gaussians.
pub(crate) fn selected_count(state: &State) -> u64 {
    state.selection.as_ref().map_or(0, |s| s.count)
}

/// Refuses a scene without a selection.
pub(crate) fn need_selection(state: &State) -> Result<(), Refusal> {
    if selected_count(state) > 0 {
        return Ok(());
    }
    let locked = |name: &&str| {
        state.base_units.iter().any(|u| u.name == *name && u.locked)
            || state.units.iter().any(|u| u.name == *name && u.locked)
    };
    let free = unit_names::addressable(state).into_iter().find(|name| !locked(name));
    let example = free.map_or(String::new(), |name| format!(" or say “select the {name}”"));
    Err(Refusal::precondition(format!("Nothing is selected. Brush a structure{example} first.")))
}

/// The target of "it": the units of the last command that still exist, else the selection.
fn focus(state: &State) -> Option<Target> {
    let names = unit_names::all(state);
    let units: Vec<String> = state.focus.iter().filter(|f| names.contains(&f.as_str())).cloned().collect();
    if !units.is_empty() {
        return Some(Target { units, ..Target::default() });
    }
    (selected_count(state) > 0).then(|| Target { selection: true, ..Target::default() })
}

/// Resolves a reference in a scene.
///
/// # Errors
/// `NotFound`, `InvalidArgument` as [`unit()`]. `FailedPrecondition`: nothing is selected, or the reference has no
/// antecedent.
pub fn target(reference: &Reference, state: &State) -> Result<Target, Refusal> {
    let no_antecedent = || {
        let names = match unit_names::addressable(state).as_slice() {
            [] => "Nothing has a name yet.".to_owned(),
            [name] => format!("Only “{name}” exists; say “the {name}” for that."),
            _ => format!("Names: {}.", name_list(state)),
        };
        Refusal::precondition(format!("Which structure? {names}"))
    };
    let mut target = Target { complement: reference.complement, everything: reference.everything, ..Target::default() };
    for spoken in &reference.names {
        let name = unit(spoken, state)?;
        if !target.units.iter().any(|u| u == name) {
            target.units.push(name.to_owned());
        }
    }
    if reference.selection {
        need_selection(state)?;
        target.selection = true;
    }
    let needs_antecedent = reference.focus
        || (reference.complement && reference.names.is_empty() && !reference.selection && !reference.everything);
    if needs_antecedent {
        let antecedent = focus(state).ok_or_else(no_antecedent)?;
        target.selection |= antecedent.selection;
        for name in antecedent.units {
            if !target.units.contains(&name) {
                target.units.push(name);
            }
        }
    }
    if target.units.is_empty() && !target.selection && !target.everything {
        return Err(Refusal::invalid(format!("Which structure? Names: {}.", name_list(state))));
    }
    Ok(target)
}

/// Resolves the target of a clause.
pub(crate) fn target_of(clause: &Clause, state: &State) -> Result<Target, Refusal> {
    let empty = Reference::default();
    target(clause.target.as_ref().unwrap_or(&empty), state)
}

/// Checks a colour.
pub(crate) fn color_of(color: Option<&Color>) -> Result<Option<Color>, Refusal> {
    match color {
        None => Ok(None),
        Some(c) if [c.red, c.green, c.blue].iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Some(*c)),
        Some(_) => Err(Refusal::new(Code::OutOfRange, "A colour needs three numbers from 0 to 1.")),
    }
}

/// The refusal of a clause that lacks a field.
pub(crate) fn missing(what: &str) -> Refusal {
    Refusal::invalid(format!("The clause has no {what}."))
}

/// Checks the number of a clause: finite, 0 to 1,000,000.
pub(crate) fn number(clause: &Clause, what: &str) -> Result<f64, Refusal> {
    let value = clause.amount.ok_or_else(|| missing(what))?;
    if value.is_finite() && (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err(Refusal::new(Code::OutOfRange, format!("{value} is not a valid {what}; use a number from 0 to 1,000,000.")))
    }
}

/// Checks the number of history steps: 1 to 1,000.
pub(crate) fn step_count(clause: &Clause) -> Result<u32, Refusal> {
    let value = clause.amount.unwrap_or(1.0);
    if value.fract() == 0.0 && (1.0..=1000.0).contains(&value) {
        Ok(value as u32)
    } else {
        Err(Refusal::new(
            Code::OutOfRange,
            format!("{value} is not a number of steps; use a whole number from 1 to 1,000."),
        ))
    }
}

/// Checks the new name of a clause.
pub(crate) fn checked_name(clause: &Clause) -> Result<String, Refusal> {
    let name = clause.name.trim();
    if name.is_empty() {
        return Err(missing("new name"));
    }
    if name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
        return Err(Refusal::invalid(format!("A name has at most {MAX_NAME_BYTES} bytes and no control characters.")));
    }
    Ok(name.to_owned())
}

/// The refusal of a new name that a unit has already.
pub(crate) fn name_taken(name: &str) -> Refusal {
    Refusal::new(Code::AlreadyExists, format!("The name “{name}” exists already. Use another name."))
}

/// Whether the name is that of a base unit.
pub(crate) fn is_base_unit(name: &str, state: &State) -> bool {
    state.base_units.iter().any(|u| u.name == name)
}

/// Finds the one editable unit of a clause.
pub(crate) fn editable_unit(clause: &Clause, state: &State, verb: &str) -> Result<String, Refusal> {
    unit_to_name(clause, state, verb, |name| !is_base_unit(name, state))
}

/// Finds the one unit of a clause of which the name is not the file's own: an editable one or duplicated Gaussians.
pub(crate) fn renamable_unit(clause: &Clause, state: &State) -> Result<String, Refusal> {
    unit_to_name(clause, state, "rename", |name| {
        state.base_units.iter().all(|unit| unit.name != name || unit.duplicated)
    })
}

fn unit_to_name(clause: &Clause, state: &State, verb: &str, can_be: impl Fn(&str) -> bool) -> Result<String, Refusal> {
    let reference = clause.target.clone().unwrap_or_default();
    let saved: Vec<&str> = state.units.iter().filter(|u| !u.locked).map(|u| u.name.as_str()).collect();
    let which = || {
        if saved.is_empty() {
            "No unit is saved yet.".to_owned()
        } else {
            format!("Say the name of the unit: {}.", saved.join(", "))
        }
    };
    if reference.everything || reference.complement {
        return Err(Refusal::precondition(format!("Only one unit at a time can be {verb}d. {}", which())));
    }
    if reference.selection {
        return Err(Refusal::precondition(format!("The selection has no name yet. {}", which())));
    }
    let target = target(&reference, state)?;
    match target.units.as_slice() {
        [name] if !can_be(name) => Err(Refusal::precondition(format!(
            "“{name}” is part of the scene file and cannot be {verb}d. You can hide it. {}",
            which()
        ))),
        [name] if !target.selection => Ok(name.clone()),
        _ => Err(Refusal::precondition(which())),
    }
}
