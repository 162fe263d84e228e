//! The shape of the house: the invariants of `ARCHITECTURE.md` that can be read off the source.
//!
//! Each rule is a function from the tracked files to complaints. So a test can also give it a file that breaks it.

#![allow(clippy::unwrap_used, clippy::print_stderr, clippy::panic, reason = "a test fails by panicking")]

mod circles;
mod clocks;
mod dependencies;
mod guarantees;

use std::path::Path;
use std::process::Command;

/// A tracked file; the text of a binary file is empty.
struct File {
    path: String,
    text: String,
}

impl File {
    fn new(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    fn is_rust(&self) -> bool {
        self.path.ends_with(".rs")
    }

    /// Whether the file is a test, a bench or an example rather than part of a room's program.
    fn is_test(&self) -> bool {
        let inside = |folder: &str| self.path.contains(&format!("/{folder}/"));
        self.path.starts_with("tests/") || inside("tests") || inside("benches") || inside("examples")
    }

    /// The lines that are neither comments nor in the test module at the file's end, with their numbers.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines: Vec<&str> = self.text.lines().collect();
        let opens_tests = |pair: &[&str]| pair[0].trim() == "#[cfg(test)]" && pair[1].trim_end().ends_with('{');
        let end = lines.windows(2).position(opens_tests).unwrap_or(lines.len());
        let numbered = lines.into_iter().take(end).enumerate().map(|(at, line)| (at + 1, line));
        numbered.filter(|(_, line)| !line.trim_start().starts_with("//"))
    }
}

/// A package of others with a mended fault. Their rules hold in it.
const OF_OTHERS: &str = "services/runtime/zenoh-link-tls/";

/// The tracked files but those of others, or `None` outside a git checkout.
fn tracked_files() -> Option<Vec<File>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent()?;
    let listing = Command::new("git").args(["ls-files", "-z"]).current_dir(root).output().ok();
    let listing = listing.filter(|l| l.status.success() && !l.stdout.is_empty());
    if listing.is_none() && std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1") {
        panic!("git lists no files of this checkout");
    }
    let names = String::from_utf8(listing?.stdout).unwrap();
    let read = |path: &str| {
        // A file that was deleted but not yet committed is listed too.
        let bytes = std::fs::read(root.join(path)).ok()?;
        Some(File::new(path, std::str::from_utf8(&bytes).unwrap_or_default()))
    };
    Some(names.split_terminator('\0').filter(|path| !path.starts_with(OF_OTHERS)).filter_map(read).collect())
}

fn hold(rule: fn(&[File]) -> Vec<String>) {
    match tracked_files() {
        None => eprintln!("SKIPPED: not a git checkout, the shape of the tree is not checked"),
        Some(files) => {
            let complaints = rule(&files);
            assert!(complaints.is_empty(), "\n{}", complaints.join("\n"));
        }
    }
}

fn complaints_about(rule: fn(&[File]) -> Vec<String>, files: &[(&str, &str)]) -> usize {
    rule(&files.iter().map(|(path, text)| File::new(path, text)).collect::<Vec<_>>()).len()
}

const TOP_LEVEL: [&str; 23] = [
    ".cargo",
    ".ci",
    ".config",
    ".gitignore",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "Cargo.lock",
    "Cargo.toml",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "README.md",
    "clippy.toml",
    "deny.toml",
    "docs",
    "launch",
    "ops",
    "proto",
    "render-node",
    "rust-toolchain.toml",
    "rustfmt.toml",
    "services",
    "tests",
];

fn top_level_lists_all_commands(files: &[File]) -> Vec<String> {
    let found: std::collections::BTreeSet<&str> =
        files.iter().map(|f| f.path.split('/').next().unwrap_or_default()).collect();
    let strange =
        found.iter().filter(|name| !TOP_LEVEL.contains(name)).map(|name| format!("{name}: not at the top level"));
    let absent = TOP_LEVEL.iter().filter(|name| !found.contains(*name)).map(|name| format!("{name}: missing"));
    strange.chain(absent).collect()
}

