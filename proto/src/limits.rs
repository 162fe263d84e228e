//! Bounds that every service keeps and may rely on.

use std::time::Duration;

/// Largest payload of one message, bytes. A mask of 33 million Gaussians fits.
pub const MAX_MESSAGE_BYTES: usize = 4 << 20;

/// Largest attachment (an encoded envelope), bytes.
pub const MAX_ENVELOPE_BYTES: usize = 4096;

/// Longest name of a unit, a role, a session or a command id, bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Longest utterance, bytes.
pub const MAX_UTTERANCE_BYTES: usize = 4096;

/// Most corners of one stroke.
pub const MAX_STROKE_POINTS: usize = 100_000;

/// Most strokes that one selection accumulates.
pub const MAX_STROKES: usize = 1000;

/// Most places that a selection proposes for a next stroke at once.
pub const MAX_PROPOSALS: u32 = 16;

/// Most editable units of one scene.
pub const MAX_UNITS: usize = 1000;

/// Largest picture on one axis, pixels.
pub const MAX_PICTURE_PIXELS: u32 = 8192;

/// How long an asker waits where it states no other deadline.
pub const DEFAULT_DEADLINE: Duration = Duration::from_secs(5);

/// How often each process publishes its health.
pub const HEALTH_PERIOD: Duration = Duration::from_secs(1);
