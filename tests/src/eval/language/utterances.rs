//! Sets of utterances with the state that each has to lead to.

use std::path::PathBuf;

use serde::Deserialize;
use sg_input::{file, limits, printable};

use super::condition::Condition;
use crate::eval::EvalError;

/// The sets that come with the program, by name.
const OWN: [(&str, &str); 3] = [
    ("first", include_str!("first.toml")),
    ("second", include_str!("second.toml")),
    ("third", include_str!("third.toml")),
];

/// A set of one author.
#[derive(Debug, Clone, PartialEq)]
pub struct UtteranceSet {
    /// Its name.
    pub name: String,
    /// Its utterances.
    pub utterances: Vec<Utterance>,
}

/// What is said, and what has to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Utterance {
    /// Kind, for the table.
    pub kind: String,
    /// Turns of one conversation, in order.
    pub say: Vec<String>,
    /// Conditions on the state at the end.
    pub expect: Vec<Condition>,
    /// Whether a part of the vessels is selected at the start.
    pub selected: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    utterance: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    kind: String,
    say: Vec<String>,
    expect: Vec<String>,
    #[serde(default)]
    selected: bool,
}

/// The sets that come with the program.
///
/// # Errors
/// [`EvalError::Data`] for a set that is none.
pub fn own() -> Result<Vec<UtteranceSet>, EvalError> {
    OWN.iter().map(|(name, text)| parse(name, text)).collect()
}

/// Sets from files.
///
/// # Errors
/// [`EvalError::Data`] for a file that is no set.
pub fn read(paths: &[PathBuf]) -> Result<Vec<UtteranceSet>, EvalError> {
    let read = |path: &PathBuf| {
        // The name is a heading of the table, too.
        let name = printable(&path.display().to_string()).into_owned();
        let text = file::read_text(path, limits::SMALL_TEXT_BYTES);
        let text = text.map_err(|e| EvalError::Data { path: name.clone(), why: e.to_string() })?;
        parse(&name, &text)
    };
    paths.iter().map(read).collect()
}

/// The set of a text.
///
/// # Errors
/// [`EvalError::Data`] names the utterance.
pub fn parse(name: &str, text: &str) -> Result<UtteranceSet, EvalError> {
    let wrong = |why: String| EvalError::Data { path: name.to_owned(), why };
    limits::check_toml_parts(text).map_err(wrong)?;
    let file: File = toml::from_str(text).map_err(|e| wrong(one_line(text, &e)))?;
    let utterance = |entry: Entry| {
        let about = entry.say.join(" / ");
        if entry.say.is_empty() || entry.expect.is_empty() {
            return Err(wrong(format!("“{about}” has nothing to say or to expect")));
        }
        let expect = entry.expect.iter().map(|text| Condition::parse(text)).collect::<Result<_, String>>();
        let expect = expect.map_err(|why| wrong(format!("“{about}”: {why}")))?;
        Ok(Utterance { kind: entry.kind, say: entry.say, expect, selected: entry.selected })
    };
    let utterances = file.utterance.into_iter().map(utterance).collect::<Result<_, EvalError>>()?;
    Ok(UtteranceSet { name: name.to_owned(), utterances })
}

/// An error of the parser with its line, without the text around it.
fn one_line(text: &str, error: &toml::de::Error) -> String {
    let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
    format!("line {}: {}", before.matches('\n').count() + 1, error.message().trim().replace('\n', ", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sets_are_whole_and_have_many_kinds() {
        let sets = own().unwrap();
        let all: Vec<&Utterance> = sets.iter().flat_map(|set| &set.utterances).collect();
        let mut kinds: Vec<&str> = all.iter().map(|utterance| utterance.kind.as_str()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        assert!(all.len() >= 400 && kinds.len() >= 20, "{} utterances of {kinds:?}", all.len());
    }

    #[test]
    fn the_third_set_is_there_and_says_nothing_twice() {
        let sets = own().unwrap();
        let names: Vec<&str> = sets.iter().map(|set| set.name.as_str()).collect();
        assert_eq!(names, ["first", "second", "third"]);
        let third = &sets[2].utterances;
        let mut said: Vec<&Vec<String>> = third.iter().map(|utterance| &utterance.say).collect();
        said.sort_unstable();
        said.dedup();
        assert_eq!((third.len(), said.len()), (240, 240));
    }

    #[test]
    fn only_short_regular_files_are_sets_and_each_error_is_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("set.toml");
        let refused = |part: &str| {
            let error = read(std::slice::from_ref(&path)).unwrap_err().to_string();
            assert!(error.contains("set.toml") && error.contains(part) && !error.contains('\n'), "{error}");
        };
        refused("No such file");
        std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
        refused("it is a device");
        std::fs::remove_file(&path).unwrap();
        for (text, part) in [
            ("# a\n[[utterance]\n".to_owned(), "line 2: "),
            ("#".repeat(2 << 20), "limit"),
            (format!("a = [{}]", "0,".repeat(400_000)), "the limit is"),
        ] {
            std::fs::write(&path, text).unwrap();
            refused(part);
        }
    }

    #[test]
    fn a_broken_set_is_refused_with_its_utterance() {
        let of = |say: &str, expect: &str| {
            parse("a set", &format!("[[utterance]]\nkind = 'a'\nsay = [{say}]\nexpect = [{expect}]"))
        };
        assert_eq!(of("'hide it'", "'unchanged'").unwrap().utterances[0].expect, [Condition::Unchanged]);
        let error = of("'hide it'", "'bone is gone'").unwrap_err().to_string();
        assert!(error.contains("a set") && error.contains("“hide it”") && error.contains("bone is gone"), "{error}");
        assert!(of("", "'unchanged'").is_err() && of("'hide it'", "").is_err());
    }
}
