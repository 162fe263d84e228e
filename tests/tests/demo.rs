//! The whole stack by its front door. The demo runs on the made volume, with every service killed in the middle, and on real
//! volumes.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and prints what it measured")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;
use sg_proto::keys::{self, role};
use sg_proto::scene::command::Action;
use sg_proto::scene::{self, ChangesRequest, SaveUnit, Select, Target};
use sg_runtime::bus::{Bus, endpoint_of};
use sg_runtime::context::Context;
use sg_tests::screen::Screen;
use sg_tests::{Picture, Recolour, command, real_data, said};

/// Few enough that a run takes seconds.
const GAUSSIANS: &str = "20000";

const SERVICES: [&str; 9] = [
    "scene",
    "selection",
    "labeling",
    "speech",
    "render-view",
    "render-capture",
    "agent-core",
    "agent-intent",
    "agent-function",
];

struct Run {
    folder: tempfile::TempDir,
}

impl Run {
    /// Plays the demo; it has to succeed.
    fn play(arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let output = command(&folder.path().join("run"))
            .unwrap()
            .args(["demo", "--gaussians", GAUSSIANS, "--out"])
            .arg(folder.path().join("out"))
            .args(arguments)
            .output()
            .unwrap();
        assert!(output.status.success(), "demo {arguments:?}: {}", said(&output));
        Self { folder }
    }

    /// The file that a capture of this name was written to.
    fn capture(&self, name: &str) -> PathBuf {
        let ending = format!("-{name}.npy");
        let out = std::fs::read_dir(self.folder.path().join("out")).unwrap();
        let mut found: Vec<PathBuf> = out.map(|e| e.unwrap().path()).collect();
        found.retain(|p| p.to_string_lossy().ends_with(&ending));
        assert_eq!(found.len(), 1, "captures named {name}: {found:?}");
        assert!(found[0].with_extension("png").is_file());
        found.remove(0)
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.capture(name)).unwrap()
    }

    /// The recolour shows where the unit is and nowhere else, and undoing brings the picture back byte for byte.
    fn check(&self, unit: &str, recoloured: &str) {
        let read = |name: &str| Picture::read(&self.capture(name)).unwrap();
        let change = Recolour::between(&read("before"), &read(recoloured), &read(unit));
        println!("{unit}: outside at most {:.4}, inside median {:.4}", change.outside_max, change.inside_median);
        assert!(change.outside_max <= 1.0 / 255.0, "{change:?}");
        assert!(change.inside_median >= 16.0 / 255.0, "{change:?}");
        assert_ne!(self.bytes(recoloured), self.bytes("before"));
        assert_eq!(self.bytes("undone"), self.bytes(recoloured), "undo brings the picture back");
    }

    fn transcript(&self) -> Vec<Value> {
        let path = self.folder.path().join("out/transcript.json");
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    }
}

#[test]
fn the_made_volume_is_brushed_named_and_talked_about() {
    let run = Run::play(&[]);
    run.check("sac", "red");
    assert_ne!(run.bytes("faded"), run.bytes("red"));

    let transcript = run.transcript();
    for entry in &transcript {
        for key in ["t_seconds", "conversation", "step", "stage", "key", "type", "message"] {
            assert!(entry.get(key).is_some(), "{key} is missing in {entry}");
        }
    }
    // The loop reports each stage: said, seen, understood, planned, done, seen again, answered.
    let types: Vec<&str> = transcript.iter().filter_map(|e| e["type"].as_str()).collect();
    for stage in ["Utterance", "Perceive", "Observation", "Intent", "Plan", "ActionResult", "Reply"] {
        let name = format!("supergaussian.language.v1.{stage}");
        assert!(types.contains(&name.as_str()), "no {stage} in the transcript");
    }
    let replies: Vec<&str> = transcript
        .iter()
        .filter(|e| e["type"] == "supergaussian.language.v1.Reply")
        .filter_map(|e| e["message"]["text"].as_str())
        .collect();
    assert!(replies.iter().any(|r| r.contains("all of the sac")), "{replies:#?}");
}

