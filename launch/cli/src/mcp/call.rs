//! A tool with its arguments, checked before anything is asked of the session.

use std::ops::RangeInclusive;

use serde_json::{Map, Value};
use sg_language::intent_schema::IntentSchema;
use sg_language::permission::FILE_ACTS;
use sg_language::prompt::single_line;
use sg_proto::language::{Act, Clause, Reference};
use sg_proto::limits::{MAX_NAME_BYTES, MAX_UTTERANCE_BYTES};
use sg_stack::suggestion::suggestion;

use crate::terminal::Failure;

/// Arguments by name.
pub(super) type Arguments = Map<String, Value>;

/// Width and height of a picture, pixels.
pub(super) const PICTURE_PIXELS: RangeInclusive<u32> = 16..=2048;

/// Width and height without an argument.
pub(super) const DEFAULT_PIXELS: (u32, u32) = (800, 600);

/// Steps of the history in one call.
pub(super) const STEPS: RangeInclusive<u32> = 1..=1000;

/// Most units of one picture.
pub(super) const MAX_PICTURE_UNITS: usize = 16;

/// Typed actions.
pub(super) const COMMAND: &str = "command";
/// A sentence.
pub(super) const SAY: &str = "say";
/// The state of the scene.
pub(super) const SCENE: &str = "scene";
/// A picture.
pub(super) const SCREENSHOT: &str = "screenshot";
/// Undo.
pub(super) const UNDO: &str = "undo";
/// Redo.
pub(super) const REDO: &str = "redo";

/// Names of all tools.
pub(super) const NAMES: [&str; 6] = [COMMAND, SAY, SCENE, SCREENSHOT, UNDO, REDO];

/// A call of a tool.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Call {
    /// It changes nothing.
    Look(Look),
    /// It may change the scene.
    Edit(Edit),
}

/// A call that changes nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Look {
    /// The state of the scene.
    Scene,
    /// A picture.
    Screenshot(Screenshot),
}

/// A call that may change the scene.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Edit {
    /// Typed actions.
    Command(Vec<Clause>),
    /// A sentence.
    Say(String),
    /// Undo; without a number, all that the last call did.
    Undo(Option<u32>),
    /// Redo; without a number, all that the last undo took back.
    Redo(Option<u32>),
}

/// What a picture shall be like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Screenshot {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) highlight_selection: bool,
    /// If not empty, only these units are drawn.
    pub(super) only_units: Vec<String>,
}

impl Call {
    /// Reads a call.
    ///
    /// # Errors
    /// [`Failure::Input`]: no such tool, or wrong arguments.
    pub(super) fn read(tool: &str, arguments: &Arguments, schema: &IntentSchema) -> Result<Self, Failure> {
        let look = |look| Ok(Self::Look(look));
        let edit = |edit| Ok(Self::Edit(edit));
        match tool {
            COMMAND => edit(Edit::Command(clauses(arguments, schema)?)),
            SAY => edit(Edit::Say(sentence(arguments)?)),
            SCENE => known(arguments, &[]).and_then(|()| look(Look::Scene)),
            SCREENSHOT => look(Look::Screenshot(screenshot(arguments)?)),
            UNDO => edit(Edit::Undo(steps(arguments)?)),
            REDO => edit(Edit::Redo(steps(arguments)?)),
            _ => Err(Failure::Input(format!("no tool `{}`{}", single_line(tool), suggestion(tool, NAMES)))),
        }
    }
}

/// Whether `command` leaves an act to other tools or to people, and why.
pub(super) fn left_out(act: Act) -> Option<&'static str> {
    match act {
        Act::Undo => Some("use the tool `undo`"),
        Act::Redo => Some("use the tool `redo`"),
        _ if FILE_ACTS.contains(&act) => Some("it reaches files, which no tool does"),
        _ => None,
    }
}

/// The clauses of `command`, checked as the answer of a language model is.
fn clauses(arguments: &Arguments, schema: &IntentSchema) -> Result<Vec<Clause>, Failure> {
    known(arguments, &["clauses"])?;
    let wrong = |why: String| Failure::Input(format!("arguments of `{COMMAND}`: {why}"));
    let intent = schema.decode(&Value::Object(arguments.clone()).to_string()).map_err(|e| wrong(e.to_string()))?;
    let mut clauses = intent.clauses;
    if clauses.is_empty() {
        return Err(wrong("`clauses` is empty; it needs one clause for each action".to_owned()));
    }
    for (at, clause) in clauses.iter_mut().enumerate() {
        let act = clause.act();
        if let Some(why) = left_out(act) {
            return Err(wrong(format!("`clauses[{at}]`: {} is not done here; {why}", act.as_str_name())));
        }
        if clause.words.trim().is_empty() {
            clause.words = spelled(act);
        }
        if clause.target.as_ref().is_some_and(|target| *target == Reference::default()) {
            clause.target = None;
        }
    }
    Ok(clauses)
}

