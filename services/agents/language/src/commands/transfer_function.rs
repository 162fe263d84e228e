//! The transfer function: level and window, shown, hidden and coloured values, scale.

use sg_input::number_format::{significant, values_between};
use sg_proto::language::{Act, Clause};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    AdjustTransferFunction, SetTransferFunction, State, ValueColor, ValueRange, ValueScale, ValueWindow,
};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field, complete};
use super::verbs::{DECREASE, INCREASE, MAKE, PAINT, SET, SHOW};
use crate::color;
use crate::property::values::{compared, stepped, term, value, values, window};
use crate::resolution::{Refusal, Step, color_of, missing};
use crate::syntax::phrase::{Input, Outcome, article, color as parse_color, end, exactly, items, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::text::capital;

const FIELDS: &[Field] = &[Field::required("values"), Field::optional("name"), Field::optional("color_name")];

/// The command "window and level".
pub(super) const WINDOW: Command = Command {
    act: Act::AdjustTransferFunction,
    title: "window and level",
    constructs: &[
        Construct::new(SET, set_window),
        Construct::new("show | show me | apply | try | go to | switch to | change to | display | i want", set_window),
        Construct::new(INCREASE, |_, input| step(true, input)),
        Construct::new(DECREASE, |_, input| step(false, input)),
        Construct::new("widen | broaden | expand", |_, input| step(true, input)),
        Construct::new("narrow | tighten", |_, input| step(false, input)),
    ],
    examples: &["level 300, window 1500", "bone window", "widen the window", "raise the level by 100"],
    fields: FIELDS,
    effect: Effect::Possible,
    resolve,
};

/// The command "values".
pub(super) const VALUES: Command = Command {
    act: Act::AdjustTransferFunction,
    title: "values",
    constructs: &[
        Construct::new(SHOW, show),
        Construct::new("show only | show just | only show | just show | show me only | only | keep only | keep", show),
        Construct::new(
            "threshold | threshold at | set the threshold to | set a threshold of | set the threshold at",
            threshold,
        ),
        Construct::new(
            "hide | remove | cut | cut off | cut away | drop | discard | conceal | get rid of | clip | don't show | do not show",
            hide,
        ),
        Construct::new(MAKE, make),
        Construct::new(PAINT, make),
    ],
    examples: &["show values above 200", "hide values below 100", "make values between 200 and 300 red"],
    fields: FIELDS,
    effect: Effect::Possible,
    resolve,
};

/// The command "scale of values".
pub(super) const SCALE: Command = Command {
    act: Act::AdjustTransferFunction,
    title: "scale of values",
    constructs: &[Construct::new("use | set | switch to | change to | show | make | try | apply | (none)", scale)],
    examples: &["use a logarithmic scale of values"],
    fields: FIELDS,
    effect: Effect::Possible,
    resolve,
};

/// The command "transfer function of the file".
pub(super) const RESET_TRANSFER_FUNCTION: Command = Command {
    act: Act::ResetTransferFunction,
    title: "transfer function of the file",
    constructs: &[Construct::new(
        "reset the transfer function | restore the transfer function | reset the window | reset the level | \
             reset the window and level | reset window and level | reset the values | restore the window | \
             original transfer function | restore the original transfer function | use the original transfer function | \
             back to the original transfer function | go back to the original transfer function | \
             use the transfer function of the file | undo all changes of the transfer function | show all values | \
             show all values again | reset transfer function",
        complete,
    )],
    examples: &["reset the transfer function"],
    fields: &[],
    effect: Effect::Possible,
    resolve: resolve_reset,
};

/// A window of computed tomography by its name: level and window, Hounsfield units.
struct Preset {
    names: &'static str,
    level: f64,
    window: f64,
}

impl Preset {
    fn ends(&self) -> ValueWindow {
        ValueWindow { level: Some(self.level), window: Some(self.window), ..ValueWindow::default() }
    }
}

/// The usual windows of computed tomography.
const PRESETS: [Preset; 9] = [
    Preset { names: "bone", level: 400.0, window: 1800.0 },
    Preset { names: "lung | lungs", level: -600.0, window: 1500.0 },
    Preset { names: "brain", level: 40.0, window: 80.0 },
    Preset { names: "soft tissue", level: 50.0, window: 400.0 },
    Preset { names: "abdomen | abdominal", level: 50.0, window: 400.0 },
    Preset { names: "mediastinum | mediastinal", level: 50.0, window: 350.0 },
    Preset { names: "liver", level: 30.0, window: 150.0 },
    Preset { names: "stroke", level: 40.0, window: 40.0 },
    Preset { names: "temporal bone", level: 600.0, window: 2800.0 },
];

/// A volume with values in Hounsfield units has some below this one: air is at -1,000.
const LEAST_OF_AIR: f64 = -500.0;

fn adjust(change: Change) -> Reading {
    let values = AdjustTransferFunction { change: Some(change) };
    Reading::plain(Act::AdjustTransferFunction).map(|c| c.values = Some(values))
}

/// Parses "level 300, window 1500", "the bone window", "a wider window".
fn set_window(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let changed = alt((compared, window)).map(|found| adjust(Change::Window(found)));
    alt((preset, changed)).parse_next(input)
}

/// Parses "the bone window", "a CT lung window".
fn preset(input: &mut Input<'_>) -> Outcome<Reading> {
    skip("the ct | a ct | ct").parse_next(input)?;
    article(input)?;
    let (name, preset) = preset_name(input)?;
    one_of("window | windowing | window setting | window settings | window preset | preset | ct window")
        .parse_next(input)?;
    end(input)?;
    Ok(adjust(Change::Window(preset.ends())).map(|c| c.name = format!("{name} window")))
}

fn preset_name(input: &mut Input<'_>) -> Outcome<(&'static str, &'static Preset)> {
    // The longest name wins: "temporal bone" is not "bone".
    let found = PRESETS.iter().rev().find_map(|preset| {
        let mut at = *input;
        one_of(preset.names).parse_next(&mut at).ok().map(|_| (preset, at))
    });
    let (preset, at) = found.ok_or(EmptyError)?;
    *input = at;
    Ok((items(preset.names).next().unwrap_or(preset.names), preset))
}

/// Parses "the level by 100", "the window".
fn step(grows: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let term = term(input)?;
    stepped(term, grows, input).map(|change| adjust(Change::Window(change)))
}

/// Parses "values above 200".
fn show(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let found = values(input)?;
    skip("only | alone").parse_next(input)?;
    end(input)?;
    Ok(adjust(Change::ShowOnly(found)))
}

/// Parses the number of "threshold at 200".
fn threshold(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let low = value(input)?;
    end(input)?;
    Ok(adjust(Change::ShowOnly(ValueRange { low: Some(low), high: None })))
}

/// Parses "values below 100".
fn hide(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let found = values(input)?;
    end(input)?;
    Ok(adjust(Change::Hide(found)))
}

/// Parses "values above 300 red", "values below 100 transparent".
fn make(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let found = values(input)?;
    skip("be | in | to be").parse_next(input)?;
    if opt(exactly("invisible | transparent | hidden | disappear")).parse_next(input)?.is_some() {
        end(input)?;
        return Ok(adjust(Change::Hide(found)));
    }
    let (color, name) = parse_color(input)?;
    end(input)?;
    let change = Change::Color(ValueColor { range: Some(found), color: Some(color) });
    Ok(adjust(change).map(|c| c.color_name.clone_from(&name)))
}

/// Parses "a logarithmic scale", "log scale of values".
fn scale(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("values on | the values on | the transfer function to | the transfer function on").parse_next(input)?;
    article(input)?;
    let logarithmic = one_of("logarithmic | log").map(|_| ValueScale::Log10);
    let symmetric = one_of("symlog | symmetric logarithmic | symmetric log").map(|_| ValueScale::Symlog);
    let linear = exactly("linear").map(|_| ValueScale::Linear);
    let kind = alt((symmetric, logarithmic, linear)).parse_next(input)?;
    one_of("scale | scaling | axis | spacing").parse_next(input)?;
    skip("of values | of the values | for the values | for values | of the transfer function | for the transfer function")
        .parse_next(input)?;
    end(input)?;
    Ok(adjust(Change::Scale(kind.into())))
}

/// The refusal where no Gaussian keeps values of its volume.
fn need_volume(state: &State) -> Result<(), Refusal> {
    if state.volume.is_some() {
        return Ok(());
    }
    Err(Refusal::precondition(
        "This scene keeps no values of a volume, so it has no transfer function. Make it of its volume anew with “fit”.",
    ))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let state = context.state;
    let values = clause.values.as_ref().filter(|values| values.change.is_some());
    let mut values = values.copied().ok_or_else(|| missing("change of the transfer function"))?;
    need_volume(state)?;
    let present = state.transfer_function.as_ref().or_else(|| state.volume.as_ref()?.function.as_ref());
    let (least, greatest) = state.volume.as_ref().map_or((0.0, 0.0), |volume| (volume.least, volume.greatest));
    match &mut values.change {
        Some(Change::Window(window)) => {
            let name = clause.name.trim().trim_end_matches("window").trim().to_lowercase();
            let preset = PRESETS.iter().find(|preset| items(preset.names).any(|n| n == name));
            if let Some(preset) = preset {
                let is_hounsfield = least < LEAST_OF_AIR && present.is_some_and(|function| !function.normalized);
                if !is_hounsfield {
                    return Err(Refusal::precondition(format!(
                        "The {name} window is for Hounsfield units. The values here go from {} to {}: say a level and a window, such as “level {}, window {}”.",
                        significant(least),
                        significant(greatest),
                        significant(0.5 * (least + greatest)),
                        significant(0.5 * (greatest - least)),
                    )));
                }
                *window = preset.ends();
            }
        }
        Some(Change::Color(color)) => {
            color_of(color.color.as_ref())?.ok_or_else(|| missing("colour"))?;
        }
        // Values at or below 0 have no logarithm; the symmetric scale is the one people mean there.
        Some(Change::Scale(scale))
            if *scale == i32::from(ValueScale::Log10) && present.is_some_and(|function| function.low <= 0.0) =>
        {
            *scale = ValueScale::Symlog.into();
        }
        _ => {}
    }
    Ok(Step::scene_wide(Action::AdjustTransferFunction(values)))
}

fn resolve_reset(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    need_volume(context.state)?;
    Ok(Step::scene_wide(Action::SetTransferFunction(SetTransferFunction { function: None })))
}

/// One sentence about a changed transfer function. `summary` is that of the scene.
pub(crate) fn report(clause: &Clause, adjust: &AdjustTransferFunction, summary: &str) -> String {
    match &adjust.change {
        Some(Change::Window(_)) if clause.name.is_empty() => format!("{}.", capital(summary)),
        Some(Change::Window(_)) => format!("{}: {summary}.", capital(&clause.name)),
        Some(Change::ShowOnly(range)) => format!("Only {} are shown now.", range_words(range)),
        Some(Change::Hide(range)) => format!("{} are hidden now.", capital(&range_words(range))),
        Some(Change::Color(ValueColor { range, color })) => {
            let range = capital(&range.as_ref().map_or_else(|| "all values".to_owned(), range_words));
            let spoken = clause.color_name.trim().to_lowercase();
            let named = color.as_ref().map_or("coloured", color::name_of);
            format!("{range} are now {}.", if spoken.is_empty() { named } else { &spoken })
        }
        Some(Change::Scale(scale)) => match ValueScale::try_from(*scale) {
            Ok(ValueScale::Linear) => "The values have a linear scale now.".to_owned(),
            Ok(ValueScale::Symlog) => "The values have a logarithmic scale now, linear around 0.".to_owned(),
            _ => "The values have a logarithmic scale now.".to_owned(),
        },
        None => capital(summary),
    }
}

fn range_words(range: &ValueRange) -> String {
    values_between(range.low, range.high)
}
