//! A simulated world of processes.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use sg_proto::launch::{Change, ServiceState, SwapState};

use super::*;
use crate::file::Restart;

/// How a simulated process behaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Behaviour {
    /// Gets ready, lives, obeys.
    Good,
    /// Ends with a status before it is ready.
    Crash(i32),
    /// Gets ready, then ends with a status.
    CrashLater(i32),
    /// Never gets ready, obeys.
    Slow,
    /// Gets ready, then falls silent and obeys only SIGKILL.
    Hang,
    /// Gets ready, sends signs of life, but its work makes no progress. It obeys only SIGKILL.
    Stuck,
    /// Gets ready and leaves the bus without ending.
    Leave,
    /// Gets ready, ignores requests to stop.
    Stubborn,
    /// SIGKILL does not remove it.
    Undead,
    /// Cannot be started.
    Missing,
    /// Takes more and more memory.
    Greedy,
    /// Stands by and fails its probe.
    Unfit,
    /// Stands by and says nothing more.
    Mute,
    /// Serves at once instead of standing by.
    Impostor,
    /// Cannot take its role.
    Refuse,
    /// Dies while it takes its role.
    Faint,
}

const BEHAVIOURS: [Behaviour; 21] = [
    Behaviour::Good,
    Behaviour::Good,
    Behaviour::Good,
    Behaviour::Crash(1),
    Behaviour::Crash(0),
    Behaviour::Crash(EXIT_INPUT),
    Behaviour::CrashLater(1),
    Behaviour::CrashLater(0),
    Behaviour::Slow,
    Behaviour::Hang,
    Behaviour::Stuck,
    Behaviour::Leave,
    Behaviour::Stubborn,
    Behaviour::Undead,
    Behaviour::Missing,
    Behaviour::Greedy,
    Behaviour::Unfit,
    Behaviour::Mute,
    Behaviour::Impostor,
    Behaviour::Refuse,
    Behaviour::Faint,
];

/// Resident memory of a greedy process.
const TOO_MUCH: u64 = 100 << 20;

#[derive(Debug, Clone)]
pub(super) struct Simulated {
    pub(super) service: usize,
    pub(super) instance: String,
    pub(super) role: String,
    pub(super) start: Start,
    behaviour: Behaviour,
    delay: Duration,
    /// Serves its role, or was promoted.
    pub(super) serves: bool,
}

pub(super) struct World {
    pub(super) stack: Reconciler,
    pub(super) now: Time,
    pub(super) behaviours: Vec<(Behaviour, Duration)>,
    next_behaviour: usize,
    /// Future events, by time and serial number.
    future: BTreeMap<(Time, u64), Event>,
    serial: u64,
    pub(super) alive: BTreeMap<ProcessId, Simulated>,
    pub(super) spawned: Vec<(Time, Spawn)>,
    pub(super) ended: BTreeMap<ProcessId, End>,
    pub(super) first_started: Vec<usize>,
    pub(super) asked_to_stop: Vec<usize>,
    wished: bool,
    /// Whether the other machine is present.
    present: bool,
    pub(super) finished: Option<Outcome>,
    /// Times of automatic restarts.
    automatic: BTreeMap<usize, Vec<Time>>,
    /// Last granted epoch of each role.
    epochs: BTreeMap<String, u64>,
    /// States that swaps went through.
    pub(super) swaps: Vec<(usize, u64, SwapState, String)>,
}

impl World {
    pub(super) fn new(services: Vec<Service>, behaviours: Vec<(Behaviour, Duration)>) -> Self {
        Self {
            stack: Reconciler::new(services, 1, 100),
            now: Duration::ZERO,
            behaviours,
            next_behaviour: 0,
            future: BTreeMap::new(),
            serial: 0,
            alive: BTreeMap::new(),
            spawned: Vec::new(),
            ended: BTreeMap::new(),
            first_started: Vec::new(),
            asked_to_stop: Vec::new(),
            wished: false,
            present: false,
            finished: None,
            automatic: BTreeMap::new(),
            epochs: BTreeMap::new(),
            swaps: Vec::new(),
        }
    }

    /// A running world of one service, with the behaviours of its processes in order.
    pub(super) fn of_one(policy: Policy, behaviours: &[Behaviour]) -> Self {
        let behaviours = behaviours.iter().map(|b| (*b, millis(50))).collect();
        let mut world = Self::new(vec![service(0, &[], policy)], behaviours);
        world.give(Event::Tick);
        world
    }

