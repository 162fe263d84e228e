//! Graphics cards by their published numbers, and the time that they need for counted work.
//!
//! The time of a pass is that of its slowest part: memory, blending or evaluations. Each barrier adds the latency with which
//! dependent work follows. Sources and assumptions are in `docs/costs.md`.

use super::{Pass, PassWork, TargetFormat};

/// Seconds from the end of a dispatch to the begin of one that depends on it.
const BARRIER_SECONDS: f64 = 3e-6;

/// Issued instructions for one evaluation of a splat at a pixel: arithmetic, loads and the loop of `blend` in `blend_tiles.wgsl`.
const EVALUATION: f64 = 40.0;

/// As [`EVALUATION`], for a splat that rays evaluate (`meet_ray`).
const RAY_EVALUATION: f64 = 110.0;

/// As [`EVALUATION`], at a block of pixels, whose mean widens the ellipse.
const BLOCK_EVALUATION: f64 = 54.0;

/// Clocks of a raster unit for one blended pixel of four f32, of four f16, and for one pixel that is stored.
const BLEND_CLOCKS_32: f64 = 8.0;
const BLEND_CLOCKS_16: f64 = 2.0;
const STORE_CLOCKS_32: f64 = 4.0;
const STORE_CLOCKS_16: f64 = 2.0;

/// A graphics card.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Card {
    /// Name on the command line.
    pub name: &'static str,
    /// Raster units: pixels of 4 bytes a clock.
    pub raster_units: f64,
    /// Lanes that issue one f32 instruction a clock.
    pub lanes: f64,
    /// Boost clock, hertz.
    pub clock: f64,
    /// Bytes of memory a second.
    pub bandwidth: f64,
}

impl Card {
    /// The card of the paper, a faster and a middling one, and the card of a data centre that measurements were made on.
    pub const ALL: [Self; 4] = [
        Self { name: "rtx-3090", raster_units: 112.0, lanes: 10_496.0, clock: 1.695e9, bandwidth: 936e9 },
        Self { name: "rtx-4090", raster_units: 176.0, lanes: 16_384.0, clock: 2.52e9, bandwidth: 1008e9 },
        Self { name: "rtx-3060", raster_units: 48.0, lanes: 3_584.0, clock: 1.777e9, bandwidth: 360e9 },
        Self { name: "h100", raster_units: 24.0, lanes: 16_896.0, clock: 1.98e9, bandwidth: 3350e9 },
    ];

    /// Pixels of four numbers that are blended a second.
    #[must_use]
    pub fn blend_rate(&self, target: TargetFormat) -> f64 {
        let clocks = match target {
            TargetFormat::Float32 => BLEND_CLOCKS_32,
            TargetFormat::Float16 => BLEND_CLOCKS_16,
        };
        self.raster_units * self.clock / clocks
    }

    /// Pixels of four numbers that are stored a second.
    #[must_use]
    pub fn store_rate(&self, target: TargetFormat) -> f64 {
        let clocks = match target {
            TargetFormat::Float32 => STORE_CLOCKS_32,
            TargetFormat::Float16 => STORE_CLOCKS_16,
        };
        self.raster_units * self.clock / clocks
    }

    /// Predicted seconds of a pass.
    #[must_use]
    pub fn seconds(&self, work: &PassWork, target: TargetFormat) -> f64 {
        // Images of a window and depths have 4 bytes a pixel.
        let stored = match work.pass {
            Pass::Present | Pass::Depths | Pass::DepthLayer => self.raster_units * self.clock,
            _ => self.store_rate(target),
        };
        // Depths of quadrilaterals are blended in four f32.
        let target = if work.pass == Pass::Depths { TargetFormat::Float32 } else { target };
        let raster = work.blended as f64 / self.blend_rate(target) + work.stored as f64 / stored;
        let memory = (work.bytes_read + work.bytes_written) as f64 / self.bandwidth;
        let plain = work.in_step.saturating_sub(work.in_step_by_rays + work.in_step_in_blocks) as f64;
        let [by_rays, in_blocks] = [work.in_step_by_rays, work.in_step_in_blocks].map(|count| count as f64);
        let instructions = EVALUATION * plain + RAY_EVALUATION * by_rays + BLOCK_EVALUATION * in_blocks;
        let shading = instructions / (self.lanes * self.clock);
        memory.max(raster).max(shading) + BARRIER_SECONDS * f64::from(work.commands.barriers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::barriers::Commands;

    #[test]
    fn the_slowest_part_and_the_barriers_make_the_time() {
        let [card, ..] = Card::ALL;
        let nothing = PassWork::of(Pass::Blend);
        let seconds = |work: PassWork, target| card.seconds(&work, target);
        assert_eq!(seconds(nothing, TargetFormat::Float32), 0.0);
        let barriers = Commands { barriers: 10, ..Commands::default() };
        assert!((seconds(PassWork { commands: barriers, ..nothing }, TargetFormat::Float32) - 3e-5).abs() < 1e-12);
        let bytes = PassWork { bytes_read: 936_000_000, ..nothing };
        assert!((seconds(bytes, TargetFormat::Float32) - 1e-3).abs() < 1e-9);
        let fragments = PassWork { blended: 1_000_000_000, ..bytes };
        let [full, half] = [TargetFormat::Float32, TargetFormat::Float16].map(|target| seconds(fragments, target));
        assert!((full / half - 4.0).abs() < 1e-9 && full > 0.04, "{full} {half}");
        let evaluated = PassWork { in_step: 1_000_000_000, in_step_by_rays: 500_000_000, ..nothing };
        assert!((seconds(evaluated, TargetFormat::Float32) - 75e9 / (10_496.0 * 1.695e9)).abs() < 1e-9);
    }
}