/// An act in words, such as "set color".
fn spelled(act: Act) -> String {
    act.as_str_name().trim_start_matches("ACT_").to_lowercase().replace('_', " ")
}

fn sentence(arguments: &Arguments) -> Result<String, Failure> {
    known(arguments, &["text"])?;
    let text = present(arguments, "text").and_then(Value::as_str).unwrap_or_default();
    if text.trim().is_empty() || text.len() > MAX_UTTERANCE_BYTES {
        return Err(Failure::Input(format!("`text` must be a sentence of 1 to {MAX_UTTERANCE_BYTES} bytes")));
    }
    Ok(text.to_owned())
}

fn screenshot(arguments: &Arguments) -> Result<Screenshot, Failure> {
    known(arguments, &["width", "height", "highlight_selection", "only_units"])?;
    let (width, height) = DEFAULT_PIXELS;
    Ok(Screenshot {
        width: whole(arguments, "width", &PICTURE_PIXELS)?.unwrap_or(width),
        height: whole(arguments, "height", &PICTURE_PIXELS)?.unwrap_or(height),
        highlight_selection: flag(arguments, "highlight_selection")?,
        only_units: names(arguments, "only_units")?,
    })
}

fn steps(arguments: &Arguments) -> Result<Option<u32>, Failure> {
    known(arguments, &["steps"])?;
    whole(arguments, "steps", &STEPS)
}

/// Refuses arguments that a tool does not have.
fn known(arguments: &Arguments, names: &[&str]) -> Result<(), Failure> {
    let strange = arguments.keys().find(|key| !names.contains(&key.as_str()));
    strange.map_or(Ok(()), |key| {
        let hint = suggestion(key, names.iter().copied());
        Err(Failure::Input(format!("no argument `{}`{hint}", single_line(key))))
    })
}

fn present<'a>(arguments: &'a Arguments, name: &str) -> Option<&'a Value> {
    arguments.get(name).filter(|value| !value.is_null())
}

fn whole(arguments: &Arguments, name: &str, range: &RangeInclusive<u32>) -> Result<Option<u32>, Failure> {
    let Some(value) = present(arguments, name) else { return Ok(None) };
    let (least, most) = (*range.start(), *range.end());
    let number = value.as_f64().filter(|n| n.fract() == 0.0 && (f64::from(least)..=f64::from(most)).contains(n));
    let wrong = || {
        let shown = single_line(&value.to_string());
        Failure::Input(format!("`{name}` is {shown}; use a whole number from {least} to {most}"))
    };
    number.map(|n| Some(n as u32)).ok_or_else(wrong)
}

fn flag(arguments: &Arguments, name: &str) -> Result<bool, Failure> {
    let value = present(arguments, name).map(Value::as_bool);
    value.unwrap_or(Some(false)).ok_or_else(|| Failure::Input(format!("`{name}` must be true or false")))
}

