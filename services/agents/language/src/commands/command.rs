//! The form of a row in the table of commands.

use sg_proto::language::{Act, Clause};
use sg_proto::render::Frame;
use sg_proto::scene::State;

use crate::resolution::{Refusal, Step};
use crate::syntax::phrase::{Input, Outcome, end, items};
use crate::syntax::reading::{Reading, Verb};

/// Parses the rest of a clause after its opening phrase.
pub(crate) type ParseRest = for<'t> fn(Verb, &mut Input<'t>) -> Outcome<Reading>;

/// Turns a clause into a scene command or an answer.
pub(crate) type Resolve = fn(&Clause, &Context<'_>) -> Result<Step, Refusal>;

/// What a clause is resolved against.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'c> {
    /// The newest state of the scene.
    pub(crate) state: &'c State,
    /// The last frame, where it shows the same revision.
    pub(crate) frame: Option<&'c Frame>,
    /// The table of commands, for the help.
    pub(crate) table: &'static [Command],
}

/// One command in words: its phrases, its fields, its examples and its effect.
#[derive(Debug)]
pub(crate) struct Command {
    /// The act of its clauses.
    pub(crate) act: Act,
    /// Title in the help.
    pub(crate) title: &'static str,
    /// Phrases that begin it, each with the parser of the rest.
    pub(crate) constructs: &'static [Construct],
    /// Examples. `{unit}` and `{other}` stand for names of units. The help shows the first three.
    pub(crate) examples: &'static [&'static str],
    /// Fields of its clauses besides `act` and `words`, for the JSON schema.
    pub(crate) fields: &'static [Field],
    /// Its effect on the image.
    pub(crate) effect: Effect,
    /// Turns a clause into a scene command or an answer.
    pub(crate) resolve: Resolve,
}

/// Phrases that begin a clause, and the parser of the rest.
#[derive(Debug)]
pub(crate) struct Construct {
    /// Phrases separated by `|`. `(none)` stands for a clause without a verb.
    openings: &'static str,
    /// Parses the rest of the clause.
    pub(crate) parse: ParseRest,
    /// How the next clause may leave out words.
    pub(crate) ellipsis: Ellipsis,
}

impl Construct {
    /// A construct whose next clause has its own verb.
    pub(crate) const fn new(openings: &'static str, parse: ParseRest) -> Self {
        Self { openings, parse, ellipsis: Ellipsis::None }
    }

    /// A construct whose next clause may leave out words.
    pub(crate) const fn with_ellipsis(openings: &'static str, ellipsis: Ellipsis, parse: ParseRest) -> Self {
        Self { openings, parse, ellipsis }
    }

    /// The phrases one by one. A clause without a verb has the empty phrase.
    pub(crate) fn phrases(&self) -> impl Iterator<Item = &'static str> {
        items(self.openings).map(|phrase| if phrase == "(none)" { "" } else { phrase })
    }
}

/// Words that the next clause may leave out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ellipsis {
    /// None.
    None,
    /// The verb, before a known name: "hide the soil, and the pot".
    Verb,
    /// The verb, or all but the target: "fade the soil to 20 percent, and the pot to 50", "and the trunk too".
    VerbOrValue,
    /// The verb, the target, or all but the target: "make the sac red, and transparent".
    VerbTargetOrValue,
    /// The property, or all but the target: "set the opacity of the sac to 0.3, and that of the vessel to 0.5".
    PropertyOrValue,
}

/// Whether a field of a clause may be null in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Presence {
    /// Always present.
    Required,
    /// May be null.
    Optional,
    /// A count of steps; may be null.
    OptionalCount,
}

/// A field of a clause, by its name in the contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Field {
    /// Name in the contract.
    pub(crate) name: &'static str,
    /// Whether it may be null.
    pub(crate) presence: Presence,
}

impl Field {
    /// A field that is always present.
    pub(crate) const fn required(name: &'static str) -> Self {
        Self { name, presence: Presence::Required }
    }

    /// A field that may be null.
    pub(crate) const fn optional(name: &'static str) -> Self {
        Self { name, presence: Presence::Optional }
    }

    /// A count of steps that may be null.
    pub(crate) const fn optional_count(name: &'static str) -> Self {
        Self { name, presence: Presence::OptionalCount }
    }

    /// Whether it may be null.
    pub(crate) fn is_optional(self) -> bool {
        self.presence != Presence::Required
    }
}

/// The effect of a command on the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effect {
    /// The image stays the same.
    None,
    /// The image may change.
    Possible,
    /// The image should change.
    Visible,
    /// The image should change, and the reply reports the coverage of the unit.
    Coverage,
}

/// Parses a clause that its opening phrase says completely.
pub(crate) fn complete(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    Ok(Reading::plain(verb.act))
}
