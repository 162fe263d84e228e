//! Refusals of commands. A refused command changes nothing and is not stored.

use sg_proto::bus::Code;
use sg_reclassify::ReclassifyError;

use sg_scene::view::ViewError;
use sg_volume::AdjustError;

/// A command that does not fit the scene or makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EditError {
    /// No unit has this name.
    #[error("there is no unit `{name}`{}", hint(near))]
    UnknownUnit {
        /// As requested.
        name: String,
        /// Names that are close to it, closest first; all names where none is close.
        near: Vec<String>,
    },
    /// More than one unit has this name, in different capitals.
    #[error("`{name}` matches {}; write it with the exact capitals", meant.join(" or "))]
    Ambiguous {
        /// As requested.
        name: String,
        /// The matching names.
        meant: Vec<String>,
    },
    /// No kept viewpoint has this name.
    #[error("no view is kept as `{name}`{}", view_hint(kept))]
    UnknownView {
        /// As requested.
        name: String,
        /// Names of the kept viewpoints.
        kept: Vec<String>,
    },
    /// A new unit has the name of another.
    #[error("a unit `{0}` exists already; choose another name or replace it")]
    NameTaken(String),
    /// Base units cannot be changed like this.
    #[error("`{name}` is a base unit of the file and cannot be {verb}; {remedy}")]
    BaseUnit {
        /// Its name.
        name: String,
        /// The refused change, as a participle.
        verb: &'static str,
        /// The remedy.
        remedy: &'static str,
    },
    /// The command needs a selection.
    #[error("nothing is selected; brush or select something first")]
    NothingSelected,
    /// The target names nothing.
    #[error("the command has no target; name units, the selection or everything")]
    NoTarget,
    /// The target has no Gaussians.
    #[error("{0} has no Gaussians; there is nothing to act on")]
    EmptyTarget(String),
    /// There is nothing visible to look at.
    #[error("{0} has no visible Gaussian at a finite position; there is nothing to look at")]
    NothingToSee(String),
    /// The command would change Gaussians of a locked unit, or the unit.
    #[error("`{0}` is locked; unlock it first")]
    Locked(String),
    /// No Gaussian is deleted.
    #[error("nothing is deleted; there is nothing to restore")]
    NothingDeleted,
    /// There is no earlier state.
    #[error("there is nothing to undo")]
    NothingToUndo,
    /// There is no later state.
    #[error("there is nothing to redo")]
    NothingToRedo,
    /// The scene is not at the sender's revision.
    #[error("the scene is at revision {found}, not {expected}; read it again and repeat the command")]
    RevisionConflict {
        /// The sender's revision.
        expected: u64,
        /// The scene's revision.
        found: u64,
    },
    /// An accepted command with other content has this id.
    #[error("the id `{0}` belongs to another command; a new change needs a new id")]
    IdTaken(String),
    /// The selection is not the one that the new one was made from.
    #[error("the selection changed meanwhile; start again from the present one")]
    SelectionConflict {
        /// Hash of the present selection.
        found: String,
    },
    /// A number is NaN or infinite.
    #[error("`{field}` is {found}; it must be a finite number")]
    NotFinite {
        /// The field of the command.
        field: &'static str,
        /// The finding.
        found: f64,
    },
    /// A number lies outside its range.
    #[error("`{field}` is {found}; it must be {want}")]
    OutOfRange {
        /// The field of the command.
        field: &'static str,
        /// The finding.
        found: f64,
        /// The accepted values.
        want: &'static str,
    },
    /// A viewpoint shows nothing.
    #[error("{0}")]
    View(#[from] ViewError),
    /// A field is missing or malformed.
    #[error("`{field}`: {reason}")]
    Malformed {
        /// The field of the command.
        field: &'static str,
        /// The cause and the accepted values.
        reason: String,
    },
    /// The scene cannot have another transfer function.
    #[error(transparent)]
    Reclassify(#[from] ReclassifyError),
    /// The present transfer function cannot be changed like this.
    #[error(transparent)]
    Adjust(#[from] AdjustError),
    /// There is no transfer function to change.
    #[error("the transfer function of the scene's file is unknown; set one first")]
    NoFunction,
    /// A limit on a number of things is reached.
    #[error("there would be more than {limit} {what}; {remedy}")]
    TooMany {
        /// The limited things, in the plural.
        what: &'static str,
        /// The limit.
        limit: usize,
        /// The remedy.
        remedy: &'static str,
    },
    /// The change, or all masks and strokes together, would not fit one message.
    #[error(
        "{what} would take {bytes} bytes, more than the {limit} of one message; change less at a time or delete units"
    )]
    TooLarge {
        /// The limited things, in the plural.
        what: &'static str,
        /// Size of the event.
        bytes: usize,
        /// Largest size.
        limit: usize,
    },
}

impl EditError {
    /// The canonical code of the refusal on the wire.
    #[must_use]
    pub fn code(&self) -> Code {
        match self {
            Self::UnknownUnit { .. } | Self::UnknownView { .. } => Code::NotFound,
            Self::NameTaken(_) | Self::IdTaken(_) => Code::AlreadyExists,
            Self::BaseUnit { .. }
            | Self::NothingSelected
            | Self::EmptyTarget(_)
            | Self::NothingToSee(_)
            | Self::Locked(_)
            | Self::NothingDeleted
            | Self::NothingToUndo
            | Self::NothingToRedo
            | Self::RevisionConflict { .. }
            | Self::SelectionConflict { .. }
            | Self::NoFunction
            | Self::Reclassify(_) => Code::FailedPrecondition,
            Self::OutOfRange { .. }
            | Self::Adjust(_)
            | Self::View(ViewError::Distance(_) | ViewError::FieldOfView(_)) => Code::OutOfRange,
            Self::Ambiguous { .. }
            | Self::NoTarget
            | Self::NotFinite { .. }
            | Self::View(_)
            | Self::Malformed { .. } => Code::InvalidArgument,
            Self::TooMany { .. } | Self::TooLarge { .. } => Code::ResourceExhausted,
        }
    }

    /// Facts for a program: valid names, the present revision or hash, or the id.
    #[must_use]
    pub fn details(&self) -> Vec<String> {
        match self {
            Self::UnknownUnit { near, .. } => near.clone(),
            Self::UnknownView { kept, .. } => kept.clone(),
            Self::Ambiguous { meant, .. } => meant.clone(),
            Self::RevisionConflict { found, .. } => vec![found.to_string()],
            Self::SelectionConflict { found } => vec![found.clone()],
            Self::IdTaken(id) => vec![id.clone()],
            _ => Vec::new(),
        }
    }
}

fn view_hint(kept: &[String]) -> String {
    if kept.is_empty() {
        return "; keep one first".to_owned();
    }
    let shown: Vec<_> = kept.iter().take(6).map(|n| format!("`{n}`")).collect();
    format!("; there are {}{}", shown.join(", "), if kept.len() > 6 { ", …" } else { "" })
}

fn hint(near: &[String]) -> String {
    match near {
        [] => "; the scene has no units".to_owned(),
        [one] => format!("; did you mean `{one}`?"),
        many => {
            let shown: Vec<_> = many.iter().take(6).map(|n| format!("`{n}`")).collect();
            format!("; there are {}{}", shown.join(", "), if many.len() > 6 { ", …" } else { "" })
        }
    }
}
