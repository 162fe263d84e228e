//! All orders of events for one service during its swap, to a depth.
//!
//! The simulated worlds draw at random. This test enumerates: each process may end, get ready, be probed or promoted,
//! the next deadline may pass, and a request may arrive.

use std::collections::BTreeMap;

use super::*;
use crate::reconcile::slot::State;

#[derive(Debug, Clone, Default)]
struct Process {
    instance: String,
    standby: bool,
    ready: bool,
    serves: bool,
    verifying: bool,
    promoting: bool,
}

#[derive(Debug, Clone)]
struct Point {
    stack: Reconciler,
    now: Time,
    alive: BTreeMap<ProcessId, Process>,
    ended: usize,
    started: usize,
    epoch: u64,
    swaps: u32,
    wished: bool,
    finished: bool,
    /// Whether a serving process was lost. It stays for ever.
    haunted: bool,
    trace: Vec<&'static str>,
}

impl Point {
    fn new() -> Self {
        Self {
            stack: Reconciler::new(vec![service(0, &[], Policy { restarts: 2, ..patient() })], 1, 0),
            now: Duration::ZERO,
            alive: BTreeMap::new(),
            ended: 0,
            started: 0,
            epoch: 0,
            swaps: 0,
            wished: false,
            finished: false,
            haunted: false,
            trace: Vec::new(),
        }
    }

    fn take(&mut self, what: &'static str, event: Event) {
        self.trace.push(what);
        self.now =
            if event == Event::Tick { self.stack.next_deadline().unwrap_or(self.now) } else { self.now + millis(1) };
        match &event {
            Event::Exited { id, .. } => assert!(self.alive.remove(id).is_some()),
            Event::Ready { instance, .. } => {
                self.alive.values_mut().filter(|p| p.instance == *instance).for_each(|p| p.ready = true);
            }
            Event::Verified { id, .. } => self.alive.get_mut(id).unwrap().verifying = false,
            Event::Promoted { id, .. } => self.alive.get_mut(id).unwrap().promoting = false,
            Event::Swap { .. } => self.swaps += 1,
            Event::Restart { .. } | Event::Down => self.wished = true,
            _ => {}
        }
        for action in self.stack.step(event, self.now) {
            assert!(!self.finished, "{action:?} after the end: {:?}", self.trace);
            match action {
                Action::Spawn(spawn) => {
                    self.started += 1;
                    if !spawn.standby {
                        self.grant(spawn.epoch);
                    }
                    assert!(!spawn.standby || self.alive.values().all(|p| p.serves), "{:?}", self.trace);
                    let process = Process {
                        instance: spawn.instance,
                        standby: spawn.standby,
                        serves: !spawn.standby,
                        ..Process::default()
                    };
                    self.alive.insert(spawn.id, process);
                }
                Action::Verify { id, .. } => self.alive.get_mut(&id).unwrap().verifying = true,
                Action::Promote { id, epoch, .. } => {
                    self.grant(epoch);
                    let process = self.alive.get_mut(&id).unwrap();
                    (process.promoting, process.serves) = (true, true);
                }
                Action::Terminate(id) | Action::Kill(id) => {
                    assert!(self.alive.contains_key(&id), "{:?}", self.trace);
                }
                Action::Ended { id, end, .. } => {
                    self.ended += 1;
                    if end == End::Lost {
                        self.haunted |= self.alive.remove(&id).unwrap().serves;
                    }
                }
                Action::Finish(_) => self.finished = true,
                Action::Announce { .. } | Action::AnnounceSwap { .. } => {}
            }
        }
        let slot = &self.stack.slots[0];
        let running = usize::from(matches!(slot.state, State::Alive(_))) + usize::from(slot.candidate.is_some());
        assert_eq!(running, self.alive.len(), "{:?}: {slot:?}", self.trace);
        assert!(slot.deadlines().all(|d| d > self.now), "handle_deadline: {:?}", self.trace);
        assert!(slot.deadlines().count() >= running);
    }

    fn grant(&mut self, epoch: u64) {
        assert!(!self.haunted && self.alive.values().all(|p| !p.serves), "two serve: {:?}", self.trace);
        assert!(epoch > self.epoch, "{:?}", self.trace);
        self.epoch = epoch;
    }

    fn choices(&self) -> Vec<(&'static str, Event)> {
        let mut choices = Vec::new();
        for (id, process) in &self.alive {
            let id = *id;
            let candidate = process.standby && !process.serves;
            let name = |main, other| if candidate { other } else { main };
            choices.push((name("main ends", "candidate ends"), Event::Exited { id, exit: exit(Some(1)) }));
            if !process.ready {
                let event = Event::Ready { instance: process.instance.clone(), start_ms: 1, standby: process.standby };
                choices.push((name("main is ready", "candidate stands by"), event));
            }
            if process.verifying {
                choices.push(("verified", Event::Verified { id, outcome: Ok(()) }));
                choices.push(("unfit", Event::Verified { id, outcome: Err("unfit".into()) }));
            }
            if process.promoting {
                choices.push(("promoted", Event::Promoted { id, outcome: Ok(()) }));
                choices.push(("cannot", Event::Promoted { id, outcome: Err("cannot".into()) }));
            }
        }
        if self.stack.next_deadline().is_some() {
            choices.push(("time passes", Event::Tick));
        }
        if self.swaps < 2 {
            choices.push(("swap", Event::Swap { service: 0, start: start(self.swaps + 1) }));
        }
        if !self.wished {
            choices.push(("restart", Event::Restart { service: 0 }));
            choices.push(("down", Event::Down));
            let list = vec![service(0, &[], patient())];
            choices.push(("as it was", Event::SetServices(list)));
        }
        choices
    }

    /// From every state an obedient world reaches its end, with one end for each process.
    fn ends(mut self) {
        if !self.finished {
            self.take("down", Event::Down);
        }
        for _ in 0..20 {
            let Some(id) = self.alive.keys().next().copied() else { break };
            self.take("obeys", Event::Exited { id, exit: exit(Some(0)) });
        }
        assert!(self.finished, "{:?}: {:?}", self.trace, self.stack);
        assert_eq!(self.ended, self.started, "{:?}", self.trace);
    }
}

fn explore(point: &Point, depth: u32, seen: &mut u64) {
    *seen += 1;
    if depth == 0 || point.finished {
        return point.clone().ends();
    }
    for (what, event) in point.choices() {
        let mut next = point.clone();
        next.take(what, event);
        explore(&next, depth - 1, seen);
    }
}

/// From the first start, and from each stage of a swap.
#[test]
fn all_orders_of_events_keep_the_invariants() {
    let mut point = Point::new();
    point.take("begin", Event::Tick);
    let story = ["main is ready", "swap", "candidate stands by", "verified", "main ends", "promoted"];
    let mut seen = 0;
    explore(&point, 6, &mut seen);
    for wanted in story {
        let (what, event) = point.choices().into_iter().find(|(what, _)| *what == wanted).unwrap();
        point.take(what, event);
        explore(&point, 6, &mut seen);
    }
    assert_eq!(point.stack.service(0, point.now).unwrap().executable, "/v1");
    assert!(seen > 300_000, "{seen}");
}
