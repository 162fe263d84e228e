//! Commands by words: what people say, played through a running stack, and the state in which the scene ends.
//!
//! `supergaussian eval language`. An utterance is right if the state after it meets all of its conditions, and nothing else has
//! changed. Each one begins from the same state. The authors of the sets had not seen how the program reads language. Failures of the
//! first two sets were looked at, and those of every second utterance of the third. The others of the third were only counted.

pub mod condition;
pub mod outcome;
mod player;
pub mod utterances;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use self::player::Player;
use self::utterances::UtteranceSet;
use super::EvalError;
use crate::bench::quantile;

/// What is measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Sets of one's own, in place of those that come with the program.
    pub sets: Vec<PathBuf>,
    /// Settings of the stack, as `supergaussian up --set` takes them: another backend of an agent.
    pub settings: Vec<String>,
    /// Every so manyth utterance.
    pub every: usize,
}

/// What became of an utterance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Played {
    /// Its kind.
    pub kind: String,
    /// What was said, turn by turn.
    pub say: Vec<String>,
    /// The replies.
    pub replies: Vec<String>,
    /// What does not hold; empty for an utterance that is right.
    pub problems: Vec<String>,
    /// Whether something changed that should not have.
    pub is_false_action: bool,
    /// Milliseconds from the last turn to its reply.
    pub milliseconds: f64,
}

/// One set, played.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Name of the set.
    pub set: String,
    /// Its utterances.
    pub played: Vec<Played>,
}

/// Plays all sets.
///
/// # Errors
/// [`EvalError::Data`] for a set that is none, or a stack that does not start or break off.
pub fn run(options: &Options, tell: &impl Fn(&str)) -> Result<Vec<Measured>, EvalError> {
    let sets = if options.sets.is_empty() { utterances::own()? } else { utterances::read(&options.sets)? };
    let mut player = Player::new(&options.settings)?;
    let mut measured = Vec::new();
    for UtteranceSet { name, utterances } in sets {
        let mut played = Vec::new();
        let chosen: Vec<_> = utterances.iter().step_by(options.every.max(1)).collect();
        for (at, utterance) in chosen.iter().enumerate() {
            if at % 20 == 0 {
                tell(&format!("{name}: {at} of {} utterances", chosen.len()));
            }
            played.push(player.play(utterance)?);
        }
        measured.push(Measured { set: name, played });
    }
    Ok(measured)
}

/// Numbers of right utterances, of all, and of false actions.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    right: usize,
    all: usize,
    false_actions: usize,
}

impl Count {
    fn of<'p>(played: impl Iterator<Item = &'p Played>) -> Self {
        played.fold(Self::default(), |count, played| Self {
            right: count.right + usize::from(played.problems.is_empty()),
            all: count.all + 1,
            false_actions: count.false_actions + usize::from(played.is_false_action),
        })
    }

    fn text(self) -> String {
        let share = 100.0 * self.right as f64 / self.all.max(1) as f64;
        if self.all == 0 { "–".to_owned() } else { format!("{} of {} ({share:.0} %)", self.right, self.all) }
    }
}

/// The tables.
#[must_use]
pub fn markdown(measured: &[Measured]) -> String {
    let mut kinds: BTreeMap<&str, Vec<Count>> = BTreeMap::new();
    for (at, set) in measured.iter().enumerate() {
        for played in &set.played {
            let counts = kinds.entry(&played.kind).or_insert_with(|| vec![Count::default(); measured.len()]);
            let one = Count::of(std::iter::once(played));
            if let Some(count) = counts.get_mut(at) {
                count.right += one.right;
                count.all += one.all;
                count.false_actions += one.false_actions;
            }
        }
    }
    let names: String = measured.iter().map(|set| format!(" {} |", set.set)).collect();
    let rule: String = measured.iter().map(|_| " --- |").collect();
    let mut text = format!("| kind |{names}\n| --- |{rule}\n");
    for (kind, counts) in &kinds {
        let cells: String = counts.iter().map(|count| format!(" {} |", count.text())).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| {kind} |{cells}");
    }
    let all: Vec<Count> = measured.iter().map(|set| Count::of(set.played.iter())).collect();
    let row = |title: &str, cell: &dyn Fn(usize) -> String| {
        let cells: String = (0..measured.len()).map(|at| format!(" {} |", cell(at))).collect();
        format!("| **{title}** |{cells}\n")
    };
    text += &row("right", &|at| all.get(at).map_or_else(String::new, |count| count.text()));
    text += &row("false actions", &|at| {
        all.get(at).map_or_else(String::new, |c| format!("{} of {}", c.false_actions, c.all))
    });
    for (title, share) in [("milliseconds, median", 0.5), ("milliseconds, 99th percentile", 0.99)] {
        text += &row(title, &|at| {
            let times = measured.get(at).map(|set| set.played.iter().map(|p| p.milliseconds).collect::<Vec<_>>());
            times
                .filter(|times| !times.is_empty())
                .map_or_else(String::new, |mut t| format!("{:.0}", quantile(&mut t, share)))
        });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn played(kind: &str, problem: Option<&str>) -> Played {
        Played {
            kind: kind.to_owned(),
            say: vec!["hide the bone".to_owned()],
            replies: vec!["The bone is now hidden.".to_owned()],
            problems: problem.map(str::to_owned).into_iter().collect(),
            is_false_action: problem.is_some_and(|problem| problem.starts_with("also")),
            milliseconds: 12.0,
        }
    }

    #[test]
    fn a_table_has_each_kind_and_the_sums() {
        let first = vec![played("colour", None), played("colour", Some("also: the view")), played("select", None)];
        let second = vec![played("select", Some("selection = sac"))];
        let of = |set: &str, played| Measured { set: set.to_owned(), played };
        let text = markdown(&[of("first", first), of("second", second)]);
        assert!(text.contains("| colour | 1 of 2 (50 %) | – |"), "{text}");
        assert!(text.contains("| select | 1 of 1 (100 %) | 0 of 1 (0 %) |"), "{text}");
        assert!(text.contains("| **right** | 2 of 3 (67 %) | 0 of 1 (0 %) |"), "{text}");
        assert!(text.contains("| **false actions** | 1 of 3 | 0 of 1 |") && text.contains("| 12 | 12 |"), "{text}");
    }
}
