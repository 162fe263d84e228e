//! Saturation, brightness and temperature of a target.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetTone, State, Target};

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::opacity::term_change;
use super::verbs::{DECREASE, INCREASE, MAKE, SET};
use crate::property::assignment::{becoming, property, restoring};
use crate::property::tone::Term;
use crate::property::value::{Value, assign};
use crate::resolution::{Refusal, Step, missing, target_of};
use crate::syntax::phrase::{Input, Outcome, end};
use crate::syntax::reading::Reading;
use crate::syntax::target::target_then;
use crate::text::{capital, factor, join, percent, target};

/// The command "saturation".
pub(super) const SET_TONE: Command = Command {
    act: Act::SetTone,
    title: "saturation",
    constructs: &[
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
        Construct::with_ellipsis(SET, Ellipsis::PropertyOrValue, property),
        Construct::with_ellipsis(INCREASE, Ellipsis::Verb, |verb, input| term_change(verb, true, input)),
        Construct::with_ellipsis(DECREASE, Ellipsis::Verb, |verb, input| term_change(verb, false, input)),
        Construct::with_ellipsis("desaturate", Ellipsis::Verb, |_, input| verb(0.0, false, input)),
        Construct::with_ellipsis("saturate", Ellipsis::Verb, |_, input| verb(1.5, true, input)),
        Construct::new("reset | restore | bring back", restoring),
    ],
    examples: &[
        "make the {unit} less saturated",
        "set the saturation of the {unit} to 50 %",
        "make the {unit} brighter",
        "make the {unit} warmer",
        "desaturate the {unit}",
        "reset the saturation of the {unit}",
    ],
    fields: &[Field::required("target"), Field::required("tone")],
    effect: Effect::Coverage,
    resolve,
};

fn verb(value: f64, relative: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| end(rest))?;
    assign(target, Value::Tone(Term::Saturation.set(value, relative)))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let tone = clause.tone.as_ref().ok_or_else(|| missing("saturation, brightness or temperature"))?;
    let SetTone { saturation, brightness, temperature, relative, .. } = *tone;
    if saturation.is_none() && brightness.is_none() && temperature.is_none() {
        return Err(missing("saturation, brightness or temperature"));
    }
    let beyond = |factor: Option<f32>| factor.is_some_and(|f| !(0.0..=4.0).contains(&f));
    for (name, wrong) in [("Saturation", beyond(saturation)), ("Brightness", beyond(brightness))] {
        if wrong {
            return Err(Refusal::invalid(format!("{name} goes from 0 to 400 %, and 100 % is as in the file.")));
        }
    }
    if temperature.is_some_and(|t| !(-1.0..=1.0).contains(&t)) {
        return Err(Refusal::invalid("The temperature goes from -1 (blue) to 1 (red), and 0 is as in the file."));
    }
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    let set = SetTone { target: Some(target), saturation, brightness, temperature, relative };
    Ok(Step::Change { action: Action::SetTone(set), units })
}

/// One sentence about a changed tone. `before` is the scene before the command.
pub(crate) fn report(set: &SetTone, before: &State) -> String {
    let nothing = Target::default();
    let of = set.target.as_ref().unwrap_or(&nothing);
    let (what, plural) = target(of);
    // The new value of a change is known only for a single unit.
    let present = match (of.units.as_slice(), of.complement, of.selection) {
        ([name], false, false) => {
            let base = before.base_units.iter().find(|u| u.name == *name).map(|u| u.tone);
            let tone = base.or_else(|| before.units.iter().find(|u| u.name == *name).map(|u| u.tone));
            tone.map(|t| t.map_or((1.0, 1.0, 0.0), |t| (t.saturation, t.brightness, t.temperature)))
        }
        _ => None,
    };
    let mut parts = Vec::new();
    let factors =
        [("saturation", set.saturation, present.map(|p| p.0)), ("brightness", set.brightness, present.map(|p| p.1))];
    for (name, value, present) in factors {
        let Some(value) = value else { continue };
        parts.push(match (set.relative, present) {
            (false, _) => format!("{} {name}", percent(value.into())),
            (true, Some(present)) => format!("{} {name}", percent(f64::from((present * value).clamp(0.0, 4.0)))),
            (true, None) => format!("{} times the {name}", factor(value.into())),
        });
    }
    if let Some(value) = set.temperature {
        parts.push(match (set.relative, present) {
            (false, _) => format!("temperature {}", factor(value.into())),
            (true, Some((_, _, present))) => {
                format!("temperature {}", factor(f64::from((present + value).clamp(-1.0, 1.0))))
            }
            (true, None) if value > 0.0 => "warmer colours".to_owned(),
            (true, None) => "cooler colours".to_owned(),
        });
    }
    let has = if plural { "have" } else { "has" };
    format!("{} now {has} {}.", capital(&what), join(&parts))
}
