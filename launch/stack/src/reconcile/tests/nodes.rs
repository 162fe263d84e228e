//! Services on other machines, case by case.

use sg_proto::launch::{ServiceState, SwapState};

use super::world::{Behaviour, World};
use super::*;

fn elsewhere(policy: Policy) -> Service {
    Service { start: start(ELSEWHERE), ..service(0, &[], policy) }
}

fn world(behaviours: &[Behaviour]) -> World {
    let behaviours = behaviours.iter().map(|b| (*b, millis(50))).collect();
    World::new(vec![elsewhere(patient())], behaviours)
}

#[test]
fn service_and_stack_wait_for_a_node() {
    let mut world = world(&[Behaviour::Good]);
    world.give(Event::Tick);
    world.run_until(millis(60_000));
    let waits = "waits for node `n`, which has not joined".to_owned();
    assert_eq!((world.state(0), world.finished.clone()), ((ServiceState::Waiting, waits), None));
    world.give(node(true));
    world.run_until(millis(61_000));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.give(Event::Down);
    world.run_until(millis(62_000));
    assert_eq!(world.finished, Some(Outcome::Down));
}

#[test]
fn lost_node_is_no_failure_of_its_services() {
    let policy = Policy { restarts: 1, ..patient() };
    let mut world = World::new(vec![elsewhere(policy)], vec![(Behaviour::Good, millis(50))]);
    for round in 0..10 {
        world.give(node(true));
        world.run_until(millis(round * 1000 + 500));
        assert_eq!(world.state(0).0, ServiceState::Ready);
        world.give(node(false));
        assert_eq!(world.state(0).0, ServiceState::Waiting);
        world.run_until(millis((round + 1) * 1000));
    }
    assert_eq!((world.spawned.len(), world.ended.len()), (10, 10));
    assert!(world.ended.values().all(|end| *end == End::Stopped), "{:?}", world.ended);
}

#[test]
fn hang_on_a_lost_node_is_no_failure() {
    let policy = Policy { restarts: 0, ..patient() };
    let mut world = World::new(vec![elsewhere(policy)], vec![(Behaviour::Undead, millis(50))]);
    world.give(node(true));
    world.run_until(millis(1000));
    // The node is silent from now on: SIGTERM and SIGKILL do not arrive.
    world.alive.values_mut().for_each(|s| s.instance = "cut off".into());
    world.run_until(millis(30_000));
    assert_eq!(world.state(0).0, ServiceState::Stopping, "never given up while its machine may have it");
    world.give(node(false));
    assert_eq!(world.state(0).0, ServiceState::Waiting);
    world.behaviours = vec![(Behaviour::Good, millis(50))];
    world.give(node(true));
    world.run_until(millis(31_000));
    assert_eq!(world.state(0).0, ServiceState::Ready);
}

#[test]
fn short_absence_of_a_node_process_is_tolerated() {
    let mut world = world(&[Behaviour::Leave]);
    world.give(node(true));
    world.run_until(millis(1500));
    assert_eq!(world.state(0).0, ServiceState::Ready, "a second away from the bus ends only a process of this machine");
    world.run_until(millis(1551));
    assert_eq!(world.state(0).0, ServiceState::Stopping, "silence ends it as it does any other");
}

#[test]
fn a_service_moves_to_another_machine_by_a_swap() {
    let mut world = World::new(vec![service(0, &[], patient())], vec![(Behaviour::Good, millis(50))]);
    world.give(Event::Tick);
    world.run_until(millis(500));
    world.give(Event::SetServices(vec![elsewhere(patient())]));
    world.run_until(millis(1000));
    assert_eq!(world.swap(0), (SwapState::Waiting, "waits for node `n`, which has not joined".to_owned()));
    assert_eq!(world.state(0).0, ServiceState::Ready);
    world.give(node(true));
    world.run_until(millis(2000));
    assert_eq!(world.swap(0).0, SwapState::Done);
    assert_eq!(world.serving(0).unwrap().start.node.as_deref(), Some(NODE));
    world.give(node(false));
    assert_eq!(world.state(0).0, ServiceState::Waiting);
}
