//! Another list of services, case by case.

use sg_proto::launch::{Change, ServiceState, SwapState};

use super::world::{Behaviour, World};
use super::*;

fn changes(world: &World, services: &[Service]) -> Vec<(String, Change)> {
    world.stack.differences(services).into_iter().map(|d| (d.service.clone(), d.change())).collect()
}

fn running(services: Vec<Service>) -> World {
    let mut world = World::new(services, vec![(Behaviour::Good, millis(20))]);
    world.give(Event::Tick);
    world.run_until(millis(200));
    world
}

#[test]
fn only_the_difference_is_applied() {
    let plain = |i| service(i, &[], patient());
    let mut world = running(vec![plain(0), plain(1), plain(2), plain(3), plain(4)]);
    let mut list = vec![plain(5), plain(0), plain(1), plain(2), plain(3)];
    list[2].start = start(1);
    list[3].policy.liveness = millis(9000);
    list[4].role = "other".to_owned();
    let name = |i: usize| format!("s{i}");
    let expected = vec![
        (name(5), Change::Added),
        (name(0), Change::Unchanged),
        (name(1), Change::Swapped),
        (name(2), Change::InPlace),
        (name(3), Change::Restarted),
        (name(4), Change::Removed),
    ];
    assert_eq!(changes(&world, &list), expected);
    world.give(Event::SetServices(list.clone()));
    world.run_until(millis(2000));
    assert!(changes(&world, &list).iter().all(|(_, change)| *change == Change::Unchanged));
    let services = world.stack.services(world.now);
    let told: Vec<_> = services.iter().map(|s| (s.name.as_str(), s.instance.as_str(), s.role.as_str())).collect();
    let expected = [
        ("s5", "s5.1", "r5"),
        ("s0", "s0.1", "r0"),
        ("s1", "s1.2", "r1"),
        ("s2", "s2.1", "r2"),
        ("s3", "s3.2", "other"),
    ];
    assert_eq!(told, expected);
    assert_eq!(world.stack.find_service("s2").unwrap().1.policy.liveness, millis(9000));
    assert!(world.stack.find_service("s4").is_none());

    // A returning service keeps its slot, so that instance names stay unique.
    list.push(plain(4));
    assert_eq!(changes(&world, &list).last().unwrap(), &(name(4), Change::Added));
    world.give(Event::SetServices(list));
    world.run_until(millis(3000));
    assert_eq!(world.stack.service(4, world.now).unwrap().instance, "s4.2");
}

#[test]
fn role_is_granted_after_its_last_holder_is_gone() {
    let mut world = World::new(vec![service(0, &[], patient())], vec![(Behaviour::Stubborn, millis(20))]);
    world.give(Event::Tick);
    world.run_until(millis(200));
    let heir = Service { role: "r0".to_owned(), ..service(1, &[], patient()) };
    world.give(Event::SetServices(vec![heir]));
    assert_eq!(world.state(1).1, "waits for the end of `s0`, which has the role");
    let seen: Vec<_> = world.stack.services(world.now).into_iter().map(|s| s.name).collect();
    assert_eq!(seen, ["s1", "s0"], "what was removed is seen until it is gone");
    world.run_until(millis(1000));
    assert_eq!(world.state(1).0, ServiceState::Ready);
    assert_eq!(world.stack.services(world.now).len(), 1);
}

#[test]
fn unchanged_file_cancels_a_swap() {
    let list = vec![service(0, &[], patient())];
    let mut world = running(list.clone());
    world.behaviours = vec![(Behaviour::Slow, millis(20))];
    world.give(Event::SetServices(vec![Service { start: start(1), ..list[0].clone() }]));
    world.run_until(millis(300));
    assert_eq!(world.swap(0).0, SwapState::Starting);
    world.give(Event::SetServices(list));
    assert_eq!(
        world.swap(0),
        (SwapState::Failed, "withdrawn: the launch file has the present executable again".to_owned())
    );
    world.run_until(millis(2000));
    assert_eq!((world.serving(0).unwrap().instance.as_str(), world.alive.len()), ("s0.1", 1));
}

#[test]
fn the_same_file_repeats_only_a_failed_swap() {
    let list = vec![Service { start: start(1), ..service(0, &[], patient()) }];
    let mut world = running(vec![service(0, &[], patient())]);
    world.behaviours = vec![(Behaviour::Slow, millis(20))];
    world.give(Event::SetServices(list.clone()));
    assert_eq!(changes(&world, &list)[0].1, Change::Unchanged);
    world.run_until(millis(3000));
    assert_eq!(world.swap(0).0, SwapState::Failed);
    assert_eq!(world.stack.differences(&list)[0].swap, 2);
    world.behaviours = vec![(Behaviour::Good, millis(20))];
    world.give(Event::SetServices(list));
    world.run_until(millis(4000));
    assert_eq!((world.swap(0).0, &world.serving(0).unwrap().start), (SwapState::Done, &start(1)));
}

#[test]
fn unstarted_service_takes_the_new_start() {
    let mut world =
        World::new(vec![service(0, &[], patient()), service(1, &[0], patient())], vec![(Behaviour::Good, millis(300))]);
    world.give(Event::Tick);
    let list = vec![service(0, &[], patient()), Service { start: start(1), ..service(1, &[0], patient()) }];
    assert_eq!(changes(&world, &list)[1].1, Change::InPlace);
    world.give(Event::SetServices(list));
    world.run_until(millis(1500));
    assert_eq!((world.spawned.len(), &world.serving(1).unwrap().start), (2, &start(1)));
}
