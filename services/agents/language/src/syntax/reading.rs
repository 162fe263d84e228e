//! The result of parsing one clause.

use sg_proto::language::movement::Kind;
use sg_proto::language::{Act, Clause, Movement, Reference};
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

/// Named properties.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Property {
    /// Colour.
    Color,
    /// Opacity.
    Opacity,
    /// Transparency: one minus opacity.
    Transparency,
    /// Saturation of a unit's colours.
    Saturation,
    /// Brightness of a unit's colours.
    Brightness,
    /// Temperature of a unit's colours.
    Temperature,
}

/// A parsed clause.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reading {
    /// One clause, or one for each object of the verb.
    pub(crate) clauses: Vec<Clause>,
    /// Number of unknown names.
    pub(crate) unknown: usize,
    /// The named property, which the next clause may leave out.
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

    /// A movement.
    pub(crate) fn movement(target: Target, kind: Kind) -> Self {
        Self::of(Act::Transform, target).map(|c| c.movement = Some(Movement { kind: Some(kind) }))
    }

    pub(crate) fn map(mut self, change: impl Fn(&mut Clause)) -> Self {
        self.clauses.iter_mut().for_each(change);
        self
    }
}

/// A clause with a target.
pub(crate) fn clause(act: Act, target: Reference) -> Clause {
    let target = (target != Reference::default()).then_some(target);
    Clause { act: act.into(), target, ..Clause::default() }
}
