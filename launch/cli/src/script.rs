//! Demo scripts: strokes, utterances, saved units, viewpoints and captures, in order.
//!
//! ```toml
//! [[step]]
//! strokes = "sac.json"        # relative to the script
//! restart = true              # forget earlier strokes first
//! [[step]]
//! capture = "brushed"
//! highlight = true            # with the selection highlighted
//! only = ["sac"]              # only Gaussians of these units
//! [[step]]
//! save = "sac"                # the selection becomes a unit
//! [[step]]
//! say = "make the sac red"
//! [[step]]                    # viewpoint in scene coordinates
//! view = { eye = [-350, 330, -150], target = [128, 105, 140], up = [0, 1, 0], fov_y_degrees = 35 }
//! [[step]]
//! chaos = true                # kills the service of --chaos here
//! ```

use std::path::{Path, PathBuf};

use sg_proto::limits::{MAX_NAME_BYTES, MAX_UTTERANCE_BYTES};
use sg_proto::scene::{Vector, View};

use sg_stack::document::{self, Entry, Node, Place, Problem, Problems, Reader, Table, Value};

/// Most steps of one script.
const MAX_STEPS: usize = 1000;

/// One step.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// Play strokes.
    Strokes {
        /// File of strokes.
        file: PathBuf,
        /// Whether to forget earlier strokes first.
        restart: bool,
    },
    /// Send an utterance.
    Say(String),
    /// Save the selection as a unit.
    Save(String),
    /// Change the viewpoint.
    View(View),
    /// Save a picture.
    Capture {
        /// Part of the picture's file names.
        name: String,
        /// Whether to highlight the selection.
        highlight: bool,
        /// Units to draw; all if empty.
        only: Vec<String>,
    },
    /// Kill the service of `--chaos`.
    Chaos,
}

/// Parses a script.
///
/// # Errors
/// All mistakes, with their places.
pub fn read(path: &Path, text: &str) -> Result<Vec<Step>, Problems> {
    let mut problems = Vec::new();
    let steps = match document::parse(text) {
        Ok(table) => steps(&table, path, &mut problems),
        Err(problem) => {
            problems.push(problem);
            Vec::new()
        }
    };
    if problems.is_empty() { Ok(steps) } else { Err(document::in_order(path, problems)) }
}

fn steps(table: &Table, path: &Path, problems: &mut Vec<Problem>) -> Vec<Step> {
    let start = Place::File { line: 1, column: 1 };
    let mut top = Reader::new("the script", table, problems);
    let list = match top.node("step") {
        None => {
            top.problem(&start, "no steps; start each with `[[step]]`");
            &[][..]
        }
        Some(Node { value: Value::Array(list), .. }) => list,
        Some(node) => {
            top.problem(&node.place, "write `[[step]]`, with two brackets on each side");
            &[][..]
        }
    };
    if let Some(extra) = list.get(MAX_STEPS) {
        top.problem(&extra.place, format!("more than {MAX_STEPS} steps"));
    }
    top.finish();
    let mut names: Vec<String> = Vec::new();
    let mut steps = Vec::new();
    for (index, node) in list.iter().take(MAX_STEPS).enumerate() {
        let Value::Table(table) = &node.value else {
            problems.push(Problem { place: node.place.clone(), text: "a step must be a table".to_owned() });
            continue;
        };
        let step = step(index + 1, table, &node.place, path, problems);
        if let Some(Step::Capture { name, .. }) = &step {
            if names.contains(name) {
                let text = format!("two pictures have the name `{name}`");
                problems.push(Problem { place: node.place.clone(), text });
            }
            names.push(name.clone());
        }
        steps.extend(step);
    }
    steps
}