#[test]
fn the_demo_completes_when_any_service_is_killed() {
    let calm = Run::play(&[]);
    for service in SERVICES {
        let shaken = Run::play(&["--chaos", service]);
        for name in ["walked", "sac", "red", "faded", "undone"] {
            assert_eq!(shaken.bytes(name), calm.bytes(name), "{name} after {service} was killed");
        }
        let transcript = shaken.transcript();
        let restarted = transcript.iter().any(|e| {
            e["type"] == "supergaussian.launch.v1.ServiceEvent"
                && e["message"]["service"]["name"] == service
                && e["message"]["service"]["restarts"].as_u64().is_some_and(|n| n > 0)
        });
        assert!(restarted, "{service} was killed and started again");
    }
}

#[test]
fn real_volumes_play_their_own_scripts() {
    let Some(data) = real_data().unwrap() else {
        println!("SKIPPED: the demo on real volumes needs SUPERGAUSSIAN_DATA");
        return;
    };
    for (file, unit, recoloured) in [
        ("bonsai_256x256x256_uint8.raw.zst", "trunk", "orange"),
        ("aneurism_256x256x256_uint8.raw.zst", "aneurysm", "red"),
        ("tooth_103x94x161_uint8.raw.zst", "root", "blue"),
    ] {
        let volume = data.join("volumes").join(file);
        Run::play(&[&volume.to_string_lossy()]).check(unit, recoloured);
    }
}

#[test]
fn the_generic_script_works_on_any_scene() {
    let folder = tempfile::tempdir().unwrap();
    let made =
        command(folder.path()).unwrap().args(["fit", "phantom", "--size", "48", "--out"]).arg(folder.path()).output();
    assert!(made.as_ref().unwrap().status.success(), "{}", said(&made.unwrap()));
    let volume = folder.path().join("phantom_48x48x48_uint8.raw");
    let run = Run::play(&[&volume.to_string_lossy(), "--script", "generic"]);
    let out = run.folder.path().join("out");
    assert!(std::fs::read_dir(out).unwrap().any(|e| e.unwrap().path().extension().is_some_and(|x| x == "png")));
}

/// Sessions of a person with a screen: volumes are opened, and a logout clears the run folder.
struct Person<'a> {
    home: &'a Path,
    screen: &'a Screen,
}

impl Person<'_> {
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = command(&self.home.join("run")).unwrap();
        command.env("DISPLAY", self.screen.display()).env("XDG_CONFIG_HOME", self.home.join("config"));
        command.env("XDG_DATA_HOME", self.home.join("data")).args(arguments);
        command
    }

    fn run(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let output = self.command(arguments).output().unwrap();
        (output.status.code(), String::from_utf8(output.stdout.clone()).unwrap(), said(&output))
    }

    fn projects(&self) -> Vec<Value> {
        let (status, text, all) = self.run(&["projects", "--json"]);
        assert_eq!(status, Some(0), "{all}");
        serde_json::from_str(&text).unwrap()
    }

    /// Runs a command that opens a window in a session, does something there, and ends the session with a logout. Returns what
    /// the command said.
    fn session(&self, arguments: &[&str], act: impl AsyncFnOnce(&Bus)) -> String {
        let log = self.home.join("log");
        let arguments = [arguments, &["--session", "one"]].concat();
        let mut opened = self.command(&arguments).stderr(std::fs::File::create(&log).unwrap()).spawn().unwrap();
        let said = || std::fs::read_to_string(&log).unwrap();
        let begun = Instant::now();
        loop {
            let (status, text, _) = self.run(&["ps", "--json", "--session", "one"]);
            let ps: Value = serde_json::from_str(&text).unwrap_or_default();
            let services = ps["services"].as_array().filter(|_| status == Some(0));
            if services.is_some_and(|s| s.iter().all(|s| s["state"] == "READY")) {
                break;
            }
            assert!(opened.try_wait().unwrap().is_none() && begun.elapsed() < Duration::from_secs(90), "{}", said());
            std::thread::sleep(Duration::from_millis(50));
        }
        let socket = self.home.join("run/one/bus.sock");
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        runtime.block_on(async {
            let bus = Bus::connect("one", role::CLI, &endpoint_of(&socket)).await.unwrap();
            act(&bus).await;
            bus.close().await;
        });
        let (status, _, all) = self.run(&["down", "--session", "one"]);
        assert_eq!(status, Some(0), "{all}");
        assert!(opened.wait().unwrap().success(), "{}", said());
        std::fs::remove_dir_all(self.home.join("run")).unwrap();
        said()
    }
}

