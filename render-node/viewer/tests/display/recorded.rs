//! Replay of recorded sessions: the costs and pauses of real frames, at the rate and the speed of a headset's own card.
//!
//! `SUPERGAUSSIAN_TRACES=write cargo nextest run --release --locked --workspace -E 'test(=traces::a_session_records_its_frames)'` records
//! them anew, under Monado on processor cores.

use std::fmt::Write as _;
use std::path::Path;

use sg_viewer::display::frame_trace::{FrameTrace, SessionVisibility, TraceRow};
use sg_viewer::display::quality_control::{LEVELS, work};

use crate::quality::{
    Course, Load, PERIOD, Session, at_level, convergence, is_documented, levels_of, most_off, play_course,
};

/// Most pictures on each side of one whose median is its load.
const REACH: usize = 6;

/// Ratio of the medians after and before a picture from which a new part begins.
const JUMP: f64 = 2.0;

/// Device seconds of a recorded picture: those of pixels as if drawn at the whole edge in `fast`, and the others.
#[derive(Debug, Clone, Copy)]
struct Cost {
    pixels: f64,
    fixed: f64,
}

impl Cost {
    fn total(&self) -> f64 {
        self.pixels + self.fixed
    }
}

/// A recorded picture.
#[derive(Debug, Clone, Copy)]
struct Picture {
    time: f64,
    cost: Cost,
    /// The cost without noise: medians of the neighbours within the part.
    load: Cost,
}

/// A piece of a session without a pause and without a jump of its load.
#[derive(Debug)]
struct Part {
    begin: f64,
    end: f64,
    /// None: the session is hidden.
    pictures: Vec<Picture>,
}

/// A recorded session that is being replayed.
struct Recording {
    parts: Vec<Part>,
    /// Pictures replayed so far.
    replayed: usize,
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// The cost of a measured row, times `speed`.
fn cost_of(row: &TraceRow, speed: f64) -> Option<Cost> {
    let (level, cost) = (row.level?, row.cost?);
    let pixels = cost.pixel_seconds?;
    Some(Cost { pixels: speed * pixels / work(level), fixed: speed * (cost.seconds - pixels) })
}

/// Ratio of the median total after a picture to that before it, above 1 in any case.
fn jump(pictures: &[Picture], at: usize) -> f64 {
    let of = |range: &[Picture]| median(range.iter().map(|p| p.cost.total()).collect());
    if at < REACH || at + REACH > pictures.len() {
        return 1.0;
    }
    let ratio = of(&pictures[at..at + REACH]) / of(&pictures[at - REACH..at]);
    ratio.max(1.0 / ratio)
}

/// Parts of the pictures of one unbroken stretch.
fn parts(pictures: &[Picture], end: f64) -> Vec<Part> {
    let jumps: Vec<f64> = (0..pictures.len()).map(|at| jump(pictures, at)).collect();
    let mut begins = vec![0];
    for (at, ratio) in jumps.iter().enumerate() {
        let near = &jumps[at.saturating_sub(REACH)..(at + REACH + 1).min(jumps.len())];
        let is_highest = near.iter().all(|other| other <= ratio);
        if *ratio > JUMP && is_highest && begins.last().is_some_and(|last| at >= last + REACH) {
            begins.push(at);
        }
    }
    let ends = begins.iter().skip(1).copied().chain([pictures.len()]);
    let part = |(from, to): (usize, usize)| {
        let own = &pictures[from..to];
        let smooth = |k: usize| {
            let near = &own[k.saturating_sub(REACH)..(k + REACH + 1).min(own.len())];
            let of = |value: fn(&Cost) -> f64| median(near.iter().map(|p| value(&p.cost)).collect());
            Picture { load: Cost { pixels: of(|c| c.pixels), fixed: of(|c| c.fixed) }, ..own[k] }
        };
        let end = pictures.get(to).map_or(end, |next| next.time);
        Part { begin: own[0].time, end, pictures: (0..own.len()).map(smooth).collect() }
    };
    begins.iter().copied().zip(ends).map(part).collect()
}

impl Recording {
    /// A recording on a card that takes `speed` times as long.
    fn new(trace: &FrameTrace, speed: f64) -> Self {
        let mut found = Vec::new();
        let mut stretch: Vec<Picture> = Vec::new();
        let mut hidden_since = None;
        let last = trace.rows.last().map_or(0.0, |row| row.time);
        for row in &trace.rows {
            if row.state == SessionVisibility::Focused {
                if let Some(begin) = hidden_since.take() {
                    found.push(Part { begin, end: row.time, pictures: Vec::new() });
                }
                if let Some(cost) = cost_of(row, speed) {
                    stretch.push(Picture { time: row.time, cost, load: cost });
                }
            } else if !stretch.is_empty() {
                found.extend(parts(&stretch, row.time));
                stretch.clear();
                hidden_since = Some(row.time);
            }
        }
        if !stretch.is_empty() {
            found.extend(parts(&stretch, last));
        }
        // From the first picture on.
        let begin = found.first().map_or(0.0, |part| part.begin);
        for part in &mut found {
            (part.begin, part.end) = (part.begin - begin, part.end - begin);
            part.pictures.iter_mut().for_each(|p| p.time -= begin);
        }
        Self { parts: found, replayed: 0 }
    }

