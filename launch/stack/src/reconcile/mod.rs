//! The reconciler: compares desired and observed state, as a pure state machine.
//!
//! [`Reconciler::step`] takes one event and the time, and returns actions. It reads no clock, starts nothing and never
//! waits, so tests can simulate years of failures. First start, restart, swap, reload and stop share one path. An event
//! changes the desired or observed state, and the machine settles towards its goal.
//!
//! A service is a slot with a fixed position. A slot has at most one serving process and one candidate to replace it.
//! Every pause and every state with a process has a deadline ([`Reconciler::next_deadline`]).

mod backoff;
mod handover;
mod intensity;
mod model;
mod reconciler;
mod reload;
mod slot;
mod start;
mod stop;
mod view;

pub use model::{Action, End, Event, Exit, Outcome, PROBE_TIME, ProcessId, Spawn, Time, Work};
pub use reconciler::Reconciler;

#[cfg(test)]
mod tests;