    pub(super) fn later(&mut self, after: Duration, event: Event) {
        self.serial += 1;
        self.future.insert((self.now + after, self.serial), event);
    }

    /// State and reason of a service.
    pub(super) fn state(&self, index: usize) -> (ServiceState, String) {
        let service = self.stack.service(index, self.now).unwrap();
        (service.state(), service.reason)
    }

    /// State and reason of the newest swap of a service.
    pub(super) fn swap(&self, index: usize) -> (SwapState, String) {
        let swap = self.stack.service(index, self.now).unwrap().swap.unwrap();
        (swap.state(), swap.reason)
    }

    /// The process that serves a service.
    pub(super) fn serving(&self, index: usize) -> Option<&Simulated> {
        self.alive.values().find(|s| s.service == index && s.serves)
    }

    pub(super) fn give(&mut self, event: Event) {
        match &event {
            // The end of a process cancels its future events.
            Event::Exited { id, .. } if self.alive.remove(id).is_none() => return,
            Event::Ready { instance, .. } | Event::Presence { instance, .. } | Event::Health { instance, .. }
                if !self.alive.values().any(|s| s.instance == *instance) =>
            {
                return;
            }
            Event::Down | Event::Kill => self.wished = true,
            // The node's lease ran out, and its processes ended.
            Event::Node { present, .. } => {
                self.present = *present;
                self.alive.retain(|_, s| *present || s.start.node.is_none());
            }
            Event::Restart { service } => {
                self.automatic.remove(service);
            }
            Event::SetServices(_) => self.automatic.clear(),
            _ => {}
        }
        let actions = self.stack.step(event, self.now);
        for action in actions {
            self.act(action);
        }
        self.check();
    }

    fn act(&mut self, action: Action) {
        assert!(self.finished.is_none(), "{action:?} after the end");
        match action {
            Action::Spawn(spawn) => self.spawn(*spawn),
            Action::Verify { id, .. } => {
                let Some(Simulated { behaviour, delay, .. }) = self.alive.get(&id).cloned() else { return };
                let outcome = if behaviour == Behaviour::Unfit { Err("unfit".to_owned()) } else { Ok(()) };
                if behaviour != Behaviour::Mute {
                    self.later(delay / 3, Event::Verified { id, outcome });
                }
            }
            Action::Promote { id, epoch, .. } => self.promote(id, epoch),
            Action::Terminate(id) => {
                let Some(process) = self.alive.get(&id).cloned() else { return };
                self.asked_to_stop.push(process.service);
                let deaf = [Behaviour::Hang, Behaviour::Stuck, Behaviour::Stubborn, Behaviour::Undead];
                if !deaf.contains(&process.behaviour) {
                    self.later(process.delay / 4, Event::Exited { id, exit: exit(Some(0)) });
                }
            }
            Action::Kill(id) => {
                if self.alive.get(&id).is_some_and(|s| s.behaviour != Behaviour::Undead) {
                    self.later(millis(3), Event::Exited { id, exit: exit(None) });
                }
            }
            Action::Ended { id, service, end } => {
                let before = self.ended.insert(id, end);
                assert_eq!(before, None, "{id:?} of {service} ended twice");
            }
            Action::Announce { service } => {
                if self.state(service).0 == ServiceState::Backoff {
                    self.automatic.entry(service).or_default().push(self.now);
                }
            }
            Action::AnnounceSwap { service, swap } => {
                self.swaps.push((service, swap.number, swap.state(), swap.reason.clone()));
            }
            Action::Finish(outcome) => {
                let left: Vec<_> = self.alive.values().filter(|s| s.behaviour != Behaviour::Undead).collect();
                assert!(left.is_empty(), "{outcome:?} while {left:?} run");
                self.finished = Some(outcome);
            }
        }
    }

    /// The role is free, and the epoch is new.
    fn grant(&mut self, role: &str, epoch: u64) {
        let other = self.alive.values().find(|s| s.serves && s.role == role);
        assert!(other.is_none(), "role {role} is given away while {other:?} has it");
        let before = self.epochs.insert(role.to_owned(), epoch);
        assert!(epoch > 100 && before.is_none_or(|b| b < epoch), "{role}: {before:?} then {epoch}");
    }

