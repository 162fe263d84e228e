//! The rule of every command: a refused command has changed nothing, and an output replaces only what an earlier run wrote.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod refused;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use sg_scene::synthetic::samples;
use sg_tests::command;

use refused::{REFUSED, VOLUME};

/// Foreign files of the working folder. Each has the name of an output.
const FOREIGN: [(&str, &str); 26] = [
    ("picture.png", "notes under the name of a picture"),
    ("values.npy", "notes under the name of an array"),
    ("points.ply", "notes under the name of a point cloud"),
    ("report.json", "notes under the name of a report"),
    ("taken/scene.toml", "title = \"a file of another program\"\n"),
    ("taken/photo.png", "photo"),
    ("taken/calm/diary.txt", "diary"),
    ("taken/authority.pem", "a certificate of somebody else"),
    ("earlier/demo-files.json", "[\"01-before.png\"]"),
    ("earlier/01-before.png", "a picture of an earlier demo"),
    ("earlier/scene.sgproj", "edits in the window of an earlier demo"),
    ("steps/series.toml", "title = \"a file of another program\"\n"),
    (
        "carried/series.toml",
        "step = [{ previous = \"a.npy\", gaussians = 3 }, { previous = \"b.npy\", gaussians = 3 }]\n",
    ),
    ("tables/ablation.json", "notes under the name of a table"),
    ("tables/labels.npy", "notes under the name of an array"),
    ("tables/language.json", "notes under the name of a table"),
    ("tables/one-stroke.json", "notes under the name of a table"),
    ("tables/speech.json", "notes under the name of a table"),
    ("tables/truth.json", "notes under the name of a ground truth"),
    ("trained/training.checkpoint", "notes under the name of a checkpoint"),
    ("strokes.json", "[]"),
    ("launch.toml", "schema = 99\n"),
    ("graph.json", "{\"nodes\": 2, \"edges\": [[0, 1, 1.0]], \"foreground\": [0], \"background\": [1]}"),
    ("script.toml", "schema = 1\nstep = 3\n"),
    ("short.raw", "four"),
    (
        "a.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 nonsense\n",
    ),
];

/// A working folder with foreign files and good inputs, a home and a run folder.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        for folder in [
            "work/taken/calm",
            "work/earlier",
            "work/trained",
            "work/good",
            "work/steps",
            "work/carried",
            "work/tables",
            "home",
            "run",
        ] {
            std::fs::create_dir_all(place.at(folder)).unwrap();
        }
        for (name, text) in FOREIGN {
            std::fs::write(place.work().join(name), text).unwrap();
        }
        std::fs::write(place.work().join(VOLUME), (0..64).collect::<Vec<u8>>()).unwrap();
        let scene = samples::editable(50, 1);
        for name in ["good.ply", "good/scene.toml"] {
            sg_formats::save(&place.work().join(name), &scene, &sg_formats::SaveOptions::default()).unwrap();
        }
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn work(&self) -> PathBuf {
        self.at("work")
    }

    /// Every file and folder of the place with its content. Empty folders of the home and the run folder do not count.
    fn contents(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut all = BTreeMap::new();
        let mut folders = vec![self.folder.path().to_path_buf()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    if path.starts_with(self.work()) {
                        all.insert(path.clone(), Vec::new());
                    }
                    folders.push(path);
                } else {
                    all.insert(path.clone(), std::fs::read(&path).unwrap());
                }
            }
        }
        all
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.run_on("", arguments)
    }

    /// Runs a command on a display; none if that is empty.
    fn run_on(&self, display: &str, arguments: &[&str]) -> Output {
        let mut command = command(&self.at("run")).unwrap();
        command.env("HOME", self.at("home")).env("XDG_DATA_HOME", self.at("home/data"));
        command.env("XDG_CONFIG_HOME", self.at("home/config")).env("XDG_CACHE_HOME", self.at("home/cache"));
        // The driver's cache of shaders is not the command's.
        command.env("MESA_SHADER_CACHE_DISABLE", "true").env("DISPLAY", display);
        command.current_dir(self.work()).args(arguments).stdin(Stdio::null()).output().unwrap()
    }
}

/// The subcommands that the help of a command lists. Those of other executables stand in a section of their own.
fn subcommands(help: &str) -> Vec<String> {
    let mut listed = Vec::new();
    let mut lists_commands = false;
    for line in help.lines() {
        if !line.is_empty() && !line.starts_with(' ') {
            lists_commands = line == "Commands:" || line.starts_with("Offline, on files");
        }
        // What a command is about goes on in lines that are indented further.
        let Some(row) = line.strip_prefix("  ").filter(|row| lists_commands && !row.starts_with(' ')) else { continue };
        listed.extend(row.split_whitespace().next().filter(|name| *name != "help").map(str::to_owned));
    }
    listed
}

