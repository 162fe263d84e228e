//! Status lines on standard error, and formats for them: colours and times.

use std::borrow::Cow;
use std::io::{self, IsTerminal, Write};

use sg_input::{print, printable, printable_lines};

/// Writes a status line to standard error. Text of files and messages is escaped, and [`paint`]ed parts are coloured.
/// Ignores a closed stream: supervision goes on without a reader.
pub fn print_status(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", rendered(&print::shortened(line), printable));
}

/// The text of a result for a terminal: as [`print_status`] writes it, with all its lines.
#[must_use]
pub fn rendered_lines(text: &str) -> String {
    rendered(text, printable_lines)
}

/// Whether lines on this stream may be coloured: it is a terminal, and `NO_COLOR` (no-color.org) is not set.
#[must_use]
pub fn may_color(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// A colour of the terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// Red.
    Red,
    /// Green.
    Green,
    /// Yellow.
    Yellow,
    /// Blue.
    Blue,
    /// Magenta.
    Magenta,
    /// Cyan.
    Cyan,
    /// The text colour, dimmed.
    Faint,
}

/// A mark in painted text, and the code of its colour. Escape codes in a text are written by [`print_status`] alone, so that
/// no other text can hold one. Noncharacters are for such use within one program.
const MARKS: [(char, u8); 8] = [
    ('\u{fdd0}', 0),
    ('\u{fdd1}', 31),
    ('\u{fdd2}', 32),
    ('\u{fdd3}', 33),
    ('\u{fdd4}', 34),
    ('\u{fdd5}', 35),
    ('\u{fdd6}', 36),
    ('\u{fdd7}', 2),
];

/// The text with the marks of a colour, or unchanged if `colored` is false.
#[must_use]
pub fn paint(color: Color, text: &str, colored: bool) -> String {
    if !colored {
        return text.to_owned();
    }
    let code = match color {
        Color::Red => 31,
        Color::Green => 32,
        Color::Yellow => 33,
        Color::Blue => 34,
        Color::Magenta => 35,
        Color::Cyan => 36,
        Color::Faint => 2,
    };
    let mark = |code: u8| MARKS.iter().find(|(_, c)| *c == code).map(|(mark, _)| *mark).into_iter();
    mark(code).chain(text.chars()).chain(mark(0)).collect()
}

/// Text with escape codes in place of the marks. `escape` makes the parts between them printable.
fn rendered<'a>(text: &'a str, escape: impl Fn(&'a str) -> Cow<'a, str>) -> String {
    let code = |c: char| MARKS.iter().find(|(mark, _)| *mark == c).map(|(_, code)| *code);
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((at, mark)) = rest.char_indices().find(|(_, c)| code(*c).is_some()) {
        let (part, after) = rest.split_at(at);
        out.push_str(&escape(part));
        out.push_str(&code(mark).map_or_else(String::new, |code| format!("\u{1b}[{code}m")));
        rest = after.get(mark.len_utf8()..).unwrap_or_default();
    }
    out.push_str(&escape(rest));
    out
}

/// The text without the marks of [`paint`].
#[must_use]
pub fn without_color(text: &str) -> String {
    text.chars().filter(|c| MARKS.iter().all(|(mark, _)| mark != c)).collect()
}

/// A time in milliseconds for people: `312 ms`, `1.4 s`, `2 min 5 s`, `3 h 20 min`.
#[must_use]
pub fn format_time(ms: f64) -> String {
    let seconds = ms / 1000.0;
    match ms {
        ms if ms < 9.95 => format!("{ms:.1} ms"),
        ms if ms < 999.5 => format!("{ms:.0} ms"),
        ms if ms < 59_950.0 => format!("{seconds:.1} s"),
        ms if ms < 3_600_000.0 => format!("{} min {:.0} s", (seconds / 60.0).floor(), (seconds % 60.0).floor()),
        _ => format!("{} h {:.0} min", (seconds / 3600.0).floor(), (seconds % 3600.0 / 60.0).floor()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_removed() {
        let text = format!("  scene  {} after 1 s", paint(Color::Green, "ready", true));
        assert_eq!(without_color(&text), "  scene  ready after 1 s");
    }

    #[test]
    fn only_painted_text_has_escape_codes() {
        let line = format!("{} \u{1b}[2J{}", paint(Color::Red, "FAILED", true), paint(Color::Red, "x", false));
        assert_eq!(rendered(&line, printable), "\u{1b}[31mFAILED\u{1b}[0m \\u001b[2Jx");
        assert_eq!(rendered_lines("a\n\u{202e}b"), "a\n\\u202eb");
    }

    #[test]
    fn times_have_a_unit_that_fits() {
        let times = [0.04, 312.4, 999.7, 1400.0, 59_949.0, 125_000.0, 12_000_000.0].map(format_time);
        assert_eq!(times, ["0.0 ms", "312 ms", "1.0 s", "1.4 s", "59.9 s", "2 min 5 s", "3 h 20 min"]);
    }
}
