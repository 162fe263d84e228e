//! Films of `supergaussian render` as a person makes them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use sg_scene::camera_path::CameraPath;
use sg_scene::synthetic::samples;

/// A way from outside into the scene.
const WAY: &str = "up 0 0 1\nnear 0.1\nfov 70\npose 0 -6 0 0 0 0\npose 1 -3 0.5 0 0 0\npose 0.5 -1 0.2 0 2 0\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = samples::editable(200, 1);
    sg_formats::save(&folder.path().join("a.ply"), &scene, &sg_formats::SaveOptions::default()).unwrap();
    std::fs::write(folder.path().join("way.txt"), WAY).unwrap();
    folder
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_supergaussian-render-node"));
    command.current_dir(folder).args(["a.ply", "--backend", "cpu"]).args(arguments).stdin(Stdio::null());
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

fn good(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The names in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const SMALL: [&str; 4] = ["--width", "48", "--height", "33"];

#[test]
fn a_film_is_a_turn_and_then_the_way_as_numbered_pictures_with_their_cameras() {
    let folder = folder();
    let at = folder.path();
    let words = ["--turntable", "--camera-path", "way.txt", "--out", "film", "--frames", "4", "--no-video", "--json"];
    let report: serde_json::Value = serde_json::from_str(&good(at, &[&words[..], &SMALL].concat())).unwrap();
    assert_eq!((&report["pictures"], &report["video"]), (&8.into(), &serde_json::Value::Null));
    let film = at.join("film");
    let pictures: Vec<String> = (0..8).map(|k| format!("{k:04}.png")).collect();
    assert_eq!(names(&film), [pictures.clone(), vec!["film.json".to_owned()]].concat());
    let list: serde_json::Value = serde_json::from_slice(&std::fs::read(film.join("film.json")).unwrap()).unwrap();
    let cameras: Vec<&serde_json::Value> = list["pictures"].as_array().unwrap().iter().map(|p| &p["camera"]).collect();
    assert_eq!(cameras.len(), 8);
    // A listed camera makes its picture again.
    for k in [2, 6] {
        std::fs::write(at.join("camera.json"), cameras[k].to_string()).unwrap();
        good(at, &["--camera", "camera.json", "--out", "again.png"]);
        assert_eq!(
            std::fs::read(at.join("again.png")).unwrap(),
            std::fs::read(film.join(&pictures[k])).unwrap(),
            "{k}"
        );
    }
    // Turn and way begin at the first pose, and the way ends at the last.
    let path = CameraPath::parse(WAY, "way.txt").unwrap();
    let want: Vec<_> = path.cameras([48, 33]).collect();
    for (k, pose) in [(0, 0), (4, 0), (7, 2)] {
        let numbers = cameras[k]["world_to_camera"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap());
        let off = numbers.zip(want[pose].world_to_camera).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9 && cameras[k]["near"] == 0.1, "picture {k}");
    }
    // A shorter film in the same folder leaves nothing of the longer one.
    good(at, &[&["--turntable", "--out", "film", "--frames", "2", "--no-video"], &SMALL[..]].concat());
    assert_eq!(names(&film), ["0000.png", "0001.png", "film.json"]);
}

#[test]
fn the_video_is_made_where_ffmpeg_is_and_missing_where_it_is_not() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = folder();
    let at = folder.path();
    let words = [&["--camera-path", "way.txt", "--out", "film", "--frames", "3", "--fps", "12"], &SMALL[..]].concat();
    let output = command(at, &words).env("PATH", at.join("none")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("no video: ffmpeg is not installed"), "{said}");
    std::fs::create_dir(at.join("bin")).unwrap();
    let program = at.join("bin/ffmpeg");
    std::fs::write(&program, "#!/bin/sh\nfor out; do :; done\necho \"$@\" > \"$out\"\n").unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let output = command(at, &words).env("PATH", at.join("bin")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("film/film.mp4: 12 pictures a second"), "{said}");
    let given = std::fs::read_to_string(at.join("film/film.mp4")).unwrap();
    assert!(given.contains("-framerate 12 ") && given.contains("film/%04d.png"), "{given}");
    std::fs::write(&program, "#!/bin/sh\necho no room >&2\nexit 3\n").unwrap();
    let output = command(at, &words).env("PATH", at.join("bin")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("warning: no video: ffmpeg failed: no room"), "{said}");
    assert_eq!(names(&at.join("film")), ["0000.png", "0001.png", "0002.png", "film.json"]);
}

#[test]
fn an_interrupt_leaves_finished_pictures_only() {
    let folder = folder();
    let at = folder.path();
    let words = ["--turntable", "--out", "film", "--frames", "4999", "--width", "64", "--height", "64"];
    let mut child = command(at, &words).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while !at.join("film/0002.png").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no picture");
        std::thread::sleep(Duration::from_millis(5));
    }
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let status = child.wait().unwrap();
    let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert!(status.code() == Some(1) && said.contains("stopped: ") && said.contains(" of 4999 pictures"), "{said}");
    let names = names(&at.join("film"));
    let pictures = names.iter().filter(|name| name.ends_with(".png"));
    for name in pictures.clone() {
        let file = std::fs::File::open(at.join("film").join(name)).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
    }
    assert_eq!(pictures.count() + 1, names.len(), "only pictures and their list: {names:?}");
    // A later film takes the folder.
    good(at, &[&["--turntable", "--out", "film", "--frames", "2", "--no-video"], &SMALL[..]].concat());
}

#[test]
fn a_wrong_film_is_refused_with_one_line() {
    let folder = folder();
    let at = folder.path();
    std::fs::write(at.join("one.txt"), "pose 0 -3 0 0 0 0\n").unwrap();
    std::fs::write(at.join("wrong.txt"), "up 0 0 1\npose 1 2\n").unwrap();
    std::fs::create_dir(at.join("taken")).unwrap();
    std::fs::write(at.join("taken/photo.png"), "photo").unwrap();
    for (words, want) in [
        (vec!["--turntable", "--out", "taken"], "no film wrote"),
        (vec!["--turntable", "--out", "a.ply"], "a.ply"),
        (vec!["--turntable"], "--out"),
        (vec!["--camera-path", "one.txt", "--out", "film"], "--turntable"),
        (vec!["--camera-path", "wrong.txt", "--out", "film"], "wrong.txt, line 2"),
        (vec!["--camera-path", "none.txt", "--out", "film"], "none.txt"),
        (vec!["--frames", "3", "--out", "a.png"], "--turntable or --camera-path"),
        (vec!["--turntable", "--out", "film", "--width", "16384", "--height", "16384"], "67108864"),
    ] {
        let output = run(at, &words);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains(want), "{words:?}: {said}");
    }
    for words in [
        vec!["--turntable", "--out", "film", "--camera", "camera.json"],
        vec!["--turntable", "--out", "film", "--pick", "1,1"],
        vec!["--turntable", "--out", "film", "--frames", "1"],
        vec!["--turntable", "--out", "film", "--frames", "5000"],
        vec!["--turntable", "--out", "film", "--fps", "0"],
    ] {
        assert_eq!(run(at, &words).status.code(), Some(2), "{words:?}");
    }
    assert!(!at.join("film").exists());
}
