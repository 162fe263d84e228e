//! Back-pressure: a process that stands still holds no other process up.

#![allow(clippy::panic, clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_proto::keys;
use sg_proto::render::State;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_tests::stack::{SERVICES, Stack};

/// A process that a test started, ended with it.
struct Started(Child);

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

async fn frames(bus: &Bus) -> State {
    bus.newest(&keys::VIEW_STATE, &Context::root().deadline_in(Duration::from_secs(10))).await.unwrap()
}

/// Pictures that are drawn within a while.
async fn pace(bus: &Bus, time: Duration) -> u64 {
    let before = frames(bus).await.frames;
    tokio::time::sleep(time).await;
    frames(bus).await.frames - before
}

#[test]
fn pictures_go_on_while_every_other_service_and_a_listener_stand_still() {
    let settings = [
        "service.render-view.params.width=32",
        "service.render-view.params.height=32",
        "service.render-view.params.frames_per_second=60",
        // No process may be taken for hung while it is stopped here.
        "defaults.liveness=600",
    ];
    let stack = Stack::up_with(&settings.map(str::to_owned)).unwrap();

    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        let bus = stack.join(keys::role::CLI).await.unwrap();
        let calm = pace(&bus, Duration::from_secs(2)).await;
        assert!(calm > 10, "{calm} pictures in two seconds");

        // A listener to everything that takes nothing any more …
        let mut watch = stack.command().unwrap();
        let watch = Started(watch.args(["watch", "--json", "--all"]).stdout(Stdio::null()).spawn().unwrap());
        tokio::time::sleep(Duration::from_millis(500)).await;
        kill(Pid::from_raw(watch.0.id().try_into().unwrap()), Signal::SIGSTOP).unwrap();
        // … and every other service, until the supervisor notices and replaces them one by one.
        let others: Vec<_> = stack
            .ps()
            .iter()
            .filter(|s| s["name"] != "render-view")
            .map(|s| Pid::from_raw(s["pid"].as_i64().unwrap().try_into().unwrap()))
            .collect();
        assert_eq!(others.len(), SERVICES - 1);
        for pid in &others {
            kill(*pid, Signal::SIGSTOP).unwrap();
        }
        let begun = Instant::now();
        let stopped = pace(&bus, Duration::from_secs(4)).await;
        assert!(begun.elapsed() < Duration::from_secs(8), "the process itself answers");
        // Half the pace: the machine has other things to do as well.
        assert!(stopped > calm, "{stopped} pictures in four seconds, {calm} in two before");

        for pid in &others {
            // One that the supervisor has replaced by now is gone.
            let _ = kill(*pid, Signal::SIGCONT);
        }
        let (status, _, all) = stack.run(&["say", "hide everything"]).unwrap();
        assert_eq!(status, Some(0), "{all}");
    });
}
