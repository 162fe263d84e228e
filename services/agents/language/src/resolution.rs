//! From what was understood to what is done: a clause against the scene as it stands.
//!
//! | reference | stands for |
//! | --- | --- |
//! | names | units of these names: exactly, else without regard to case, else word by word in any inflection |
//! | focus | the units last addressed, else the selection |
//! | complement of nothing | all but the units last addressed, else all but the selection |

use std::fmt::Write as _;

use sg_proto::bus::Code;
use sg_proto::language::{Clause, Reference};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, State, Target};

use crate::unit_names::{self, Lookup};

/// A clause that does not fit the scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    /// What kind of refusal.
    pub code: Code,
    /// One line for a person: what, and what to do.
    pub message: String,
    /// Further facts: the names that there are.
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

/// What is to be done for one clause.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// The scene is to be changed.
    Change {
        /// How.
        action: Action,
        /// Names of the units it is about, as they stand in the scene.
        units: Vec<String>,
    },
    /// A question, and its answer.
    Answer {
        /// The answer, for a person.
        text: String,
        /// Names of the units it is about.
        units: Vec<String>,
    },
}

impl Step {
    /// A change that is not about units.
    pub(crate) fn scene_wide(action: Action) -> Self {
        Self::Change { action, units: Vec::new() }
    }
}

/// How many names a message lists.
const LISTED_NAMES: usize = 12;

fn listed(state: &State) -> String {
    let names = unit_names::addressable(state);
    let shown = names.iter().take(LISTED_NAMES).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "none".to_owned(),
        n if n > LISTED_NAMES => format!("{shown} and {} more", n - LISTED_NAMES),
        _ => shown,
    }
}

/// The unit that a spoken name means.
///
/// # Errors
/// `NotFound` with near misses, `InvalidArgument` where several fit.
pub fn unit<'s>(spoken: &str, state: &'s State) -> Result<&'s str, Refusal> {
    match unit_names::lookup(spoken, &unit_names::all(state)) {
        Lookup::Unique(name) => Ok(name),
        Lookup::Ambiguous(names) => {
            let names: Vec<String> = names.iter().map(|n| format!("“{n}”")).collect();
            Err(Refusal::invalid(format!(
                "“{spoken}” could be {}; say it exactly, in quotation marks.",
                names.join(" or ")
            )))
        }
        Lookup::Missing(near) => {
            let mut message = format!("No unit is called “{spoken}”.");
            if !near.is_empty() {
                let near: Vec<String> = near.iter().map(|n| format!("“{n}”")).collect();
                let _ = write!(message, " Did you mean {}?", near.join(" or "));
            }
            let _ = write!(message, " Units: {}.", listed(state));
            let details = unit_names::addressable(state).into_iter().map(str::to_owned).collect();
            Err(Refusal { code: Code::NotFound, message, details })
        }
    }
}

pub(crate) fn selected_count(state: &State) -> u64 {
    state.selection.as_ref().map_or(0, |s| s.count)
}

pub(crate) fn need_selection(state: &State) -> Result<(), Refusal> {
    if selected_count(state) > 0 {
        return Ok(());
    }
    let example =
        unit_names::addressable(state).first().map_or(String::new(), |name| format!(" or say “select the {name}”"));
    Err(Refusal::precondition(format!("Nothing is selected. Brush a structure{example} first.")))
}

/// What "it" means: the units last addressed that are still there, else the selection.
fn focus(state: &State) -> Option<Target> {
    let names = unit_names::all(state);
    let units: Vec<String> = state.focus.iter().filter(|f| names.contains(&f.as_str())).cloned().collect();
    if !units.is_empty() {
        return Some(Target { units, ..Target::default() });
    }
    (selected_count(state) > 0).then(|| Target { selection: true, ..Target::default() })
}

/// What a reference means in a scene.
///
/// # Errors
/// `NotFound`, `InvalidArgument` as [`unit()`]; `FailedPrecondition` where it leans on a selection or on something said
/// before and there is none.
pub fn target(reference: &Reference, state: &State) -> Result<Target, Refusal> {
    let nothing_said = |what: &str| {
        Refusal::precondition(format!(
            "Nothing was spoken of before, so “{what}” means nothing yet. Units: {}.",
            listed(state)
        ))
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
    let leans = reference.focus
        || (reference.complement && reference.names.is_empty() && !reference.selection && !reference.everything);
    if leans {
        let what = if reference.complement { "everything else" } else { "it" };
        let before = focus(state).ok_or_else(|| nothing_said(what))?;
        target.selection |= before.selection;
        for name in before.units {
            if !target.units.contains(&name) {
                target.units.push(name);
            }
        }
    }
    if target.units.is_empty() && !target.selection && !target.everything {
        return Err(Refusal::invalid(format!("Say what it is about. Units: {}.", listed(state))));
    }
    Ok(target)
}

pub(crate) fn target_of(clause: &Clause, state: &State) -> Result<Target, Refusal> {
    let nothing = Reference::default();
    target(clause.target.as_ref().unwrap_or(&nothing), state)
}

pub(crate) fn color_of(color: Option<&Color>) -> Result<Option<Color>, Refusal> {
    match color {
        None => Ok(None),
        Some(c) if [c.red, c.green, c.blue].iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Some(*c)),
        Some(_) => Err(Refusal::new(Code::OutOfRange, "A colour has three numbers from 0 to 1.")),
    }
}

pub(crate) fn missing(what: &str) -> Refusal {
    Refusal::invalid(format!("The clause names no {what}."))
}

pub(crate) fn number(clause: &Clause, what: &str) -> Result<f64, Refusal> {
    let value = clause.amount.ok_or_else(|| missing(what))?;
    if value.is_finite() && (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err(Refusal::new(Code::OutOfRange, format!("{value} is no {what}; say a number from 0 to 1000000.")))
    }
}

pub(crate) fn step_count(clause: &Clause) -> Result<u32, Refusal> {
    let value = clause.amount.unwrap_or(1.0);
    if value.fract() == 0.0 && (1.0..=1000.0).contains(&value) {
        Ok(value as u32)
    } else {
        Err(Refusal::new(
            Code::OutOfRange,
            format!("{value} steps cannot be taken; say a whole number from 1 to 1000."),
        ))
    }
}

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

/// Whether a name belongs to a base unit.
pub(crate) fn is_base_unit(name: &str, state: &State) -> bool {
    state.base_units.iter().any(|u| u.name == name)
}

/// The one editable unit that a clause is about.
pub(crate) fn editable_unit(clause: &Clause, state: &State, verb: &str) -> Result<String, Refusal> {
    let reference = clause.target.clone().unwrap_or_default();
    let saved: Vec<&str> = state.units.iter().map(|u| u.name.as_str()).collect();
    let which = || {
        let names = if saved.is_empty() { "none yet".to_owned() } else { saved.join(", ") };
        format!("Say by name which unit to {verb}. Saved units: {names}.")
    };
    if reference.everything || reference.complement {
        return Err(Refusal::precondition(format!("Units are named one at a time here. {}", which())));
    }
    if reference.selection {
        return Err(Refusal::precondition(format!("The selection is not a unit. {}", which())));
    }
    let target = target(&reference, state)?;
    match target.units.as_slice() {
        [name] if is_base_unit(name, state) => Err(Refusal::precondition(format!(
            "“{name}” is part of the scene file and cannot be {verb}d; it can be hidden. {}",
            which()
        ))),
        [name] if !target.selection => Ok(name.clone()),
        _ => Err(Refusal::precondition(which())),
    }
}
