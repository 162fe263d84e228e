//! Scenes and volumes opened from a running stack.

use std::path::Path;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::sys::stat::Mode;
use nix::unistd::{Pid, mkfifo};
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::launch::{OpenFailed, OpenReply, OpenRequest};
use sg_runtime::bus::{Bus, Subscription};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

use crate::sandbox::{Sandbox, TIMEOUT, runs};

const ONE: &str = "schema = 1\n[service.scene]\nexec = \"./fixture\"\n";

async fn open(bus: &Bus, path: &Path) -> Result<OpenReply, Fault> {
    let request = OpenRequest { path: path.display().to_string(), ..OpenRequest::default() };
    bus.ask(&keys::OPEN, &request, &Context::root().deadline_in(TIMEOUT)).await
}

async fn failed(events: &mut Subscription<OpenFailed>) -> OpenFailed {
    tokio::time::timeout(TIMEOUT, events.next()).await.expect("a failure is told").unwrap().0
}

#[test]
fn unopenable_files_are_refused_with_one_line() {
    let sandbox = Sandbox::new();
    let file = sandbox.file("one.toml", ONE);
    let command = Path::new(env!("CARGO_BIN_EXE_supergaussian"));
    let up = sandbox.up_by(command, &file, ":4711");
    sandbox.ready("one", "scene");
    let pipe = sandbox.path().join("pipe.ply");
    mkfifo(&pipe, Mode::S_IRWXU).unwrap();
    let refused = |path: &Path| {
        let asked = async { open(&Sandbox::join_in(sandbox.path(), "one").await, path).await };
        sg_runtime::process::block_on(asked).unwrap().unwrap_err()
    };
    for (path, code, said) in [
        (Path::new("../scene.ply"), Code::InvalidArgument, "without `..`"),
        (&sandbox.path().join("none.ply"), Code::NotFound, "none.ply: No such file"),
        (&pipe, Code::FailedPrecondition, "it is a pipe"),
        (&sandbox.file("cells.h5", "HDF"), Code::FailedPrecondition, "HDF5 cannot be read; open it in Fiji"),
    ] {
        let fault = refused(path);
        assert!(fault.code == code && fault.message.contains(said), "{fault:?}");
    }
    drop(up);
    let _up = sandbox.up_by(command, &file, "");
    sandbox.ready("one", "scene");
    let fault = refused(&sandbox.file("scene.ply", "ply"));
    assert!(fault.message.contains("DISPLAY is not set") && fault.message.contains("supergaussian open"), "{fault:?}");
}

#[test]
fn a_refused_file_leaves_no_session() {
    let sandbox = Sandbox::new();
    for (name, said) in [("none.ply", "No such file"), ("cells.h5", "HDF5 cannot be read; open it in Fiji")] {
        let path = sandbox.path().join(name);
        if name == "cells.h5" {
            sandbox.file(name, "HDF");
        }
        let (status, _, errors) = sandbox.run(&["open", &path.display().to_string()]);
        assert!(status == 2 && errors.contains(said), "{status} {errors}");
    }
    let sessions = std::fs::read_dir(sandbox.path().join("run")).map_or(0, Iterator::count);
    assert_eq!(sessions, 0);
}

#[test]
fn failed_open_is_reported_and_the_stack_continues() {
    let sandbox = Sandbox::new();
    let refuse = "echo '{\"level\":\"ERROR\",\"message\":\"no such scene\"}' >&2; exit 2";
    let command = sandbox.install_beside(&[("supergaussian-scene", refuse)]);
    let _up = sandbox.up_by(&command, &sandbox.file("one.toml", ONE), ":4711");
    let before = sandbox.ready("one", "scene");
    let scene = sandbox.file("heart.ply", "ply");
    sg_runtime::process::block_on(async {
        let bus = Sandbox::join_in(sandbox.path(), "one").await;
        let mut events = bus.subscribe(&keys::OPEN_FAILED, role::SUPERVISOR, 8).await.unwrap();
        let reply = open(&bus, &scene).await.unwrap();
        assert!(reply.session.starts_with("heart-") && !reply.volume, "{reply:?}");
        let told = failed(&mut events).await;
        assert_eq!((told.path, &told.session), (scene.display().to_string(), &reply.session));
        assert_eq!(told.reason, "service `scene` failed: exit status 2: no such scene");
        // The opener logs the output of the new session, which leaves no folder.
        assert!(!sandbox.path().join("run").join(&reply.session).exists());
        let (_, log, _) = sandbox.run(&["logs", "--session", "one", &reply.session]);
        assert!(log.contains("no such scene"), "{log}");
    })
    .unwrap();
    assert_eq!(sandbox.ready("one", "scene")["pid"], before["pid"]);
}

#[test]
fn at_most_four_sessions_open_and_outlive_the_opener() {
    let sandbox = Sandbox::new();
    // Fitting that never ends, with a file that records its process.
    let command = sandbox.install_beside(&[("supergaussian-fit", "echo $PPID >> \"$0.pids\"; exec sleep 60")]);
    let up = sandbox.up_by(&command, &sandbox.file("one.toml", ONE), ":4711");
    sandbox.ready("one", "scene");
    let volumes: Vec<_> = (0..5).map(|k| sandbox.file(&format!("v{k}.nrrd"), "NRRD0004")).collect();
    let making = || {
        let text = std::fs::read_to_string(command.with_file_name("supergaussian-fit.pids")).unwrap_or_default();
        text.lines().map(|l| l.parse().unwrap()).collect::<Vec<i32>>()
    };
    let until = |count: usize| {
        let began = Instant::now();
        while making().len() < count {
            assert!(began.elapsed() < TIMEOUT, "{} of {count} are made", making().len());
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    sg_runtime::process::block_on(async {
        let bus = Sandbox::join_in(sandbox.path(), "one").await;
        let mut events = bus.subscribe(&keys::OPEN_FAILED, role::SUPERVISOR, 8).await.unwrap();
        let first = open(&bus, &volumes[0]).await.unwrap();
        assert!(first.volume, "{first:?}");
        until(1);
        // A second request during the fitting.
        open(&bus, &volumes[0]).await.unwrap();
        let told = failed(&mut events).await;
        assert_eq!(told.reason, format!("it is open already, in session `{}`", first.session));
        for volume in &volumes[1..4] {
            open(&bus, volume).await.unwrap();
        }
        let fault = open(&bus, &volumes[4]).await.unwrap_err();
        assert!(fault.code == Code::ResourceExhausted && fault.message.contains("close the window"), "{fault:?}");
        until(4);
    })
    .unwrap();
    let opened = making();
    up.signal(Signal::SIGINT);
    drop(up);
    std::thread::sleep(Duration::from_millis(300));
    assert!(opened.iter().all(|pid| runs(*pid)), "what was opened has ended: {opened:?}");
    for pid in opened {
        kill(Pid::from_raw(pid), Signal::SIGKILL).unwrap();
        sandbox.gone(pid);
    }
}