    fn part_at(&self, time: f64) -> Option<&Part> {
        self.parts.iter().find(|part| time < part.end)
    }
}

impl Course for Recording {
    fn period(&self) -> f64 {
        PERIOD
    }

    fn has_timestamps(&self) -> bool {
        true
    }

    fn at(&self, time: f64) -> Option<(Session, f64)> {
        let part = self.part_at(time)?;
        let newest = part.pictures.iter().rfind(|p| p.time <= time).or(part.pictures.first());
        let session = newest.map_or(Session::Hidden, |p| Session::Shown(Load::of_parts(p.load.pixels, p.load.fixed)));
        Some((session, (time - part.begin).max(0.0)))
    }

    // A recorded part has fewer pictures than its seconds have frames at 90 in a second: they come again in their order.
    fn picture(&mut self, time: f64, load: &Load, level: usize) -> (f64, f64) {
        let ratios = self.part_at(time).map_or((1.0, 1.0), |part| {
            let p = &part.pictures[self.replayed % part.pictures.len()];
            (p.cost.pixels / p.load.pixels, p.cost.fixed / p.load.fixed)
        });
        self.replayed += 1;
        let (pixels, fixed) = (load.pixels[level] * ratios.0, (load.cost[level] - load.pixels[level]) * ratios.1);
        (pixels + fixed, pixels)
    }
}

/// A recorded session: its file, the speed of the replay, its parts, and most changes of the level.
struct Replay {
    name: &'static str,
    /// Seconds on the replaying card over those that the recording's processor cores took.
    speed: f64,
    parts: usize,
    /// Levels from one of which to one of which the session goes at least.
    reaches: [usize; 2],
    changes: u64,
}

const REPLAYS: [Replay; 4] = [
    Replay { name: "steady", speed: 0.5, parts: 1, reaches: [0, 0], changes: 0 },
    Replay { name: "spikes", speed: 0.5, parts: 1, reaches: [0, 0], changes: 0 },
    Replay { name: "overload", speed: 1.0 / 6.0, parts: 3, reaches: [0, 4], changes: 6 },
    Replay { name: "hidden", speed: 0.1, parts: 3, reaches: [1, 1], changes: 8 },
];

#[test]
fn quality_follows_recorded_sessions() {
    let mut table = String::from(
        "| recording | speed | parts | levels | s to the oracle | steps off after 2 s | changes |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut failures = Vec::new();
    for replay in REPLAYS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/traces");
        let trace = FrameTrace::read(&folder.join(replay.name).with_extension("csv")).unwrap();
        let mut recording = Recording::new(&trace, replay.speed);
        assert_eq!(recording.parts.len(), replay.parts, "{}: {:?}", replay.name, begins(&recording));
        let (points, control) = play_course(&mut recording, at_level(0, PERIOD));
        let (most_off, [low, high]) = (most_off(&points), levels_of(&points));
        let (parts, slowest) = convergence(&points, PERIOD);
        let _ = writeln!(
            table,
            "| {} | {:.2} | {parts} | {low} to {high} | {slowest:.2} | {most_off} | {} |",
            replay.name,
            replay.speed,
            control.changes()
        );
        assert!(high < LEVELS && parts == replay.parts);
        if most_off > 1 || control.changes() > replay.changes || low > replay.reaches[0] || high < replay.reaches[1] {
            failures.push(replay.name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}:\n{table}");
    is_documented(&table);
}

fn begins(recording: &Recording) -> Vec<[f64; 2]> {
    recording.parts.iter().map(|part| [part.begin, part.end]).collect()
}