fn soon() -> Context {
    Context::root().deadline_in(Duration::from_secs(30))
}

#[test]
fn an_opened_volume_keeps_its_gaussians_and_edits_over_a_logout() {
    let Some(screen) = Screen::open().unwrap() else { return };
    let home = tempfile::tempdir().unwrap();
    let person = Person { home: home.path(), screen: &screen };
    let volume = home.path().join("cube_24x24x24_uint8.raw");
    // Denser towards the middle.
    let off = |k: usize| (k as i32 - 12).unsigned_abs() as u8;
    let voxels = (0..24 * 24 * 24).map(|i| 240 - 18 * off(i % 24).max(off(i / 24 % 24)).max(off(i / 576)));
    std::fs::write(&volume, voxels.collect::<Vec<u8>>()).unwrap();
    let volume = volume.to_str().unwrap();
    let first = person.session(&["open", volume], async |bus| {
        let everything = Target { everything: true, ..Target::default() };
        for (id, action) in [
            ("select", Action::Select(Select { target: Some(everything), operation: 0 })),
            ("save", Action::SaveUnit(SaveUnit { name: "kernel".into(), replace: false })),
        ] {
            let command = scene::Command { id: id.into(), action: Some(action), ..scene::Command::default() };
            bus.ask(&keys::SCENE_APPLY, &command, &soon()).await.unwrap();
        }
    });
    assert!(first.contains("Gaussians after"), "{first}");
    let projects = person.projects();
    assert_eq!(projects.len(), 1, "{projects:?}");
    let (name, scene) = (projects[0]["name"].as_str().unwrap(), projects[0]["scene"].as_str().unwrap());
    assert!(name.starts_with("cube_24x24x24_uint8-") && Path::new(scene).starts_with(home.path()), "{projects:?}");
    assert!(projects[0]["scene_bytes"].as_u64() > Some(100_000) && projects[0]["revision"] == 2, "{projects:?}");

    let edited = async |bus: &Bus| {
        let request = ChangesRequest { from: 0, snapshot: true };
        let state = bus.ask(&keys::SCENE_CHANGES, &request, &soon()).await.unwrap().snapshot.unwrap();
        assert_eq!((state.revision, state.units[0].name.as_str()), (2, "kernel"));
        let (status, _, all) = person.run(&["projects", "delete", name]);
        assert!(status == Some(1) && all.contains("in use"), "{all}");
    };
    person.session(&["projects", "open", name], edited);
    // The volume under another name has the same Gaussians and edits.
    let copy = home.path().join("copy_24x24x24_uint8.raw");
    std::fs::rename(volume, &copy).unwrap();
    let again = person.session(&["open", copy.to_str().unwrap()], edited);
    assert!(again.contains("kept from an earlier time"), "{again}");
    assert_eq!(person.projects().len(), 1);

    let (status, _, all) = person.run(&["projects", "delete", name]);
    assert!(status == Some(0) && all.matches("deleted").count() == 2, "{all}");
    assert!(!Path::new(scene).exists());
    assert_eq!(person.projects(), [] as [Value; 0]);
}

#[test]
fn bad_input_is_one_line_and_status_two() {
    let folder = tempfile::tempdir().unwrap();
    let truncated = folder.path().join("cut_16x16x16_uint8.raw");
    std::fs::write(&truncated, [0_u8; 100]).unwrap();
    let missing = folder.path().join("nothing_here.nrrd");
    for input in [truncated.as_path(), missing.as_path(), Path::new("no-such-script")] {
        let mut demo = command(folder.path()).unwrap();
        demo.args(["demo", "--out"]).arg(folder.path().join("out"));
        if input == Path::new("no-such-script") {
            demo.arg("--script");
        }
        let output = demo.arg(input).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        let lines: Vec<&str> = errors.lines().filter(|l| l.starts_with("error")).collect();
        assert_eq!(lines.len(), 1, "{errors}");
        let name = input.file_name().unwrap().to_string_lossy().into_owned();
        assert!(lines[0].contains(&name), "{errors}");
    }
}
