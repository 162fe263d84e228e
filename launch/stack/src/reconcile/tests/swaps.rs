//! Swaps, case by case.

use sg_proto::launch::{ServiceState, SwapState};

use super::world::{Behaviour, World};
use super::*;

fn swap_to(version: u32) -> Event {
    Event::Swap { service: 0, start: start(version) }
}

/// A serving process, and a swap with a candidate of this behaviour, after some time.
fn swapped(behaviours: &[Behaviour]) -> World {
    let mut world = World::of_one(patient(), behaviours);
    world.run_until(millis(100));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.give(swap_to(1));
    world.run_until(millis(3000));
    world
}

fn states(world: &World) -> Vec<SwapState> {
    world.swaps.iter().map(|(_, _, state, _)| *state).collect()
}

#[test]
fn a_swap_goes_through_its_states_and_the_service_is_never_counted_as_restarted() {
    let world = swapped(&[Behaviour::Good]);
    use SwapState::{Done, HandingOver, Promoting, Starting, Verifying, Waiting};
    assert_eq!(states(&world), [Waiting, Starting, Verifying, HandingOver, Promoting, Done]);
    let service = world.stack.service(0, world.now).unwrap();
    assert_eq!((service.state(), service.executable.as_str(), service.restarts), (ServiceState::Ready, "/v1", 0));
    assert_eq!((service.instance.as_str(), service.epoch), ("s0.2", 102));
    assert_eq!(world.serving(0).unwrap().start, start(1));
    assert_eq!(world.spawned.len(), 2);
}

#[test]
fn candidate_failure_before_handover_leaves_the_old_process() {
    use Behaviour::{Crash, Impostor, Missing, Mute, Slow, Unfit};
    for (behaviour, why) in [
        (Crash(1), "Some(1)"),
        (Crash(0), "Some(0)"),
        (Crash(EXIT_INPUT), "Some(2)"),
        (Missing, "None"),
        (Slow, "not ready within 0.7 s"),
        (Unfit, "it failed its probe: unfit"),
        (Impostor, "it took the role without waiting for its promotion"),
    ] {
        let world = swapped(&[Behaviour::Good, behaviour]);
        assert_eq!(world.swap(0), (SwapState::Failed, why.to_owned()), "{behaviour:?}");
        assert_eq!(world.asked_to_stop.iter().filter(|s| **s == 0).count(), usize::from(why.contains(' ')));
        let serving = world.serving(0).unwrap();
        assert_eq!((serving.instance.as_str(), &serving.start), ("s0.1", &start(0)), "{behaviour:?}");
        assert_eq!((world.alive.len(), world.spawned.len()), (1, 2), "{behaviour:?}");
        assert_eq!(world.stack.find_service("s0").unwrap().1.start, start(0));
    }
    let mut world = swapped(&[Behaviour::Good, Mute]);
    assert_eq!(world.swap(0).0, SwapState::Verifying);
    world.run_until(PROBE_TIME + millis(2000));
    assert_eq!(world.swap(0), (SwapState::Failed, "no result of the probe within 10 s".to_owned()));
    assert_eq!(world.serving(0).unwrap().instance, "s0.1");
}

#[test]
fn candidate_failure_after_handover_restarts_the_old_start() {
    for (behaviour, why) in [(Behaviour::Refuse, "could not take its role: cannot"), (Behaviour::Faint, "Some(1)")] {
        let world = swapped(&[Behaviour::Good, behaviour, Behaviour::Good]);
        assert_eq!(world.swap(0), (SwapState::Failed, why.to_owned()));
        let serving = world.serving(0).unwrap();
        assert_eq!((serving.instance.as_str(), &serving.start), ("s0.3", &start(0)));
        let (at, _) = &world.spawned[2];
        let ended = millis(100) + millis(50) * 2;
        assert!(*at >= ended + millis(80), "the pause is counted: {at:?}");
        assert_eq!(world.stack.service(0, world.now).unwrap().restarts, 1);
    }
    // The restart policy does not matter: the service had not failed.
    let never = Policy { restart: crate::file::Restart::Never, ..patient() };
    let mut world = World::of_one(never, &[Behaviour::Good, Behaviour::Faint, Behaviour::Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(3000));
    assert_eq!(world.state(0).0, ServiceState::Ready);
}

#[test]
fn candidate_death_during_handover_restarts_the_old_start() {
    // The old process ignores SIGTERM and is killed after 300 ms. The candidate dies before that.
    let mut world = World::new(
        vec![service(0, &[], patient())],
        vec![(Behaviour::Stubborn, millis(30)), (Behaviour::CrashLater(1), millis(90)), (Behaviour::Good, millis(30))],
    );
    world.give(Event::Tick);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(3000));
    assert_eq!(world.swap(0), (SwapState::Failed, "Some(1)".to_owned()));
    let serving = world.serving(0).unwrap();
    assert_eq!((serving.instance.as_str(), &serving.start), ("s0.3", &start(0)));
    // The old process did not fail.
    assert_eq!(world.ended[&ProcessId(1)], End::Stopped);
}

