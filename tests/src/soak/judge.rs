//! The bounds of a session, and whether its samples keep them.

use super::samples::{DISKS, SUPERVISOR, Sample, USERS};
use super::trend::slope;
use super::usage::ProcessUse;

/// Fewest samples and commands of the stretch whose slope is judged. Less is warming up: the scene remembers 20,000 ids.
const MIN_SAMPLES: usize = 60;
const MIN_COMMANDS: f64 = 20.0;

const MEMORY: &str = "memory, KiB";

/// A quantity of a process.
struct OfProcess {
    name: &'static str,
    value: fn(&ProcessUse) -> u64,
    /// Largest slope per 1,000 commands.
    slope: f64,
    /// Largest value.
    most: Option<f64>,
}

/// A record of 25 bytes for each command, or 150 MB a month at 200,000 commands a day.
const MEMORY_SLOPE: f64 = 25.0;
/// Memory that the supervisor and the others keep of each restart, KiB. zenoh numbers the key of every instance for each listener to
/// liveliness, and takes no number back until the listener's connection ends.
const MEMORY_OF_RESTART: (f64, f64) = (6.0, 2.0);
/// Fewer than four a day.
const COUNT_SLOPE: f64 = 0.02;

const OF_PROCESS: [OfProcess; 5] = [
    OfProcess { name: MEMORY, value: |u| u.anonymous_kib, slope: MEMORY_SLOPE, most: Some(1024.0 * 1024.0) },
    OfProcess { name: "descriptors", value: |u| u.descriptors, slope: COUNT_SLOPE, most: Some(256.0) },
    OfProcess { name: "sockets", value: |u| u.sockets, slope: COUNT_SLOPE, most: Some(128.0) },
    OfProcess { name: "threads", value: |u| u.threads, slope: COUNT_SLOPE, most: Some(128.0) },
    OfProcess { name: "memory maps", value: |u| u.maps, slope: 0.5, most: None },
];

/// Bytes of one log with its earlier ones: see the launcher's log files.
const LOG_BYTES: f64 = 6.0 * 4.2 * 1024.0 * 1024.0;
/// Bytes of the pictures that a process keeps.
const PICTURE_BYTES: f64 = 1024.0 * 1024.0 * 1024.0;

/// One line of the verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Process, or `stack`.
    pub subject: String,
    /// Quantity with its unit.
    pub quantity: String,
    /// Median of the first tenth.
    pub begin: f64,
    /// Median of the last tenth.
    pub end: f64,
    /// Largest value.
    pub largest: f64,
    /// Slope per 1,000 commands over the second half; `None` if that is too short.
    pub slope: Option<f64>,
    /// Bound on the slope.
    pub slope_bound: Option<f64>,
    /// Bound on the largest value.
    pub most: Option<f64>,
}

impl Row {
    fn new(subject: &str, quantity: &str, points: &[(f64, f64)], bounds: (Option<f64>, Option<f64>)) -> Self {
        let tenth = points.len().div_ceil(10).max(1);
        let middle =
            |part: &[(f64, f64)]| crate::bench::quantile(&mut part.iter().map(|p| p.1).collect::<Vec<_>>(), 0.5);
        let half = points.get(points.len() / 2..).unwrap_or_default();
        let span = half.last().zip(half.first()).map_or(0.0, |(last, first)| last.0 - first.0);
        let is_long = half.len() >= MIN_SAMPLES && span >= MIN_COMMANDS;
        Self {
            subject: subject.to_owned(),
            quantity: quantity.to_owned(),
            begin: middle(points.get(..tenth.min(points.len())).unwrap_or_default()),
            end: middle(points.get(points.len().saturating_sub(tenth)..).unwrap_or_default()),
            largest: points.iter().map(|p| p.1).fold(0.0, f64::max),
            slope: is_long.then(|| slope(half)).flatten(),
            slope_bound: bounds.0,
            most: bounds.1,
        }
    }

    /// Whether it keeps its bounds. A slope that could not be measured keeps them.
    #[must_use]
    pub fn holds(&self) -> bool {
        let flat = self.slope.zip(self.slope_bound).is_none_or(|(slope, bound)| slope <= bound);
        flat && self.most.is_none_or(|most| self.largest <= most)
    }
}