    fn promote(&mut self, id: ProcessId, epoch: u64) {
        let Some(Simulated { behaviour, delay, role, serves, .. }) = self.alive.get(&id).cloned() else {
            return;
        };
        assert!(!serves, "promoted twice");
        self.grant(&role, epoch);
        self.alive.get_mut(&id).unwrap().serves = true;
        let outcome = match behaviour {
            Behaviour::Refuse => Err("cannot".to_owned()),
            Behaviour::Faint => {
                return self.later(delay / 3, Event::Exited { id, exit: exit(Some(1)) });
            }
            _ => Ok(()),
        };
        self.later(delay / 3, Event::Promoted { id, outcome });
    }

    fn spawn(&mut self, spawn: Spawn) {
        let Spawn { service, id, instance, role, start, epoch, standby, .. } = spawn.clone();
        let standing =
            self.alive.values().find(|s| s.service == service && !s.serves && s.behaviour != Behaviour::Undead);
        assert!(!standby || standing.is_none(), "two candidates: {standing:?}");
        assert!(!self.wished, "{service} started although the stack is to stop");
        assert!(start.node.is_none() || self.present, "{service} started on a machine that is not there");
        for on in &self.stack.slots[service].service.after {
            let index = self.stack.find_service(on).unwrap().0;
            assert_eq!(self.state(index).0, ServiceState::Ready, "{service} started before {on} is ready");
        }
        assert!(self.spawned.iter().all(|(_, s)| s.id != id && s.instance != instance));
        if standby {
            assert_eq!(epoch, 0, "an epoch is granted with the role");
        } else {
            self.grant(&role, epoch);
        }
        if !self.first_started.contains(&service) {
            self.first_started.push(service);
        }
        self.spawned.push((self.now, spawn));
        let (behaviour, delay) = self.behaviours[self.next_behaviour % self.behaviours.len()];
        self.next_behaviour += 1;
        let process =
            Simulated { service, instance: instance.clone(), role, start, behaviour, delay, serves: !standby };
        self.alive.insert(id, process);
        if behaviour == Behaviour::Missing {
            return self.later(Duration::ZERO, Event::Exited { id, exit: exit(None) });
        }
        self.later(Duration::ZERO, Event::Started { id, pid: 7 });
        match behaviour {
            Behaviour::Crash(status) => self.later(delay, Event::Exited { id, exit: exit(Some(status)) }),
            Behaviour::Slow => {}
            _ => {
                let standby = standby && behaviour != Behaviour::Impostor;
                self.later(delay, Event::Ready { instance: instance.clone(), start_ms: 1, standby });
            }
        }
        match behaviour {
            Behaviour::CrashLater(status) => {
                self.later(delay * 2, Event::Exited { id, exit: exit(Some(status)) });
            }
            Behaviour::Leave => self.later(delay * 2, Event::Presence { instance, alive: false }),
            Behaviour::Stuck => self.later(delay * 3, stuck(instance, millis(3001))),
            Behaviour::Greedy => self.later(delay * 3, health(instance, TOO_MUCH)),
            Behaviour::Hang | Behaviour::Crash(_) | Behaviour::Slow | Behaviour::Missing => {}
            _ => self.later(delay + millis(500), health(instance, 1)),
        }
    }

    fn check(&self) {
        for (index, slot) in self.stack.slots.iter().enumerate() {
            let name = &slot.service.name;
            let state = self.state(index).0;
            let timed = [ServiceState::Starting, ServiceState::Ready, ServiceState::Stopping, ServiceState::Backoff];
            let states = usize::from(timed.contains(&state)) + usize::from(slot.candidate.is_some());
            let deadlines: Vec<_> = slot.deadlines().collect();
            assert_eq!(deadlines.len(), states, "{name} is {state:?}: {slot:?}");
            assert!(deadlines.iter().all(|d| *d > self.now), "{name} is handle_deadline in {state:?}: {slot:?}");
            if self.finished.is_none() {
                let known = slot.main().into_iter().chain(&slot.candidate).map(|p| p.id);
                let known: BTreeSet<_> = known.chain(slot.lost.iter().map(|(i, _, _)| *i)).collect();
                let mine = self.alive.iter().filter(|(_, s)| s.service == index && s.behaviour != Behaviour::Undead);
                for (id, process) in mine {
                    assert!(known.contains(id), "{process:?} is forgotten");
                }
            }
            let times = self.automatic.get(&index).map_or(&[][..], Vec::as_slice);
            let most = usize::try_from(slot.service.policy.restarts).unwrap();
            for window in times.windows(most + 1) {
                assert!(window[most] - window[0] >= slot.service.policy.within, "{name} too often: {window:?}");
            }
        }
    }

