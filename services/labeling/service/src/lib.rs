//! What the labeling process shares with fuzzing: stored embeddings, and pictures of queries.

pub mod embedding_cache;
pub mod query_png;