#[test]
fn the_top_level_lists_all_commands() {
    hold(top_level_lists_all_commands);
    let complete: Vec<(&str, &str)> = TOP_LEVEL.iter().map(|name| (*name, "")).collect();
    assert_eq!(complaints_about(top_level_lists_all_commands, &complete), 0);
    assert_eq!(complaints_about(top_level_lists_all_commands, &[&complete[..], &[("notes/plan.md", "")]].concat()), 1);
    assert_eq!(complaints_about(top_level_lists_all_commands, &complete[1..]), 1);
}

/// A complaint for each line of code that breaks a rule.
fn lines_against<'a>(
    files: impl Iterator<Item = &'a File>,
    rule: &str,
    breaks_it: impl Fn(&str) -> bool,
) -> Vec<String> {
    let complaint = |file: &File| -> Vec<String> {
        let lines = file.code().filter(|(_, line)| breaks_it(line));
        lines.map(|(number, _)| format!("{}:{number}: {rule}", file.path)).collect()
    };
    files.flat_map(complaint).collect()
}

fn no_drawers_for_everything(files: &[File]) -> Vec<String> {
    let drawers = ["util", "utils", "common", "helper", "helpers", "misc", "manager", "shared"];
    let is_drawer = |part: &str| drawers.contains(&part.trim_end_matches(".rs"));
    let rust = files.iter().filter(|f| f.is_rust());
    rust.filter(|f| f.path.split('/').any(is_drawer))
        .map(|f| format!("{}: a module is named after its subject", f.path))
        .collect()
}

#[test]
fn modules_are_named_after_a_subject() {
    hold(no_drawers_for_everything);
    assert_eq!(complaints_about(no_drawers_for_everything, &[("launch/cli/src/utils.rs", "")]), 1);
    assert_eq!(complaints_about(no_drawers_for_everything, &[("launch/cli/src/common/mod.rs", "")]), 1);
    assert_eq!(complaints_about(no_drawers_for_everything, &[("launch/cli/src/common_words.rs", "")]), 0);
}

fn only_the_runtime_names_the_bus(files: &[File]) -> Vec<String> {
    let outside = files.iter().filter(|f| !f.path.starts_with("services/runtime/"));
    let mut complaints = Vec::new();
    for file in outside {
        let manifest = file.path.ends_with("/Cargo.toml");
        for (number, line) in file.text.lines().enumerate() {
            let code = file.is_rust() && !line.trim_start().starts_with("//");
            let names_it = code && (line.contains(concat!("zenoh", "::")) || line.contains(concat!("use ", "zenoh")));
            if names_it || manifest && line.starts_with("zenoh") {
                complaints.push(format!("{}:{}: only services/runtime names zenoh", file.path, number + 1));
            }
        }
    }
    complaints
}

#[test]
fn the_bus_is_named_in_the_runtime_only() {
    hold(only_the_runtime_names_the_bus);
    let session = concat!("let s = zenoh", "::open(config).await?;");
    assert_eq!(
        complaints_about(only_the_runtime_names_the_bus, &[("services/scene/service/src/actor.rs", session)]),
        1
    );
    assert_eq!(complaints_about(only_the_runtime_names_the_bus, &[("services/runtime/src/bus.rs", session)]), 0);
    let manifest = [("launch/Cargo.toml", "zenoh.workspace = true")];
    assert_eq!(complaints_about(only_the_runtime_names_the_bus, &manifest), 1);
}

/// Whether a package's folder holds a process rather than a library.
fn is_process(folder: &str) -> bool {
    let last = folder.rsplit('/').next().unwrap_or_default();
    ["service", "core", "intent", "function", "node", "cli"].contains(&last)
}

/// Modules of a package that belong to its process: those that `main.rs` declares, if it has one.
fn process_modules(files: &[File], package: &str) -> Vec<String> {
    let main = files.iter().find(|f| f.path == format!("{package}/src/main.rs"));
    let lines = main.into_iter().flat_map(|f| f.text.lines());
    lines.filter_map(|line| line.trim().strip_prefix("mod ")?.strip_suffix(';')).map(str::to_owned).collect()
}

/// Packages whose subject is processes or asynchronous calls.
const ASYNCHRONOUS: [&str; 4] = ["services/runtime", "services/endpoint", "services/agents/llm", "launch/stack"];