    /// Advances time until `end`, the end of all events, or the end of the stack.
    pub(super) fn run_until(&mut self, end: Time) {
        for _ in 0..200_000 {
            if self.finished.is_some() {
                return;
            }
            let due = self.future.keys().next().copied();
            let deadline = self.stack.next_deadline();
            let next = due.map(|(t, _)| t).into_iter().chain(deadline).min();
            let Some(next) = next.filter(|t| *t <= end) else {
                self.now = self.now.max(end);
                return;
            };
            self.now = self.now.max(next);
            match due {
                Some(key) if key.0 <= self.now => {
                    let event = self.future.remove(&key).unwrap();
                    if let Event::Health { instance, .. } = &event {
                        let (instance, again) = (instance.clone(), event.clone());
                        if self.alive.values().any(|s| s.instance == instance) {
                            self.later(millis(1000), again);
                        }
                    }
                    self.give(event);
                }
                _ => self.give(Event::Tick),
            }
        }
        panic!("the machine does not come to rest");
    }
}

fn health(instance: String, memory_bytes: u64) -> Event {
    Event::Health { instance, memory_bytes, answer_ms: (0.0, 0.0), work: Work::default() }
}

/// The health of a process whose work has made no progress for this time.
pub(super) fn stuck(instance: String, stalled: Duration) -> Event {
    let work = Work { stalled, stalled_in: "actor `a`".to_owned(), ..Work::default() };
    Event::Health { instance, memory_bytes: 1, answer_ms: (0.0, 0.0), work }
}

fn policies() -> impl Strategy<Value = Policy> {
    let restart = prop_oneof![Just(Restart::Always), Just(Restart::OnFailure), Just(Restart::Never)];
    let limit = prop_oneof![Just(None), Just(Some(TOO_MUCH / 2))];
    (restart, 1..400_u64, 0..4_u32, 500..9000_u64, any::<bool>(), limit).prop_map(
        |(restart, initial, restarts, within, critical, memory_bytes)| Policy {
            restart,
            backoff_initial: millis(initial),
            backoff_max: millis(initial * 4),
            restarts,
            within: millis(within),
            ready: millis(700),
            liveness: millis(1500),
            progress: millis(3000),
            stop: millis(300),
            critical,
            memory_bytes,
        },
    )
}

/// Lists of services: a subset of six, with few starts and roles, each with earlier dependencies.
fn plans() -> impl Strategy<Value = Vec<Service>> {
    prop::collection::vec((policies(), any::<u8>(), 0..5_u32, 0..8_usize), 1..6).prop_map(|services| {
        let mut plan: Vec<Service> = Vec::new();
        for (i, (policy, bits, version, other)) in services.into_iter().enumerate() {
            let after: Vec<_> = (0..i).filter(|j| bits & (1 << j) != 0).collect();
            let mut service = Service { start: start(version), ..service(i, &after, policy) };
            // Sometimes the role of another service in another list.
            let role = format!("r{other}");
            if other < 6 && plan.iter().all(|s| s.role != role) && other > i {
                service.role = role;
            }
            if plan.iter().all(|s| s.role != service.role) {
                plan.push(service);
            }
        }
        let names: Vec<_> = plan.iter().map(|s| s.name.clone()).collect();
        for service in &mut plan {
            service.after.retain(|a| names.contains(a));
        }
        plan
    })
}

fn behaviours() -> impl Strategy<Value = Vec<(Behaviour, Duration)>> {
    let one = (prop::sample::select(&BEHAVIOURS[..]), 1..900_u64).prop_map(|(b, ms)| (b, millis(ms)));
    prop::collection::vec(one, 1..30)
}

