//! The whole stack by its front door. The demo runs on the made volume, with every service killed in the middle, and on real
//! volumes.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by its helpers and prints what it measured")]

use std::path::{Path, PathBuf};

use sg_tests::{Picture, Recolour, command, real_data, said};

/// Few enough that a run takes seconds.
const GAUSSIANS: &str = "20000";

const SERVICES: [&str; 7] =
    ["scene", "selection", "render-view", "render-capture", "agent-core", "agent-intent", "agent-function"];

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

    fn transcript(&self) -> Vec<serde_json::Value> {
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
