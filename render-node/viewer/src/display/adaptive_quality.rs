//! Chooses the quality that keeps a display's pace.
//!
//! While the view or the scene changes, each picture has a time budget. After a late picture, quality drops one level.
//! Quality rises when the level above would fit the budget. Its past cost, or else its pixel count, gives the estimate. A
//! still view is drawn at the best quality.

use std::time::Duration;

use sg_raster::render::Quality;

/// Drawing quality of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Error against the reference.
    pub quality: Quality,
    /// Edge of the picture over that of the display, above 0 and at most 1.
    pub scale: f64,
}

/// Edges of the pictures below the level of the best quality, from the finest.
const SCALES: [f64; 6] = [1.0, 0.75, 0.5, 0.35, 0.25, 0.18];

/// Share of the budget that a level must leave free before quality returns to it.
const ROOM: f64 = 0.3;

/// Decay of a level's remembered cost, for each picture drawn in time at a lower level.
const AGES: f64 = 0.97;

/// Weight of the newest measurement.
const NEWEST: f64 = 0.5;

/// Time without a change after which something is at rest.
const SETTLES: Duration = Duration::from_millis(180);

/// That time where a picture at rest takes up to [`QUICK`] seconds. A dragging hand seldom pauses for so long.
const SETTLES_QUICKLY: Duration = Duration::from_millis(60);

/// Seconds of a picture that the continued motion hardly waits for.
const QUICK: f64 = 0.3;

/// Chooses the quality level by the measured cost of each level.
#[derive(Debug, Clone)]
pub struct AdaptiveQuality {
    budget: f64,
    at: usize,
    /// Seconds per picture of each level, once drawn.
    cost: [Option<f64>; SCALES.len() + 1],
    late: u64,
}

impl AdaptiveQuality {
    /// Pictures that may take `budget` seconds each while something moves.
    #[must_use]
    pub fn new(budget: f64) -> Self {
        Self { budget, at: 0, cost: [None; SCALES.len() + 1], late: 0 }
    }

    /// Level of the next picture.
    #[must_use]
    pub fn level(&self, best: Quality, moving: bool) -> Level {
        match if moving { self.at } else { 0 } {
            0 => Level { quality: best, scale: 1.0 },
            k => Level { quality: Quality::Fast, scale: SCALES[k - 1] },
        }
    }

    /// Records a picture's seconds, with motion or without.
    pub fn record(&mut self, seconds: f64, moving: bool) {
        let at = if moving { self.at } else { 0 };
        if !(seconds.is_finite() && seconds >= 0.0) {
            return;
        }
        let known = self.cost[at].get_or_insert(seconds);
        *known += NEWEST * (seconds - *known);
        if !moving {
            return;
        }
        if seconds > self.budget {
            self.late += 1;
            let here = self.at;
            self.at = (here + 1).min(SCALES.len());
            while self.at < SCALES.len() && self.by_pixels(here, self.at) > self.budget {
                self.at += 1;
            }
        } else if let Some(above) = self.at.checked_sub(1) {
            // The remembered cost of the level above ages.
            self.cost[above] = self.cost[above].map(|before| AGES * before);
            let grown = self.by_pixels(self.at, above);
            let predicted = self.cost[above].map_or(grown, |before| grown.max(before));
            if predicted < (1.0 - ROOM) * self.budget {
                self.at = above;
            }
        }
    }

    /// Time without a change after which something is at rest. Motion may go on while the picture at rest is drawn, so a costly one
    /// waits for longer.
    #[must_use]
    pub fn settles(&self) -> Duration {
        if self.cost[0].is_some_and(|seconds| seconds <= QUICK) { SETTLES_QUICKLY } else { SETTLES }
    }

    /// Number of moving pictures over budget.
    #[must_use]
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Estimates a level's cost from another level's, if all work grew with pixels.
    fn by_pixels(&self, from: usize, level: usize) -> f64 {
        let pixels = |k: usize| SCALES[k.saturating_sub(1)].powi(2);
        self.cost[from].unwrap_or(f64::INFINITY) * pixels(level) / pixels(from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws pictures that take `seconds(level)` until the level stays.
    fn settled(adaptive_quality: &mut AdaptiveQuality, seconds: impl Fn(Level) -> f64) -> Level {
        for _ in 0..120 {
            let level = adaptive_quality.level(Quality::Standard, true);
            adaptive_quality.record(seconds(level), true);
        }
        adaptive_quality.level(Quality::Standard, true)
    }

    #[test]
    fn a_slow_device_goes_down_until_it_keeps_pace_and_what_stands_still_is_at_its_best() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        let cost = |l: Level| 0.4 * l.scale * l.scale;
        let level = settled(&mut adaptive_quality, cost);
        assert!(cost(level) <= 0.05 && level.scale < 0.5, "{level:?}");
        assert_eq!(adaptive_quality.level(Quality::Standard, false), Level { quality: Quality::Standard, scale: 1.0 });
        assert!(adaptive_quality.late() > 0);
    }

    #[test]
    fn a_fast_one_stays_at_its_best() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        let level = settled(&mut adaptive_quality, |_| 0.004);
        assert_eq!(level, Level { quality: Quality::Standard, scale: 1.0 });
        assert_eq!(adaptive_quality.late(), 0);
    }

    #[test]
    fn it_comes_back_up_when_there_is_room_again() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        settled(&mut adaptive_quality, |l| 0.4 * l.scale * l.scale);
        let level = settled(&mut adaptive_quality, |_| 0.002);
        assert!((level.scale, level.quality) == (1.0, Quality::Standard), "{level:?}");
    }

    #[test]
    fn a_level_between_is_kept_rather_than_gone_up_and_down() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        // Half the edge takes 0.04 s: the level above would take 0.09.
        let cost = |l: Level| if l.quality == Quality::Fast { 0.16 * l.scale * l.scale } else { 0.3 };
        let level = settled(&mut adaptive_quality, cost);
        let late = adaptive_quality.late();
        assert_eq!(settled(&mut adaptive_quality, cost), level);
        assert_eq!(adaptive_quality.late(), late, "late again and again");
    }

    #[test]
    fn a_costly_picture_at_rest_waits_for_longer() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        assert_eq!(adaptive_quality.settles(), SETTLES, "its cost is not known");
        adaptive_quality.record(0.1, false);
        assert_eq!(adaptive_quality.settles(), SETTLES_QUICKLY);
        (0..10).for_each(|_| adaptive_quality.record(2.0, false));
        assert_eq!(adaptive_quality.settles(), SETTLES);
    }

    #[test]
    fn nonsense_changes_nothing() {
        let mut adaptive_quality = AdaptiveQuality::new(0.05);
        adaptive_quality.record(f64::NAN, true);
        adaptive_quality.record(-1.0, true);
        assert_eq!(adaptive_quality.level(Quality::Fast, true), Level { quality: Quality::Fast, scale: 1.0 });
    }
}
