//! Properties of every stack: in simulated worlds ([`world`]), in every order of events ([`orderings`]), and case by
//! case ([`cases`], [`swaps`], [`reloads`], [`nodes`]).

mod cases;
mod nodes;
mod orderings;
mod reloads;
mod swaps;
mod world;

use std::time::Duration;

use super::model::*;
use super::reconciler::*;
use crate::document::Place;
use crate::file::{Policy, Service, Start};

fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn exit(status: Option<i32>) -> Exit {
    Exit { status, reason: format!("{status:?}") }
}

/// Starts from this version on are on another machine.
const ELSEWHERE: u32 = 3;
const NODE: &str = "n";

fn start(version: u32) -> Start {
    let node = (version >= ELSEWHERE).then(|| NODE.to_owned());
    Start { executable: format!("/v{version}").into(), node, ..Start::default() }
}

fn node(present: bool) -> Event {
    Event::Node { name: NODE.to_owned(), present }
}

/// The service `s<index>` in role `r<index>`, with these dependencies.
fn service(index: usize, after: &[usize], policy: Policy) -> Service {
    Service {
        name: format!("s{index}"),
        role: format!("r{index}"),
        start: start(0),
        after: after.iter().map(|i| format!("s{i}")).collect(),
        policy,
        place: Place::File { line: 1, column: 1 },
    }
}

fn patient() -> Policy {
    Policy { liveness: millis(1500), ready: millis(700), stop: millis(300), ..Policy::default() }
}
