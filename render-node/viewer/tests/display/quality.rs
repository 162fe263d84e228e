//! Simulation of a headset's quality control: loads over time, with an oracle that knows them.

use std::fmt::Write as _;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_raster::render::Quality;
use sg_viewer::display::quality_control::{
    LEVELS, LONGEST_BAR, PictureCost, QualityControl, SETPOINT, SHARE, drawn_at, edge, finest_within, work,
};

/// Seconds of a frame of the display.
pub(crate) const PERIOD: f64 = 1.0 / 90.0;

/// Seconds within which the level must be the oracle's.
pub(crate) const CONVERGES: f64 = 2.0;

/// Load of a picture: the seconds of each level, and those of them that grow with pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Load {
    pub(crate) cost: [f64; LEVELS],
    pub(crate) pixels: [f64; LEVELS],
}

impl Load {
    /// A load of these seconds at the whole edge in `fast`, those that pixels take and the others.
    pub(crate) fn of_parts(pixels: f64, fixed: f64) -> Self {
        let pixels = std::array::from_fn(|level| pixels * work(level));
        Self { cost: pixels.map(|seconds| fixed + seconds), pixels }
    }

    /// A load whose picture at the whole edge in `fast` takes this many budgets, with this share of it for pixels.
    fn of(budgets: f64, share: f64) -> Self {
        let cost = budgets * SHARE * PERIOD;
        Self::of_parts(cost * share, cost * (1.0 - share))
    }
}

/// A part of a session.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Session {
    Shown(Load),
    /// No pictures: the session is hidden, or the headset is off.
    Hidden,
    /// Pictures beside the runtime's own menu.
    Unfocused(Load),
}

use Session::{Hidden, Shown, Unfocused};

/// A session over time.
pub(crate) trait Course {
    /// Seconds of a frame of the display.
    fn period(&self) -> f64;

    /// Whether the device measures what pixels take.
    fn has_timestamps(&self) -> bool;

    /// The session at a time, and how long it has had no pause and no jump of its load. `None` after its end.
    fn at(&self, time: f64) -> Option<(Session, f64)>;

    /// The real seconds of a picture that begins at `time`, and those that pixels take.
    fn picture(&mut self, time: f64, load: &Load, level: usize) -> (f64, f64);
}

/// Made loads of a session over time.
#[derive(Debug, Clone)]
struct Trace {
    name: &'static str,
    /// Parts of so many seconds.
    parts: Vec<(f64, Session)>,
    /// Relative standard deviation of a picture's cost.
    noise: f64,
    /// Seconds from one spike to the next, and the seconds of the picture that it hits.
    spikes: Option<(f64, f64)>,
    timestamps: bool,
    start: usize,
    /// Most changes of the level, with and without timestamps.
    changes: [u64; 2],
}

impl Trace {
    fn new(name: &'static str, parts: Vec<(f64, Session)>, changes: [u64; 2]) -> Self {
        Self { name, parts, noise: 0.03, spikes: None, timestamps: true, start: 0, changes }
    }
}

/// A trace while it is played.
struct Played<'a> {
    trace: &'a Trace,
    rng: ChaCha8Rng,
    spike_at: f64,
}

impl<'a> Played<'a> {
    fn new(trace: &'a Trace) -> Self {
        let spike_at = trace.spikes.map_or(f64::INFINITY, |(every, _)| every);
        Self { trace, rng: ChaCha8Rng::seed_from_u64(16), spike_at }
    }
}

impl Course for Played<'_> {
    fn period(&self) -> f64 {
        PERIOD
    }

    fn has_timestamps(&self) -> bool {
        self.trace.timestamps
    }

    fn at(&self, time: f64) -> Option<(Session, f64)> {
        let mut begun = 0.0;
        for (seconds, session) in &self.trace.parts {
            let end = begun + seconds;
            if time < end {
                return Some((*session, time - begun));
            }
            begun = end;
        }
        None
    }

    fn picture(&mut self, time: f64, load: &Load, level: usize) -> (f64, f64) {
        // A sum of twelve has a variance of 1.
        let deviation: f64 = (0..12).map(|_| self.rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
        let mut cost = load.cost[level] * (1.0 + self.trace.noise * deviation).max(0.2);
        if let Some((every, spike)) = self.trace.spikes
            && time >= self.spike_at
        {
            self.spike_at += every;
            cost = spike;
        }
        (cost, cost * load.pixels[level] / load.cost[level])
    }
}