/// Every command and subcommand, with a space between its words.
fn commands(place: &Place) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    let mut waiting = VecDeque::from([String::new()]);
    while let Some(command) = waiting.pop_front() {
        let words: Vec<&str> = command.split_whitespace().chain(["--help"]).collect();
        let output = place.run(&words);
        assert!(output.status.success(), "{words:?}: {:?}", output.status);
        for name in subcommands(&String::from_utf8(output.stdout).unwrap()) {
            let subcommand = format!("{command} {name}").trim().to_owned();
            assert!(all.insert(subcommand.clone()), "{subcommand} is listed twice");
            waiting.push_back(subcommand);
        }
    }
    all
}

/// The longest command that the words of a run begin with.
fn command_of<'c>(commands: &'c BTreeSet<String>, words: &[&str]) -> Option<&'c str> {
    let mut beginnings = (1..=words.len()).rev().map(|end| words[..end].join(" "));
    beginnings.find_map(|beginning| commands.get(&beginning)).map(String::as_str)
}

/// Runs a command that must be refused on a display, and sees that nothing has changed. Returns what it said.
fn refuse(place: &Place, before: &BTreeMap<PathBuf, Vec<u8>>, display: &str, arguments: &[&str]) -> String {
    let output = place.run_on(display, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {:?}\n{said}", output.status);
    let after = place.contents();
    let changed: Vec<_> = before.iter().filter(|(path, bytes)| after.get(*path) != Some(bytes)).collect();
    let added: Vec<_> = after.keys().filter(|path| !before.contains_key(*path)).collect();
    assert!(changed.is_empty() && added.is_empty(), "{arguments:?}: changed {changed:?}, added {added:?}\n{said}");
    assert!(Path::new("/dev/null").metadata().is_ok_and(|m| !m.is_file()), "{arguments:?} replaced a device");
    said
}

#[test]
fn a_refused_command_has_changed_nothing() {
    let place = Place::new();
    let commands = commands(&place);
    assert!(commands.contains("fit carry") && commands.contains("scene projects describe"), "{commands:?}");
    let tried: BTreeSet<&str> = REFUSED.iter().filter_map(|words| command_of(&commands, words)).collect();
    let missing: Vec<&String> = commands.iter().filter(|command| !tried.contains(command.as_str())).collect();
    assert!(missing.is_empty(), "each command needs a run that is refused: {missing:?}");
    let before = place.contents();
    for arguments in REFUSED {
        refuse(&place, &before, "", arguments);
    }
    // A volume is fitted before a window opens.
    let on_display: [&[&str]; 3] =
        [&["open", "short.raw"], &["open", "good.ply", "--spacing", "1,1,1"], &["demo", "short.raw", "--out", "new"]];
    for arguments in on_display {
        refuse(&place, &before, ":4711", arguments);
    }
}

#[test]
fn a_demo_leaves_a_session_that_runs_alone() {
    let place = Place::new();
    let session = place.at("run/busy");
    std::fs::create_dir(&session).unwrap();
    std::fs::write(session.join("scene.sgproj"), "edits of a person").unwrap();
    let mut lock = File::create(session.join("supervisor.lock")).unwrap();
    lock.write_all(b"4711").unwrap();
    lock.lock().unwrap();
    let before = place.contents();
    for arguments in [
        &["demo", "--session", "busy", "--out", "new"][..],
        &["demo", "--session", "busy", "--out", "earlier"],
        &["demo", VOLUME, "--session", "busy", "--out", "new/deep"],
        &["demo", "good.ply", "--session", "busy", "--script", "generic", "--out", "earlier"],
    ] {
        let said = refuse(&place, &before, "", arguments);
        assert!(said.contains("session `busy` runs already (supervisor 4711)"), "{arguments:?}: {said}");
    }
}

#[test]
fn an_earlier_output_is_replaced() {
    let place = Place::new();
    let runs: [&[&str]; 8] = [
        &["scene", "convert", "good.ply", "copy.ply"],
        &["scene", "convert", "good.ply", "copy/scene.toml"],
        &["render", "good.ply", "--out", "new.png", "--backend", "cpu", "--width", "16", "--height", "16"],
        &[
            "render",
            "good.ply",
            "--turntable",
            "--out",
            "film",
            "--frames",
            "2",
            "--backend",
            "cpu",
            "--width",
            "16",
            "--height",
            "16",
        ],
        &["selection", "cluster", "good.ply", "--out", "labels.npy", "--report", "new.json"],
        &["selection", "solve", "graph.json", "--out", "solution.json"],
        &["fit", VOLUME, "--initial-only", "--out", "fitted"],
        &["certificates", "tls", "--home", "localhost", "--node", "gpu1"],
    ];
    std::fs::create_dir(place.work().join("copy")).unwrap();
    for arguments in runs {
        for round in ["first", "second"] {
            let output = place.run(arguments);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(output.status.success(), "{round} run of {arguments:?}: {said}");
        }
    }
    // A unit's file beside another scene file keeps its place: the new unit gets another name.
    let before = std::fs::read(place.work().join("good.ply")).unwrap();
    assert!(place.run(&["scene", "convert", "good.ply", "scene.toml"]).status.success());
    assert_eq!(std::fs::read(place.work().join("good.ply")).unwrap(), before);
}
