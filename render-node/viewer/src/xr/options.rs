//! Options of a headset session.

use std::time::Duration;

use crate::hands::Stance;

/// How a headset is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Factor on the width and height that the runtime recommends, 0.1 to 4.
    pub resolution: f64,
    /// Frames in a second, where the runtime lets one choose; the nearest that it offers.
    pub refresh_rate: Option<f32>,
    /// Standing, the room's floor is at y = 0 where the runtime knows it; seated, the eyes are.
    pub stance: Stance,
    /// Pause before a runtime that went away is looked for again.
    pub retry_pause: Duration,
    /// How often it is looked for.
    pub tries: u32,
    /// Timeout for the runtime's answer during a search; after it, the runtime counts as hung.
    pub timeout: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            resolution: 1.0,
            refresh_rate: None,
            stance: Stance::Standing,
            retry_pause: Duration::from_secs(1),
            tries: 300,
            timeout: Duration::from_secs(20),
        }
    }
}
