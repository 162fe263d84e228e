//! TOML documents whose values carry their place, so that a mistake is reported with file, line and column.
//!
//! Overrides from the command line (`a.b=c`) replace values. The place of such a value is the override.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use toml::de::{DeTable, DeValue};

use sg_input::{limits, printable};

use crate::suggestion::suggestion;

/// Where a key or value was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// In the file.
    File {
        /// From 1.
        line: usize,
        /// From 1, counted in characters.
        column: usize,
    },
    /// On the command line, as `a.b=c`.
    Override(String),
}

/// One mistake: its place, and how to correct it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Place of the mistake.
    pub place: Place,
    /// Description, and what to do.
    pub text: String,
}

/// Mistakes of one file, at least one. Displayed as one line each, `FILE:LINE:COLUMN: text`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Problems {
    /// The file as it was named.
    pub file: PathBuf,
    /// The mistakes in the order of their places, at most [`MAX_PROBLEMS`].
    pub list: Vec<Problem>,
    /// Further mistakes.
    pub more: usize,
}

/// Most mistakes of one file that are reported.
pub const MAX_PROBLEMS: usize = 20;

impl Problems {
    /// One printable line for each mistake, `FILE:LINE:COLUMN: text`, and one that counts further mistakes.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        let file = self.file.display();
        let line = move |problem: &Problem| match &problem.place {
            Place::File { line, column } => format!("{file}:{line}:{column}: {}", problem.text),
            Place::Override(set) => format!("--set {set}: {}", problem.text),
        };
        let more = (self.more > 0).then(|| format!("{}: {} further mistakes", self.file.display(), self.more));
        self.list.iter().map(line).chain(more).map(|line| printable(&line).into_owned())
    }
}

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.lines().collect::<Vec<_>>().join("\n"))
    }
}

/// A value of a document.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Text.
    String(String),
    /// Whole number.
    Integer(i64),
    /// Number.
    Float(f64),
    /// Truth value.
    Boolean(bool),
    /// Date or time, as written.
    Datetime(String),
    /// List.
    Array(Vec<Node>),
    /// Table.
    Table(Table),
}

impl Value {
    fn kind(&self) -> &'static str {
        match self {
            Self::String(_) => "a string",
            Self::Integer(_) => "an integer",
            Self::Float(_) => "a number",
            Self::Boolean(_) => "a boolean",
            Self::Datetime(_) => "a date",
            Self::Array(_) => "a list",
            Self::Table(_) => "a table",
        }
    }

    /// The number, for integers and floats.
    #[must_use]
    pub fn as_number(&self) -> Option<f64> {
        match self {
            Self::Integer(i) => Some(*i as f64),
            Self::Float(x) => Some(*x),
            _ => None,
        }
    }

    /// The same as JSON. Dates and infinite numbers become text.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        match self {
            Self::String(s) | Self::Datetime(s) => s.as_str().into(),
            Self::Integer(i) => (*i).into(),
            Self::Float(x) => serde_json::Number::from_f64(*x).map_or_else(|| x.to_string().into(), Into::into),
            Self::Boolean(b) => (*b).into(),
            Self::Array(items) => items.iter().map(|n| n.value.to_json()).collect(),
            Self::Table(table) => serde_json::Value::Object(table.to_json()),
        }
    }
}

/// A value and its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Where it was written.
    pub place: Place,
}

/// One key of a table with its value.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// Where the key was written.
    pub place: Place,
    /// Its value.
    pub node: Node,
}

/// A table in the order of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Its entries. Keys are unique.
    pub entries: Vec<Entry>,
}

impl Table {
    /// The entry of a key.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Entry> {
        self.entries.iter().find(|e| e.key == key)
    }

    /// The same as JSON.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Map<String, serde_json::Value> {
        self.entries.iter().map(|e| (e.key.clone(), e.node.value.to_json())).collect()
    }

    /// Puts the entries of `other` over these. Tables are merged, other values replaced.
    fn merge(&mut self, other: Self) {
        for entry in other.entries {
            match self.entries.iter_mut().find(|e| e.key == entry.key) {
                None => self.entries.push(entry),
                Some(old) => match (&mut old.node.value, entry.node.value) {
                    (Value::Table(old), Value::Table(new)) => old.merge(new),
                    (_, value) => {
                        old.place = entry.place;
                        old.node = Node { value, place: entry.node.place };
                    }
                },
            }
        }
    }
}

