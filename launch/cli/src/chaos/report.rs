//! The result of a run with faults, compared with the same session without faults.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use super::inject::{FaultLog, Recovery};
use super::plan::Kind;
use super::session::SessionResult;
use crate::terminal::{self, columns, format_count, format_time};

/// Most differences that are listed.
const MAX_DIFFERENCES: usize = 5;

/// The comparison of two sessions.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Verdict {
    /// Number of acknowledged commands that the scene has lost.
    pub(super) lost: usize,
    /// Number of commands that took effect more than once.
    pub(super) doubled: usize,
    /// Differences, one line each; empty after success.
    pub(super) wrong: Vec<String>,
}

impl Verdict {
    /// Compares the session with faults to the session without faults.
    pub(super) fn of(calm: &SessionResult, shaken: &SessionResult) -> Self {
        let mut verdict = Self::default();
        let mut revisions: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
        for (revision, id) in &shaken.changes {
            revisions.entry(id).or_default().push(*revision);
        }
        for (id, at) in revisions.iter().filter(|(_, at)| at.len() > 1) {
            verdict.doubled += 1;
            verdict.tell(format!("command {id} took effect at revisions {at:?}"));
        }
        let known: BTreeSet<_> = shaken.changes.iter().map(|(revision, _)| *revision).collect();
        for one in &shaken.acknowledged {
            let there = match one.id.as_str() {
                "" => one.revision == 0 || known.contains(&one.revision),
                id => revisions.get(id).is_some_and(|at| at.contains(&one.revision)),
            };
            if !there {
                verdict.lost += 1;
                verdict.tell(format!("command {} was acknowledged as revision {}, but is lost", one.id, one.revision));
            }
        }
        for (index, (revision, _)) in shaken.changes.iter().enumerate() {
            if *revision != index as u64 + 1 {
                verdict.tell(format!("revision {} is missing", index + 1));
                break;
            }
        }
        if calm.changes != shaken.changes {
            let at = calm.changes.iter().zip(&shaken.changes).position(|(c, s)| c != s);
            let at = at.unwrap_or(calm.changes.len().min(shaken.changes.len())) + 1;
            let (c, s) = (calm.changes.len(), shaken.changes.len());
            verdict.tell(format!("the history differs from revision {at} on ({s} changes, without faults {c})"));
        }
        if calm.state != shaken.state {
            verdict.tell("the final scene differs".to_owned());
        }
        if calm.failed_utterances != shaken.failed_utterances {
            verdict.tell(format!(
                "failed utterances: {:?}; without faults {:?}",
                shaken.failed_utterances, calm.failed_utterances
            ));
        }
        if calm.hashes.len() != shaken.hashes.len() {
            let (c, s) = (calm.hashes.len(), shaken.hashes.len());
            verdict.tell(format!("{s} pictures, without faults {c}"));
        }
        for (index, (a, b)) in calm.pictures.iter().zip(&shaken.pictures).enumerate() {
            let hashes = calm.hashes.get(index) == shaken.hashes.get(index);
            if !hashes || !same_bytes(a, b) {
                verdict.tell(format!("{} differs from {}", b.display(), a.display()));
            }
        }
        verdict
    }

    /// Adds the orphaned processes.
    pub(super) fn with(mut self, log: &FaultLog) -> Self {
        for orphan in &log.orphans {
            self.tell(orphan.clone());
        }
        self
    }

    fn tell(&mut self, what: String) {
        match self.wrong.len() {
            n if n < MAX_DIFFERENCES => self.wrong.push(what),
            MAX_DIFFERENCES => self.wrong.push("and more".to_owned()),
            _ => {}
        }
    }
}

/// Whether two pictures are equal, as arrays and as PNG.
fn same_bytes(a: &Path, b: &Path) -> bool {
    ["png", "npy"].iter().all(|extension| {
        let read = |path: &Path| std::fs::read(path.with_extension(extension));
        matches!((read(a), read(b)), (Ok(a), Ok(b)) if a == b)
    })
}

/// The numbers of a run.
pub(super) struct Report<'a> {
    pub(super) seed: u64,
    pub(super) rounds: usize,
    pub(super) steps: usize,
    pub(super) calm: Duration,
    pub(super) shaken: Duration,
    pub(super) retries: u64,
    pub(super) refused_for_room: u64,
    pub(super) acknowledged: usize,
    pub(super) revision: u64,
    pub(super) pictures: usize,
    pub(super) log: &'a FaultLog,
    pub(super) verdict: &'a Verdict,
}

