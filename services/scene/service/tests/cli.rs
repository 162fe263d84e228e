//! The executable: exit status, output streams, files on disk.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-scene")).current_dir(folder).args(arguments).output().unwrap()
}

fn words(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Three Gaussians of a 3DGS file, as text; the last has no finite centre.
const PLY: &str = "ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
property uchar state
end_header
0 0 0 0.1 0.2 0.3 2 -1 -2 -3 1 0 0 0 7
1 2 3 0.4 0.5 0.6 -1 -4 -4 -4 0.5 0.5 0.5 0.5 8
nan 2 3 0.4 0.5 0.6 -1 -4 -4 -4 0 0 0 0 9
";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.ply"), PLY).unwrap();
    folder
}

#[test]
fn info_reports_the_content_of_a_file() {
    let folder = folder();
    let output = run(folder.path(), &["info", "a.ply", "--json"]);
    let (status, _, stderr) = words(&output);
    assert_eq!((status, stderr.as_str()), (0, ""));
    let report = json(&output);
    assert_eq!(report["format"], "3dgs");
    assert_eq!(report["gaussians"], 3);
    assert_eq!(report["bounds"]["max"], serde_json::json!([1.0, 2.0, 3.0]));
    let unit = &report["units"][0];
    assert_eq!(unit["not_finite"]["positions"], 1);
    assert_eq!(unit["not_finite"]["zero_rotations"], 1);
    assert_eq!(unit["extra"], serde_json::json!([{"name": "state", "type": "uchar"}]));
    assert_eq!(unit["attributes"], serde_json::json!(["position", "rotation", "scale", "opacity", "harmonics"]));
    assert_eq!(report["content_hash"].as_str().unwrap().len(), 64);
    let codes: Vec<_> = report["warnings"].as_array().unwrap().iter().map(|w| w["code"].as_str().unwrap()).collect();
    assert_eq!(codes, ["non-finite", "zero-rotation"]);
    let (status, stdout, stderr) = words(&run(folder.path(), &["info", "a.ply"]));
    assert_eq!((status, stdout.as_str()), (0, ""));
    assert!(
        stderr.contains("3 Gaussians") && stderr.contains("warning: a.ply: centres that are not finite"),
        "{stderr}"
    );
}

#[test]
fn convert_goes_by_extension_and_back() {
    let folder = folder();
    let convert = |arguments: &[&str]| {
        let output = run(folder.path(), &[&["convert", "--json"], arguments].concat());
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        json(&output)
    };
    assert_eq!(convert(&["a.ply", "scene.toml"])["files"], serde_json::json!(["scene.toml", "a-2.ply"]));
    // The input keeps its name and its bytes.
    let report = json(&run(folder.path(), &["info", "scene.toml", "--json"]));
    assert_eq!(report["units"][0]["not_finite"]["positions"], 1);
    let hash = |file: &str| json(&run(folder.path(), &["info", file, "--json"]))["content_hash"].clone();
    for (output, format, arguments) in [
        ("b.ply", "3dgs", [].as_slice()),
        ("b.compressed.ply", "compressed", &[]),
        ("ours.ply", "ours", &["--format", "ours"]),
        ("float.ply", "ivrgs", &["--to", "ivrgs"]),
        ("half.ply", "ivrgs-quantised", &["--to", "ivrgs-quantised", "--to-convention", "legacy"]),
        ("folder", "ivrgs", &["--to", "ivrgs"]),
        ("a.splat", "splat", &[]),
    ] {
        let report = convert(&[&["scene.toml", output], arguments].concat());
        assert_eq!(
            (report["output_format"].as_str(), report["gaussians"].as_u64()),
            (Some(format), Some(3)),
            "{output}"
        );
        let info = json(&run(folder.path(), &["info", output, "--json"]));
        assert_eq!((info["format"].as_str(), info["gaussians"].as_u64()), (Some(format), Some(3)), "{output}");
    }
    assert_eq!(hash("b.ply"), hash("scene.toml"));
    let lossy = convert(&["ours.ply", "c.ply", "--format", "3dgs"]);
    assert!(lossy["warnings"].as_array().unwrap().iter().any(|w| w["code"] == "lossy"), "{lossy}");
}

