//! Status lines on standard error, and formats for them: colours and times.

use std::io::{self, IsTerminal, Write};

/// Writes a status line to standard error. Ignores a closed stream: supervision goes on without a reader.
pub fn print_status(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
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

/// The text with the escape codes of a colour, or unchanged if `colored` is false.
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
    format!("\u{1b}[{code}m{text}\u{1b}[0m")
}

/// The text without escape codes of colours.
#[must_use]
pub fn without_color(text: &str) -> String {
    let mut parts = text.split("\u{1b}[");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |plain, part| plain + part.split_once('m').map_or(part, |(_, rest)| rest))
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
        assert_eq!(without_color("plain [m]"), "plain [m]");
    }

    #[test]
    fn times_have_a_unit_that_fits() {
        let times = [0.04, 312.4, 999.7, 1400.0, 59_949.0, 125_000.0, 12_000_000.0].map(format_time);
        assert_eq!(times, ["0.0 ms", "312 ms", "1.0 s", "1.4 s", "59.9 s", "2 min 5 s", "3 h 20 min"]);
    }
}