/// One frame of a simulated session.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) time: f64,
    pub(crate) level: usize,
    /// Finest level that fits the budget, and the finest one that fits the setpoint.
    pub(crate) oracle: [usize; 2],
    /// Seconds of the session without a pause, at most those since the load jumped.
    pub(crate) since: f64,
    pub(crate) shown: bool,
}

/// Steps of a level outside the range of an oracle.
pub(crate) fn off(level: usize, [finest, coarsest]: [usize; 2]) -> usize {
    finest.saturating_sub(level).max(level.saturating_sub(coarsest))
}

/// Most steps between the level and the oracle of the last two seconds, wherever there are two seconds.
pub(crate) fn most_off(points: &[Point]) -> usize {
    let mut first = 0;
    let late = points.iter().enumerate().filter(|(_, p)| p.shown && p.since > CONVERGES);
    late.map(|(k, p)| {
        while points[first].time < p.time - CONVERGES {
            first += 1;
        }
        let recent = || points[first..=k].iter().map(|p| p.oracle);
        let finest = recent().map(|o| o[0]).min().unwrap();
        let coarsest = recent().map(|o| o[1]).max().unwrap();
        off(p.level, [finest, coarsest])
    })
    .max()
    .unwrap_or(0)
}

pub(crate) fn at_level(level: usize, period: f64) -> QualityControl {
    let seconds = 0.999 * SETPOINT * SHARE * period * work(0) / work(level);
    let all = PictureCost { time: 0.0, level: 0, seconds, pixel_seconds: Some(seconds), period };
    let control = QualityControl::starting_from(all);
    assert_eq!(control.level(), level);
    control
}

fn play(trace: &Trace) -> (Vec<Point>, QualityControl) {
    play_course(&mut Played::new(trace), at_level(trace.start, PERIOD))
}

/// Plays a session. A late picture takes whole frames. Its time comes one frame after it, and one picture at a time is
/// measured, as a device does.
pub(crate) fn play_course(course: &mut impl Course, mut control: QualityControl) -> (Vec<Point>, QualityControl) {
    let period = course.period();
    let (mut time, mut points) = (0.0, Vec::new());
    let mut pending: Option<(PictureCost, f64)> = None;
    while let Some((session, since)) = course.at(time) {
        let (Shown(load) | Unfocused(load)) = session else {
            control.interrupt();
            pending = None;
            points.push(Point { time, level: control.level(), oracle: [0; 2], since, shown: false });
            time += period;
            continue;
        };
        let focused = matches!(session, Shown(_));
        if !focused {
            control.interrupt();
        }
        let level = control.level();
        let (seconds, pixels) = course.picture(time, &load, level);
        let fits = |limit: f64| finest_within(limit * SHARE * period, |k| load.cost[k]);
        points.push(Point { time, level, oracle: [fits(1.0), fits(SETPOINT)], since, shown: focused });
        let pixel_seconds = course.has_timestamps().then_some(pixels);
        let submitted = time;
        time += (seconds / period).ceil().max(1.0) * period;
        if let Some((measured, due)) = pending
            && time >= due
        {
            if focused {
                control.measure(measured);
            }
            pending = None;
        }
        if pending.is_none() {
            pending = Some((PictureCost { time: submitted, level, seconds, pixel_seconds, period }, time + period));
        }
    }
    (points, control)
}

