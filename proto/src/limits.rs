//! Limits that every service enforces.

use std::time::Duration;

/// Largest payload of one message, bytes. A mask of 33 million Gaussians fits.
pub const MAX_MESSAGE_BYTES: usize = 4 << 20;

/// Largest encoded envelope, bytes.
pub const MAX_ENVELOPE_BYTES: usize = 4096;

/// Longest name of a unit, a role, a session or a command id, bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Longest utterance, bytes.
pub const MAX_UTTERANCE_BYTES: usize = 4096;

/// Most points of one stroke.
pub const MAX_STROKE_POINTS: usize = 100_000;

/// Most strokes of one selection.
pub const MAX_STROKES: usize = 1000;

/// Most proposals in one reply.
pub const MAX_PROPOSALS: u32 = 16;

/// Most editable units of one scene.
pub const MAX_UNITS: usize = 1000;

/// Most kept viewpoints of one scene.
pub const MAX_KEPT_VIEWS: usize = 64;

/// Largest width and height of a picture, pixels.
pub const MAX_PICTURE_PIXELS: u32 = 8192;

/// Default deadline of a request.
pub const DEFAULT_DEADLINE: Duration = Duration::from_secs(5);

/// Period of the health messages of each process.
pub const HEALTH_PERIOD: Duration = Duration::from_secs(1);

/// Most messages that one process takes from one node, per second.
pub const NODE_MESSAGES_PER_SECOND: u32 = 5000;

/// Most bytes that one process takes from one node, per second. Sixty previews of the largest mask fit.
pub const NODE_BYTES_PER_SECOND: u32 = 256 << 20;

/// Seconds of unused quota that a node can save up for a burst.
pub const NODE_BURST_SECONDS: u32 = 4;

/// Most requests of one node that wait for an answer of one process.
pub const NODE_OPEN_REQUESTS: usize = 64;