fn libraries_know_no_bus(files: &[File]) -> Vec<String> {
    let mut complaints = Vec::new();
    for (package, ..) in
        MAP.iter().filter(|(package, ..)| !ASYNCHRONOUS.contains(package) && !package.starts_with("tests"))
    {
        let process = process_modules(files, package);
        for file in files.iter().filter(|f| f.is_rust()) {
            let Some(inside) = file.path.strip_prefix(&format!("{package}/src/")) else { continue };
            let first = inside.split('/').next().unwrap_or_default().trim_end_matches(".rs");
            if first == "main" || process.iter().any(|module| module == first) {
                continue;
            }
            for (number, line) in file.code() {
                let word =
                    ["sg_runtime", "tokio", "async fn", "async move", ".await"].iter().find(|w| line.contains(**w));
                if let Some(word) = word {
                    complaints.push(format!("{}:{number}: `{word}` in a library; it belongs into actor.rs", file.path));
                }
            }
        }
    }
    complaints
}

#[test]
fn a_library_names_neither_bus_nor_async() {
    hold(libraries_know_no_bus);
    let main = ("services/scene/service/src/main.rs", "mod actor;\nmod cli;\n#[tokio::main]\nasync fn main() {}");
    let actor = ("services/scene/service/src/actor.rs", "use sg_runtime::Process;");
    let library = ("services/scene/service/src/journal.rs", "pub async fn append() {}");
    let test = ("services/scene/edit/src/history.rs", "#[cfg(test)]\nmod tests {\n    async fn f() {}\n}");
    assert_eq!(complaints_about(libraries_know_no_bus, &[main, actor]), 0);
    assert_eq!(complaints_about(libraries_know_no_bus, &[actor]), 1, "actor.rs as a module of the library");
    assert_eq!(complaints_about(libraries_know_no_bus, &[main, library]), 1);
    assert_eq!(complaints_about(libraries_know_no_bus, &[test]), 0);
}

#[test]
fn modules_import_each_other_in_one_direction() {
    hold(circles::complaints);
    let complaints = |files: &[(&str, &str)]| complaints_about(circles::complaints, files);
    let (a, b) = (("x/src/a.rs", "use crate::{b::{self, B}, d};"), ("x/src/b.rs", "fn f() { super::c::g(); }"));
    assert_eq!(complaints(&[a, b]), 0);
    assert_eq!(complaints(&[a, b, ("x/src/c.rs", "use crate::a::A;")]), 1);
    assert_eq!(complaints(&[a, b, ("x/src/c/mod.rs", "mod e;"), ("x/src/c/e.rs", "use super::super::a;")]), 0);
    assert_eq!(complaints(&[a, b, ("y/src/c.rs", "use crate::a::A;")]), 0, "another package");
    assert_eq!(complaints(&[a, b, ("x/src/c.rs", "#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}")]), 0);
    let parent = [("x/src/a/mod.rs", "use self::b::B;"), ("x/src/a/b.rs", "use super::A;")];
    assert_eq!(complaints(&parent), 0, "a module and what is inside it are one subject");
}

/// Functions that open a file for reading, and files that may call them.
const OPENERS: [&str; 4] = ["fs::read(", "fs::read_to_string(", "File::open(", "OpenOptions::new().read("];
const MAY_OPEN: [(&str, &str); 8] = [
    ("services/input/src/file.rs", "the one place"),
    ("proto/build.rs", "the contract's own files"),
    ("services/agents/language/build.rs", "the package's own sentences"),
    ("services/scene/formats/src/staged_file.rs", "folders, to make a renaming durable"),
    ("services/runtime/src/session.rs", "the lock of a session"),
    ("services/runtime/src/blobs.rs", "content-addressed files of the own session"),
    ("services/runtime/src/scene_files.rs", "the time of a folder's last use"),
    ("services/runtime/src/process/memory.rs", "the kernel's numbers about this process"),
];

