//! The contract: messages, keys, limits.