/// Parses a document.
///
/// # Errors
/// The first syntax error.
pub fn parse(text: &str) -> Result<Table, Problem> {
    limits::check_toml_parts(text).map_err(|text| Problem { place: Place::File { line: 1, column: 1 }, text })?;
    let places = Places::of(text);
    let place = |at: usize| places.place(at);
    let table = DeTable::parse(text).map_err(|e| Problem {
        place: place(e.span().map_or(0, |s| s.start)),
        text: e.message().trim_end().replace('\n', "; "),
    })?;
    table_of(table.get_ref(), &place)
}

/// Puts an override `a.b=c` over a document. The value is TOML if it parses as TOML, otherwise a string.
///
/// # Errors
/// The path before `=` is not a path of keys.
pub fn override_with(table: &mut Table, set: &str) -> Result<(), Problem> {
    let place = |_| Place::Override(set.to_owned());
    let problem = |text: &str| Problem { place: Place::Override(set.to_owned()), text: text.to_owned() };
    let Some((path, value)) = set.split_once('=') else {
        return Err(problem("write it as a.b=c, such as service.scene.params.scene=skull.ply"));
    };
    if path.contains('\n') {
        return Err(problem("the path before `=` has a line break"));
    }
    let typed = (!value.contains('\n')).then(|| format!("{path} = {value}"));
    let literal = format!("{path} = {}", toml::Value::String(value.to_owned()));
    for text in typed.iter().chain([&literal]) {
        if let Ok(parsed) = DeTable::parse(text) {
            table.merge(table_of(parsed.get_ref(), &place)?);
            return Ok(());
        }
    }
    Err(problem(&format!("`{path}` is not a path of keys; write keys separated by dots")))
}

fn table_of(table: &DeTable<'_>, place: &dyn Fn(usize) -> Place) -> Result<Table, Problem> {
    let mut entries: Vec<_> = table.iter().collect();
    // The parser sorts tables alphabetically. Users expect the order of the file.
    entries.sort_by_key(|(key, _)| key.span().start);
    let entries = entries
        .into_iter()
        .map(|(key, value)| {
            let node =
                Node { value: value_of(value.get_ref(), value.span().start, place)?, place: place(value.span().start) };
            Ok(Entry { key: key.get_ref().to_string(), place: place(key.span().start), node })
        })
        .collect::<Result<_, _>>()?;
    Ok(Table { entries })
}

fn value_of(value: &DeValue<'_>, at: usize, place: &dyn Fn(usize) -> Place) -> Result<Value, Problem> {
    let problem = |text: String| Problem { place: place(at), text };
    Ok(match value {
        DeValue::String(s) => Value::String(s.to_string()),
        DeValue::Integer(i) => Value::Integer(
            i64::from_str_radix(i.as_str(), i.radix())
                .map_err(|_| problem(format!("{i} does not fit into a 64-bit integer")))?,
        ),
        DeValue::Float(x) => {
            Value::Float(x.as_str().parse().map_err(|_| problem(format!("`{}` is no number", x.as_str())))?)
        }
        DeValue::Boolean(b) => Value::Boolean(*b),
        DeValue::Datetime(d) => Value::Datetime(d.to_string()),
        DeValue::Array(items) => Value::Array(
            items
                .iter()
                .map(|v| {
                    let at = v.span().start;
                    Ok(Node { value: value_of(v.get_ref(), at, place)?, place: place(at) })
                })
                .collect::<Result<_, _>>()?,
        ),
        DeValue::Table(table) => Value::Table(table_of(table, place)?),
    })
}

/// Lines and columns of a text, found in a few steps for each place.
struct Places<'a> {
    text: &'a str,
    /// Byte offset of each line.
    lines: Vec<usize>,
    /// Characters before every [`STRIDE`]th byte.
    characters: Vec<usize>,
}

/// Bytes between two entries of [`Places::characters`].
const STRIDE: usize = 256;

/// Whether a byte begins a character of UTF-8.
fn begins_character(byte: &u8) -> bool {
    byte & 0xc0 != 0x80
}

impl<'a> Places<'a> {
    fn of(text: &'a str) -> Self {
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let lines = std::iter::once(0).chain(ends.map(|(at, _)| at + 1)).collect();
        let mut count = 0;
        let characters = text.as_bytes().chunks(STRIDE).map(|part| {
            let before = count;
            count += part.iter().filter(|b| begins_character(b)).count();
            before
        });
        Self { text, lines, characters: characters.collect() }
    }

    /// Characters before a byte.
    fn characters_before(&self, at: usize) -> usize {
        let part = (at / STRIDE).min(self.characters.len().saturating_sub(1));
        let rest = self.text.as_bytes().get(part * STRIDE..at).unwrap_or_default();
        self.characters.get(part).copied().unwrap_or(0) + rest.iter().filter(|b| begins_character(b)).count()
    }

