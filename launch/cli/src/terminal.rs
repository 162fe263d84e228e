//! Output of commands: results on standard output, everything else on standard error.

use std::io::{self, Write};
use std::process::ExitCode;

use comfy_table::{CellAlignment, Table, presets};
pub(crate) use sg_input::number_format::grouped as format_count;
use sg_runtime::process::{EXIT_FAILED, EXIT_INPUT};
use sg_stack::StackError;
pub(crate) use sg_stack::terminal::{Color, format_time, paint, print_status};
use sg_stack::terminal::{may_color, rendered_lines};

/// Writes a line of the result, or several. Text of files and messages is escaped. A closed reader ends the command quietly, as in other programs.
pub(crate) fn print_line(line: &str) {
    let mut stdout = io::stdout().lock();
    if writeln!(stdout, "{}", rendered_lines(line)).and_then(|()| stdout.flush()).is_err() {
        std::process::exit(0);
    }
}

/// Whether lines on standard output may be coloured.
pub(crate) fn stdout_colored() -> bool {
    may_color(&io::stdout())
}

/// Failure of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Failure {
    /// The arguments or the input are wrong.
    Input(String),
    /// The work failed.
    Work(String),
    /// The input has mistakes, one line each. Indented lines belong to the mistake above them.
    Mistakes(Vec<String>),
    /// The work failed for several reasons, one line each.
    Faults(Vec<String>),
    /// A child program has reported its failure. Its exit status is passed on.
    Reported(u8),
}

impl Failure {
    /// The text to print; empty if it was printed already.
    pub(crate) fn text(&self) -> String {
        self.lines().join("\n")
    }

    fn lines(&self) -> Vec<&str> {
        match self {
            Self::Input(line) | Self::Work(line) => vec![line],
            Self::Mistakes(lines) | Self::Faults(lines) => lines.iter().map(String::as_str).collect(),
            Self::Reported(_) => Vec::new(),
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
            SessionError::InvalidName(_) | SessionError::NotRunning { .. } | SessionError::Ambiguous(_) => {
                Self::Input(error.to_string())
            }
            _ => Self::Work(error.to_string()),
        }
    }
}

impl From<StackError> for Failure {
    fn from(error: StackError) -> Self {
        match error {
            StackError::Session(error) => error.into(),
            StackError::Bus(error) => error.into(),
            StackError::Refused(fault) => Self::Input(fault.to_string()),
            _ => Self::Work(error.to_string()),
        }
    }
}

/// Result of a command.
pub(crate) type CommandResult = Result<(), Failure>;

/// Prints a failure once. Returns the exit status.
pub(crate) fn exit_code(done: CommandResult) -> ExitCode {
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let colored = may_color(&io::stderr());
            for line in failure.lines() {
                // Indented lines belong to the error above them.
                let mark = if line.starts_with("  ") { String::new() } else { paint(Color::Red, "error: ", colored) };
                print_status(&format!("{mark}{line}"));
            }
            ExitCode::from(match failure {
                Failure::Input(_) | Failure::Mistakes(_) => EXIT_INPUT,
                Failure::Work(_) | Failure::Faults(_) => EXIT_FAILED,
                Failure::Reported(status) => status,
            })
        }
    }
}

/// Aligns rows in columns, two blanks apart. The first row holds the titles. Columns of numbers (cells that begin with a
/// digit) are right-aligned.
pub(crate) fn columns(rows: &[Vec<String>]) -> Vec<String> {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).add_rows(rows);
    for (c, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        let mut cells = rows.iter().skip(1).filter_map(|row| row.get(c));
        if cells.all(|cell| cell.starts_with(|c: char| c.is_ascii_digit())) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.trim_fmt().lines().map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let cell = |s: &str| s.to_owned();
        let rows = vec![vec![cell("NAME"), cell("PID"), cell("WHY")], vec![cell("scene"), cell("12345"), cell("")]];
        assert_eq!(columns(&rows), ["NAME     PID  WHY", "scene  12345"]);
        let wide = vec![vec![cell("NAME"), cell("STATE")], vec![cell("脑"), cell("ready")]];
        assert_eq!(columns(&wide), ["NAME  STATE", "脑    ready"], "a wide character takes two places");
    }
}
