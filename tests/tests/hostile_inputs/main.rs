//! Hostile files through the real command line. Each is refused with one clear line and exit status 2, at once, with little
//! memory, and changes nothing on disk.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "a test fails by panicking and reports")]

mod bombs;
mod case;
mod contents;
mod launch_files;
mod names;
mod not_regular;
mod readers;
mod run;
mod sizes;

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use case::Case;

/// Fewest inputs of the table.
const LEAST: usize = 500;
/// Inputs at a time.
const THREADS: usize = 2;

fn table() -> Vec<Case> {
    // Not copied: a command begins as an image of this process, so the table counts as memory of the command.
    [not_regular::cases(), names::cases(), contents::cases(), bombs::cases(), sizes::cases(), launch_files::cases()]
        .into_iter()
        .flatten()
        .collect()
}

#[test]
fn hostile_inputs_are_refused_with_one_line() {
    let mut cases = table();
    if let Ok(only) = std::env::var("HOSTILE_ONLY") {
        cases.retain(|case| case.title().contains(&only));
    } else {
        assert!(cases.len() >= LEAST, "{} inputs", cases.len());
    }
    let (next, complaints) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let found = run::complaints(case);
                    complaints
                        .lock()
                        .unwrap()
                        .extend(found.into_iter().map(|what| format!("{}: {what}", case.title())));
                }
            });
        }
    });
    let mut families: BTreeMap<&str, usize> = BTreeMap::new();
    for case in &cases {
        *families.entry(case.family).or_default() += 1;
    }
    eprintln!("{} inputs: {families:?}", cases.len());
    let mut complaints = complaints.into_inner().unwrap();
    complaints.extend(run::memory_complaint());
    assert!(complaints.is_empty(), "{} complaints\n{}", complaints.len(), complaints.join("\n"));
}
