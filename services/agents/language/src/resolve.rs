//! From what was understood to what is done: a clause against the scene as it stands.
//!
//! | reference | stands for |
//! | --- | --- |
//! | names | units of these names: exactly, else without regard to case, else word by word in any inflection |
//! | focus | the units last addressed, else the selection |
//! | complement of nothing | all but the units last addressed, else all but the selection |

use std::fmt::Write as _;

use sg_proto::bus::Code;
use sg_proto::language::{Act, Clause, Reference};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::render::Frame;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    Color, DeleteUnit, Redo, RenameUnit, Reset, SaveUnit, Select, SetBackground, SetColor, SetLight, SetOpacity,
    SetOperation, SetTerm, SetView, SetVisibility, ShadingTerm, ShowOnly, State, Target, Undo, Vector, set_view,
};

use crate::unit_names::{self, Lookup};
use crate::{grammar, query};

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
    fn new(code: Code, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), details: Vec::new() }
    }

    fn precondition(message: impl Into<String>) -> Self {
        Self::new(Code::FailedPrecondition, message)
    }

    fn invalid(message: impl Into<String>) -> Self {
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

fn selected(state: &State) -> u64 {
    state.selection.as_ref().map_or(0, |s| s.count)
}

fn need_selection(state: &State) -> Result<(), Refusal> {
    if selected(state) > 0 {
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
    (selected(state) > 0).then(|| Target { selection: true, ..Target::default() })
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

fn target_of(clause: &Clause, state: &State) -> Result<Target, Refusal> {
    let nothing = Reference::default();
    target(clause.target.as_ref().unwrap_or(&nothing), state)
}

fn color_of(color: Option<&Color>) -> Result<Option<Color>, Refusal> {
    match color {
        None => Ok(None),
        Some(c) if [c.red, c.green, c.blue].iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Some(*c)),
        Some(_) => Err(Refusal::new(Code::OutOfRange, "A colour has three numbers from 0 to 1.")),
    }
}

fn missing(what: &str) -> Refusal {
    Refusal::invalid(format!("The clause names no {what}."))
}

fn number(clause: &Clause, what: &str) -> Result<f64, Refusal> {
    let value = clause.amount.ok_or_else(|| missing(what))?;
    if value.is_finite() && (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err(Refusal::new(Code::OutOfRange, format!("{value} is no {what}; say a number from 0 to 1000000.")))
    }
}

fn count(clause: &Clause) -> Result<u32, Refusal> {
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

/// Resolves a clause against the newest state of the scene. `frame` is the picture that was looked at last, for
/// questions; it is used only where it shows the same revision.
///
/// # Errors
/// [`Refusal`]: a line for a person and a code for programs.
pub fn resolve(clause: &Clause, state: &State, frame: Option<&Frame>) -> Result<Step, Refusal> {
    let frame = frame.filter(|f| f.revision == state.revision);
    let whole = |action| Ok(Step::Change { action, units: Vec::new() });
    let about = |target: Target, action: fn(Target) -> Action| {
        let units = target.units.clone();
        Ok(Step::Change { action: action(target), units })
    };
    match clause.act() {
        Act::Unspecified => Err(Refusal::invalid("The clause does not say what to do.")),
        Act::SetColor => {
            let target = target_of(clause, state)?;
            let units = target.units.clone();
            let color = color_of(clause.color.as_ref())?;
            Ok(Step::Change { action: Action::SetColor(SetColor { target: Some(target), color }), units })
        }
        Act::SetOpacity => {
            let target = target_of(clause, state)?;
            let units = target.units.clone();
            let factor = number(clause, "opacity")? as f32;
            let set = SetOpacity { target: Some(target), factor, relative: clause.relative };
            Ok(Step::Change { action: Action::SetOpacity(set), units })
        }
        Act::Show => about(target_of(clause, state)?, |t| {
            Action::SetVisibility(SetVisibility { target: Some(t), visible: true })
        }),
        Act::Hide => about(target_of(clause, state)?, |t| {
            Action::SetVisibility(SetVisibility { target: Some(t), visible: false })
        }),
        Act::ShowOnly => about(target_of(clause, state)?, |t| Action::ShowOnly(ShowOnly { target: Some(t) })),
        Act::SetLight => {
            let light = clause.light.ok_or_else(|| missing("light"))?;
            whole(Action::SetLight(checked_light(light)?))
        }
        Act::SetBackground => {
            let color = color_of(clause.color.as_ref())?.ok_or_else(|| missing("colour"))?;
            whole(Action::SetBackground(SetBackground { color: Some(color) }))
        }
        Act::SetView => view(clause, state),
        Act::SetTerm => match clause.term() {
            ShadingTerm::Unspecified => Err(missing("part of the shading")),
            term => whole(Action::SetTerm(SetTerm { term: term.into() })),
        },
        Act::Select => {
            let target = target_of(clause, state)?;
            let operation = clause.operation();
            if matches!(operation, SetOperation::Remove | SetOperation::Intersect) {
                need_selection(state)?;
            }
            let units = target.units.clone();
            let select = Select { target: Some(target), operation: operation.into() };
            Ok(Step::Change { action: Action::Select(select), units })
        }
        Act::ClearSelection if selected(state) == 0 => {
            Ok(Step::Answer { text: "Nothing was selected.".to_owned(), units: Vec::new() })
        }
        Act::ClearSelection => {
            let select = Select { target: None, operation: SetOperation::Replace.into() };
            whole(Action::Select(select))
        }
        Act::Label => label(clause, state),
        Act::Rename => rename(clause, state),
        Act::Delete => delete(clause, state),
        Act::Undo if state.undo.is_empty() => Err(Refusal::precondition("There is nothing to take back.")),
        Act::Undo => whole(Action::Undo(Undo { steps: count(clause)? })),
        Act::Redo if state.redo.is_empty() => Err(Refusal::precondition("There is nothing to bring back.")),
        Act::Redo => whole(Action::Redo(Redo { steps: count(clause)? })),
        Act::Reset => whole(Action::Reset(Reset {})),
        Act::List => Ok(Step::Answer { text: query::list(state, frame), units: Vec::new() }),
        Act::Describe => describe(clause, state, frame),
        Act::QuerySelection => Ok(Step::Answer { text: query::selection(state), units: Vec::new() }),
        Act::Help => Ok(Step::Answer { text: grammar::help(&unit_names::addressable(state)), units: Vec::new() }),
    }
}

fn checked_light(light: SetLight) -> Result<SetLight, Refusal> {
    let numbers = [light.ambient, light.diffuse, light.specular, light.shininess];
    let direction = light.direction.is_none_or(|Vector { x, y, z }| {
        let length = x * x + y * y + z * z;
        length.is_finite() && length > 0.0
    });
    if numbers.iter().flatten().all(|v| v.is_finite() && *v >= 0.0) && direction {
        Ok(light)
    } else {
        Err(Refusal::new(Code::OutOfRange, "Light is set by numbers from 0 up and a direction that is not zero."))
    }
}

fn view(clause: &Clause, state: &State) -> Result<Step, Refusal> {
    let view = clause.view.as_ref().and_then(|v| v.change.as_ref()).ok_or_else(|| missing("view"))?;
    let set = |change| Action::SetView(SetView { change: Some(change) });
    match view {
        set_view::Change::Focus(_) => {
            let target = target_of(clause, state)?;
            let units = target.units.clone();
            Ok(Step::Change { action: set(set_view::Change::Focus(target)), units })
        }
        set_view::Change::Zoom(factor) if !(factor.is_finite() && *factor > 0.0) => {
            Err(Refusal::new(Code::OutOfRange, format!("{factor} is no zoom; say a number above 0.")))
        }
        change => Ok(Step::Change { action: set(change.clone()), units: Vec::new() }),
    }
}

fn checked_name(clause: &Clause) -> Result<String, Refusal> {
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
fn is_base(name: &str, state: &State) -> bool {
    state.base_units.iter().any(|u| u.name == name)
}

fn label(clause: &Clause, state: &State) -> Result<Step, Refusal> {
    need_selection(state)?;
    let spoken = checked_name(clause)?;
    let replace = clause.operation() == SetOperation::Replace;
    let name = if replace {
        // What is updated must be there, under whatever spelling it was spoken.
        unit(&spoken, state)?.to_owned()
    } else {
        // A unit made by a command yields its name to one that a person gives.
        match unit_names::lookup(&spoken, &unit_names::addressable(state)) {
            Lookup::Missing(_) => spoken,
            Lookup::Unique(name) if !is_base(name, state) => {
                return Err(Refusal::new(
                    Code::AlreadyExists,
                    format!(
                        "A unit is called “{name}” already. Say “update the {name}” to put the selection in its place, or choose another name."
                    ),
                ));
            }
            Lookup::Unique(_) | Lookup::Ambiguous(_) => {
                return Err(Refusal::new(
                    Code::AlreadyExists,
                    format!("A unit is called “{spoken}” already; choose another name."),
                ));
            }
        }
    };
    if is_base(&name, state) {
        return Err(Refusal::precondition(format!(
            "“{name}” is part of the scene file and stays what it is; save the selection under another name."
        )));
    }
    let save = SaveUnit { name: name.clone(), replace };
    Ok(Step::Change { action: Action::SaveUnit(save), units: vec![name] })
}

/// The one editable unit that a clause is about.
fn editable(clause: &Clause, state: &State, verb: &str) -> Result<String, Refusal> {
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
        [name] if is_base(name, state) => Err(Refusal::precondition(format!(
            "“{name}” is part of the scene file and cannot be {verb}d; it can be hidden. {}",
            which()
        ))),
        [name] if !target.selection => Ok(name.clone()),
        _ => Err(Refusal::precondition(which())),
    }
}

fn rename(clause: &Clause, state: &State) -> Result<Step, Refusal> {
    let name = editable(clause, state, "rename")?;
    let new_name = checked_name(clause)?;
    if let Lookup::Unique(other) = unit_names::lookup(&new_name, &unit_names::addressable(state))
        && other != name
    {
        return Err(Refusal::new(
            Code::AlreadyExists,
            format!("A unit is called “{other}” already; choose another name."),
        ));
    }
    let units = vec![new_name.clone()];
    Ok(Step::Change { action: Action::RenameUnit(RenameUnit { name, new_name }), units })
}

fn delete(clause: &Clause, state: &State) -> Result<Step, Refusal> {
    let name = editable(clause, state, "delete")?;
    Ok(Step::Change { action: Action::DeleteUnit(DeleteUnit { name: name.clone() }), units: vec![name] })
}

fn describe(clause: &Clause, state: &State, frame: Option<&Frame>) -> Result<Step, Refusal> {
    let reference = clause.target.clone().unwrap_or(Reference { everything: true, ..Reference::default() });
    if reference.everything {
        return Ok(Step::Answer { text: query::scene(state, frame), units: Vec::new() });
    }
    if reference.complement {
        return Ok(Step::Answer { text: query::list(state, frame), units: Vec::new() });
    }
    let target = target(&reference, state)?;
    let mut parts: Vec<String> = target.units.iter().filter_map(|name| query::unit(name, state, frame)).collect();
    if target.selection {
        parts.push(query::selection(state));
    }
    Ok(Step::Answer { text: parts.join("\n"), units: target.units })
}