fn files_are_opened_in_one_place(files: &[File]) -> Vec<String> {
    let is_bound = |f: &&File| f.is_rust() && !f.is_test() && !MAY_OPEN.iter().any(|(path, _)| f.path == *path);
    // Files of tests within a room.
    let is_tests = |f: &&File| f.path.ends_with("tests.rs") || f.path.starts_with("launch/cli/src/chaos/");
    let bound = files.iter().filter(|f| is_bound(f) && !is_tests(f));
    let opens = |line: &str| OPENERS.iter().any(|call| line.contains(call)) && !line.contains("sg_input");
    lines_against(bound, "files are opened by sg_input::file", opens)
}

#[test]
fn files_are_opened_by_the_input_library_only() {
    hold(files_are_opened_in_one_place);
    let complaints = |path: &str, line: &str| complaints_about(files_are_opened_in_one_place, &[(path, line)]);
    assert_eq!(complaints("services/fit/src/train.rs", "let text = std::fs::read_to_string(path)?;"), 1);
    assert_eq!(complaints("launch/stack/src/file/load.rs", "let file = File::open(path)?;"), 1);
    assert_eq!(complaints("launch/stack/src/file/load.rs", "let text = file::read_text(path, most)?;"), 0);
    assert_eq!(complaints("services/input/src/file.rs", "let file = File::open(path)?;"), 0);
    assert_eq!(complaints("services/fit/tests/cli.rs", "let text = std::fs::read(path)?;"), 0);
}

fn prints_are_escaped(files: &[File]) -> Vec<String> {
    // In a library, clippy refuses to print. What a process prints goes through this function.
    let in_process = |f: &&File| {
        let package = MAP.iter().find(|(folder, ..)| f.path.starts_with(&format!("{folder}/src/")));
        package.is_some_and(|(folder, ..)| is_process(folder) || ASYNCHRONOUS.contains(folder))
    };
    let bound = files.iter().filter(|f| f.is_rust() && !f.is_test() && in_process(f));
    let prints = |line: &str| line.contains("println!(") || line.contains("print!(");
    lines_against(bound, "printed by sg_input::print, which escapes", prints)
}

#[test]
fn what_is_printed_is_escaped() {
    hold(prints_are_escaped);
    assert_eq!(
        complaints_about(prints_are_escaped, &[("services/fit/service/src/cli.rs", "eprintln!(\"{name}\");")]),
        1
    );
    assert_eq!(
        complaints_about(prints_are_escaped, &[("services/fit/service/src/cli.rs", "print::status(&name);")]),
        0
    );
}

fn only_launch_starts_processes(files: &[File]) -> Vec<String> {
    // A video of pictures that are there already; speech programs, which are no libraries.
    let programs = ["render-node/viewer/src/video.rs", "services/speech/src/child_process.rs"];
    let may = |f: &&File| f.path.starts_with("launch/") || programs.contains(&f.path.as_str()) || f.is_test();
    let rooms = files.iter().filter(|f| f.is_rust() && !may(f));
    let spawns = |line: &str| line.contains("Command::new(") || line.contains("process::Command");
    lines_against(rooms, "only launch/ starts processes", spawns)
}

#[test]
fn processes_are_started_by_launch_only() {
    hold(only_launch_starts_processes);
    let spawn = "let child = Command::new(\"ls\").spawn()?;";
    assert_eq!(complaints_about(only_launch_starts_processes, &[("services/fit/src/train.rs", spawn)]), 1);
    assert_eq!(complaints_about(only_launch_starts_processes, &[("launch/stack/src/spawn.rs", spawn)]), 0);
    assert_eq!(complaints_about(only_launch_starts_processes, &[("render-node/viewer/src/video.rs", spawn)]), 0);
    assert_eq!(
        complaints_about(only_launch_starts_processes, &[("render-node/viewer/src/window/exporter.rs", spawn)]),
        1
    );
    assert_eq!(complaints_about(only_launch_starts_processes, &[("services/fit/tests/cli.rs", spawn)]), 0);
}

