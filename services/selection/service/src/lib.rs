//! What the selection process shares with tests: graphs for a random walk.

pub mod graph_file;
