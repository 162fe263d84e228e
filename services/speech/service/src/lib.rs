//! What the speech process shares with fuzzing: answers of servers.

pub mod transcription;
