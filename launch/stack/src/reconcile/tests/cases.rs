//! Restarts, pauses, limits, case by case.

use sg_proto::launch::ServiceState;

use super::world::{Behaviour, World, stuck};
use super::*;
use crate::file::Restart;

fn one(policy: Policy, behaviour: Behaviour) -> World {
    World::of_one(policy, &[behaviour])
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
fn only_a_finished_critical_service_ends_the_stack() {
    for critical in [true, false] {
        let policy = Policy { critical, ..patient() };
        let mut world = World::new(
            vec![service(0, &[], policy), service(1, &[], patient())],
            vec![(Behaviour::CrashLater(0), millis(500)), (Behaviour::Good, millis(10))],
        );
        world.give(Event::Tick);
        world.run_until(millis(20_000));
        assert_eq!(world.finished, critical.then_some(Outcome::Finished));
        let other = if critical { ServiceState::Stopped } else { ServiceState::Ready };
        assert_eq!((world.state(0).0, world.state(1).0), (ServiceState::Stopped, other));
    }
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
    // Ready for longer than the longest pause: the next pause starts over.
    let mut world = World::new(vec![service(0, &[], policy)], vec![(Behaviour::CrashLater(1), millis(500))]);
    world.give(Event::Tick);
    world.run_until(millis(9000));
    let gaps: Vec<_> = world.spawned.windows(2).map(|w| (w[1].0 - w[0].0).as_millis() as i64 - 1000).collect();
    assert!(gaps.len() >= 5 && gaps.iter().all(|g| (80..=121).contains(g)), "{gaps:?}");
}

#[test]
fn wrong_input_is_final() {
    let mut world = one(patient(), Behaviour::Crash(EXIT_INPUT));
    world.behaviours = vec![(Behaviour::Good, millis(10))];
    world.give(Event::SetServices(vec![service(0, &[], patient()), service(1, &[], patient())]));
    world.run_until(millis(5000));
    assert_eq!(world.state(0), (ServiceState::Failed, "Some(2)".to_owned()));
    assert_eq!(world.state(1).0, ServiceState::Ready);
    assert_eq!(world.spawned.len(), 2);
    // A manual restart is still possible.
    world.give(Event::Restart { service: 0 });
    world.run_until(millis(6000));
    assert_eq!(world.state(0).0, ServiceState::Ready);
}

#[test]
fn hung_process_is_killed_and_restarted() {
    let mut world = one(patient(), Behaviour::Hang);
    world.run_until(millis(1549));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.run_until(millis(1551));
    assert_eq!(world.state(0), (ServiceState::Stopping, "hung: no sign of life for 1.5 s".to_owned()));
    world.run_until(millis(2000));
    assert!(world.spawned.len() >= 2);
}

#[test]
fn work_without_progress_is_hung_although_its_process_is_not() {
    let policy = Policy { progress: millis(3000), ..patient() };
    let mut world = one(policy, Behaviour::Good);
    world.run_until(millis(600));
    world.give(stuck("s0.1".into(), millis(2999)));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.give(stuck("s0.1".into(), millis(3000)));
    let reason = "hung: actor `a` has made no progress for 3 s".to_owned();
    assert_eq!(world.state(0), (ServiceState::Stopping, reason));
    world.run_until(millis(2000));
    assert_eq!((world.state(0).0, world.spawned.len()), (ServiceState::Ready, 2));
}

#[test]
fn progress_while_loading_extends_the_start() {
    let mut world = one(Policy { ready: millis(700), ..patient() }, Behaviour::Slow);
    let loading = |loading_steps| Event::Health {
        instance: "s0.1".into(),
        memory_bytes: 1,
        answer_ms: (0.0, 0.0),
        work: Work { loading_steps, ..Work::default() },
    };
    for step in 1..=3 {
        world.run_until(millis(600 * step));
        world.stack.step(loading(step), millis(600 * step));
    }
    world.run_until(millis(2400));
    assert_eq!(world.state(0).0, ServiceState::Starting);
    // The same step again is no progress.
    world.stack.step(loading(3), millis(2400));
    world.run_until(millis(2500));
    assert_eq!(world.state(0).1, "not ready within 0.7 s");
}

#[test]
fn nobody_is_judged_by_what_waits_in_the_queue_of_a_supervisor_that_slept() {
    let mut world = one(patient(), Behaviour::Hang);
    world.run_until(millis(1000));
    let now = world.now;
    // It was silent for too long. But its sign of life is among what waits.
    let late = now + millis(9000);
    assert!(world.stack.observe(Event::Node { name: "other".into(), present: true }, late).is_empty());
    world.stack.observe(world_health("s0.1"), late);
    world.stack.step(Event::Tick, late);
    assert_eq!(world.state(0).0, ServiceState::Ready);
    // The supervisor slept: everyone's time begins anew, and a lost connection has time to come back.
    let later = late + millis(60_000);
    world.stack.observe(Event::Awoke(millis(60_000)), later);
    world.stack.observe(Event::Presence { instance: "s0.1".into(), alive: false }, later);
    world.stack.observe(stuck("s0.1".into(), millis(3_600_000)), later);
    world.stack.step(Event::Tick, later + AWAKENING_TIME - millis(1));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.stack.step(Event::Tick, later + AWAKENING_TIME);
    assert_eq!(world.state(0).0, ServiceState::Stopping);
}

#[test]
fn the_time_of_a_standstill_is_no_time_without_progress() {
    let mut world = one(Policy { progress: millis(60_000), ..patient() }, Behaviour::Good);
    world.run_until(millis(1000));
    let now = world.now;
    world.stack.observe(Event::Awoke(millis(100_000)), now);
    // Its work began ten seconds before the machine was suspended.
    let (early, late) = (now + millis(6000), now + millis(51_000));
    world.stack.step(stuck("s0.1".into(), millis(10_000 + 100_000 + 6000)), early);
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.stack.step(stuck("s0.1".into(), millis(10_000 + 100_000 + 51_000)), late);
    assert_eq!(world.state(0).0, ServiceState::Stopping);
}

fn world_health(instance: &str) -> Event {
    Event::Health { instance: instance.into(), memory_bytes: 1, answer_ms: (0.0, 0.0), work: Work::default() }
}

#[test]
fn process_off_the_bus_has_a_shorter_deadline() {
    let policy = Policy { liveness: millis(60_000), ..patient() };
    let mut world = one(policy, Behaviour::Leave);
    world.run_until(millis(100) + AWAY_TIME + millis(1));
    assert_eq!(world.state(0).0, ServiceState::Stopping);
}

#[test]
fn waiting_service_names_its_dependencies() {
    let plan = vec![
        service(0, &[], Policy { restart: Restart::Never, ..patient() }),
        service(1, &[], patient()),
        service(2, &[0, 1], patient()),
    ];
    let behaviours = vec![(Behaviour::Crash(1), millis(100)), (Behaviour::Good, millis(200))];
    let mut world = World::new(plan, behaviours);
    world.give(Event::Tick);
    assert_eq!(world.state(2), (ServiceState::Waiting, "waits for `s0`, `s1`".to_owned()));
    world.run_until(millis(150));
    assert_eq!(world.state(2).1, "waits for `s0`, which failed, `s1`");
    world.run_until(millis(250));
    assert_eq!(world.state(2).1, "waits for `s0`, which failed");
}

#[test]
fn unremovable_process_is_lost() {
    let mut world = one(patient(), Behaviour::Undead);
    world.run_until(millis(1000));
    world.give(Event::Down);
    world.run_until(millis(20_000));
    assert_eq!(world.finished, Some(Outcome::Down));
    assert_eq!(world.ended.len(), 1);
    assert_eq!(world.state(0).1, "process 7 was killed, but the system does not remove it");
}

#[test]
fn manual_restart_waits_for_the_old_process_and_is_no_failure() {
    let policy = Policy { restarts: 0, ..patient() };
    let mut world = one(policy, Behaviour::Stubborn);
    world.run_until(millis(100));
    world.give(Event::Restart { service: 0 });
    assert_eq!(world.state(0).0, ServiceState::Stopping);
    world.run_until(millis(390));
    assert_eq!(world.spawned.len(), 1, "the old process still runs");
    world.run_until(millis(600));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    assert_eq!(world.stack.service(0, world.now).unwrap().restarts, 1);
}

#[test]
fn stack_ends_with_its_last_service() {
    let mut world = one(patient(), Behaviour::CrashLater(0));
    world.run_until(millis(5000));
    assert_eq!(world.finished, Some(Outcome::Finished));
}
