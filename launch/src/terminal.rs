//! Words for people and for programs: what was asked for goes to standard output, everything else to standard error.

use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;

use sg_runtime::process::{EXIT_FAILED, EXIT_INPUT};

/// Writes a line that was asked for. A reader that went away ends the command quietly, as it does for other programs.
pub(crate) fn out(line: &str) {
    let mut stdout = io::stdout().lock();
    if writeln!(stdout, "{line}").and_then(|()| stdout.flush()).is_err() {
        std::process::exit(0);
    }
}

/// Writes a line about what goes on. Nobody to read it is no reason to stop.
pub(crate) fn tell(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// Whether lines on standard error may be coloured.
pub(crate) fn colored() -> bool {
    io::stderr().is_terminal() && color_is_wanted()
}

/// Whether lines on standard output may be coloured.
pub(crate) fn stdout_colored() -> bool {
    io::stdout().is_terminal() && color_is_wanted()
}

/// The convention of no-color.org.
fn color_is_wanted() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// A colour of the terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ink {
    Red,
    Green,
    Yellow,
    Blue,
    Magenta,
    Cyan,
    Faint,
}

/// The text in a colour, where that is wanted.
pub(crate) fn paint(ink: Ink, text: &str, colored: bool) -> String {
    if !colored {
        return text.to_owned();
    }
    let code = match ink {
        Ink::Red => 31,
        Ink::Green => 32,
        Ink::Yellow => 33,
        Ink::Blue => 34,
        Ink::Magenta => 35,
        Ink::Cyan => 36,
        Ink::Faint => 2,
    };
    format!("\u{1b}[{code}m{text}\u{1b}[0m")
}

/// Why a command did not do what was asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Failure {
    /// The arguments or the input are wrong.
    Input(String),
    /// The work failed.
    Work(String),
    /// A program that was started has told its failure itself; its exit status is passed on.
    Told(u8),
}

impl Failure {
    /// What is still to be told; empty where it has been told.
    pub(crate) fn text(&self) -> &str {
        match self {
            Self::Input(text) | Self::Work(text) => text,
            Self::Told(_) => "",
        }
    }
}

impl From<sg_runtime::fault::Fault> for Failure {
    fn from(fault: sg_runtime::fault::Fault) -> Self {
        let details = if fault.details.is_empty() { String::new() } else { format!(" ({})", fault.details.join("; ")) };
        Self::Work(format!("{fault}{details}"))
    }
}

impl From<sg_runtime::bus::BusError> for Failure {
    fn from(error: sg_runtime::bus::BusError) -> Self {
        Self::Work(error.to_string())
    }
}

impl From<sg_runtime::session::SessionError> for Failure {
    fn from(error: sg_runtime::session::SessionError) -> Self {
        use sg_runtime::session::SessionError;
        match error {
            SessionError::Name(_) | SessionError::Unknown { .. } | SessionError::Many(_) => {
                Self::Input(error.to_string())
            }
            _ => Self::Work(error.to_string()),
        }
    }
}

/// What a command comes to.
pub(crate) type Done = Result<(), Failure>;

/// Tells a failure, once, and gives the exit status.
pub(crate) fn finish(done: Done) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let colored = colored();
            for line in failure.text().lines() {
                tell(&format!("{} {line}", paint(Ink::Red, "error:", colored)));
            }
            ExitCode::from(match failure {
                Failure::Input(_) => EXIT_INPUT,
                Failure::Work(_) => EXIT_FAILED,
                Failure::Told(status) => status,
            })
        }
    }
}

/// Rows as columns of equal width, two blanks apart; numbers (cells that begin with a digit) to the right.
pub(crate) fn columns(rows: &[Vec<String>]) -> Vec<String> {
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<_> = (0..count).map(width).collect();
    let numeric: Vec<_> = (0..count)
        .map(|c| {
            rows.iter().skip(1).filter_map(|r| r.get(c)).all(|cell| cell.starts_with(|c: char| c.is_ascii_digit()))
        })
        .collect();
    rows.iter()
        .map(|row| {
            let cells = row.iter().zip(widths.iter().zip(&numeric)).map(|(cell, (width, numeric))| {
                if *numeric { format!("{cell:>width$}") } else { format!("{cell:<width$}") }
            });
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        })
        .collect()
}

/// A time for people: `312 ms`, `1.4 s`, `2 min 5 s`, `3 h 20 min`.
pub(crate) fn time(ms: f64) -> String {
    let seconds = ms / 1000.0;
    match ms {
        ms if ms < 9.95 => format!("{ms:.1} ms"),
        ms if ms < 999.5 => format!("{ms:.0} ms"),
        ms if ms < 59_950.0 => format!("{seconds:.1} s"),
        ms if ms < 3_600_000.0 => format!("{} min {:.0} s", (seconds / 60.0).floor(), (seconds % 60.0).floor()),
        _ => format!("{} h {:.0} min", (seconds / 3600.0).floor(), (seconds % 3600.0 / 60.0).floor()),
    }
}

/// A whole number with thousands apart: `1,234,567`.
pub(crate) fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_times_read_well() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1,000", "1,234,567"]);
        let times = [0.04, 312.4, 999.7, 1400.0, 59_949.0, 125_000.0, 12_000_000.0].map(time);
        assert_eq!(times, ["0.0 ms", "312 ms", "1.0 s", "1.4 s", "59.9 s", "2 min 5 s", "3 h 20 min"]);
    }

    #[test]
    fn columns_line_up() {
        let cell = |s: &str| s.to_owned();
        let rows = vec![vec![cell("NAME"), cell("PID"), cell("WHY")], vec![cell("scene"), cell("12345"), cell("")]];
        assert_eq!(columns(&rows), ["NAME     PID  WHY", "scene  12345"]);
    }
}