fn traces() -> Vec<Trace> {
    let (light, heavy, medium) = (Load::of(0.3, 0.8), Load::of(4.0, 0.9), Load::of(1.6, 0.9));
    // A card that was idle begins with a low clock.
    let low_clock = Load::of(4.8, 0.9);
    let all = [
        Trace::new("steady", vec![(20.0, Shown(light))], [0, 0]),
        Trace { start: LEVELS - 1, ..Trace::new("from the coarsest level", vec![(20.0, Shown(light))], [4, 4]) },
        Trace { spikes: Some((1.0, 5.0 * PERIOD)), ..Trace::new("spikes", vec![(20.0, Shown(light))], [0, 0]) },
        Trace::new("overload", vec![(20.0, Shown(heavy))], [3, 10]),
        Trace::new("overload beyond every level", vec![(20.0, Shown(Load::of(10.0, 0.8)))], [3, 6]),
        Trace::new("overload that no pixels cause", vec![(20.0, Shown(Load::of(2.0, 0.0)))], [0, 6]),
        Trace::new(
            "step load",
            vec![(6.0, Shown(light)), (6.0, Shown(heavy)), (6.0, Shown(light)), (6.0, Shown(Load::of(1.6, 0.7)))],
            [8, 14],
        ),
        Trace::new(
            "headset off and on",
            vec![(6.0, Shown(medium)), (60.0, Hidden), (0.4, Shown(low_clock)), (8.0, Shown(medium))],
            [2, 8],
        ),
        Trace::new(
            "the runtime's menu",
            vec![(6.0, Shown(light)), (10.0, Unfocused(heavy)), (6.0, Shown(light))],
            [0, 0],
        ),
        Trace { noise: 0.15, ..Trace::new("noisy", vec![(60.0, Shown(medium))], [4, 12]) },
        Trace { noise: 0.15, ..Trace::new("noisy at the limit", vec![(60.0, Shown(Load::of(0.9, 0.9)))], [6, 14]) },
    ];
    let blind = all.iter().map(|trace| Trace { timestamps: false, ..trace.clone() });
    all.iter().cloned().chain(blind).collect()
}

/// Number of parts of a session, and the longest time from a change of the load to the oracle's level, kept from there on.
pub(crate) fn convergence(points: &[Point], period: f64) -> (usize, f64) {
    let mut parts = 1;
    let mut slowest: f64 = 0.0;
    for pair in points.windows(2) {
        if pair[0].shown && off(pair[0].level, pair[0].oracle) > 1 {
            slowest = slowest.max(pair[0].since + period);
        }
        parts += usize::from(pair[1].since < pair[0].since);
    }
    (parts, slowest)
}

/// The finest and the coarsest level of a session.
pub(crate) fn levels_of(points: &[Point]) -> [usize; 2] {
    let levels = points.iter().map(|p| p.level);
    [levels.clone().min().unwrap_or(0), levels.max().unwrap_or(0)]
}

/// One row of the table in `docs/headset.md`.
fn row(trace: &Trace, points: &[Point], control: &QualityControl) -> String {
    let most_off = most_off(points);
    let (parts, slowest) = convergence(points, PERIOD);
    let times = if trace.timestamps { "yes" } else { "no" };
    let mut row = String::new();
    let [low, high] = levels_of(points);
    let _ = write!(
        row,
        "| {} | {times} | {parts} | {low} to {high} | {slowest:.2} | {most_off} | {} |",
        trace.name,
        control.changes()
    );
    row
}

/// Prints a table, which `docs/headset.md` has to contain.
pub(crate) fn is_documented(table: &str) {
    println!("{table}");
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/headset.md");
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains(table), "docs/headset.md has another table than this:\n{table}");
}

#[test]
fn quality_converges_within_two_seconds_both_ways_and_stays() {
    let mut table = String::from(
        "| trace | timestamps | parts | levels | s to the oracle | steps off after 2 s | changes |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for trace in traces() {
        let (points, control) = play(&trace);
        let (name, timestamps) = (trace.name, trace.timestamps);
        assert!(most_off(&points) <= 1, "{name}, timestamps {timestamps}: {} steps off", most_off(&points));
        let most = trace.changes[usize::from(!timestamps)];
        assert!(control.changes() <= most, "{name}, timestamps {timestamps}: {} changes", control.changes());
        table += &row(&trace, &points, &control);
        table.push('\n');
    }
    is_documented(&table);
}