fn step(number: usize, table: &Table, place: &Place, path: &Path, problems: &mut Vec<Problem>) -> Option<Step> {
    const KINDS: [&str; 6] = ["strokes", "say", "save", "view", "capture", "chaos"];
    let place = table.entries.first().map_or(place, |e| &e.place);
    let mut reader = Reader::new(format!("step {number}"), table, problems);
    let kinds: Vec<&Entry> = table.entries.iter().filter(|e| KINDS.contains(&e.key.as_str())).collect();
    let kind = match kinds.as_slice() {
        [kind] => kind.key.as_str(),
        [] => {
            reader.problem(place, format!("step {number} has no action; give it one of {}", KINDS.join(", ")));
            ""
        }
        [_, second, ..] => {
            let text = format!("step {number} has two actions; make `{}` a step of its own", second.key);
            reader.problem(&second.place, text);
            ""
        }
    };
    let step = match kind {
        "strokes" => reader
            .string("strokes")
            .map(|file| Step::Strokes { file: path.parent().unwrap_or(Path::new("")).join(file), restart: false }),
        "say" => text(&mut reader, "say", MAX_UTTERANCE_BYTES).map(Step::Say),
        "save" => text(&mut reader, "save", MAX_NAME_BYTES).map(Step::Save),
        "view" => reader.table("view").and_then(|table| view(&mut reader, table)).map(Step::View),
        "capture" => picture_name(&mut reader).map(|name| Step::Capture { name, highlight: false, only: Vec::new() }),
        "chaos" => match reader.boolean("chaos") {
            Some(false) => {
                reader.problem(place, "remove the step instead of `chaos = false`");
                None
            }
            other => other.map(|_| Step::Chaos),
        },
        // Keys of a step without a valid kind are not reported again as unknown.
        _ => {
            for key in KINDS {
                reader.node(key);
            }
            None
        }
    };
    let step = step.map(|step| match step {
        Step::Strokes { file, .. } => Step::Strokes { file, restart: reader.boolean("restart").unwrap_or(false) },
        Step::Capture { name, .. } => {
            let highlight = reader.boolean("highlight").unwrap_or(false);
            Step::Capture { name, highlight, only: names(&mut reader, "only") }
        }
        other => other,
    });
    reader.finish();
    step
}

fn text(reader: &mut Reader<'_, '_>, key: &'static str, most: usize) -> Option<String> {
    let text = reader.string(key)?;
    if (1..=most).contains(&text.trim().len()) {
        return Some(text.to_owned());
    }
    let place = reader.node(key)?.place.clone();
    reader.problem(&place, format!("`{key}` must have 1 to {most} bytes"));
    None
}

fn view(reader: &mut Reader<'_, '_>, table: &Table) -> Option<View> {
    let mut inner = reader.inner("`view`", table);
    let [eye, target, up] = ["eye", "target", "up"].map(|key| vector(&mut inner, key));
    let fov = number(&mut inner, "fov_y_degrees");
    let checked = match fov {
        Some((_, degrees)) if (1.0..=120.0).contains(&degrees) => Some(degrees),
        Some((place, degrees)) => {
            inner.problem(&place, format!("`fov_y_degrees` is {degrees}; it must lie between 1 and 120"));
            None
        }
        None => None,
    };
    inner.finish();
    Some(View { eye: Some(eye?), target: Some(target?), up: Some(up?), fov_y_degrees: checked? })
}

