//! A simulated world of processes that behave in every way we could think of, and what must hold in it.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use sg_proto::launch::ServiceState;

use super::*;

/// How a simulated process behaves.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Behaviour {
    /// Gets ready, lives, obeys.
    Good,
    /// Ends with a status before it is ready.
    Crash(i32),
    /// Gets ready, then ends with a status.
    CrashLater(i32),
    /// Never gets ready, obeys.
    Slow,
    /// Gets ready, then falls silent and obeys nothing but a kill.
    Hang,
    /// Gets ready and leaves the bus without ending.
    Leave,
    /// Gets ready, ignores requests to stop.
    Stubborn,
    /// Not even a kill removes it.
    Undead,
    /// Cannot be started.
    Missing,
}

const BEHAVIOURS: [Behaviour; 12] = [
    Behaviour::Good,
    Behaviour::Good,
    Behaviour::Crash(1),
    Behaviour::Crash(0),
    Behaviour::Crash(EXIT_INPUT),
    Behaviour::CrashLater(1),
    Behaviour::CrashLater(0),
    Behaviour::Slow,
    Behaviour::Hang,
    Behaviour::Leave,
    Behaviour::Stubborn,
    Behaviour::Missing,
];

struct World {
    stack: Reconciler,
    desired: Vec<Desired>,
    now: Time,
    behaviours: Vec<(Behaviour, Duration)>,
    next_behaviour: usize,
    /// What will happen, by time and a serial number.
    future: BTreeMap<(Time, u64), Event>,
    serial: u64,
    alive: BTreeMap<Incarnation, (usize, String, Behaviour, Duration)>,
    spawned: Vec<(Time, usize, Incarnation)>,
    ended: BTreeSet<Incarnation>,
    first_started: Vec<usize>,
    asked_to_stop: Vec<usize>,
    wished: bool,
    finished: Option<Outcome>,
    /// Times at which the machine decided by itself to start a service again.
    automatic: BTreeMap<usize, Vec<Time>>,
}

fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

impl World {
    fn new(desired: Vec<Desired>, behaviours: Vec<(Behaviour, Duration)>) -> Self {
        Self {
            stack: Reconciler::new(desired.clone(), 1),
            desired,
            now: Duration::ZERO,
            behaviours,
            next_behaviour: 0,
            future: BTreeMap::new(),
            serial: 0,
            alive: BTreeMap::new(),
            spawned: Vec::new(),
            ended: BTreeSet::new(),
            first_started: Vec::new(),
            asked_to_stop: Vec::new(),
            wished: false,
            finished: None,
            automatic: BTreeMap::new(),
        }
    }

    fn later(&mut self, after: Duration, event: Event) {
        self.serial += 1;
        self.future.insert((self.now + after, self.serial), event);
    }

    fn give(&mut self, event: Event) {
        match &event {
            Event::Exited { incarnation, .. } => {
                // A process that was killed meanwhile cannot end a second time.
                if self.alive.remove(incarnation).is_none() {
                    return;
                }
            }
            Event::Ready { instance, .. } | Event::Seen { instance, .. } | Event::Health { instance, .. } => {
                if !self.alive.values().any(|(_, i, ..)| i == instance) {
                    return;
                }
            }
            Event::Down | Event::Kill => self.wished = true,
            Event::Restart { service } => {
                self.automatic.remove(service);
            }
            Event::Tick | Event::Started { .. } => {}
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
            Action::Spawn { service, incarnation, instance } => self.spawn(service, incarnation, instance),
            Action::Terminate(incarnation) => {
                let Some((service, _, behaviour, delay)) = self.alive.get(&incarnation).cloned() else { return };
                self.asked_to_stop.push(service);
                if !matches!(behaviour, Behaviour::Hang | Behaviour::Stubborn | Behaviour::Undead) {
                    self.later(delay / 4, Event::Exited { incarnation, exit: exit(Some(0)) });
                }
            }
            Action::Kill(incarnation) => {
                let undead = self.alive.get(&incarnation).is_none_or(|(_, _, b, _)| *b == Behaviour::Undead);
                if !undead {
                    self.later(millis(3), Event::Exited { incarnation, exit: exit(None) });
                }
            }
            Action::Ended { incarnation, service, .. } => {
                assert!(self.ended.insert(incarnation), "{incarnation:?} of {service} ended twice");
            }
            Action::Announce { service } => {
                let state = self.stack.service(service, self.now).unwrap().state();
                if state == ServiceState::Backoff {
                    self.automatic.entry(service).or_default().push(self.now);
                }
            }
            Action::Finish(outcome) => {
                let left: Vec<_> = self.alive.values().filter(|(_, _, b, _)| *b != Behaviour::Undead).collect();
                assert!(left.is_empty(), "{outcome:?} while {left:?} run");
                self.finished = Some(outcome);
            }
        }
    }

