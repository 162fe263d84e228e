//! The project file under `kill -9`: it has every acknowledged command.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod support;

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command as Process, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_formats::LoadOptions;
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, Command, SaveUnit, Select, SetColor, Target, Undo};
use supergaussian_scene::project::Project;

const FOLDER: &str = "SUPERGAUSSIAN_CRASH_TEST_FOLDER";
const FIRST: &str = "SUPERGAUSSIAN_CRASH_TEST_FIRST";

fn open(folder: &Path) -> Project {
    let file = folder.join("spiral.ply");
    let scene = Arc::new(sg_formats::load(&file, &LoadOptions::default()).unwrap().scene);
    Project::open(&folder.join("a.sgproj"), scene, &file.display().to_string()).unwrap()
}

/// The command of a number: looks, selections, units, undo, all with masks in their events.
fn command(n: u64) -> Command {
    let everything = || Some(Target { everything: true, ..Target::default() });
    let action = match n % 5 {
        0 => Action::Select(Select { target: everything(), operation: 0 }),
        1 => Action::SaveUnit(SaveUnit { name: format!("unit {}", n % 50), replace: true }),
        2 => Action::Undo(Undo { steps: 1 }),
        _ => {
            let color = Some(Color { red: (n % 97) as f32 / 97.0, green: 0.5, blue: 0.5 });
            Action::SetColor(SetColor { target: everything(), color })
        }
    };
    Command { id: format!("command-{n}"), expected_revision: 0, action: Some(action) }
}

/// Runs as a child process of the test below and gets killed: applies commands and prints each accepted one.
#[test]
#[ignore = "started by `acknowledged_commands_survive_kill_9`"]
fn writer() {
    let (Ok(folder), Ok(first)) = (std::env::var(FOLDER), std::env::var(FIRST)) else { return };
    let mut project = open(Path::new(&folder));
    let mut out = std::io::stdout().lock();
    for n in first.parse().unwrap()..u64::MAX {
        let result = project.apply(&command(n)).unwrap().result;
        writeln!(out, "ack {n} {} {}", result.revision, result.selection_hash).unwrap();
        out.flush().unwrap();
        project.checkpoint_if_due().unwrap();
    }
}

#[test]
fn acknowledged_commands_survive_kill_9() {
    let folder = tempfile::tempdir().unwrap();
    support::write_ply(&folder.path().join("spiral.ply"), 4000);
    let mut acknowledged: Vec<(u64, u64, String)> = Vec::new();
    for round in 0..12_u64 {
        let mut writer = Process::new(std::env::current_exe().unwrap())
            .args(["--exact", "writer", "--ignored", "--nocapture"])
            .env(FOLDER, folder.path())
            .env(FIRST, acknowledged.last().map_or(0, |(n, ..)| n + 1).to_string())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(writer.stdout.take().unwrap());
        let (sender, heard) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || {
            for line in lines.split(b'\n') {
                // The harness prints before the first line and a kill may cut the last.
                let Ok(line) = line.map(|l| String::from_utf8_lossy(&l).into_owned()) else { break };
                let Some((_, line)) = line.split_once("ack ") else { continue };
                if let [n, revision, hash] = line.split(' ').collect::<Vec<_>>()[..]
                    && hash.len() == 64
                {
                    sender.send((n.parse().unwrap(), revision.parse().unwrap(), hash.to_owned())).unwrap();
                }
            }
        });
        // Killed at another moment in each round, once it works.
        acknowledged.push(heard.recv_timeout(Duration::from_secs(30)).unwrap());
        let until = Instant::now() + Duration::from_millis(3 + 11 * round);
        while let Some(time) = until.checked_duration_since(Instant::now()) {
            acknowledged.extend(heard.recv_timeout(time).ok());
        }
        writer.kill().unwrap();
        writer.wait().unwrap();
        reader.join().unwrap();
        acknowledged.extend(heard.try_iter());

        let mut project = open(folder.path());
        let revision = project.editor().state().revision();
        let last = acknowledged.last().unwrap().1;
        assert!(revision == last || revision == last + 1, "round {round}: {revision} after acknowledged {last}");
        for (n, revision, hash) in &acknowledged {
            let again = project.apply(&command(*n)).unwrap().result;
            assert!(again.repeated, "round {round}: command {n} was acknowledged and is gone");
            assert_eq!((again.revision, &again.selection_hash), (*revision, hash), "round {round}: command {n}");
        }
        if revision > last {
            // Stored, but killed before publication: the next writer finds it applied.
            let next = acknowledged.last().unwrap().0 + 1;
            let done = project.apply(&command(next)).unwrap().result;
            assert!(done.repeated);
            acknowledged.push((next, done.revision, done.selection_hash));
        }
        assert_eq!(project.editor().state().revision(), revision);
    }
    assert!(acknowledged.len() > 50, "only {} commands were tried", acknowledged.len());
    assert!(acknowledged.iter().zip(1..).all(|((_, revision, _), want)| *revision == want), "revisions have no gaps");
}
