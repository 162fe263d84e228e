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
use sg_proto::scene::{Color, Command, CommitSelection, SaveUnit, Select, SetColor, Target, Undo};
use sg_scene::mask::Mask;
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
        // More often than in service, so that many kills meet a checkpoint and the removal of old rows.
        if n % 3 == 0 {
            project.checkpoint().unwrap();
        }
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

/// Measures a project by the number of its selections: size on disk, time of a command, and time to open.
/// `cargo test --release -p supergaussian-scene --test crash -- --ignored --nocapture growth`.
#[test]
#[ignore = "prints sizes and times"]
fn growth() {
    for (gaussians, commits) in [(8_000, [500, 4_000, 16_500]), (1_000_000, [64, 500, 1_500])] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.sgproj");
        let scene = Arc::new(support::shaded_scene(gaussians));
        let open = || Project::open(&path, Arc::clone(&scene), "").unwrap();
        let size = || {
            let files = std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().metadata().unwrap().len());
            files.sum::<u64>() as f64 / 1e6
        };
        // Indices say nothing about places, as in a fitted scene: masks compress little.
        let mut bits = 1_u64;
        let mut coordinate = || {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (bits >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
        };
        let places: Vec<_> =
            (0..gaussians).map(|_| glam::Vec3::new(coordinate(), coordinate(), coordinate())).collect();
        let mut project = open();
        let mut done = 0;
        for commits in commits {
            let begun = Instant::now();
            let first = done;
            while done < commits {
                // A ball that wanders through the scene.
                let t = done as f32 * 0.07;
                let centre = glam::Vec3::new(t.sin(), (1.3 * t).cos(), (0.7 * t).sin()) * 0.7;
                let mask = Mask::from_fn(gaussians, |i| places[i].distance_squared(centre) < 0.2);
                let mask = Some(sg_edit::wire::encode_mask(&mask));
                let action = Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() });
                let id = format!("strokes-0193a5f0-0000-7000-8000-{done:012}");
                project.apply(&Command { id, expected_revision: 0, action: Some(action) }).unwrap();
                project.checkpoint_if_due().unwrap();
                done += 1;
            }
            let each = begun.elapsed().as_secs_f64() * 1e3 / f64::from(done - first);
            let running = size();
            drop(project);
            let begun = Instant::now();
            project = open();
            let opened = begun.elapsed().as_secs_f64() * 1e3;
            let line = format!(
                "{gaussians} Gaussians, {done} selections: {running:.1} MB while open, {:.1} MB closed, opened in {opened:.0} ms, {each:.2} ms each",
                std::fs::metadata(&path).unwrap().len() as f64 / 1e6,
            );
            writeln!(std::io::stderr(), "{line}").unwrap();
        }
    }
}