    fn spawn(&mut self, service: usize, incarnation: Incarnation, instance: String) {
        let of_same = self.alive.iter().find(|(_, (s, ..))| *s == service);
        assert!(of_same.is_none(), "{service} started while {of_same:?} runs");
        assert!(!self.wished, "{service} started although the stack is to stop");
        for on in &self.desired[service].after {
            let state = self.stack.service(*on, self.now).unwrap().state();
            assert_eq!(state, ServiceState::Ready, "{service} started before {on} is ready");
        }
        assert!(self.spawned.iter().all(|(_, _, i)| *i != incarnation), "{incarnation:?} is used twice");
        if !self.first_started.contains(&service) {
            self.first_started.push(service);
        }
        self.spawned.push((self.now, service, incarnation));
        let (behaviour, delay) = self.behaviours[self.next_behaviour % self.behaviours.len()];
        self.next_behaviour += 1;
        if behaviour == Behaviour::Missing {
            self.alive.insert(incarnation, (service, instance, behaviour, delay));
            return self.later(Duration::ZERO, Event::Exited { incarnation, exit: exit(None) });
        }
        self.alive.insert(incarnation, (service, instance.clone(), behaviour, delay));
        self.later(Duration::ZERO, Event::Started { incarnation, pid: 7 });
        match behaviour {
            Behaviour::Crash(status) => self.later(delay, Event::Exited { incarnation, exit: exit(Some(status)) }),
            Behaviour::Slow | Behaviour::Missing => {}
            _ => self.later(delay, Event::Ready { instance: instance.clone(), start_ms: 1 }),
        }
        match behaviour {
            Behaviour::CrashLater(status) => {
                self.later(delay * 2, Event::Exited { incarnation, exit: exit(Some(status)) });
            }
            Behaviour::Leave => self.later(delay * 2, Event::Seen { instance, alive: false }),
            Behaviour::Good | Behaviour::Stubborn | Behaviour::Undead => {
                self.later(delay + millis(500), Event::Health { instance, memory_bytes: 1 });
            }
            _ => {}
        }
    }

    fn check(&self) {
        for (index, desired) in self.desired.iter().enumerate() {
            let state = self.stack.service(index, self.now).unwrap().state();
            let deadline = self.stack.services[index].deadline();
            let timed = [ServiceState::Starting, ServiceState::Ready, ServiceState::Stopping, ServiceState::Backoff];
            assert_eq!(deadline.is_some(), timed.contains(&state), "{} is {state:?}", desired.name);
            assert!(deadline.is_none_or(|d| d > self.now), "{} is overdue in {state:?}", desired.name);
            let times = self.automatic.get(&index).map_or(&[][..], Vec::as_slice);
            let most = usize::try_from(desired.policy.restarts).unwrap();
            for window in times.windows(most + 1) {
                assert!(
                    window[most] - window[0] >= desired.policy.within,
                    "{} restarted too often: {window:?}",
                    desired.name
                );
            }
        }
    }