#[test]
fn a_moved_scene_file_still_finds_its_transfer_function() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(
        folder.path().join("s.toml"),
        "schema = 1\n[[unit]]\nname = \"a\"\nfile = \"a.ply\"\ntransfer_function = \"tf.json\"\n",
    )
    .unwrap();
    std::fs::write(folder.path().join("tf.json"), "{}").unwrap();
    assert_eq!(words(&run(folder.path(), &["convert", "s.toml", "sub/s.toml"])).0, 0);
    let report = json(&run(folder.path(), &["info", "sub/s.toml", "--json"]));
    let named = report["units"][0]["transfer_function"].as_str().unwrap();
    assert!(Path::new(named).is_absolute() && Path::new(named).is_file(), "{named}");
    assert_eq!(words(&run(folder.path(), &["convert", "s.toml", "t.toml"])).0, 0);
    let report = json(&run(folder.path(), &["info", "t.toml", "--json"]));
    assert_eq!(report["units"][0]["transfer_function"], "tf.json");
}

#[test]
fn wrong_input_is_status_2_and_one_line() {
    let folder = folder();
    std::fs::write(folder.path().join("cut.ply"), &PLY[..PLY.len() - 40]).unwrap();
    std::fs::write(folder.path().join("s.toml"), "schema = 1\nunits = 3\n").unwrap();
    std::fs::write(folder.path().join("picture.png"), [0x89, b'P', b'N', b'G']).unwrap();
    let table: [(&[&str], &str); 8] = [
        (&["info", "none.ply"], "none.ply"),
        (&["info", "cut.ply"], "cut.ply: line 22"),
        (&["info", "s.toml"], "s.toml: line 2, column 1"),
        (&["info", "picture.png"], "picture.png: byte 0"),
        (&["convert", "a.ply", "b.obj"], "b.obj: path"),
        (&["convert", "a.ply", "b.toml", "--to", "compressed"], "b.toml: format"),
        (&["convert", "a.ply", "b.ply", "--reorder"], "b.ply: options"),
        (&["convert", "cut.ply", "b.ply", "--json"], "cut.ply"),
    ];
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    for (arguments, want) in table {
        let (status, stdout, stderr) = words(&run(folder.path(), arguments));
        assert_eq!((status, stdout.as_str()), (2, ""), "{arguments:?}: {stderr}");
        assert_eq!(stderr.lines().count(), 1, "{arguments:?}: {stderr}");
        assert!(stderr.contains(want), "{arguments:?}: {stderr}");
    }
    for arguments in [
        &["info"][..],
        &["convert", "a.ply", "b.ply", "--to", "obj"],
        &["info", "a.ply", "--palette", "1,2"],
        &["inform"],
    ] {
        assert_eq!(words(&run(folder.path(), arguments)).0, 2, "{arguments:?}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before, "nothing is left behind");
}

#[test]
fn work_that_fails_is_status_1() {
    let folder = folder();
    let (status, _, stderr) = words(&run(folder.path(), &["convert", "a.ply", "no/such/folder/b.ply"]));
    assert_eq!(status, 1, "{stderr}");
    assert!(stderr.contains("no/such/folder/b.ply") && stderr.contains("nothing was written"), "{stderr}");
}

#[test]
fn help_shows_an_example() {
    for command in ["info", "convert"] {
        let (status, stdout, _) = words(&run(Path::new("."), &[command, "--help"]));
        assert_eq!(status, 0);
        assert!(stdout.contains(&format!("supergaussian scene {command} bonsai/scene.toml")), "{stdout}");
    }
}
