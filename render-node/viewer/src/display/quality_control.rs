//! Chooses the level of a headset's pictures from measured device times.
//!
//! A headset shows a picture in every frame of its display, so the loop's own clock says nothing about spare time: every
//! picture in time takes one period. This control reads the time that the device needed for each picture. It is a pure
//! state machine: it owns no device and no clock, and every time is an argument.
//!
//! # Levels
//!
//! Level 0 is the best quality at the whole edge. Level k ≥ 1 is `fast` at the edge 0.8^((k − 1) / 2), so each step takes
//! a fifth of the pixels away. [`LEVELS`] levels reach down to a sixth of the edge.
//!
//! # Model
//!
//! A picture costs `fixed + pixels · work(k)` seconds. `work(k)` is its number of pixels over those of the whole picture;
//! level 0 counts [`BEST_WORK`] times, since it blends more fragments. Devices with timestamps measure both parts in each
//! picture. Without them the parts are learnt from changes of the level, and at first all of a cost counts as pixels.
//!
//! # Rules
//!
//! The budget of a picture is [`SHARE`] of the display's period.
//!
//! - **Down** when three of the last five pictures exceed the budget, or two in a row that took [`SLOW`] seconds. The next
//!   level is the finest one with a predicted cost of at most [`SETPOINT`] of the budget. If none fits, it is the finest one
//!   that costs at most [`NEAR_LEAST`] of the coarsest one: a loss of pixels must gain something.
//! - **Up** when the pictures of [`CLIMB`] seconds predict a cost of at most [`SETPOINT`] of the budget for a finer level,
//!   by their 90th percentile. One climb at most quadruples the work.
//! - **Patient up** by one level after [`PATIENCE`] seconds at a level whose finer neighbour is predicted at
//!   [`PATIENT_SETPOINT`] of the budget, or at [`BLIND_SETPOINT`] of it without timestamps. Even that one is below a period.
//! - **Bar.** A climb that is taken back within [`FIRST_BAR`] seconds bars its level for as long. Each further failure doubles
//!   that time, up to [`LONGEST_BAR`]; a climb that holds resets it. A load that has fallen by a fifth lifts the bar.
//! - **Interruptions.** A pause, a hidden session, one without focus, or a gap between two pictures drops what was measured,
//!   and keeps the level. The first [`SETTLES`] seconds after it do not count: clocks and caches have to recover.
//!
//! Down reacts to a median, so single spikes change nothing. Up needs every tenth picture at most above the prediction. The
//! distance between both limits and the bar keep the level from swinging.

use std::collections::VecDeque;

use sg_raster::render::Quality;

use super::adaptive_quality::Level;

/// Number of levels.
pub const LEVELS: usize = 17;

/// Share of the display's period that the scene's picture may take. Panels, depths and the runtime's compositor get the
/// rest.
pub const SHARE: f64 = 0.8;

/// Factor on the edge from one level to the next: √0.8.
const EDGE_STEP: f64 = 0.894_427_190_999_915_9;

/// Work of the best quality at the whole edge, over that of `fast`.
pub const BEST_WORK: f64 = 1.5;

/// Share of the budget that the predicted cost of another level may take.
pub const SETPOINT: f64 = 0.9;

/// The same after [`PATIENCE`].
pub const PATIENT_SETPOINT: f64 = 0.97;

/// The same without timestamps: below the period, so that a wrong guess misses no frame.
pub const BLIND_SETPOINT: f64 = 1.2;

/// Cost over that of the coarsest level, below which pixels are not worth giving up.
pub const NEAR_LEAST: f64 = 1.1;

/// Pictures that a descent looks at, and how many of them must be late.
const RECENT: (usize, usize) = (5, 3);

/// Seconds of two late pictures in a row that are enough for a descent.
pub const SLOW: f64 = 0.25;

/// Seconds and number of pictures before a climb.
pub const CLIMB: f64 = 0.3;
const CLIMB_PICTURES: usize = 10;

/// Most work of a climb's level over that of the level before.
const CLIMB_WORK: f64 = 4.0;

/// Seconds at a level before a patient climb.
pub const PATIENCE: f64 = 2.0;

