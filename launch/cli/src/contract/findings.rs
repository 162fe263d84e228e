//! Results of a contract check, for people and programs.

use serde_json::{Value, json};

use crate::terminal::{self, Color, paint};

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Outcome {
    /// Passed, with a summary.
    Passed(String),
    /// Failed, with the problems.
    Failed(Vec<String>),
    /// Skipped, with the reason.
    Skipped(String),
}

/// Results in order.
#[derive(Debug, Default)]
pub(super) struct Findings(Vec<(String, Outcome)>);

impl Findings {
    /// Adds a result: passed if there are no problems.
    pub(super) fn add_result(&mut self, what: impl Into<String>, problems: Vec<String>, summary: impl Into<String>) {
        let outcome = if problems.is_empty() { Outcome::Passed(summary.into()) } else { Outcome::Failed(problems) };
        self.0.push((what.into(), outcome));
    }

    /// Adds a skipped check.
    pub(super) fn skip(&mut self, what: impl Into<String>, why: impl Into<String>) {
        self.0.push((what.into(), Outcome::Skipped(why.into())));
    }

    /// Number of failed checks.
    pub(super) fn broken(&self) -> usize {
        self.0.iter().filter(|(_, outcome)| matches!(outcome, Outcome::Failed(_))).count()
    }

    /// Number of checks that ran.
    pub(super) fn checked(&self) -> usize {
        self.0.iter().filter(|(_, outcome)| !matches!(outcome, Outcome::Skipped(_))).count()
    }

    pub(super) fn print(&self) {
        let colored = terminal::stdout_colored();
        let width = self.0.iter().map(|(what, _)| what.chars().count()).max().unwrap_or(0);
        for (what, outcome) in &self.0 {
            match outcome {
                Outcome::Passed(text) => {
                    terminal::print_line(&format!(
                        "{}        {what:<width$}  {text}",
                        paint(Color::Green, "ok", colored)
                    ));
                }
                Outcome::Skipped(why) => {
                    terminal::print_line(&format!(
                        "{}   {what:<width$}  {why}",
                        paint(Color::Yellow, "SKIPPED", colored)
                    ));
                }
                Outcome::Failed(problems) => {
                    terminal::print_line(&format!("{}    {what}", paint(Color::Red, "FAILED", colored)));
                    for complaint in problems.iter().flat_map(|c| c.lines()) {
                        terminal::print_line(&format!("          {complaint}"));
                    }
                }
            }
        }
    }

    pub(super) fn as_json(&self) -> Value {
        let one = |(what, outcome): &(String, Outcome)| match outcome {
            Outcome::Passed(text) => json!({"check": what, "outcome": "ok", "details": [text]}),
            Outcome::Skipped(why) => json!({"check": what, "outcome": "skipped", "details": [why]}),
            Outcome::Failed(problems) => json!({"check": what, "outcome": "failed", "details": problems}),
        };
        self.0.iter().map(one).collect()
    }
}
