//! What the command shares with tests: the language of the demo's scripts.

pub mod script;
