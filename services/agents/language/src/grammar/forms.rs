//! What follows a clause's beginning, form by form.

mod becomes;
mod light;
mod look;
mod opacity;
mod units;
mod view;

use sg_proto::language::{Act, Clause, Reference};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::phrase::{Input, Outcome, Quantity, exactly, mark, one_of, phrase, quantity};
use super::table::Form;
use super::target::Target;

pub(super) use becomes::Property;
pub(super) use look::{continued, same_property};

/// What a clause was read as.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reading {
    /// Mostly one clause; several where one verb has several objects that are acted on one by one.
    pub(super) clauses: Vec<Clause>,
    /// Names in it that the scene does not have.
    pub(super) unknown: usize,
    /// The property it names, which the next clause may leave out.
    pub(super) property: Option<Property>,
}

impl Reading {
    fn of(act: Act, target: Target) -> Self {
        let clause = clause(act, target.reference);
        Self { clauses: vec![clause], unknown: target.unknown, property: None }
    }

    fn plain(act: Act) -> Self {
        Self::of(act, Target::default())
    }

    fn map(mut self, change: impl Fn(&mut Clause)) -> Self {
        self.clauses.iter_mut().for_each(change);
        self
    }
}

/// A clause about something.
fn clause(act: Act, target: Reference) -> Clause {
    let target = (target != Reference::default()).then_some(target);
    Clause { act: act.into(), target, ..Clause::default() }
}

/// Reads what follows `opening`, up to the end of the clause.
pub(super) fn read(form: Form, act: Act, opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    match form {
        Form::Becoming => look::becoming(input),
        Form::Property => look::property(input),
        Form::Restoring => look::restoring(input),
        Form::Fading => opacity::fading(opening, input),
        Form::Raising => opacity::opacity_change(opening, true, input),
        Form::Lowering => opacity::opacity_change(opening, false, input),
        Form::Target => look::target(opening, act, input),
        Form::Switching => look::switching(opening, input),
        Form::TargetAlone => look::alone(input),
        Form::Background => look::background(input),
        Form::Term => look::term(opening, input),
        Form::LightWords => light::words(input),
        Form::LightProperty => light::property(input),
        Form::LightFrom => light::from(input),
        Form::LightUp => light::change(opening, true, input),
        Form::LightDown => light::change(opening, false, input),
        Form::Side => view::side(opening, input),
        Form::LookAt => view::look_at(opening, input),
        Form::Turn => view::turn(opening, input),
        Form::ZoomIn => view::zoom(true, input),
        Form::ZoomOut => view::zoom(false, input),
        Form::ZoomTo => view::zoom_to(input),
        Form::Selecting => units::selecting(opening, input),
        Form::Unselecting => units::unselecting(opening, input),
        Form::Intersecting => units::intersecting(input),
        Form::Naming => units::naming(opening, input),
        Form::NameOnly => units::name_only(input),
        Form::Renaming => units::renaming(opening, input),
        Form::Updating => units::updating(opening, input),
        Form::Deleting => units::deleting(opening, input),
        Form::Subject => units::subject(input),
        Form::Asking => units::asking(input),
        Form::Steps => units::steps(act, opening, input),
        Form::Nothing => units::nothing(act, input),
    }
}

/// How strongly something was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Degree {
    Slight,
    Plain,
    Much,
}

impl Degree {
    /// The value of three that belongs to it.
    fn pick(self, slight: f64, plain: f64, much: f64) -> f64 {
        match self {
            Self::Slight => slight,
            Self::Plain => plain,
            Self::Much => much,
        }
    }
}

const SLIGHTLY: &str = "a bit | a little | a little bit | a tiny bit | slightly | somewhat | a touch | a notch";
const MUCH: &str = "much | a lot | lots | far | way | considerably | significantly | strongly | a good deal | \
     even much";

/// "a bit", "much", or nothing.
fn degree(input: &mut Input<'_>) -> Outcome<Degree> {
    alt((
        one_of(SLIGHTLY).map(|_| Degree::Slight),
        one_of(MUCH).map(|_| Degree::Much),
        opt(exactly("even | still")).map(|_| Degree::Plain),
    ))
    .parse_next(input)
}

/// Words between a property and its value.
fn connector(input: &mut Input<'_>) -> Outcome<()> {
    opt(alt((
        one_of(
            "to | at | as | be | to be | should be | must be | equal to | back to | down to | up to | \
         of | is",
        )
        .void(),
        mark('=').void(),
        mark(':').void(),
    )))
    .void()
    .parse_next(input)
}

/// A factor by which something grows or shrinks: "by 20 percent", "by half", "by a factor of 2", "two times".
fn factor_by(grows: bool, input: &mut Input<'_>) -> Outcome<f64> {
    phrase("by").parse_next(input)?;
    let factor = opt(one_of("a factor of | a factor")).parse_next(input)?;
    let amount: Quantity = quantity(input)?;
    let value = match (factor, amount.share, grows) {
        (Some(_), _, true) => amount.value,
        (Some(_), _, false) => 1.0 / amount.value,
        (None, true, true) => 1.0 + amount.value,
        (None, true, false) => 1.0 - amount.value,
        // A bare number above 1 is percent; one below could as well be added as multiplied, so it is not guessed at.
        (None, false, true) if amount.value > 1.0 => 1.0 + amount.value / 100.0,
        (None, false, false) if amount.value > 1.0 => 1.0 - amount.value / 100.0,
        _ => return Err(EmptyError),
    };
    if value.is_finite() && (0.0..=1000.0).contains(&value) { Ok(value) } else { Err(EmptyError) }
}
