//! Help: examples of all commands.

use sg_proto::language::{Act, Clause};

use super::command::{Command, Construct, Context, Effect, complete};
use crate::resolution::{Refusal, Step};
use crate::syntax::token::normalized_name;
use crate::text::is_plural;
use crate::unit_names;

/// The command "help".
pub(super) const HELP: Command = Command {
    act: Act::Help,
    title: "help",
    constructs: &[Construct::new(
        "help | help me | show help | show me help | show me the help | i need help | \
             what can i say | what can i do | what can i ask | what can i ask you | \
             what can i tell you | what can you do | what can you do for me | \
             what do you understand | what can you understand | what commands are there | \
             which commands are there | what commands do you know | what are the commands | \
             list the commands | list commands | show me the commands | commands | \
             how does this work | how do i use this | what are my options | what should i say",
        complete,
    )],
    examples: &["help", "what can I say?"],
    fields: &[],
    effect: Effect::None,
    resolve,
};

fn resolve(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let names = unit_names::addressable(context.state);
    Ok(Step::Answer { text: help_text(context.table, &names), units: Vec::new() })
}

/// Names in examples where the scene has no units.
const SAMPLE_NAMES: [&str; 2] = ["sac", "vessel"];

/// An example with the names of units. The verb agrees with a plural name.
pub(crate) fn with_names(example: &str, names: &[&str]) -> String {
    let [first_sample, second_sample] = SAMPLE_NAMES;
    let unit = names.first().copied().unwrap_or(first_sample);
    let sample = if normalized_name(unit) == normalized_name(second_sample) { first_sample } else { second_sample };
    let other = names.get(1).copied().unwrap_or(sample);
    let mut words: Vec<&str> = example.split(' ').collect();
    if is_plural(unit)
        && let Some(place) = words.windows(3).position(|w| w[0] == "is" && w[1] == "the" && w[2].starts_with("{unit}"))
    {
        words[place] = "are";
    }
    let example = words.join(" ");
    example.replace("{unit}", unit).replace("{other}", other)
}

/// The help: one line per command, with names of the scene's units in the examples.
pub(super) fn help_text(table: &[Command], names: &[&str]) -> String {
    let mut text = String::from("Examples of what you can say:");
    for command in table {
        let examples: Vec<String> =
            command.examples.iter().take(3).map(|example| format!("“{}”", with_names(example, names))).collect();
        text.push_str(&format!("\n  {}: {}", command.title, examples.join(", ")));
    }
    text.push_str("\nSeveral at once: “");
    text.push_str(&with_names("make the {unit} red and fade everything else to 20 percent, then zoom in", names));
    text.push_str("”.");
    text
}
