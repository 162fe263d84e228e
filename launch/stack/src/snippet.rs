//! Reports of mistakes with the lines of the file that they are in.

use codespan_reporting::diagnostic::{Diagnostic, Label};
use codespan_reporting::files::SimpleFile;
use codespan_reporting::term::{self, Config};

use crate::document::{Place, Problems};

/// Indentation of the lines below a mistake.
const INDENT: &str = "  ";
/// Longest line of a file that is shown, bytes.
const LONGEST_LINE: usize = 1000;

/// Each mistake as a line `FILE:LINE:COLUMN: text`, followed by the line of `text` that it is in.
///
/// Lines of the file are indented. Mistakes of the command line have none.
#[must_use]
pub fn report(problems: &Problems, text: &str) -> Vec<String> {
    let file = SimpleFile::new("", text);
    let mut lines = Vec::new();
    for (at, line) in problems.lines().enumerate() {
        lines.push(line);
        if let Some(Place::File { line, column }) = problems.list.get(at).map(|p| &p.place) {
            lines.extend(snippet(&file, text, *line, *column));
        }
    }
    lines
}

/// The line of a place, with its word marked.
fn snippet(file: &SimpleFile<&str, &str>, text: &str, line: usize, column: usize) -> Vec<String> {
    let source = text.split('\n').nth(line.saturating_sub(1)).unwrap_or_default();
    if source.len() > LONGEST_LINE {
        return Vec::new();
    }
    let start = offset(text, line, column);
    let word = text.get(start..).map_or(0, word_length);
    let diagnostic = Diagnostic::error().with_label(Label::primary((), start..start + word));
    // The source is in memory. Without a snippet the mistake itself is still reported.
    let rendered = term::emit_into_string(&Config::default(), file, &diagnostic).unwrap_or_default();
    // The header repeats the line of the mistake.
    let body = rendered.lines().skip_while(|l| !l.contains('│'));
    body.map(str::trim_end).filter(|l| !l.is_empty()).map(|l| format!("{INDENT}{l}")).collect()
}

/// Byte offset of a place. Lines and columns are counted from 1, columns in characters.
fn offset(text: &str, line: usize, column: usize) -> usize {
    let before: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
    let within = text.get(before..).unwrap_or_default();
    before + within.chars().take_while(|c| *c != '\n').take(column.saturating_sub(1)).map(char::len_utf8).sum::<usize>()
}

/// Bytes of the TOML key or value that a text begins with, on its first line.
fn word_length(text: &str) -> usize {
    let line = text.split('\n').next().unwrap_or_default();
    let quoted = |quote: char| line.get(1..).and_then(|rest| rest.find(quote)).map(|end| end + 2);
    match line.chars().next() {
        None => 0,
        Some(quote @ ('"' | '\'')) => quoted(quote).unwrap_or(line.len()),
        Some(first) => line.find([' ', '\t', '=', ',', ']', '}']).unwrap_or(line.len()).max(first.len_utf8()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::{Problem, in_order};

    #[test]
    fn a_mistake_is_reported_with_its_line() {
        let text = "schema = 1\n[service.ä]\nexec = \"./plain\"\n";
        let list = vec![
            Problem { place: Place::File { line: 3, column: 8 }, text: "not executable".into() },
            Problem { place: Place::Override("a=1".into()), text: "unknown".into() },
        ];
        let report = report(&in_order("x.toml".as_ref(), list), text);
        let (first, last) = (report[0].as_str(), report[report.len() - 1].as_str());
        assert_eq!((first, last), ("x.toml:3:8: not executable", "--set a=1: unknown"), "{report:?}");
        assert!(report.iter().any(|l| l.ends_with("3 │ exec = \"./plain\"")), "{report:?}");
        assert!(report.iter().any(|l| l.ends_with("        ^^^^^^^^^")), "{report:?}");
        assert!(report[1..report.len() - 1].iter().all(|l| l.starts_with(INDENT)), "{report:?}");
    }

    #[test]
    fn places_beyond_the_text_have_no_word() {
        assert_eq!((offset("ab\ncd", 2, 2), offset("ab", 9, 9), offset("", 1, 1)), (4, 2, 0));
        assert_eq!(
            (word_length(""), word_length("= 1"), word_length("\"a b\" = 1"), word_length("key = 1")),
            (0, 1, 5, 3)
        );
    }
}