/// Folder of a package, its name, and the packages of ours that it may depend on.
const MAP: [(&str, &str, &[&str]); 40] = [
    ("proto", "sg-proto", &[]),
    ("services/input", "sg-input", &[]),
    ("services/confinement", "sg-confinement", &[]),
    ("services/runtime", "sg-runtime", &["sg-input", "sg-proto"]),
    ("services/scene/model", "sg-scene", &["sg-input"]),
    ("services/scene/formats", "sg-formats", &["sg-input", "sg-scene"]),
    ("services/scene/reclassify", "sg-reclassify", &["sg-scene", "sg-volume"]),
    ("services/scene/edit", "sg-edit", &["sg-input", "sg-proto", "sg-reclassify", "sg-scene", "sg-volume"]),
    (
        "services/scene/service",
        "supergaussian-scene",
        &["sg-edit", "sg-formats", "sg-input", "sg-proto", "sg-reclassify", "sg-runtime", "sg-scene"],
    ),
    ("services/volume", "sg-volume", &["sg-input"]),
    ("services/fit", "sg-fit", &["sg-formats", "sg-gpu", "sg-raster", "sg-reclassify", "sg-scene", "sg-volume"]),
    (
        "services/fit/service",
        "supergaussian-fit",
        &["sg-confinement", "sg-fit", "sg-formats", "sg-input", "sg-reclassify", "sg-runtime", "sg-scene", "sg-volume"],
    ),
    ("services/selection/walk", "sg-walk", &["sg-scene"]),
    ("services/selection/clusters", "sg-clusters", &["sg-formats", "sg-input", "sg-scene", "sg-walk"]),
    ("services/selection/selection", "sg-selection", &["sg-clusters", "sg-formats", "sg-scene", "sg-walk"]),
    (
        "services/selection/service",
        "supergaussian-selection",
        &[
            "sg-clusters",
            "sg-color",
            "sg-edit",
            "sg-formats",
            "sg-input",
            "sg-proto",
            "sg-reclassify",
            "sg-runtime",
            "sg-scene",
            "sg-selection",
            "sg-walk",
        ],
    ),
    ("services/color", "sg-color", &[]),
    ("services/labeling", "sg-labeling", &["sg-color", "sg-encoders", "sg-scene"]),
    (
        "services/labeling/service",
        "supergaussian-labeling",
        &[
            "sg-edit",
            "sg-encoders",
            "sg-formats",
            "sg-input",
            "sg-labeling",
            "sg-proto",
            "sg-raster",
            "sg-runtime",
            "sg-scene",
        ],
    ),
    ("services/speech", "sg-speech", &["sg-input"]),
    (
        "services/speech/service",
        "supergaussian-speech",
        &[
            "sg-endpoint",
            "sg-input",
            "sg-language",
            "sg-layers",
            "sg-piper",
            "sg-proto",
            "sg-runtime",
            "sg-speech",
            "sg-whisper",
        ],
    ),
    ("services/layers", "sg-layers", &["sg-input"]),
    ("services/labeling/encoders", "sg-encoders", &["sg-input", "sg-layers"]),
    ("services/speech/whisper", "sg-whisper", &["sg-input", "sg-layers", "sg-speech"]),
    ("services/speech/piper", "sg-piper", &["sg-input", "sg-layers", "sg-speech"]),
    ("services/agents/language", "sg-language", &["sg-color", "sg-input", "sg-proto", "sg-sentence-model"]),
    ("services/agents/sentence-model", "sg-sentence-model", &["sg-color"]),
    ("services/endpoint", "sg-endpoint", &[]),
    ("services/agents/llm", "sg-llm", &["sg-endpoint", "sg-language", "sg-proto"]),
    ("services/agents/core", "supergaussian-agent-core", &["sg-language", "sg-llm", "sg-proto", "sg-runtime"]),
    (
        "services/agents/intent",
        "supergaussian-agent-intent",
        &["sg-input", "sg-language", "sg-llm", "sg-proto", "sg-runtime"],
    ),
    ("services/agents/function", "supergaussian-agent-function", &["sg-language", "sg-llm", "sg-proto", "sg-runtime"]),
    ("render-node/raster", "sg-raster", &["sg-formats", "sg-scene", "sg-volume"]),
    ("render-node/gpu", "sg-gpu", &["sg-formats", "sg-input", "sg-raster", "sg-scene"]),
    (
        "render-node/viewer",
        "sg-viewer",
        &[
            "sg-clusters",
            "sg-edit",
            "sg-formats",
            "sg-gpu",
            "sg-input",
            "sg-proto",
            "sg-raster",
            "sg-reclassify",
            "sg-scene",
            "sg-selection",
            "sg-volume",
        ],
    ),
    (
        "render-node/node",
        "supergaussian-render-node",
        &[
            "sg-edit",
            "sg-formats",
            "sg-gpu",
            "sg-input",
            "sg-proto",
            "sg-raster",
            "sg-reclassify",
            "sg-runtime",
            "sg-scene",
            "sg-viewer",
            "sg-volume",
        ],
    ),
    ("launch/stack", "sg-stack", &["sg-confinement", "sg-input", "sg-proto", "sg-runtime"]),
    (
        "launch/cli",
        "supergaussian",
        &["sg-confinement", "sg-formats", "sg-input", "sg-language", "sg-proto", "sg-runtime", "sg-stack", "sg-volume"],
    ),
    (
        "tests",
        "sg-tests",
        &[
            "sg-clusters",
            "sg-color",
            "sg-edit",
            "sg-fit",
            "sg-formats",
            "sg-gpu",
            "sg-input",
            "sg-language",
            "sg-proto",
            "sg-raster",
            "sg-reclassify",
            "sg-runtime",
            "sg-scene",
            "sg-selection",
            "sg-speech",
            "sg-stack",
            "sg-viewer",
            "sg-volume",
            "sg-walk",
        ],
    ),
    (
        "tests/fuzz",
        "sg-fuzz",
        &[
            "sg-clusters",
            "sg-edit",
            "sg-encoders",
            "sg-formats",
            "sg-input",
            "sg-language",
            "sg-llm",
            "sg-piper",
            "sg-proto",
            "sg-reclassify",
            "sg-runtime",
            "sg-scene",
            "sg-speech",
            "sg-stack",
            "sg-volume",
            "sg-walk",
            "sg-whisper",
            "supergaussian",
            "supergaussian-labeling",
            "supergaussian-scene",
            "supergaussian-selection",
            "supergaussian-speech",
        ],
    ),
];

