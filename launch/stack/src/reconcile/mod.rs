//! The supervisor's reconciler: desired state against observed state, as a pure state machine.
//!
//! [`Reconciler::step`] takes one event and the time and says what is to be done; it reads no clock, starts nothing and
//! waits for nothing, so that tests can drive it through years of failures. First start, restart, swap, reload and stop are
//! one path: an event changes what is wished or what is known, and the machine then settles towards its goal.
//!
//! A service is a slot that keeps its position for as long as the supervisor lives. A slot has at most one process that
//! serves and at most one candidate that stands by to replace it. Every state that has a process, and every pause, has a
//! deadline ([`Reconciler::next_deadline`]).

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

pub use model::{Action, End, Event, Exit, Outcome, PROBE_TIME, ProcessId, Spawn, Time};
pub use reconciler::Reconciler;

#[cfg(test)]
mod tests;
