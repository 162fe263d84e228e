//! Lines and results of commands, safe for a terminal.
//!
//! What a command says comes from files and arguments in part, so all of it is escaped here.

use std::borrow::Cow;
use std::io::{self, Write};

use crate::printable::{printable, printable_lines};

/// Most characters of a line on standard error. A name in a file can be as long as the file.
const MAX_LINE: usize = 4000;
/// Characters that stay of the end of a longer line: the remedy stands there.
const END_OF_LINE: usize = 400;

/// Writes one line to standard error. A closed stream is ignored. The middle of a very long line is left out.
pub fn status(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", shortened(&printable(line)));
}

/// The line, with the middle of a very long one left out.
#[must_use]
pub fn shortened(line: &str) -> Cow<'_, str> {
    let start = line.char_indices().nth(MAX_LINE - END_OF_LINE);
    let end = line.char_indices().rev().nth(END_OF_LINE - 1);
    match (start, end, line.char_indices().nth(MAX_LINE)) {
        (Some((start, _)), Some((end, _)), Some(_)) => {
            let part = |range: &str| range.to_owned();
            let (head, tail) = (line.get(..start).map(part), line.get(end..).map(part));
            let left_out = line.get(start..end).map_or(0, |middle| middle.chars().count());
            let (head, tail) = (head.unwrap_or_default(), tail.unwrap_or_default());
            Cow::Owned(format!("{head}… {left_out} characters …{tail}"))
        }
        _ => Cow::Borrowed(line),
    }
}

/// Writes lines to standard error, such as the report of a wrong command line. A closed stream is ignored.
pub fn status_lines(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", printable_lines(text.trim_end_matches('\n')));
}

/// Writes a result of one or more lines to standard output, with a line end.
///
/// # Errors
/// The system's error. A reader that has seen enough and left is none.
pub fn result(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", printable_lines(text.trim_end_matches('\n'))).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        done => done,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_keep_their_ends() {
        let line = format!("start{}remedy", "é".repeat(10_000));
        let short = shortened(&line);
        assert!(short.starts_with("start") && short.ends_with("remedy"), "{short}");
        assert!(short.contains("… 6011 characters …") && short.chars().count() < 4100, "{short}");
        assert_eq!(shortened("short"), "short");
    }
}