fn vector(reader: &mut Reader<'_, '_>, key: &'static str) -> Option<Vector> {
    let Some(node) = reader.node(key) else {
        reader.missing(key);
        return None;
    };
    let numbers = match &node.value {
        Value::Array(items) => items.iter().map(|i| i.value.as_number()).collect::<Option<Vec<_>>>(),
        _ => None,
    };
    match numbers.as_deref() {
        Some([x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => Some(Vector { x: *x, y: *y, z: *z }),
        _ => {
            let place = node.place.clone();
            reader.problem(&place, format!("`{key}` must be three numbers"));
            None
        }
    }
}

fn number(reader: &mut Reader<'_, '_>, key: &'static str) -> Option<(Place, f64)> {
    let Some(node) = reader.node(key) else {
        reader.missing(key);
        return None;
    };
    let number = node.value.as_number();
    if number.is_none() {
        let place = node.place.clone();
        reader.problem(&place, format!("`{key}` must be a number"));
    }
    number.map(|n| (node.place.clone(), n))
}

fn picture_name(reader: &mut Reader<'_, '_>) -> Option<String> {
    let name = reader.string("capture")?;
    let ok = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
    if (1..=64).contains(&name.len()) && name.bytes().all(ok) {
        return Some(name.to_owned());
    }
    let place = reader.node("capture")?.place.clone();
    reader.problem(&place, format!("picture `{name}`: use 1 to 64 letters, digits, `-` or `_`"));
    None
}

fn names(reader: &mut Reader<'_, '_>, key: &'static str) -> Vec<String> {
    let Some(node) = reader.node(key) else { return Vec::new() };
    let names = match &node.value {
        Value::Array(items) => items
            .iter()
            .map(|item| if let Value::String(name) = &item.value { Some(name.clone()) } else { None })
            .collect::<Option<Vec<_>>>(),
        _ => None,
    };
    names.unwrap_or_else(|| {
        let place = node.place.clone();
        reader.problem(&place, format!("`{key}` must be a list of names"));
        Vec::new()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_is_read_in_order() {
        let text = r#"
[[step]]
strokes = "a/sac.json"
[[step]]
strokes = "more.json"
restart = true
[[step]]
capture = "one"
highlight = true
only = ["sac", "vessels"]
[[step]]
say = "undo"
[[step]]
view = { eye = [1, 2.5, -3], target = [0, 0, 0], up = [0, 0, 1], fov_y_degrees = 35 }
[[step]]
chaos = true
[[step]]
save = "the sac"
"#;
        let expected = [
            Step::Strokes { file: "scripts/a/sac.json".into(), restart: false },
            Step::Strokes { file: "scripts/more.json".into(), restart: true },
            Step::Capture { name: "one".into(), highlight: true, only: vec!["sac".into(), "vessels".into()] },
            Step::Say("undo".into()),
            Step::View(View {
                eye: Some(Vector { x: 1.0, y: 2.5, z: -3.0 }),
                target: Some(Vector::default()),
                up: Some(Vector { x: 0.0, y: 0.0, z: 1.0 }),
                fov_y_degrees: 35.0,
            }),
            Step::Chaos,
            Step::Save("the sac".into()),
        ];
        assert_eq!(read(Path::new("scripts/x.toml"), text).unwrap(), expected);
    }

    #[test]
    fn mistakes_have_places() {
        for (text, expected) in [
            ("", "x.toml:1:1: no steps; start each with `[[step]]`"),
            ("[step]\nsay = \"undo\"\n", "x.toml:1:1: write `[[step]]`, with two brackets on each side"),
            (
                "[[step]]\nsay = \"undo\"\n[[steps]]\n",
                "x.toml:3:3: unknown key `steps` in the script; did you mean `step`?",
            ),
            (
                "[[step]]\nsya = \"undo\"\n",
                "x.toml:2:1: step 1 has no action; give it one of strokes, say, save, view, capture, chaos\nx.toml:2:1: unknown key `sya` in step 1; did you mean `say`?",
            ),
            (
                "[[step]]\nsay = \"undo\"\nsave = \"x\"\n",
                "x.toml:3:1: step 1 has two actions; make `save` a step of its own",
            ),
            ("[[step]]\nsay = 3\n", "x.toml:2:7: `say` must be a string, not an integer"),
            ("[[step]]\nsay = \" \"\n", "x.toml:2:7: `say` must have 1 to 4096 bytes"),
            ("[[step]]\ncapture = \"a/b\"\n", "x.toml:2:11: picture `a/b`: use 1 to 64 letters, digits, `-` or `_`"),
            (
                "[[step]]\ncapture = \"a\"\nonly = [1]\n[[step]]\ncapture = \"a\"\n",
                "x.toml:3:8: `only` must be a list of names\nx.toml:4:1: two pictures have the name `a`",
            ),
            (
                "[[step]]\nview = { eye = [1, 2], up = [0, 0, 1], fov_y_degrees = 0 }\n",
                "x.toml:2:10: `target` is missing in `view`\nx.toml:2:16: `eye` must be three numbers\nx.toml:2:56: `fov_y_degrees` is 0; it must lie between 1 and 120",
            ),
            (
                "[[step]]\nsay = \"a\"\nhighlight = true\n",
                "x.toml:3:1: unknown key `highlight` in step 1; there are `say`",
            ),
        ] {
            let said = read(Path::new("x.toml"), text).unwrap_err().to_string();
            assert_eq!(said, expected, "{text}");
        }
    }
}