    fn place(&self, at: usize) -> Place {
        let at = at.min(self.text.len());
        let line = self.lines.partition_point(|start| *start <= at).max(1);
        let start = self.lines.get(line - 1).copied().unwrap_or(0);
        Place::File { line, column: self.characters_before(at) - self.characters_before(start) + 1 }
    }
}

/// Reads the keys of one table one by one, and collects wrong and unknown ones.
#[derive(Debug)]
pub struct Reader<'t, 'p> {
    title: String,
    /// Place where the table begins.
    place: Place,
    table: &'t Table,
    known: Vec<&'static str>,
    problems: &'p mut Vec<Problem>,
}

impl<'t, 'p> Reader<'t, 'p> {
    /// Reads `table`, called `title` in messages (such as `[service.scene]`).
    pub fn new(title: impl Into<String>, table: &'t Table, problems: &'p mut Vec<Problem>) -> Self {
        let place = table.entries.first().map_or(Place::File { line: 1, column: 1 }, |e| e.place.clone());
        Self { title: title.into(), place, table, known: Vec::new(), problems }
    }

    /// Reads a table within this one.
    pub fn inner<'u>(&mut self, title: impl Into<String>, table: &'u Table) -> Reader<'u, '_> {
        Reader::new(title, table, self.problems)
    }

    /// Adds a mistake.
    pub fn problem(&mut self, place: &Place, text: impl Into<String>) {
        self.problems.push(Problem { place: place.clone(), text: text.into() });
    }

    /// The value of a key, of any type.
    pub fn node(&mut self, key: &'static str) -> Option<&'t Node> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.table.get(key).map(|e| &e.node)
    }

    fn typed<T>(&mut self, key: &'static str, wanted: &str, read: impl Fn(&'t Value) -> Option<T>) -> Option<T> {
        let node = self.node(key)?;
        let value = read(&node.value);
        if value.is_none() {
            self.problem(&node.place, format!("`{key}` must be {wanted}, not {}", node.value.kind()));
        }
        value
    }

    /// Adds a mistake: the key is missing.
    pub fn missing(&mut self, key: &str) {
        let place = self.place.clone();
        let text = format!("`{key}` is missing in {}", self.title);
        self.problem(&place, text);
    }

    /// A string.
    pub fn string(&mut self, key: &'static str) -> Option<&'t str> {
        self.typed(key, "a string", |v| if let Value::String(s) = v { Some(s.as_str()) } else { None })
    }

    /// A boolean.
    pub fn boolean(&mut self, key: &'static str) -> Option<bool> {
        self.typed(key, "true or false", |v| if let Value::Boolean(b) = v { Some(*b) } else { None })
    }

    /// A table.
    pub fn table(&mut self, key: &'static str) -> Option<&'t Table> {
        self.typed(key, "a table", |v| if let Value::Table(t) = v { Some(t) } else { None })
    }

    /// An integer within bounds.
    pub fn integer(&mut self, key: &'static str, least: i64, most: i64) -> Option<i64> {
        let value = self.typed(key, "an integer", |v| if let Value::Integer(i) = v { Some(*i) } else { None })?;
        if (least..=most).contains(&value) {
            return Some(value);
        }
        let place = self.node(key)?.place.clone();
        self.problem(&place, format!("`{key}` is {value}; it must lie between {least} and {most}"));
        None
    }

    /// A time above 0 and at most a day. `seconds` is the length of the unit.
    pub fn time(&mut self, key: &'static str, unit: &str, seconds: f64) -> Option<Duration> {
        let value = self.typed(key, &format!("a number of {unit}"), Value::as_number)?;
        let time = value * seconds;
        if time > 0.0 && time <= 86_400.0 {
            return Some(Duration::from_secs_f64(time));
        }
        let place = self.node(key)?.place.clone();
        self.problem(&place, format!("`{key}` is {value} {unit}; it must be above 0 and at most a day"));
        None
    }

    /// Adds a mistake for every key that was not read.
    pub fn finish(self) {
        for entry in &self.table.entries {
            if !self.known.contains(&entry.key.as_str()) {
                // Suggestions take time, and only the first mistakes are reported.
                let is_reported = self.problems.len() < MAX_PROBLEMS;
                let known = self.known.iter().copied().filter(|_| is_reported);
                let hint = suggestion(&entry.key, known);
                let text = format!("unknown key `{}` in {}{hint}", entry.key, self.title);
                self.problems.push(Problem { place: entry.place.clone(), text });
            }
        }
    }
}

/// Sorts mistakes by place. Mistakes of the command line come last.
#[must_use]
pub fn in_order(file: &Path, mut list: Vec<Problem>) -> Problems {
    list.sort_by_key(|p| match p.place {
        Place::File { line, column } => (line, column),
        Place::Override(_) => (usize::MAX, 0),
    });
    list.dedup();
    let more = list.len().saturating_sub(MAX_PROBLEMS);
    list.truncate(MAX_PROBLEMS);
    Problems { file: file.to_owned(), list, more }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(line: usize, column: usize) -> Place {
        Place::File { line, column }
    }

    #[test]
    fn values_know_their_places_and_tables_keep_the_order_of_the_file() {
        let table = parse("b = 1\n\n[z.y]\n  \"ä\" = \"ö\"\nk = [1, 2.5]\n[a]\n").unwrap();
        assert_eq!(table.entries.iter().map(|e| e.key.as_str()).collect::<Vec<_>>(), ["b", "z", "a"]);
        assert_eq!(table.get("b").unwrap().node.place, at(1, 5));
        let Value::Table(z) = &table.get("z").unwrap().node.value else { panic!() };
        let Value::Table(y) = &z.get("y").unwrap().node.value else { panic!() };
        assert_eq!((&y.get("ä").unwrap().place, &y.get("ä").unwrap().node.place), (&at(4, 3), &at(4, 9)));
        assert_eq!(y.get("k").unwrap().node.value.to_json(), serde_json::json!([1, 2.5]));
    }

    #[test]
    fn places_are_those_of_a_plain_count() {
        let text = format!("a = 1\n\n# {}\nb = \"ö\"", "é脑x".repeat(400));
        let places = Places::of(&text);
        for (at, _) in text.char_indices().chain([(text.len(), ' ')]) {
            let before = &text[..at];
            let start = before.rfind('\n').map_or(0, |i| i + 1);
            let (line, column) = (before.matches('\n').count() + 1, before[start..].chars().count() + 1);
            assert_eq!(places.place(at), Place::File { line, column }, "byte {at}");
        }
        assert_eq!(Places::of("").place(7), Place::File { line: 1, column: 1 });
    }

    #[test]
    fn only_the_first_mistakes_are_listed() {
        let list = (1..=50).map(|line| Problem { place: at(line, 1), text: format!("wrong {line}\u{1b}") }).collect();
        let problems = in_order("x\n.toml".as_ref(), list);
        let lines: Vec<_> = problems.lines().collect();
        assert_eq!(lines.len(), MAX_PROBLEMS + 1);
        assert_eq!(lines[0], "x\\n.toml:1:1: wrong 1\\u001b");
        assert_eq!(lines[MAX_PROBLEMS], "x\\n.toml: 30 further mistakes");
    }

    #[test]
    fn syntax_error_has_a_place() {
        let problem = parse("a = 1\nb = [1,\n").unwrap_err();
        let Place::File { line, .. } = problem.place else { panic!() };
        assert!((2..=3).contains(&line), "{problem:?}");
        assert!(!problem.text.contains('\n'));
        let twice = parse("a = 1\na = 2\n").unwrap_err();
        assert_eq!((&twice.place, twice.text.as_str()), (&at(2, 1), "duplicate key"));
    }

    #[test]
    fn an_override_is_typed_where_it_can_be() {
        let mut table = parse("[service.a]\nstop = 1\n").unwrap();
        for set in [
            "service.a.stop=2.5",
            "service.a.params.scene=/x/a b.toml",
            "service.a.params.list=[1, 2]",
            "service.a.env.\"A.B\"=true",
            "service.a.params.version=1.2.3",
            "service.a.params.text=a = b",
        ] {
            override_with(&mut table, set).unwrap();
        }
        let expected = serde_json::json!({"service": {"a": {"stop": 2.5,
            "params": {"scene": "/x/a b.toml", "list": [1, 2], "version": "1.2.3", "text": "a = b"},
            "env": {"A.B": true}}}});
        assert_eq!(serde_json::Value::Object(table.to_json()), expected);
        for bad in ["service", "=3", "a b=3", ".a=3"] {
            assert!(override_with(&mut table, bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn near_names_are_suggested_and_others_listed() {
        assert_eq!(suggestion("exce", ["exec", "role"]), "; did you mean `exec`?");
        assert_eq!(suggestion("Selectoin", ["scene", "selection"]), "; did you mean `selection`?");
        assert_eq!(suggestion("xyz", ["exec", "role"]), "; there are `exec`, `role`");
        assert_eq!(suggestion("xyz", []), "");
    }
}
