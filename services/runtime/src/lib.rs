//! What every process is built on: bus, actors, lifecycle, health, telemetry.
//!
//! This is the only room that names zenoh. A service is written against four things:
//! [`bus::Bus`] (ask, answer, publish, newest value), [`actor::Actor`] (a bounded mailbox, typed messages, an observable
//! state), [`process::Host`] (one lifecycle for every process) and [`fault::Fault`] (a typed refusal).

pub mod actor;
pub mod blobs;
pub mod bus;
pub mod context;
pub mod fault;
pub mod metrics;
pub mod process;
pub mod scene_feed;
mod scene_files;
pub mod scene_replica;
pub mod session;
pub mod telemetry;
pub mod trace;
mod wire;
