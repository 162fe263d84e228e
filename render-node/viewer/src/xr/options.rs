//! Options of a headset session.

use std::time::Duration;

use crate::hands::Stance;

/// How a headset puts pictures before a person's surroundings: OpenXR's environment blend modes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BlendMode {
    /// The surroundings are not seen.
    #[default]
    Opaque,
    /// They are seen where a picture has less than full opacity, as through cameras.
    AlphaBlend,
    /// The picture's light is added to theirs, as on glass.
    Additive,
}

impl BlendMode {
    /// Whether the surroundings are seen.
    #[must_use]
    pub fn shows_surroundings(self) -> bool {
        self != Self::Opaque
    }
}

/// What shows a person's surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurroundingsSource {
    /// A blend mode of the runtime.
    Blend(BlendMode),
    /// A layer behind all others: `XR_FB_passthrough`.
    Passthrough,
}

/// How a headset is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Factor on the width and height that the runtime recommends, 0.1 to 4.
    pub resolution: f64,
    /// Frames in a second, where the runtime lets one choose; the nearest that it offers.
    pub refresh_rate: Option<f32>,
    /// Whether the surroundings are shown at first, and how, where the runtime offers this; else in another way that it offers.
    pub blend_mode: BlendMode,
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
            blend_mode: BlendMode::Opaque,
            stance: Stance::Standing,
            retry_pause: Duration::from_secs(1),
            tries: 300,
            timeout: Duration::from_secs(20),
        }
    }
}