/// Seconds of the first bar.
pub const FIRST_BAR: f64 = 4.0;

/// Seconds of the longest bar.
pub const LONGEST_BAR: f64 = 64.0;

/// Cost over that before the failed climb, below which a bar is lifted.
const LIFTS: f64 = 0.8;

/// Seconds between two pictures that count as an interruption, unless a picture takes a third of it.
const GAP: f64 = 0.25;

/// Seconds after an interruption that do not count.
pub const SETTLES: f64 = 0.5;

/// Least share learnt without timestamps. Two noisy times can hide what pixels cost.
const LEAST_LEARNT: f64 = 0.05;

/// Least change of the work that the share is learnt from.
const LEAST_CHANGE: f64 = 0.3;

/// Most kept measurements of one level.
const KEPT: usize = 64;

/// Measured cost of one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureCost {
    /// Time of its submission in seconds, on any clock that only goes forward.
    pub time: f64,
    /// Level that it was drawn at.
    pub level: usize,
    /// Device seconds of the picture.
    pub seconds: f64,
    /// Those of them that grow with its pixels, where the device measures passes.
    pub pixel_seconds: Option<f64>,
    /// Seconds from one frame of the display to the next.
    pub period: f64,
}

/// A climb.
#[derive(Debug, Clone, Copy)]
struct Climb {
    time: f64,
    /// The level before it.
    from: usize,
    /// The high cost there.
    cost: f64,
}

/// A climb that failed.
#[derive(Debug, Clone, Copy)]
struct Bar {
    climb: Climb,
    /// The level that failed.
    level: usize,
    until: f64,
}

/// Cost before a change of the level, from which the share is learnt.
#[derive(Debug, Clone, Copy)]
struct Before {
    level: usize,
    cost: f64,
}

/// Chooses a headset's level.
#[derive(Debug, Clone)]
pub struct QualityControl {
    level: usize,
    /// Part of the cost of level 1 that grows with pixels, 0 to 1.
    share: f64,
    /// Newest measurements at this level, oldest first.
    costs: VecDeque<PictureCost>,
    /// Time of the first one.
    since: Option<f64>,
    /// Submission time and seconds of the newest measured picture; `None` after an interruption.
    newest: Option<(f64, f64)>,
    /// Pictures before this time do not count.
    counts_from: f64,
    before: Option<Before>,
    /// The last climb, until it has held or failed.
    climb: Option<Climb>,
    bar: Option<Bar>,
    bar_seconds: f64,
    late: u64,
    changes: u64,
}

impl Default for QualityControl {
    fn default() -> Self {
        Self {
            level: 0,
            share: 1.0,
            costs: VecDeque::with_capacity(KEPT),
            since: None,
            newest: None,
            counts_from: f64::NEG_INFINITY,
            before: None,
            climb: None,
            bar: None,
            bar_seconds: FIRST_BAR,
            late: 0,
            changes: 0,
        }
    }
}

/// Edge of a level's picture over the display's, above 0 and at most 1.
#[must_use]
pub fn edge(level: usize) -> f64 {
    EDGE_STEP.powi(level.saturating_sub(1).min(LEVELS - 2) as i32)
}

/// Work of a level's pixels; 1 for `fast` at the whole edge.
#[must_use]
pub fn work(level: usize) -> f64 {
    if level == 0 { BEST_WORK } else { edge(level).powi(2) }
}

/// Quality and edge of a level, with `best` as the best quality.
#[must_use]
pub fn drawn_at(level: usize, best: Quality) -> Level {
    match level {
        0 => Level { quality: best, scale: 1.0 },
        level => Level { quality: Quality::Fast, scale: edge(level) },
    }
}

/// Cost of a level, predicted from the cost at another level, with the share of pixels at level 1.
fn predicted(cost: f64, share: f64, from: usize, to: usize) -> f64 {
    let weight = |level: usize| 1.0 - share + share * work(level);
    cost * weight(to) / weight(from).max(f64::MIN_POSITIVE)
}

