//! The parser's building blocks: tokens, phrases, numbers, targets.

pub(crate) mod length;
pub(crate) mod modifier;
pub(crate) mod number;
pub(crate) mod phrase;
pub(crate) mod reading;
pub(crate) mod target;
pub(crate) mod token;
pub(crate) mod viewer_axes;