    /// Lets time pass until nothing is left to happen before `end`, or the stack is finished.
    fn run_until(&mut self, end: Time) {
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
                        if self.alive.values().any(|(_, i, ..)| *i == instance) {
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

fn exit(status: Option<i32>) -> Exit {
    Exit { status, reason: format!("{status:?}") }
}

fn desired(index: usize, after: Vec<usize>, policy: Policy) -> Desired {
    Desired { name: format!("s{index}"), role: format!("r{index}"), after, policy }
}

fn policies() -> impl Strategy<Value = Policy> {
    let restart = prop_oneof![Just(Restart::Always), Just(Restart::OnFailure), Just(Restart::Never)];
    (restart, 1..400_u64, 0..4_u32, 500..9000_u64, any::<bool>()).prop_map(
        |(restart, initial, restarts, within, critical)| Policy {
            restart,
            backoff_initial: millis(initial),
            backoff_max: millis(initial * 4),
            restarts,
            within: millis(within),
            ready: millis(700),
            liveness: millis(1500),
            stop: millis(300),
            critical,
            env: Vec::new(),
        },
    )
}

fn plans() -> impl Strategy<Value = Vec<Desired>> {
    prop::collection::vec((policies(), any::<u8>()), 1..6).prop_map(|services| {
        let after = |i: usize, bits: u8| (0..i).filter(|j| bits & (1 << j) != 0).collect();
        services.into_iter().enumerate().map(|(i, (policy, bits))| desired(i, after(i, bits), policy)).collect()
    })
}

fn behaviours() -> impl Strategy<Value = Vec<(Behaviour, Duration)>> {
    let one = (prop::sample::select(&BEHAVIOURS[..]), 1..900_u64).prop_map(|(b, ms)| (b, millis(ms)));
    prop::collection::vec(one, 1..30)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the processes do and whatever people ask for: no two processes of one service, nothing before what it
    /// comes after, no state without a deadline, no more restarts than allowed, one end for every incarnation, and the
    /// stack ends when it is told to.
    #[test]
    fn every_world_is_survived(
        plan in plans(),
        behaviours in behaviours(),
        wishes in prop::collection::vec((0..20_000_u64, 0..6_usize), 0..6),
        end in 1000..30_000_u64,
        hurry in any::<bool>(),
    ) {
        let count = plan.len();
        let mut world = World::new(plan, behaviours);
        for (at, service) in wishes {
            world.later(millis(at), Event::Restart { service: service % count });
        }
        world.give(Event::Tick);
        world.run_until(millis(end));
        if world.finished.is_none() {
            world.give(if hurry { Event::Kill } else { Event::Down });
        }
        // Each of five services may need its grace, and a kill.
        let limit = world.now + millis(10_000);
        world.run_until(limit);
        prop_assert!(world.finished.is_some(), "not down after 10 s: {:?}", world.stack);
        prop_assert_eq!(world.ended.len(), world.spawned.len(), "an incarnation without an end");
        prop_assert!(world.alive.is_empty());
    }

    /// Well-behaved services are asked to stop in the reverse of the order in which they were started.
    #[test]
    fn a_stack_stops_in_reverse(plan in plans(), delays in prop::collection::vec(1..600_u64, 1..9)) {
        let behaviours = delays.into_iter().map(|ms| (Behaviour::Good, millis(ms))).collect();
        let mut world = World::new(plan, behaviours);
        world.give(Event::Tick);
        world.run_until(millis(5000));
        world.give(Event::Down);
        let limit = world.now + millis(5000);
        world.run_until(limit);
        prop_assert_eq!(&world.finished, &Some(Outcome::Down));
        prop_assert_eq!(world.first_started.len(), world.desired.len());
        let reversed: Vec<_> = world.first_started.iter().rev().copied().collect();
        prop_assert_eq!(&world.asked_to_stop, &reversed);
    }
}

fn one(policy: Policy, behaviour: Behaviour) -> World {
    let mut world = World::new(vec![desired(0, vec![], policy)], vec![(behaviour, millis(50))]);
    world.give(Event::Tick);
    world
}

fn patient() -> Policy {
    Policy { liveness: millis(1500), ready: millis(700), stop: millis(300), ..Policy::default() }
}

fn state(world: &World, index: usize) -> (ServiceState, String) {
    let service = world.stack.service(index, world.now).unwrap();
    (service.state(), service.reason)
}

#[test]
fn too_many_restarts_fail_a_service_and_a_critical_one_stops_the_stack() {
    let policy = Policy { critical: true, restarts: 3, ..patient() };
    let mut world = one(policy, Behaviour::Crash(1));
    world.run_until(millis(60_000));
    let reason = "failed 4 times within 30 s: Some(1)".to_owned();
    assert_eq!(world.finished, Some(Outcome::Failed { service: "s0".into(), reason }));
    assert_eq!(world.spawned.len(), 4);
}

#[test]
fn pauses_grow_and_start_over_after_health() {
    let policy = Policy { restarts: 100, backoff_max: millis(400), ..patient() };
    let mut world = one(policy.clone(), Behaviour::Crash(1));
    world.run_until(millis(3000));
    let gaps: Vec<_> = world.spawned.windows(2).map(|w| (w[1].0 - w[0].0).as_millis() as i64 - 50).collect();
    for (gap, expected) in gaps.iter().zip([100, 200, 400, 400, 400]) {
        assert!((gap - expected).abs() <= expected / 5 + 1, "{gaps:?}");
    }
    // Ready for longer than the longest pause: the next pause is the first again.
    let mut world = World::new(vec![desired(0, vec![], policy)], vec![(Behaviour::CrashLater(1), millis(500))]);
    world.give(Event::Tick);
    world.run_until(millis(9000));
    let gaps: Vec<_> = world.spawned.windows(2).map(|w| (w[1].0 - w[0].0).as_millis() as i64 - 1000).collect();
    assert!(gaps.len() >= 5 && gaps.iter().all(|g| (80..=121).contains(g)), "{gaps:?}");
}

#[test]
fn wrong_input_is_not_tried_again() {
    let mut world = one(patient(), Behaviour::Crash(EXIT_INPUT));
    world.stack.services.push(Reconciler::new(vec![desired(1, vec![], patient())], 0).services.remove(0));
    world.desired.push(desired(1, vec![], patient()));
    world.behaviours = vec![(Behaviour::Good, millis(10))];
    world.run_until(millis(5000));
    assert_eq!(state(&world, 0), (ServiceState::Failed, "Some(2)".to_owned()));
    assert_eq!(state(&world, 1).0, ServiceState::Ready);
    assert_eq!(world.spawned.len(), 2);
    // By hand it can be tried again.
    world.give(Event::Restart { service: 0 });
    world.run_until(millis(6000));
    assert_eq!(state(&world, 0).0, ServiceState::Ready);
}

#[test]
fn one_that_hangs_is_killed_and_started_again() {
    let mut world = one(patient(), Behaviour::Hang);
    world.run_until(millis(1549));
    assert_eq!(state(&world, 0).0, ServiceState::Ready);
    world.run_until(millis(1551));
    assert_eq!(state(&world, 0), (ServiceState::Stopping, "hung: no sign of life for 1.5 s".to_owned()));
    world.run_until(millis(2000));
    assert!(world.spawned.len() >= 2);
}

#[test]
fn one_that_leaves_the_bus_is_not_waited_for_as_long() {
    let policy = Policy { liveness: millis(60_000), ..patient() };
    let mut world = one(policy, Behaviour::Leave);
    world.run_until(millis(100) + AWAY_TIME + millis(1));
    assert_eq!(state(&world, 0).0, ServiceState::Stopping);
}

#[test]
fn what_waits_says_for_what() {
    let plan = vec![
        desired(0, vec![], Policy { restart: Restart::Never, ..patient() }),
        desired(1, vec![], patient()),
        desired(2, vec![0, 1], patient()),
    ];
    let behaviours = vec![(Behaviour::Crash(1), millis(100)), (Behaviour::Good, millis(200))];
    let mut world = World::new(plan, behaviours);
    world.give(Event::Tick);
    assert_eq!(state(&world, 2), (ServiceState::Waiting, "waits for `s0`, `s1`".to_owned()));
    world.run_until(millis(150));
    assert_eq!(state(&world, 2).1, "waits for `s0`, which failed, `s1`");
    world.run_until(millis(250));
    assert_eq!(state(&world, 2).1, "waits for `s0`, which failed");
}

#[test]
fn one_that_the_system_does_not_remove_is_given_up() {
    let mut world = one(patient(), Behaviour::Undead);
    world.run_until(millis(1000));
    world.give(Event::Down);
    world.run_until(millis(20_000));
    assert_eq!(world.finished, Some(Outcome::Down));
    assert_eq!(world.ended.len(), 1);
    assert_eq!(state(&world, 0).1, "process 7 was killed but the system does not remove it");
}

#[test]
fn a_restart_by_hand_waits_for_the_old_process_and_counts_as_no_failure() {
    let policy = Policy { restarts: 0, ..patient() };
    let mut world = one(policy, Behaviour::Stubborn);
    world.run_until(millis(100));
    world.give(Event::Restart { service: 0 });
    assert_eq!(state(&world, 0).0, ServiceState::Stopping);
    world.run_until(millis(390));
    assert_eq!(world.spawned.len(), 1, "the old process still runs");
    world.run_until(millis(600));
    assert_eq!(state(&world, 0).0, ServiceState::Ready);
    assert_eq!(world.stack.service(0, world.now).unwrap().restarts, 1);
}

#[test]
fn a_stack_whose_services_all_ended_is_over() {
    let mut world = one(patient(), Behaviour::CrashLater(0));
    world.run_until(millis(5000));
    assert_eq!(world.finished, Some(Outcome::Finished));
}