/// The finest level whose cost fits into `limit`. If none does, the finest one that costs hardly more than the coarsest.
#[must_use]
pub fn finest_within(limit: f64, cost: impl Fn(usize) -> f64) -> usize {
    let least = cost(LEVELS - 1);
    let limit = if least <= limit { limit } else { NEAR_LEAST * least };
    (0..LEVELS).find(|level| cost(*level) <= limit).unwrap_or(LEVELS - 1)
}

impl QualityControl {
    /// A control that starts at the level that fits a picture measured beforehand.
    #[must_use]
    pub fn starting_from(measured: PictureCost) -> Self {
        let mut control = Self::default();
        if is_sound(&measured) {
            let PictureCost { seconds, level, period, .. } = measured;
            let level = level.min(LEVELS - 1);
            let share = share_of(&measured).unwrap_or(1.0);
            control.share = share_at_whole_edge((1.0 - share) * seconds, share * seconds / work(level));
            let cost = |to| predicted(seconds, control.share, level, to);
            control.level = finest_within(SETPOINT * SHARE * period, cost);
        }
        control
    }

    /// Number of the present level, from 0.
    #[must_use]
    pub fn level(&self) -> usize {
        self.level
    }

    /// Number of measured pictures over budget.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Number of changes of the level.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Drops what was measured and keeps the level: the session is hidden, has no focus, or pauses.
    pub fn interrupt(&mut self) {
        self.newest = None;
        self.before = None;
        self.forget();
    }

    fn forget(&mut self) {
        self.costs.clear();
        self.since = None;
    }

    /// Takes in the cost of a picture and chooses the level of the next one.
    pub fn measure(&mut self, picture: PictureCost) {
        if !is_sound(&picture) || self.newest.is_some_and(|(time, _)| picture.time <= time) {
            return;
        }
        let paused = |(time, seconds): (f64, f64)| picture.time - time > GAP.max(3.0 * seconds.max(picture.seconds));
        if self.newest.is_none_or(paused) {
            self.interrupt();
            self.counts_from = picture.time + SETTLES;
        }
        self.newest = Some((picture.time, picture.seconds));
        if picture.time < self.counts_from || picture.level != self.level {
            return;
        }
        let budget = SHARE * picture.period;
        self.late += u64::from(picture.seconds > budget);
        if self.costs.len() == KEPT {
            self.costs.pop_front();
        }
        self.costs.push_back(picture);
        self.since.get_or_insert(picture.time);
        self.learn(&picture);
        if !(self.is_overloaded(budget) && self.descend_if_it_helps(picture.time, budget)) {
            self.climb_if_it_fits(&picture, budget);
        }
    }

    /// Updates the share of the cost that grows with pixels.
    fn learn(&mut self, picture: &PictureCost) {
        if share_of(picture).is_some() {
            let sum = |part: fn(&PictureCost) -> f64| self.costs.iter().rev().take(RECENT.0).map(part).sum::<f64>();
            let pixels = sum(|c| share_of(c).unwrap_or(1.0) * c.seconds);
            let fixed = sum(|c| c.seconds) - pixels;
            self.share = share_at_whole_edge(fixed, pixels / work(self.level));
            return;
        }
        if self.costs.len() < RECENT.1 {
            return;
        }
        if let Some(Before { level, cost }) = self.before.take() {
            let (here, [then, now]) = (self.recent_cost(), [level, self.level].map(work));
            // A small change says little: noise is as large as what it gains.
            let weight = (then - now).abs() / then.max(now);
            if weight > LEAST_CHANGE {
                let pixels = ((cost - here) / (then - now)).max(0.0);
                let share = share_at_whole_edge((here - pixels * now).max(0.0), pixels).max(LEAST_LEARNT);
                self.share += weight * (share - self.share);
            }
        }
    }

    /// The newest costs, sorted.
    fn sorted_costs(&self, most: usize) -> Vec<f64> {
        let mut costs: Vec<f64> = self.costs.iter().rev().take(most).map(|c| c.seconds).collect();
        costs.sort_by(f64::total_cmp);
        costs
    }

    /// Median of the last few costs.
    fn recent_cost(&self) -> f64 {
        let costs = self.sorted_costs(RECENT.0);
        costs.get(costs.len() / 2).copied().unwrap_or(0.0)
    }

