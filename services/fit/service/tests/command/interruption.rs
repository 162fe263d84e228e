//! Trainings that a signal ends: their scene is there, and they go on from their checkpoint.

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use sg_formats::LoadOptions;

use crate::{fit, ok};

/// The longest wait for a checkpoint.
const DEADLINE: Duration = Duration::from_secs(60);

const VOLUME: [&str; 11] = [
    "made/phantom_32x32x32_uint8.raw",
    "--transfer-function",
    "made/phantom.tf.json",
    "--gaussians",
    "600",
    "--views",
    "16",
    "--view-size",
    "64",
    "--progress-lines",
    "--out",
];

fn started(folder: &Path, arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_supergaussian-fit"));
    command.current_dir(folder).args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn send(child: &Child, signal: Signal) {
    kill(Pid::from_raw(child.id().cast_signed()), signal).unwrap();
}

/// Runs the command, and sends a signal when it has said this. Gives how it ended and its last line.
fn signalled(folder: &Path, arguments: &[&str], part: &str, signal: Signal) -> (ExitStatus, String) {
    let mut child = started(folder, arguments);
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let said = lines.by_ref().find(|line| line.contains(part));
    assert!(said.is_some(), "{arguments:?} never said `{part}`");
    send(&child, signal);
    let last = lines.last().unwrap_or_default();
    (child.wait().unwrap(), last)
}

fn gaussians(scene: &Path) -> usize {
    sg_formats::load(scene, &LoadOptions::default()).unwrap().scene.len()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn an_interrupted_training_leaves_its_scene_and_goes_on_to_that_of_an_uninterrupted_one() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    ok(d, &["phantom", "--out", "other", "--size", "32", "--seed", "7"]);
    let training =
        |out: &'static str, more: &[&'static str]| [&VOLUME[..], &[out, "--iterations", "400"], more].concat();
    ok(d, &training("whole", &[]));
    assert_eq!(names(&d.join("whole")), ["phantom.tf.json", "scene.toml", "vessels.ply"]);

    let (status, line) = signalled(d, &training("cut", &[]), "after 100 steps", Signal::SIGINT);
    assert_eq!(status.code(), Some(1), "{line}");
    assert!(line.starts_with("stopped after ") && line.contains(" dB; cut/scene.toml is the best scene"), "{line}");
    let again = "`supergaussian fit --resume made/phantom_32x32x32_uint8.raw --transfer-function made/phantom.tf.json";
    assert!(line.contains(again) && line.ends_with("--out cut --iterations 400` goes on"), "{line}");
    assert_eq!(names(&d.join("cut")), ["phantom.tf.json", "scene.toml", "training.checkpoint", "vessels.ply"]);
    assert_eq!(gaussians(&d.join("cut/scene.toml")), gaussians(&d.join("whole/scene.toml")));

    // The checkpoint of something else, and a damaged one.
    let file = d.join("cut/training.checkpoint");
    let right = std::fs::read(&file).unwrap();
    let refused = |arguments: &[&str], part: &str| {
        let output = fit(d, arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        let error = said.lines().last().unwrap_or_default();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(error.starts_with("error: cut/training.checkpoint: ") && error.contains(part), "{said}");
    };
    refused(&training("cut", &["--resume", "--seed", "1"]), "other options");
    refused(&training("cut", &["--resume", "--target-psnr", "60"]), "other options");
    let mut other = training("cut", &["--resume"]);
    other[0] = "other/phantom_32x32x32_uint8.raw";
    refused(&other, "another volume");
    for (bytes, part) in [
        (&right[..right.len() / 2], "damaged"),
        (&[&right[..], b"more"].concat()[..], "damaged"),
        (&b"notes"[..], "no CHECKPOINT file"),
    ] {
        std::fs::write(&file, bytes).unwrap();
        refused(&training("cut", &["--resume"]), part);
    }
    std::fs::File::create(&file).unwrap().set_len(1 << 40).unwrap();
    refused(&training("cut", &["--resume"]), "bytes are stored");
    std::fs::remove_file(&file).unwrap();
    refused(&training("cut", &["--resume"]), "there is no checkpoint");

    std::fs::write(&file, &right).unwrap();
    let resumed = ok(d, &training("cut", &["--resume"]));
    let said = String::from_utf8(resumed.stderr).unwrap();
    assert!(said.contains("the training goes on after ") && said.contains(", 400 steps: "), "{said}");
    assert_eq!(names(&d.join("cut")), ["phantom.tf.json", "scene.toml", "vessels.ply"]);
    let read = |folder: &str| std::fs::read(d.join(folder).join("vessels.ply")).unwrap();
    assert!(read("cut") == read("whole"), "the resumed training ends with another scene");
}

#[test]
fn a_killed_training_goes_on_from_its_last_checkpoint_and_ends_at_sigterm() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    let arguments = [&VOLUME[..], &["out", "--seconds", "600", "--checkpoint-every", "1"]].concat();
    let mut child = started(d, &arguments);
    let mut stderr = child.stderr.take().unwrap();
    // A full pipe would stop the command.
    let drained = std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()));
    let (file, began) = (d.join("out/training.checkpoint"), Instant::now());
    while !file.exists() {
        assert!(began.elapsed() < DEADLINE, "no checkpoint");
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    drained.join().unwrap().unwrap();
    assert!(!d.join("out/scene.toml").exists());
    let resumed = [&arguments[..], &["--resume"]].concat();
    let (status, line) = signalled(d, &resumed, "training: ", Signal::SIGTERM);
    assert_eq!(status.code(), Some(1), "{line}");
    assert!(line.starts_with("stopped after ") && line.matches("--resume").count() == 1, "{line}");
    assert!(file.exists() && gaussians(&d.join("out/scene.toml")) > 0);
}

#[test]
fn a_signal_before_the_training_ends_the_command_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    let mut arguments = [&VOLUME[..], &["out"]].concat();
    arguments[6] = "1024";
    arguments[8] = "512";
    let (status, _) = signalled(d, &arguments, "rendering the volume", Signal::SIGINT);
    assert_eq!(status.signal(), Some(Signal::SIGINT as i32));
    assert!(names(&d.join("out")).is_empty());
}

#[test]
fn an_interrupted_series_names_its_last_step() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    for (made, seed) in [("made", "0"), ("other", "7")] {
        ok(d, &["phantom", "--out", made, "--size", "32", "--seed", seed]);
    }
    let second = ["other/phantom_32x32x32_uint8.raw"];
    let arguments = [&second[..], &VOLUME, &["flow", "--seconds", "600"]].concat();
    let (status, line) = signalled(d, &arguments, "step 1 of 2: training: ", Signal::SIGINT);
    assert_eq!(status.code(), Some(1), "{line}");
    assert!(line.starts_with("stopped: 1 of 2 steps of the series are written, the last one trained for "), "{line}");
    let series = std::fs::read_to_string(d.join("flow/series.toml")).unwrap();
    assert_eq!(series.matches("[[step]]").count(), 1, "{series}");
    assert!(gaussians(&d.join("flow/step-0000/scene.toml")) > 0);
    let refused = fit(d, &[&arguments[..], &["--resume"]].concat());
    let error = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(2) && error.contains("--resume is for one volume"), "{error}");
}