fn wishes() -> impl Strategy<Value = Vec<(u64, Event)>> {
    let pending = prop_oneof![
        2 => (0..6_usize).prop_map(|service| Event::Restart { service }),
        4 => (0..6_usize, 0..5_u32).prop_map(|(service, version)| Event::Swap { service, start: start(version) }),
        2 => plans().prop_map(Event::SetServices),
        3 => any::<bool>().prop_map(node),
        2 => (1000..60_000_u64).prop_map(|ms| Event::Awoke(millis(ms))),
    ];
    prop::collection::vec((0..20_000_u64, pending), 0..10)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Invariants for all behaviours and requests. A role is granted only when its last holder is gone, with a higher
    /// epoch. Dependencies come first. Every state has a deadline. Restarts stay within their limit. Each process and
    /// each swap ends once. The stack stops on request.
    #[test]
    fn all_worlds_keep_the_invariants(
        plan in plans(),
        behaviours in behaviours(),
        wishes in wishes(),
        end in 1000..30_000_u64,
        hurry in any::<bool>(),
    ) {
        let mut world = World::new(plan, behaviours);
        for (at, pending) in wishes {
            world.later(millis(at), pending);
        }
        world.give(Event::Tick);
        world.run_until(millis(end));
        if world.finished.is_none() {
            world.give(if hurry { Event::Kill } else { Event::Down });
            // The lease ends the processes of a node at the latest.
            world.later(millis(12_000), node(false));
        }
        // Each of six services may need its grace period and two kills.
        let limit = world.now + millis(6 * 10_400);
        world.run_until(limit);
        prop_assert!(world.finished.is_some(), "not down: {:?}", world.stack);
        prop_assert_eq!(world.ended.len(), world.spawned.len(), "an id without an end");
        for slot in &world.stack.slots {
            let over = |s: &super::super::slot::Swap| matches!(s.state, SwapState::Done | SwapState::Failed);
            prop_assert!(slot.swap.as_ref().is_none_or(over), "a swap without an end: {:?}", slot.swap);
        }
    }

    /// Well-behaved services stop in the reverse order of their start.
    #[test]
    fn a_stack_stops_in_reverse(plan in plans(), delays in prop::collection::vec(1..600_u64, 1..9)) {
        let count = plan.len();
        let behaviours = delays.into_iter().map(|ms| (Behaviour::Good, millis(ms))).collect();
        let mut world = World::new(plan, behaviours);
        world.give(node(true));
        world.run_until(millis(5000));
        world.give(Event::Down);
        let limit = world.now + millis(5000);
        world.run_until(limit);
        prop_assert_eq!(&world.finished, &Some(Outcome::Down));
        prop_assert_eq!(world.first_started.len(), count);
        let reversed: Vec<_> = world.first_started.iter().rev().copied().collect();
        prop_assert_eq!(&world.asked_to_stop, &reversed);
    }

    /// In a world without failures every list of services is reached: each service runs with the last requested start,
    /// and nothing else runs.
    #[test]
    fn desired_services_are_reached(
        plans in prop::collection::vec((plans(), 1..3000_u64), 1..6),
        delays in prop::collection::vec(1..300_u64, 1..9),
    ) {
        let behaviours = delays.into_iter().map(|ms| (Behaviour::Good, millis(ms))).collect();
        let mut world = World::new(plans[0].0.clone(), behaviours);
        world.give(node(true));
        for (plan, pause) in &plans {
            world.give(Event::SetServices(plan.clone()));
            let until = world.now + millis(*pause);
            world.run_until(until);
        }
        let until = world.now + millis(20_000);
        world.run_until(until);
        let (last, _) = plans.last().unwrap();
        prop_assert_eq!(world.alive.len(), last.len());
        for service in last {
            let (index, kept) = world.stack.find_service(&service.name).unwrap();
            prop_assert_eq!(world.state(index).0, ServiceState::Ready);
            let serving = world.serving(index).unwrap();
            prop_assert_eq!((&serving.start, &serving.role), (&service.start, &service.role));
            prop_assert_eq!((&kept.start, &kept.policy), (&service.start, &service.policy));
        }
        let settled = world.stack.differences(last);
        prop_assert!(settled.iter().all(|d| d.change() == Change::Unchanged), "{settled:?}");
        let listed: Vec<_> = world.stack.services(world.now).into_iter().map(|s| s.name).collect();
        prop_assert_eq!(listed, last.iter().map(|s| s.name.clone()).collect::<Vec<_>>());
    }
}