#[test]
fn old_process_is_restarted_unless_the_candidate_is_probed() {
    // Candidates take 1 s. The old process dies and returns before that.
    let slow = (Behaviour::Good, millis(600));
    let quick = (Behaviour::Good, millis(20));
    let mut world = World::new(vec![service(0, &[], patient())], vec![quick, slow, quick]);
    world.give(Event::Tick);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(200));
    world.give(Event::Exited { id: ProcessId(1), exit: exit(Some(1)) });
    world.run_until(millis(500));
    assert_eq!((world.state(0).0, world.swap(0).0), (ServiceState::Ready, SwapState::Starting));
    assert_eq!(world.serving(0).unwrap().start, start(0));
    world.run_until(millis(3000));
    assert_eq!(world.swap(0).0, SwapState::Done);
    assert_eq!(world.serving(0).unwrap().start, start(1));

    // Probed during the old process's pause: the promotion does not wait for the pause.
    let policy = Policy { backoff_initial: millis(5000), ..patient() };
    let mut world = World::new(vec![service(0, &[], policy)], vec![quick, slow]);
    world.give(Event::Tick);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(200));
    world.give(Event::Exited { id: ProcessId(1), exit: exit(Some(1)) });
    assert_eq!(world.state(0).0, ServiceState::Backoff);
    world.run_until(millis(1200));
    assert_eq!((world.state(0).0, world.swap(0).0), (ServiceState::Ready, SwapState::Done));
    assert_eq!(world.spawned.len(), 2);
}

#[test]
fn stopped_old_process_is_killed_and_replaced() {
    let world = swapped(&[Behaviour::Stubborn, Behaviour::Good]);
    assert_eq!(world.swap(0).0, SwapState::Done);
    assert_eq!(world.serving(0).unwrap().start, start(1));
}

#[test]
fn unremovable_process_blocks_a_swap() {
    let mut world = swapped(&[Behaviour::Undead, Behaviour::Good]);
    world.run_until(millis(20_000));
    assert_eq!(world.state(0).0, ServiceState::Failed);
    assert_eq!(world.swap(0).0, SwapState::Failed);
    assert!(world.finished.is_some());
}