fn names(arguments: &Arguments, name: &str) -> Result<Vec<String>, Failure> {
    let Some(value) = present(arguments, name) else { return Ok(Vec::new()) };
    let items = value.as_array().filter(|items| items.len() <= MAX_PICTURE_UNITS);
    let of = |item: &Value| item.as_str().filter(|text| text.len() <= MAX_NAME_BYTES).map(str::to_owned);
    let names = items.and_then(|items| items.iter().map(of).collect::<Option<Vec<_>>>());
    names
        .ok_or_else(|| Failure::Input(format!("`{name}` must be a list of at most {MAX_PICTURE_UNITS} names of units")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(tool: &str, arguments: Value) -> Result<Call, String> {
        let Value::Object(arguments) = arguments else { panic!("no object") };
        Call::read(tool, &arguments, &IntentSchema::new().unwrap()).map_err(|failure| failure.text())
    }

    fn refused(tool: &str, arguments: Value, part: &str) {
        let reason = read(tool, arguments).unwrap_err();
        assert!(reason.contains(part) && !reason.contains('\n'), "{reason}");
    }

    #[test]
    fn typed_actions_are_read_with_few_fields() {
        let red = json!({"red": 1, "green": 0, "blue": 0});
        let clauses = json!([
            {"act": "ACT_SET_COLOR", "target": {"names": ["sac"]}, "color": red},
            {"act": "ACT_HIDE", "target": {"complement": true}, "words": "hide the rest"},
        ]);
        let Ok(Call::Edit(Edit::Command(clauses))) = read("command", json!({"clauses": clauses})) else {
            panic!("refused")
        };
        assert_eq!(clauses.iter().map(Clause::act).collect::<Vec<_>>(), [Act::SetColor, Act::Hide]);
        assert_eq!((clauses[0].words.as_str(), clauses[1].words.as_str()), ("set color", "hide the rest"));
        assert_eq!(clauses[0].target.as_ref().unwrap().names, ["sac"]);
    }

    #[test]
    fn wrong_actions_are_refused_with_their_place() {
        let color = |red: f64| {
            let color = json!({"red": red, "green": 0, "blue": 0});
            json!({"clauses": [{"act": "ACT_SET_COLOR", "target": {"names": ["sac"]}, "color": color}]})
        };
        assert!(read("command", color(1.0)).is_ok());
        refused("command", color(2.0), "`clauses[0].color.red` is 2; use a number from 0 to 1");
        refused("command", json!({}), "`clauses` is empty");
        refused("command", json!({"clauses": []}), "`clauses` is empty");
        refused("command", json!({"clauses": "hide the sac"}), "does not match the schema");
        refused("command", json!({"clauses": [], "shell": "ls"}), "no argument `shell`");
        refused("command", json!({"clauses": [{"act": "ACT_HIDE"}]}), "ACT_HIDE needs `target`");
    }

    #[test]
    fn no_action_reaches_a_file_or_the_history() {
        for (clause, part) in [
            (json!({"act": "ACT_SAVE_PICTURE", "file": "a.png"}), "reaches files"),
            (json!({"act": "ACT_EXPORT", "file": "a.ply"}), "reaches files"),
            (json!({"act": "ACT_SAVE_COPY"}), "reaches files"),
            (json!({"act": "ACT_OPEN", "file": "a.ply"}), "reaches files"),
            (json!({"act": "ACT_UNDO", "amount": 2}), "use the tool `undo`"),
            (json!({"act": "ACT_REDO"}), "use the tool `redo`"),
        ] {
            refused("command", json!({"clauses": [clause]}), part);
        }
    }

    #[test]
    fn sentences_and_steps_are_bounded() {
        assert_eq!(read("say", json!({"text": "hide the sac"})), Ok(Call::Edit(Edit::Say("hide the sac".to_owned()))));
        for text in [json!(" "), json!("a".repeat(MAX_UTTERANCE_BYTES + 1)), json!(7), Value::Null] {
            refused("say", json!({"text": text}), "`text` must be a sentence");
        }
        assert_eq!(read("undo", json!({})), Ok(Call::Edit(Edit::Undo(None))));
        assert_eq!(read("undo", json!({"steps": 3})), Ok(Call::Edit(Edit::Undo(Some(3)))));
        assert_eq!(read("redo", json!({"steps": 2.0})), Ok(Call::Edit(Edit::Redo(Some(2)))));
        for steps in [json!(0), json!(1.5), json!(-1), json!(1001), json!("two")] {
            refused("undo", json!({"steps": steps}), "use a whole number from 1 to 1000");
        }
    }

    #[test]
    fn pictures_have_sizes_within_limits() {
        let Ok(Call::Look(Look::Screenshot(plain))) = read("screenshot", json!({"width": null})) else {
            panic!("refused")
        };
        assert_eq!((plain.width, plain.height), DEFAULT_PIXELS);
        assert!(!plain.highlight_selection && plain.only_units.is_empty());
        let arguments = json!({"width": 64, "height": 2048, "highlight_selection": true, "only_units": ["sac"]});
        let Ok(Call::Look(Look::Screenshot(picture))) = read("screenshot", arguments) else { panic!("refused") };
        assert_eq!((picture.width, picture.height, picture.highlight_selection), (64, 2048, true));
        assert_eq!(picture.only_units, ["sac"]);
        refused("screenshot", json!({"width": 4096}), "`width` is 4096; use a whole number from 16 to 2048");
        refused("screenshot", json!({"height": 1e300}), "`height`");
        refused("screenshot", json!({"highlight_selection": "yes"}), "must be true or false");
        refused("screenshot", json!({"only_units": vec!["sac"; MAX_PICTURE_UNITS + 1]}), "at most 16 names");
        refused("screenshot", json!({"only_units": [1]}), "at most 16 names");
        refused("screenshot", json!({"path": "a.png"}), "no argument `path`");
    }

    #[test]
    fn unknown_tools_are_refused_with_a_hint() {
        refused("screenshoot", json!({}), "did you mean `screenshot`?");
        refused("scene", json!({"a\nb": 1}), "no argument `a b`");
        assert_eq!(read("scene", json!({})), Ok(Call::Look(Look::Scene)));
    }
}