#[test]
fn a_pause_changes_nothing() {
    let medium = Load::of(1.6, 0.9);
    let off_and_on = |between: Session| {
        let parts = vec![(6.0, Shown(medium)), (30.0, between), (2.0, Shown(medium))];
        let (points, _) = play(&Trace::new("pause", parts, [0; 2]));
        let before = points.iter().rfind(|p| p.time < 6.0).unwrap().level;
        let after: Vec<usize> = points.iter().filter(|p| p.time > 36.0).map(|p| p.level).collect();
        assert!(after.iter().all(|level| *level == before), "{before}, then {after:?}");
    };
    off_and_on(Hidden);
    off_and_on(Unfocused(Load::of(8.0, 0.9)));
    // The loop stood still, and nobody said so.
    let mut control = at_level(4, PERIOD);
    for k in 0..400 {
        let time = f64::from(k) * PERIOD + if k < 200 { 0.0 } else { 60.0 };
        // The first pictures afterwards are slow.
        let seconds = SHARE * PERIOD * if (200..230).contains(&k) { 6.0 } else { 0.85 };
        let pixel_seconds = Some(0.9 * seconds);
        control.measure(PictureCost { time, level: control.level(), seconds, pixel_seconds, period: PERIOD });
        assert_eq!(control.level(), 4, "{k}");
    }
}

#[test]
fn a_failing_climb_is_tried_ever_less_often() {
    // The finer level costs more than its pixels: it never fits.
    let (mut control, mut time) = (at_level(3, PERIOD), 0.0);
    let mut changes = Vec::new();
    while time < 600.0 {
        let seconds = SHARE * PERIOD * if control.level() < 3 { 1.3 } else { 0.7 };
        let before = control.changes();
        let pixel_seconds = Some(0.9 * seconds);
        control.measure(PictureCost { time, level: control.level(), seconds, pixel_seconds, period: PERIOD });
        if control.changes() > before {
            changes.push(time);
        }
        time += PERIOD;
    }
    // Up and down again, after 4, 8, 16, 32 and then each 64 s.
    let most = 2 * (5 + (600.0 / LONGEST_BAR) as usize + 1);
    assert!((8..=most).contains(&changes.len()), "{} changes, the last at {:?} s", changes.len(), changes.last());
}

#[test]
fn levels_are_a_fifth_of_the_pixels_apart() {
    assert!((work(1) - 1.0).abs() < 1e-12 && work(0) > work(1));
    assert!((1..LEVELS - 1).all(|k| (work(k + 1) / work(k) - 0.8).abs() < 1e-9));
    assert!((0.1..0.25).contains(&edge(LEVELS - 1)) && edge(0) == 1.0);
    assert_eq!(drawn_at(0, Quality::Standard).quality, Quality::Standard);
    assert_eq!(drawn_at(5, Quality::Standard).quality, Quality::Fast);
}

#[test]
fn invalid_costs_change_nothing() {
    let mut control = at_level(2, PERIOD);
    let sound = PictureCost { time: 1.0, level: 2, seconds: 1.0, pixel_seconds: None, period: PERIOD };
    for broken in [
        PictureCost { time: f64::NAN, ..sound },
        PictureCost { seconds: f64::NAN, ..sound },
        PictureCost { seconds: -1.0, ..sound },
        PictureCost { period: 0.0, ..sound },
        PictureCost { level: 9, ..sound },
    ] {
        for _ in 0..100 {
            control.measure(broken);
        }
    }
    // Old news count once.
    for _ in 0..100 {
        control.measure(sound);
    }
    assert_eq!((control.level(), control.changes(), control.late()), (2, 0, 0));
    let broken = QualityControl::starting_from(PictureCost { period: f64::NAN, ..sound });
    assert_eq!(broken.level(), 0);
}