#[test]
fn swap_replaces_an_early_swap() {
    let mut world = World::of_one(patient(), &[Behaviour::Good, Behaviour::Slow, Behaviour::Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(300));
    world.give(swap_to(2));
    world.run_until(millis(3000));
    let first: Vec<_> = world.swaps.iter().filter(|(_, number, ..)| *number == 1).collect();
    assert_eq!(first.last().unwrap().3, "withdrawn: replaced by another swap");
    assert_eq!((world.swap(0).0, &world.serving(0).unwrap().start), (SwapState::Done, &start(2)));
}

#[test]
fn restart_cancels_a_swap_and_stop_stops_both() {
    let mut world = World::of_one(patient(), &[Behaviour::Good, Behaviour::Slow, Behaviour::Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(300));
    world.give(Event::Restart { service: 0 });
    world.run_until(millis(1500));
    assert_eq!(world.swap(0), (SwapState::Failed, "withdrawn: a restart was requested".to_owned()));
    assert_eq!((world.alive.len(), &world.serving(0).unwrap().start), (1, &start(0)));

    world.behaviours = vec![(Behaviour::Good, millis(400))];
    world.give(swap_to(1));
    world.run_until(millis(1700));
    assert_eq!(world.alive.len(), 2);
    world.give(Event::Down);
    world.run_until(millis(3000));
    assert_eq!((world.finished.clone(), world.alive.len()), (Some(Outcome::Down), 0));
    assert_eq!(world.swap(0), (SwapState::Failed, "withdrawn: the stack stops".to_owned()));
}

#[test]
fn swap_revives_a_failed_service() {
    let mut world = World::new(
        vec![service(0, &[], patient()), service(1, &[], patient())],
        vec![(Behaviour::Crash(EXIT_INPUT), millis(10)), (Behaviour::Good, millis(10))],
    );
    world.give(Event::Tick);
    world.run_until(millis(100));
    assert_eq!(world.state(0).0, ServiceState::Failed);
    world.behaviours = vec![(Behaviour::Good, millis(10))];
    world.give(swap_to(1));
    world.run_until(millis(300));
    assert_eq!((world.state(0).0, world.swap(0).0), (ServiceState::Ready, SwapState::Done));
}

#[test]
fn candidate_waits_for_dependencies() {
    let mut world =
        World::new(vec![service(0, &[], patient()), service(1, &[0], patient())], vec![(Behaviour::Good, millis(20))]);
    world.give(Event::Tick);
    world.run_until(millis(100));
    world.behaviours = vec![(Behaviour::Good, millis(300))];
    world.give(Event::Restart { service: 0 });
    world.give(Event::Swap { service: 1, start: start(1) });
    assert_eq!(world.swap(1), (SwapState::Waiting, "waits for `s0`".to_owned()));
    world.run_until(millis(2000));
    assert_eq!(world.swap(1).0, SwapState::Done);
}

#[test]
fn too_much_memory_is_a_failure() {
    let policy = Policy { memory_bytes: Some(50 << 20), ..patient() };
    let mut world = World::of_one(policy.clone(), &[Behaviour::Greedy, Behaviour::Good]);
    world.run_until(millis(151));
    let reason = "uses 100 MiB of memory; its limit is 50 MiB".to_owned();
    assert_eq!(world.state(0), (ServiceState::Stopping, reason));
    world.run_until(millis(1000));
    assert_eq!((world.state(0).0, world.spawned.len()), (ServiceState::Ready, 2));
    let unlimited = World::of_one(patient(), &[Behaviour::Greedy]);
    assert_eq!(unlimited.spawned.len(), 1);
}

/// A supervisor stands still for a minute: the world goes on meanwhile, but no time of the supervisor passes.
fn stand_still(world: &mut World) {
    world.give(Event::Awoke(millis(60_000)));
}

#[test]
fn a_standstill_gives_each_stage_of_a_swap_its_time_anew() {
    let mut world = World::of_one(patient(), &[Behaviour::Good, Behaviour::Slow]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(700));
    assert_eq!(world.swap(0).0, SwapState::Starting);
    stand_still(&mut world);
    world.run_until(millis(1300));
    assert_eq!(world.swap(0).0, SwapState::Starting);
    world.run_until(millis(1500));
    assert_eq!(world.swap(0), (SwapState::Failed, "not ready within 0.7 s".to_owned()));

    let mut world = swapped(&[Behaviour::Good, Behaviour::Mute]);
    stand_still(&mut world);
    world.run_until(PROBE_TIME + millis(2900));
    assert_eq!(world.swap(0).0, SwapState::Verifying);
    world.run_until(PROBE_TIME + millis(3100));
    assert_eq!(world.swap(0).0, SwapState::Failed);
}

#[test]
fn a_start_that_fails_in_a_standstill_is_repeated_once_and_counts_for_nothing() {
    use Behaviour::{Crash, Good};
    // A candidate.
    let mut world = World::of_one(patient(), &[Good, Crash(1), Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(110));
    stand_still(&mut world);
    world.run_until(millis(3000));
    assert_eq!((world.swap(0).0, world.spawned.len()), (SwapState::Done, 3));
    assert_eq!(world.stack.service(0, world.now).unwrap().restarts, 0);
    // The next failure is its own.
    let mut world = World::of_one(patient(), &[Good, Crash(1), Crash(1), Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(110));
    stand_still(&mut world);
    world.run_until(millis(3000));
    assert_eq!((world.swap(0).0, world.spawned.len()), (SwapState::Failed, 3));
    // So is one of wrong input, and one long after the standstill.
    let mut world = World::of_one(patient(), &[Good, Crash(EXIT_INPUT), Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(110));
    stand_still(&mut world);
    world.run_until(millis(3000));
    assert_eq!((world.swap(0).0, world.spawned.len()), (SwapState::Failed, 2));
    // A candidate on its way to the role: the old start serves, and the swap goes on.
    let mut world = World::of_one(patient(), &[Good, Behaviour::Faint, Good]);
    world.run_until(millis(100));
    world.give(swap_to(1));
    world.run_until(millis(100) + millis(50) + millis(50) / 3 + millis(50) / 4 + millis(2));
    assert_eq!(world.swap(0).0, SwapState::Promoting);
    stand_still(&mut world);
    world.run_until(millis(3000));
    assert_eq!((world.swap(0).0, world.state(0).0), (SwapState::Done, ServiceState::Ready));
    assert_eq!(world.serving(0).unwrap().start, start(1));
    // A service that is no candidate: no failure is counted, so one that may not restart serves.
    let mut world = World::of_one(Policy { restarts: 0, ..patient() }, &[Crash(1), Good]);
    world.run_until(millis(10));
    stand_still(&mut world);
    world.run_until(millis(1000));
    assert_eq!(world.state(0).0, ServiceState::Ready);
}
