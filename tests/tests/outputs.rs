//! The rule of every command: a refused command has changed nothing, and an output replaces only what an earlier run wrote.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use sg_scene::synthetic::samples;
use sg_tests::command;

/// Foreign files of the working folder. Each has the name of an output.
const FOREIGN: [(&str, &str); 18] = [
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

/// Every command of `--help` with runs that must be refused.
fn refused_runs() -> BTreeMap<&'static str, Vec<&'static [&'static str]>> {
    BTreeMap::from([
        (
            "demo",
            vec![
                &["demo", "--out", "taken"][..],
                &["demo", "--script", "script.toml", "--out", "new"],
                &["demo", "missing.raw", "--out", "new"],
                &["demo", "--session", "../up", "--out", "new"],
                &["demo", "short.raw", "--out", "new"],
                &["demo", "short.raw", "--out", "earlier"],
                &["demo", "a.ply", "--out", "new"],
                &["demo", "a.ply", "--script", "generic", "--out", "earlier"],
                &["demo", VOLUME, "--transfer-function", "graph.json", "--out", "new/deep"],
                &["demo", "--transfer-function", "graph.json", "--out", "new"],
            ],
        ),
        ("open", vec![&["open", "missing.ply"], &["open", "a.ply"], &["open", "missing.sgproj"]]),
        ("up", vec![&["up", "launch.toml"], &["up", "missing.toml"]]),
        ("down", vec![&["down", "--session", "none"]]),
        ("ps", vec![&["ps", "--session", "none"]]),
        ("logs", vec![&["logs", "--session", "none"]]),
        ("restart", vec![&["restart", "scene", "--session", "none"]]),
        ("swap", vec![&["swap", "scene", "./missing", "--session", "none"]]),
        (
            "join",
            vec![&[
                "join",
                "tls/127.0.0.1:1",
                "--session",
                "none",
                "--name",
                "gpu1",
                "--authority",
                "taken/authority.pem",
                "--certificate",
                "taken/authority.pem",
                "--key",
                "taken/authority.pem",
            ]],
        ),
        (
            "certificates",
            vec![
                &["certificates", "taken", "--home", "localhost"],
                &["certificates", "new", "--home", "localhost", "--node", "authority"],
                &["certificates", "new", "--node", "gpu1"],
                &["certificates", "taken", "--revoke", "gpu1"],
                &["certificates", "new", "--home", "localhost", "--node", "gpu1", "--node", "../gpu2"],
            ],
        ),
        ("projects", vec![&["projects", "delete", "none"], &["projects", "open", "none"]]),
        ("backup", vec![&["backup", "none", "new.sgproj"], &["backup", "a.ply", "new.sgproj"]]),
        ("restore", vec![&["restore", "missing.sgproj", "new"], &["restore", "a.ply", "new"]]),
        ("doctor", vec![&["doctor", "launch.toml"]]),
        ("check", vec![&["check", "launch.toml"]]),
        ("graph", vec![&["graph", "launch.toml"]]),
        ("say", vec![&["say", "hello", "--session", "none"]]),
        (
            "capture",
            vec![
                &["capture", "picture.png", "--session", "none"],
                &["capture", "values.npy", "--session", "none"],
                &["capture", "new.png", "--session", "none"],
                &["capture", "new.txt"],
            ],
        ),
        ("watch", vec![&["watch", "--session", "none"]]),
        (
            "chaos",
            vec![
                &["chaos", "--out", "taken", "--plan"],
                &["chaos", "--out", "new", "--plan", "--script", "script.toml"],
                &["chaos", "launch.toml", "--out", "new", "--plan"],
            ],
        ),
        ("mcp", vec![&["mcp", "--session", "none"], &["mcp", "--session", "../up"]]),
        ("metrics", vec![&["metrics", "--session", "none"]]),
        (
            "contract",
            vec![
                &["contract", "release", "not-a-version"],
                &["contract", "release", "0.2.0", "--proto", "taken"],
                &["contract", "check", "--against", "missing"],
            ],
        ),
        (
            "scene",
            vec![
                &["scene", "info", "a.ply"],
                &["scene", "convert", "a.ply", "new.ply"],
                &["scene", "convert", "good.ply", "points.ply"],
                &["scene", "convert", "good.ply", "good.ply"],
                &["scene", "convert", "good/scene.toml", "good/scene.toml"],
                &["scene", "convert", "good.ply", "taken/scene.toml"],
                &["scene", "convert", "good.ply", "taken", "--format", "ivrgs"],
                &["scene", "convert", "good.ply", "new.unknown"],
                &["scene", "convert", "missing.sgproj", "new.ply"],
                &["scene", "projects", "describe", "missing.sgproj"],
                &["scene", "convert", "good.ply", "new.ply", "--unit", "good"],
            ],
        ),
        (
            "render",
            vec![
                &["render", "good.ply", "--out", "picture.png", "--backend", "cpu"],
                &["render", "good.ply", "--out", "values.npy", "--backend", "cpu"],
                &["render", "good.ply", "--out", "/dev/null"],
                &["render", "a.ply", "--out", "new.png"],
                &["render", "a.ply", "--counts"],
                &["render", "good.ply", "--counts", "--out", "picture.png"],
                &["render", "good.ply", "--turntable", "--out", "taken", "--frames", "2", "--backend", "cpu"],
                &["render", "good.ply", "--turntable", "--out", "picture.png", "--frames", "2"],
                &["render", "good.ply", "--camera-path", "strokes.json", "--out", "new"],
                &["render", "a.ply", "--turntable", "--out", "new/deep"],
                &["render", "good.ply", "--turntable", "--out", "new", "--mask", "values.npy", "--frames", "2"],
                &["render", "good.ply", "--frames", "2", "--out", "new.png"],
            ],
        ),
        (
            "selection",
            vec![
                &["selection", "cluster", "good.ply", "--out", "values.npy"],
                &["selection", "cluster", "good.ply", "--out", "new.npy", "--report", "new.npy"],
                &["selection", "cluster", "good.ply", "--out", "new.npy", "--report", "good.ply"],
                &["selection", "select", "good.ply", "--strokes", "strokes.json", "--out", "values.npy"],
                &[
                    "selection",
                    "select",
                    "good.ply",
                    "--strokes",
                    "strokes.json",
                    "--out",
                    "new.npy",
                    "--report",
                    "strokes.json",
                ],
                &["selection", "solve", "graph.json", "--out", "graph.json"],
                &["selection", "solve", "graph.json", "--out", "taken"],
            ],
        ),
        (
            "fit",
            vec![
                &["fit", "short.raw", "--initial-only", "--out", "new"],
                &["fit", VOLUME, "--initial-only", "--out", "taken"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--report", "picture.png"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--report", VOLUME],
                &["fit", "short.raw", "--initial-only", "--keep-in", "new"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--spacing", "0,1,1"],
                &["fit", "picture.png", "--initial-only", "--out", "new", "--spacing", "1,1,1"],
                &["fit", VOLUME, "--out", "trained"],
                &["fit", VOLUME, "--out", "trained", "--resume"],
                &["fit", VOLUME, "--out", "new", "--gaussians", "50", "--resume"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--labels", "short.raw", "--label-units"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--label-units", "--rest-unit"],
                &["fit", VOLUME, "--initial-only", "--out", "new", "--label-units", "--label-names", "picture.png"],
            ],
        ),
        (
            "labeling",
            vec![
                &["labeling", "find", "a.ply", "the sac"],
                &["labeling", "find", "missing.ply", "the sac"],
                &["labeling", "describe", "a.ply"],
            ],
        ),
        (
            "speech",
            vec![
                &["speech", "listen", "a.ply"],
                &["speech", "listen", "missing.wav"],
                &["speech", "speak", "Done.", "--out", "new/deep/reply.wav"],
                &["speech", "speak", "…", "--out", "new.wav"],
            ],
        ),
        ("conformance", vec![&["conformance", "no-such-role", "./missing"]]),
        ("eval", vec![&["eval", "selection-ablation", "--out", "new", "--data", "missing"]]),
    ])
}

/// A volume of 64 voxels.
const VOLUME: &str = "cube_4x4x4_uint8.raw";

/// A working folder with foreign files and good inputs, a home and a run folder.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        for folder in ["work/taken/calm", "work/earlier", "work/trained", "work/good", "home", "run"] {
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

/// The commands that `--help` lists.
fn commands(place: &Place) -> BTreeSet<String> {
    let help = String::from_utf8(place.run(&["--help"]).stdout).unwrap();
    let is_row =
        |line: &&str| line.starts_with("  ") && line.trim_start().starts_with(|c: char| c.is_ascii_lowercase());
    let rows = help.lines().filter(is_row).filter(|line| line.len() - line.trim_start().len() == 2);
    rows.filter_map(|row| row.split_whitespace().next().map(str::to_owned)).collect()
}

#[test]
fn a_refused_command_has_changed_nothing() {
    let place = Place::new();
    let runs = refused_runs();
    let known: BTreeSet<String> = runs.keys().map(|name| (*name).to_owned()).collect();
    assert_eq!(commands(&place), known, "every command needs its row of refused runs");
    let before = place.contents();
    // A volume is fitted before a window opens.
    let on_display: [&[&str]; 3] =
        [&["open", "short.raw"], &["open", "good.ply", "--spacing", "1,1,1"], &["demo", "short.raw", "--out", "new"]];
    let with = |display| move |arguments: &&'static [&'static str]| (display, *arguments);
    let all = runs.values().flatten().map(with("")).chain(on_display.iter().map(with(":4711")));
    for (display, arguments) in all {
        let output = place.run_on(display, arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {:?}\n{said}", output.status);
        let after = place.contents();
        let changed: Vec<_> = before.iter().filter(|(path, bytes)| after.get(*path) != Some(bytes)).collect();
        let added: Vec<_> = after.keys().filter(|path| !before.contains_key(*path)).collect();
        assert!(changed.is_empty() && added.is_empty(), "{arguments:?}: changed {changed:?}, added {added:?}\n{said}");
        assert!(Path::new("/dev/null").metadata().is_ok_and(|m| !m.is_file()), "{arguments:?} replaced a device");
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