fn manifests_follow_the_map(files: &[File]) -> Vec<String> {
    let mut complaints = Vec::new();
    for file in files {
        let Some(room) = file.path.strip_suffix("/Cargo.toml") else { continue };
        // The other renderers are a workspace of their own, so that nothing of it is built with ours.
        if room.starts_with("tests/peers/") && file.text.contains("\n[workspace]\n") {
            continue;
        }
        let mut say = |what: String| complaints.push(format!("{}: {what}", file.path));
        let Some((_, name, allowed)) = MAP.iter().find(|(folder, ..)| *folder == room) else {
            say("a room that is not on the map (MAP in tests/tests/rooms.rs, ARCHITECTURE.md)".into());
            continue;
        };
        if !file.text.contains("[lints]\nworkspace = true") {
            say("does not take its lints from the workspace".into());
        }
        let mut section = "";
        for line in file.text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
            if line.starts_with('[') {
                section = line;
                continue;
            }
            let (key, value) = line.split_once('=').map_or((line, ""), |(k, v)| (k.trim(), v.trim()));
            if section.contains("dependencies") {
                if !key.ends_with(".workspace") && !value.contains("workspace = true") {
                    say(format!("{key}: versions stand in the workspace only"));
                }
                let package = key.trim_end_matches(".workspace");
                if MAP.iter().any(|(_, ours, _)| *ours == package) && !allowed.contains(&package) {
                    say(format!("may not depend on {package}"));
                }
            } else if key == "name" {
                let value = value.trim_matches('"');
                let is_executable = value == "supergaussian" || value.starts_with("supergaussian-");
                let fits = match section {
                    "[package]" => value == *name && is_executable == is_process(room),
                    "[[bin]]" => is_executable,
                    _ => true,
                };
                if !fits {
                    say(format!("{section} is named {value}"));
                }
            }
        }
    }
    complaints
}