impl Report<'_> {
    /// Prints the report: JSON, or a table and a few lines.
    pub(super) fn tell(&self, as_json: bool) {
        if as_json {
            return terminal::print_line(&self.json().to_string());
        }
        for line in self.table() {
            terminal::print_line(&line);
        }
        for line in self.lines() {
            terminal::print_line(&line);
        }
    }

    fn kinds(&self) -> BTreeMap<Kind, Vec<f64>> {
        let mut kinds: BTreeMap<Kind, Vec<f64>> = BTreeMap::new();
        for Recovery { kind, recovered } in &self.log.recoveries {
            kinds.entry(*kind).or_default().push(recovered.as_secs_f64() * 1e3);
        }
        kinds.values_mut().for_each(|times| times.sort_by(f64::total_cmp));
        kinds
    }

    fn table(&self) -> Vec<String> {
        let head = ["FAULT", "TIMES", "MEDIAN", "P99", "LONGEST"].map(str::to_owned).to_vec();
        let row = |(kind, times): (Kind, Vec<f64>)| {
            let at = |share| quantile(&times, share).map_or_else(|| "-".to_owned(), format_time);
            vec![kind.name().to_owned(), times.len().to_string(), at(0.5), at(0.99), at(1.0)]
        };
        let rows: Vec<_> = std::iter::once(head).chain(self.kinds().into_iter().map(row)).collect();
        columns(&rows)
    }

    fn lines(&self) -> Vec<String> {
        let duration = |d: Duration| format_time(d.as_secs_f64() * 1e3);
        vec![
            format!(
                "faults        {} (seed {}) over {} steps in {} rounds; {}, without faults {}",
                self.log.recoveries.len(),
                self.seed,
                format_count(self.steps as u64),
                self.rounds,
                duration(self.shaken),
                duration(self.calm)
            ),
            format!(
                "commands      {} acknowledged, revision {}, {} retried, {} refused on a full disk",
                format_count(self.acknowledged as u64),
                format_count(self.revision),
                format_count(self.retries),
                self.refused_for_room
            ),
            format!(
                "lost          {}; doubled {}; orphans {} (services ended at most {} after their supervisor)",
                self.verdict.lost,
                self.verdict.doubled,
                self.log.orphans.len(),
                duration(self.log.followed)
            ),
            format!(
                "scene         {}; {} pictures",
                if self.verdict.wrong.is_empty() {
                    "equal to the session without faults"
                } else {
                    "DIFFERS FROM THE SESSION WITHOUT FAULTS"
                },
                self.pictures
            ),
        ]
    }

    fn json(&self) -> Value {
        let kinds: serde_json::Map<String, Value> = self
            .kinds()
            .into_iter()
            .map(|(kind, times)| {
                let at = |share| quantile(&times, share);
                let entry = json!({"count": times.len(), "median_ms": at(0.5), "p99_ms": at(0.99), "max_ms": at(1.0)});
                (kind.name().to_owned(), entry)
            })
            .collect();
        json!({
            "seed": self.seed, "faults": self.log.recoveries.len(), "kinds": kinds, "rounds": self.rounds,
            "steps": self.steps, "seconds": self.shaken.as_secs_f64(), "calm_seconds": self.calm.as_secs_f64(),
            "retries": self.retries, "refused_for_room": self.refused_for_room, "acknowledged": self.acknowledged,
            "revision": self.revision, "pictures": self.pictures, "lost": self.verdict.lost,
            "doubled": self.verdict.doubled, "orphans": self.log.orphans.len(),
            "children_gone_ms": self.log.followed.as_secs_f64() * 1e3, "wrong": self.verdict.wrong,
        })
    }
}

/// The smallest value of a sorted list with at least this share at or below it.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::playback::AcknowledgedChange;
    use sg_proto::scene::State;

    fn played() -> SessionResult {
        let changes = ["a", "b", "c"].iter().zip(1..).map(|(id, n)| (n, (*id).to_owned())).collect();
        let acknowledged =
            ["a", "", "c"].iter().zip(1..).map(|(id, n)| AcknowledgedChange { id: (*id).into(), revision: n });
        SessionResult {
            state: State { revision: 3, ..State::default() },
            changes,
            acknowledged: acknowledged.collect(),
            hashes: Vec::new(),
            pictures: Vec::new(),
            failed_utterances: Vec::new(),
            times: Vec::new(),
        }
    }

    #[test]
    fn the_same_session_is_the_same() {
        assert_eq!(Verdict::of(&played(), &played()), Verdict::default());
    }

    #[test]
    fn differences_are_found() {
        let mut shaken = played();
        shaken.changes.truncate(2);
        let verdict = Verdict::of(&played(), &shaken);
        assert_eq!((verdict.lost, verdict.doubled), (1, 0));
        assert!(verdict.wrong[0].contains("command c was acknowledged as revision 3, but is lost"), "{verdict:?}");

        let mut shaken = played();
        shaken.changes.push((4, "b".to_owned()));
        let verdict = Verdict::of(&played(), &shaken);
        assert_eq!((verdict.lost, verdict.doubled), (0, 1));
        assert!(verdict.wrong[0].contains("command b took effect at revisions [2, 4]"), "{verdict:?}");

        let mut shaken = played();
        shaken.changes.remove(0);
        shaken.acknowledged.remove(0);
        assert!(Verdict::of(&played(), &shaken).wrong.iter().any(|w| w == "revision 1 is missing"));

        let mut shaken = played();
        shaken.state.revision = 4;
        assert_eq!(Verdict::of(&played(), &shaken).wrong, ["the final scene differs"]);

        let mut shaken = played();
        shaken.failed_utterances.push("undo".to_owned());
        assert_eq!(Verdict::of(&played(), &shaken).wrong.len(), 1);
    }

    #[test]
    fn pictures_are_compared_by_their_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let picture = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name).with_extension("png");
            std::fs::write(&path, bytes).unwrap();
            std::fs::write(path.with_extension("npy"), bytes).unwrap();
            SessionResult { pictures: vec![path], hashes: vec!["x".to_owned()], ..played() }
        };
        let (one, same, other) = (picture("one", b"1"), picture("same", b"1"), picture("other", b"2"));
        assert_eq!(Verdict::of(&one, &same), Verdict::default());
        assert_eq!(Verdict::of(&one, &other).wrong.len(), 1);
        assert_eq!(Verdict::of(&one, &played()).wrong.len(), 1);
    }

    #[test]
    fn quantiles_are_values_of_the_list() {
        let list: Vec<_> = (1..=200).map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|s| quantile(&list, s)), [1.0, 100.0, 198.0, 200.0].map(Some));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
