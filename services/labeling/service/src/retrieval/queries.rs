//! Texts with the units that they mean, in a file of lines: a text, a tab, and the name of a unit.
//!
//! An empty name, or `-`, says that the text means nothing in the scenes. Empty lines and lines that begin with `#` are left out.

use std::io;
use std::path::{Path, PathBuf};

use sg_input::{file, limits};

/// Most queries of a file. Each is encoded and compared with all units.
const MAX_QUERIES: usize = 10_000;
/// Longest text, bytes: as in a session.
const MAX_TEXT_BYTES: usize = 512;
/// Unit of a text that means nothing.
const NOTHING: &str = "-";

/// Why the queries of a file are of no use.
#[derive(Debug, thiserror::Error)]
pub(super) enum QueriesError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A line is wrong.
    #[error("{path}, line {line}: {problem}")]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// There is no query.
    #[error("{path} has no query; write lines of a text, a tab, and the name of a unit")]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// A text and what it means.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Query {
    pub(super) text: String,
    /// The name of the unit that it means. `None` if it means nothing.
    pub(super) unit: Option<String>,
    line: usize,
}

/// The queries of a file.
///
/// # Errors
/// [`QueriesError`] with the file and the line.
pub(super) fn read(path: &Path) -> Result<Vec<Query>, QueriesError> {
    let text = file::read_text(path, limits::SMALL_TEXT_BYTES);
    let text = text.map_err(|source| QueriesError::File { path: path.to_path_buf(), source })?;
    parse(path, &text)
}

/// The queries of a text. `path` names it in errors.
///
/// # Errors
/// [`QueriesError`] with the line.
pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<Query>, QueriesError> {
    let mut queries = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        if content.trim().is_empty() || content.starts_with('#') {
            continue;
        }
        let wrong = |problem: String| QueriesError::Line { path: path.to_path_buf(), line, problem };
        let Some((text, unit)) = content.split_once('\t') else {
            return Err(wrong("it has no tab; write a text, a tab, and the name of a unit".to_owned()));
        };
        if unit.contains('\t') {
            return Err(wrong("it has several tabs; write a text, one tab, and the name of a unit".to_owned()));
        }
        let (text, unit) = (text.trim(), unit.trim());
        if text.is_empty() {
            return Err(wrong("it has no text before the tab".to_owned()));
        }
        if text.len() > MAX_TEXT_BYTES {
            let found = text.len();
            return Err(wrong(format!("the text has {found} bytes; the limit is {MAX_TEXT_BYTES}")));
        }
        if queries.len() == MAX_QUERIES {
            return Err(wrong(format!("there are more than {MAX_QUERIES} queries; split the file")));
        }
        let unit = (!unit.is_empty() && unit != NOTHING).then(|| unit.to_owned());
        queries.push(Query { text: text.to_owned(), unit, line });
    }
    if queries.is_empty() { Err(QueriesError::Empty { path: path.to_path_buf() }) } else { Ok(queries) }
}

/// Refuses a query for a unit that is not among these names.
///
/// # Errors
/// [`QueriesError`] with the line.
pub(super) fn check(path: &Path, queries: &[Query], names: &[&str]) -> Result<(), QueriesError> {
    let unknown = queries.iter().find_map(|query| {
        let unit = query.unit.as_deref().filter(|unit| !names.contains(unit))?;
        Some((query.line, unit))
    });
    let Some((line, unit)) = unknown else { return Ok(()) };
    let problem = format!("no scene has a unit `{unit}`; write `{NOTHING}` for a text that means nothing");
    Err(QueriesError::Line { path: path.to_path_buf(), line, problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Vec<Query>, String> {
        parse(Path::new("texts.tsv"), text).map_err(|e| e.to_string())
    }

    #[test]
    fn texts_mean_units_or_nothing() {
        let text = "# text\tunit\n\nthe hard part\tbone\r\n  the moon \t-\nthe sun\t\n a b\t two words \n";
        let query =
            |text: &str, unit: Option<&str>, line| Query { text: text.into(), unit: unit.map(str::to_owned), line };
        let expected = [
            query("the hard part", Some("bone"), 3),
            query("the moon", None, 4),
            query("the sun", None, 5),
            query("a b", Some("two words"), 6),
        ];
        assert_eq!(parsed(text).unwrap(), expected);
    }

    #[test]
    fn damaged_lines_are_named() {
        for (text, problem) in [
            ("a\tb\nthe hard part bone", "texts.tsv, line 2: it has no tab; "),
            ("\n#\na\tb\tc", "texts.tsv, line 3: it has several tabs; "),
            ("a\tb\n \tbone", "texts.tsv, line 2: it has no text before the tab"),
            (
                format!("{}\tbone", "a".repeat(513)).as_str(),
                "texts.tsv, line 1: the text has 513 bytes; the limit is 512",
            ),
            ("# nothing\n\n", "texts.tsv has no query; "),
            ("a\tb\n".repeat(MAX_QUERIES + 1).as_str(), "texts.tsv, line 10001: there are more than 10000 queries"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.starts_with(problem), "{error}");
        }
    }

    #[test]
    fn a_unit_that_no_scene_has_is_refused() {
        let path = Path::new("texts.tsv");
        let queries = parsed("the hard part\tbone\n\nthe moon\t-\nthe tube\tvein").unwrap();
        assert!(check(path, &queries, &["vein", "bone"]).is_ok());
        let error = check(path, &queries, &["bone"]).unwrap_err().to_string();
        assert_eq!(error, "texts.tsv, line 4: no scene has a unit `vein`; write `-` for a text that means nothing");
    }

    #[test]
    fn a_file_is_read_and_a_missing_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("texts.tsv");
        let missing = read(&path).unwrap_err().to_string();
        assert!(missing.contains("texts.tsv: No such file"), "{missing}");
        std::fs::write(&path, "the hard part\tbone\n").unwrap();
        assert_eq!(read(&path).unwrap().len(), 1);
        std::fs::write(&path, b"a\tb\n\xff\tc").unwrap();
        let damaged = read(&path).unwrap_err().to_string();
        assert!(damaged.contains("line 2"), "{damaged}");
    }
}
