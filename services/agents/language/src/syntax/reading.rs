//! The result of parsing one clause.

use sg_proto::language::{Act, Clause, Reference};
use sg_proto::scene::{SetView, set_view};

use super::target::Target;

/// The beginning of a clause: its act and the phrase that was matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Verb {
    /// The act.
    pub(crate) act: Act,
    /// The matched phrase; empty for a clause without a verb.
    pub(crate) phrase: &'static str,
}

/// Properties that have a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Property {
    /// Colour.
    Color,
    /// Opacity.
    Opacity,
    /// One minus opacity.
    Transparency,
}

/// What a clause was read as.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reading {
    /// Mostly one clause; several where one verb has several objects that are acted on one by one.
    pub(crate) clauses: Vec<Clause>,
    /// Names in it that the scene does not have.
    pub(crate) unknown: usize,
    /// The property it names, which the next clause may leave out.
    pub(crate) property: Option<Property>,
}

impl Reading {
    pub(crate) fn of(act: Act, target: Target) -> Self {
        let clause = clause(act, target.reference);
        Self { clauses: vec![clause], unknown: target.unknown, property: None }
    }

    pub(crate) fn plain(act: Act) -> Self {
        Self::of(act, Target::default())
    }

    /// A change of the viewpoint.
    pub(crate) fn view(change: set_view::Change) -> Self {
        let view = SetView { change: Some(change) };
        Self::plain(Act::SetView).map(|c| c.view = Some(view.clone()))
    }

    pub(crate) fn map(mut self, change: impl Fn(&mut Clause)) -> Self {
        self.clauses.iter_mut().for_each(change);
        self
    }
}

/// A clause about something.
pub(crate) fn clause(act: Act, target: Reference) -> Clause {
    let target = (target != Reference::default()).then_some(target);
    Clause { act: act.into(), target, ..Clause::default() }
}