/// Compares the samples of a session with the bounds. Slopes are those of the second half: of the whole session for the
/// stack, and for a service of its process that lived for the most commands.
#[must_use]
pub fn judge(names: &[String], samples: &[Sample]) -> Vec<Row> {
    let mut rows = Vec::new();
    // For each 1,000 commands.
    let restarts = samples.last().map_or(0.0, |s| s.restarts as f64 / thousands(s).max(0.001));
    for (at, name) in names.iter().enumerate() {
        let life = longest_life(samples, at);
        for quantity in &OF_PROCESS {
            let points: Vec<_> = life.iter().map(|(x, used)| (*x, (quantity.value)(used) as f64)).collect();
            let of_restart = if name == SUPERVISOR { MEMORY_OF_RESTART.0 } else { MEMORY_OF_RESTART.1 };
            let slope = match quantity.name {
                MEMORY => quantity.slope + (restarts * of_restart).round(),
                _ => quantity.slope,
            };
            // The users keep all samples of the session.
            let slope = if name == USERS { 4.0 * slope } else { slope };
            rows.push(Row::new(name, quantity.name, &points, (Some(slope), quantity.most)));
        }
    }
    let services = names.iter().filter(|name| *name != USERS && *name != SUPERVISOR).count() as f64;
    let mut of_stack = |quantity: &str, value: &dyn Fn(&Sample) -> f64, bounds| {
        let points: Vec<_> = samples.iter().map(|s| (thousands(s), value(s))).collect();
        rows.push(Row::new("stack", quantity, &points, bounds));
    };
    of_stack("processes", &|s| s.below as f64, (Some(COUNT_SLOPE), Some(4.0 * services)));
    of_stack("zombies", &|s| s.zombies as f64, (Some(COUNT_SLOPE), Some(services)));
    of_stack("folders of pictures", &|s| s.picture_folders as f64, (Some(1.0), None));
    for (at, disk) in DISKS.into_iter().enumerate() {
        let kib = |s: &Sample| s.disks.get(at).map_or(0.0, |d| d.bytes as f64 / 1024.0);
        let entries = |s: &Sample| s.disks.get(at).map_or(0.0, |d| d.entries as f64);
        let (slope, most) = match disk {
            "project" => (Some(MEMORY_SLOPE), Some(256.0 * 1024.0)),
            // They fill up to their limit.
            "logs" => (None, Some((services + 1.0) * LOG_BYTES / 1024.0)),
            // Of those that draw, and of dead ones that are not cleared yet.
            "pictures" => (None, Some(4.0 * PICTURE_BYTES / 1024.0)),
            _ => (Some(1.0), Some(64.0 * 1024.0)),
        };
        of_stack(&format!("{disk}, KiB"), &kib, (slope, most));
        if !matches!(disk, "logs" | "pictures") {
            of_stack(&format!("{disk}, files"), &entries, (Some(COUNT_SLOPE), None));
        }
    }
    rows
}

fn thousands(sample: &Sample) -> f64 {
    sample.commands as f64 / 1000.0
}

/// The samples of the process of this place that lived for the most commands, by thousands of commands.
fn longest_life(samples: &[Sample], at: usize) -> Vec<(f64, ProcessUse)> {
    let mut lives: Vec<Vec<(f64, ProcessUse)>> = Vec::new();
    for sample in samples {
        let Some(used) = sample.processes.get(at).copied().flatten() else { continue };
        let point = (thousands(sample), used);
        match lives.last_mut() {
            Some(life) if life.last().is_some_and(|(_, last)| last.pid == used.pid) => life.push(point),
            _ => lives.push(vec![point]),
        }
    }
    let span = |life: &Vec<(f64, ProcessUse)>| life.last().zip(life.first()).map_or(0.0, |(b, a)| b.0 - a.0);
    lives.into_iter().max_by(|a, b| span(a).total_cmp(&span(b))).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(memory: impl Fn(u64) -> (u32, u64)) -> Vec<Sample> {
        let sample = |i: u64| {
            let (pid, anonymous_kib) = memory(i);
            let used = ProcessUse { pid, anonymous_kib, descriptors: 20, ..ProcessUse::default() };
            Sample {
                seconds: i as f64,
                commands: 200 * i,
                captures: 20 * i,
                restarts: 2 * i,
                processes: vec![Some(used)],
                below: 8,
                zombies: 0,
                picture_folders: 100,
                disks: Default::default(),
            }
        };
        (0..1000).map(sample).collect()
    }

    fn memory_of(samples: &[Sample]) -> Row {
        let rows = judge(&["scene".to_owned()], samples);
        rows.into_iter().find(|r| r.quantity == MEMORY).unwrap()
    }

    #[test]
    fn a_leak_is_found_and_warming_up_is_none() {
        // 80 bytes for each command.
        let leak = memory_of(&samples(|i| (1, 50_000 + 200 * i * 80 / 1024)));
        assert!(!leak.holds() && (leak.slope.unwrap() - 78.0).abs() < 1.0, "{leak:?}");
        let warm = memory_of(&samples(|i| (1, 50_000 + 100 * i.min(300))));
        assert!(warm.holds() && warm.slope == Some(0.0) && warm.end > warm.begin, "{warm:?}");
    }

    #[test]
    fn restarts_do_not_hide_a_leak() {
        // Killed at every sample for a part of the session; the rest of it leaks.
        let row = memory_of(&samples(|i| if i < 400 { (i as u32 + 10, 50_000) } else { (1, 50_000 + 10 * (i - 400)) }));
        assert!(!row.holds() && (row.slope.unwrap() - 50.0).abs() < 1.0, "{row:?}");
    }

    #[test]
    fn a_short_session_is_judged_by_its_largest_values_only() {
        let mut short = samples(|i| (1, 50_000 + 10_000 * i));
        short.truncate(50);
        assert_eq!(memory_of(&short).slope, None);
        assert!(memory_of(&short).holds());
        if let Some(used) = short.last_mut().and_then(|s| s.processes[0].as_mut()) {
            used.anonymous_kib = 2 << 20;
        }
        assert!(!memory_of(&short).holds());
    }
}