    fn is_overloaded(&self, budget: f64) -> bool {
        let mut newest = self.costs.iter().rev();
        let late = newest.clone().take(RECENT.0).filter(|c| c.seconds > budget).count();
        let slow = match (newest.next(), newest.next()) {
            (Some(a), Some(b)) => a.seconds.min(b.seconds) > budget && a.seconds + b.seconds > SLOW,
            _ => false,
        };
        late >= RECENT.1 || slow
    }

    /// Goes to a coarser level if one gains something.
    fn descend_if_it_helps(&mut self, time: f64, budget: f64) -> bool {
        let cost = self.recent_cost();
        let mut target = finest_within(SETPOINT * budget, |to| predicted(cost, self.share, self.level, to));
        if target <= self.level {
            return false;
        }
        if let Some(climb) = self.climb.take().filter(|climb| time - climb.time < self.bar_seconds) {
            // The level before had held.
            target = target.min(climb.from);
            self.bar = Some(Bar { climb, level: self.level, until: time + self.bar_seconds });
            self.bar_seconds = (2.0 * self.bar_seconds).min(LONGEST_BAR);
        }
        self.change(target, cost);
        true
    }

    fn climb_if_it_fits(&mut self, picture: &PictureCost, budget: f64) {
        if self.climb.is_some_and(|climb| picture.time - climb.time >= self.bar_seconds) {
            // It has held.
            self.climb = None;
            self.bar_seconds = FIRST_BAR;
        }
        let at_level = self.since.map_or(0.0, |since| picture.time - since);
        if self.level == 0 || self.costs.len() < CLIMB_PICTURES || at_level < CLIMB {
            return;
        }
        let costs = self.sorted_costs(KEPT);
        let high = costs.get((costs.len() * 9 / 10).saturating_sub(1)).copied().unwrap_or(f64::INFINITY);
        let cost = |to| predicted(high, self.share, self.level, to);
        let may = |to: usize| work(to) <= CLIMB_WORK * work(self.level) && !self.is_barred(to, picture.time, cost);
        let fitting = finest_within(SETPOINT * budget, cost);
        let quick = (fitting..self.level).find(|to| may(*to));
        let patient = (at_level >= PATIENCE).then(|| {
            let limit = if picture.pixel_seconds.is_some() { PATIENT_SETPOINT } else { BLIND_SETPOINT };
            let next = self.level - 1;
            // A level in use above the setpoint may be held, not left upwards.
            (cost(next) <= limit * budget && high <= PATIENT_SETPOINT * budget && may(next)).then_some(next)
        });
        if let Some(target) = quick.or(patient.flatten()) {
            self.climb = Some(Climb { time: picture.time, from: self.level, cost: high });
            self.change(target, self.recent_cost());
        }
    }

    /// Whether a level has failed and would fail again, by the cost of each level predicted now.
    fn is_barred(&self, level: usize, time: f64, cost: impl Fn(usize) -> f64) -> bool {
        self.bar.is_some_and(|Bar { climb, level: failed, until }| {
            level <= failed && time < until && cost(climb.from) > LIFTS * climb.cost
        })
    }

    fn change(&mut self, level: usize, cost: f64) {
        self.before = Some(Before { level: self.level, cost });
        self.level = level;
        self.forget();
        self.changes += 1;
    }
}

fn is_sound(picture: &PictureCost) -> bool {
    let PictureCost { time, seconds, period, .. } = *picture;
    time.is_finite() && seconds.is_finite() && seconds >= 0.0 && period.is_finite() && period > 0.0
}

/// Share of pixels at level 1, from the two parts of its cost; 1 for a picture without cost.
fn share_at_whole_edge(fixed: f64, pixels: f64) -> f64 {
    if pixels + fixed > 0.0 { (pixels / (pixels + fixed)).clamp(0.0, 1.0) } else { 1.0 }
}

/// Share of the measured cost that grows with pixels.
fn share_of(picture: &PictureCost) -> Option<f64> {
    let pixels = picture.pixel_seconds.filter(|s| s.is_finite() && picture.seconds > 0.0)?;
    Some((pixels / picture.seconds).clamp(0.0, 1.0))
}
