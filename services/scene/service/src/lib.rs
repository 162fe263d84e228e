//! The journal and the project file of the scene process.

pub mod journal;
pub mod project;