#[test]
fn rooms_depend_as_the_map_says() {
    hold(manifests_follow_the_map);
    let manifest = |dependency: &str| {
        format!("[package]\nname = \"sg-language\"\n[lints]\nworkspace = true\n[dependencies]\n{dependency}\n")
    };
    let complaints = |room: &str, text: &str| complaints_about(manifests_follow_the_map, &[(room, text)]);
    assert_eq!(complaints("services/agents/language/Cargo.toml", &manifest("sg-proto.workspace = true")), 0);
    assert_eq!(
        complaints("services/agents/language/Cargo.toml", &manifest("sg-scene.workspace = true")),
        1,
        "agents act by bus"
    );
    assert_eq!(complaints("services/agents/language/Cargo.toml", &manifest("glam = \"0.34\"")), 1);
    assert_eq!(complaints("services/cellar/Cargo.toml", &manifest("")), 1);
    assert_eq!(complaints("tests/peers/other/Cargo.toml", &manifest("")), 1);
    assert_eq!(complaints("tests/peers/other/Cargo.toml", &format!("\n[workspace]\n{}", manifest("wgpu = \"30\""))), 0);
    assert_eq!(complaints("launch/stack/Cargo.toml", &manifest("")), 1, "the package's name");
}

#[test]
fn the_map_has_no_circle_of_packages() {
    // It counts what tests use too, so a library's tests take nothing from a library above it.
    let mut above: Vec<_> = MAP.to_vec();
    while !above.is_empty() {
        let names: Vec<&str> = above.iter().map(|room| room.1).collect();
        above.retain(|(_, name, allowed)| allowed.iter().any(|other| other != name && names.contains(other)));
        let left: Vec<&str> = above.iter().map(|room| room.1).collect();
        assert!(left.len() < names.len(), "a circle among {left:?}");
    }
}

/// How long `main.rs` may be: it chooses between subcommands and `serve`, nothing more.
const MAIN_LINES: usize = 40;

fn main_is_short(files: &[File]) -> Vec<String> {
    let mains = files.iter().filter(|f| f.path.ends_with("src/main.rs") && !f.is_test());
    mains
        .filter_map(|f| {
            let lines = f.code().filter(|(_, line)| !line.trim().is_empty()).count();
            (lines > MAIN_LINES).then(|| format!("{}: {lines} lines; what it does belongs into a module", f.path))
        })
        .collect()
}

#[test]
fn a_main_is_a_dozen_lines() {
    hold(main_is_short);
    assert_eq!(complaints_about(main_is_short, &[("launch/src/main.rs", &"f();\n".repeat(41))]), 1);
    assert_eq!(complaints_about(main_is_short, &[("launch/src/main.rs", &"f();\n".repeat(40))]), 0);
}

/// Traces of one machine. Written in two pieces, since this file is tracked too.
const MACHINE_TRACES: [&str; 10] = [
    concat!("/ro", "ot/"),
    concat!("/ho", "me/"),
    concat!("/wo", "rk/"),
    concat!("/Us", "ers/"),
    concat!("index.crates", ".io"),
    concat!("static.crates", ".io"),
    concat!("registry.npmjs", ".org"),
    concat!("files.python", "hosted.org"),
    concat!("deb.debian", ".org"),
    concat!("pypi", ".org"),
];

fn no_trace_of_a_machine(files: &[File]) -> Vec<String> {
    let stands_alone = |line: &str, at: usize| {
        !line[..at]
            .ends_with(|c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-' | '}' | '$' | '~' | '/'))
    };
    let mut complaints = Vec::new();
    for file in files {
        for (number, line) in file.text.lines().enumerate() {
            for trace in MACHINE_TRACES {
                let found = line.match_indices(trace).any(|(at, _)| !trace.starts_with('/') || stands_alone(line, at));
                if found {
                    complaints.push(format!("{}:{}: `{trace}`", file.path, number + 1));
                }
            }
        }
    }
    complaints
}

#[test]
fn nothing_tells_of_one_machine() {
    hold(no_trace_of_a_machine);
    let path = concat!("open(\"/ho", "me/me/volume.nrrd\")");
    assert_eq!(complaints_about(no_trace_of_a_machine, &[("docs/a.md", path)]), 1);
    assert_eq!(complaints_about(no_trace_of_a_machine, &[("docs/a.md", "see services/wo\u{72}k/queue.rs")]), 0);
    let host = concat!("resolved https://registry.npmjs", ".org/x");
    assert_eq!(complaints_about(no_trace_of_a_machine, &[("docs/a.md", host)]), 1);
}
