//! The executable: exit status, output streams, files on disk.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::path::Path;
use std::process::Output;
use std::sync::Arc;

use serde_json::Value;
use sg_edit::wire::encode_mask;
use sg_formats::{LoadOptions, SaveOptions, load, save};
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    Color, Command, CommitSelection, DeleteGaussians, SaveUnit, SetColor, SetOpacity, SetVisibility, Target,
};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::synthetic::samples;
use supergaussian_scene::project::Project;

fn run(folder: &Path, arguments: &[&str]) -> Output {
    std::process::Command::new(env!("CARGO_BIN_EXE_supergaussian-scene"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
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
        (&["info", "picture.png"], "picture.png: file name: A single picture cannot be read; "),
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

/// A scene of two base units in a folder of its own, and its project: `sac` (Gaussians 10 to 39) is red and half as opaque,
/// `skin` is hidden. The project stays open.
fn edited_project(folder: &Path) -> Project {
    let units = vec![
        samples::unit("bone", samples::editable_columns(30, 1)),
        samples::unit("skin", samples::editable_columns(20, 2)),
    ];
    let path = folder.join("in").join("scene.toml");
    std::fs::create_dir(folder.join("in")).unwrap();
    save(&path, &Scene::compose(units, None), &SaveOptions::default()).unwrap();
    let scene = Arc::new(load(&path, &LoadOptions::default()).unwrap().scene);
    let mut project = Project::open(&folder.join("a.sgproj"), scene, &path.display().to_string()).unwrap();
    let target = |name: &str| Some(Target { units: vec![name.to_owned()], ..Target::default() });
    let mask = Some(encode_mask(&Mask::from_fn(50, |i| (10..40).contains(&i))));
    let color = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    let actions = [
        Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() }),
        Action::SaveUnit(SaveUnit { name: "sac".to_owned(), replace: false }),
        Action::SetColor(SetColor { target: target("sac"), color }),
        Action::SetOpacity(SetOpacity { target: target("sac"), factor: 0.5, relative: false }),
        Action::SetVisibility(SetVisibility { target: target("skin"), visible: false }),
    ];
    for (n, action) in actions.into_iter().enumerate() {
        project.apply(&Command { id: n.to_string(), expected_revision: 0, action: Some(action) }).unwrap();
    }
    project
}

#[test]
fn a_project_is_written_with_its_edits_also_while_it_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let open = edited_project(folder.path());
    let before = std::fs::read(folder.path().join("a.sgproj")).unwrap();
    let convert = |arguments: &[&str]| {
        let output = run(folder.path(), &[&["convert", "a.sgproj", "--json"], arguments].concat());
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        json(&output)
    };
    let units = |file: &str| {
        let report = json(&run(folder.path(), &["info", file, "--json"]));
        let of = |u: &Value| (u["name"].as_str().unwrap().to_owned(), u["gaussians"].as_u64(), u["opacity"].as_f64());
        let units: Vec<_> = report["units"].as_array().unwrap().iter().map(of).collect();
        (report["format"].as_str().unwrap().to_owned(), units)
    };
    let unit = |name: &str, n, opacity| (name.to_owned(), Some(n), Some(opacity));

    convert(&["visible.toml"]);
    assert_eq!(units("visible.toml").1, [unit("bone", 10, 1.0), unit("sac", 20, 0.5)]);
    convert(&["all.toml", "--only", "everything"]);
    let all = [unit("bone", 10, 1.0), unit("sac", 20, 0.5), unit("skin", 10, 1.0), unit("sac 2", 10, 0.5)];
    assert_eq!(units("all.toml").1, all);
    let sac = load(&folder.path().join("all.toml"), &LoadOptions::default()).unwrap().scene.units.swap_remove(1);
    assert_eq!(sac.palette.to_array(), [1.0, 0.0, 0.0]);
    // Several parts become one 3DGS file, as a viewer of splats wants it.
    assert_eq!(convert(&["sac.ply", "--unit", "Sac"])["gaussians"], 30);
    assert_eq!(units("sac.ply").0, "3dgs");
    assert_eq!(convert(&["selected.compressed.ply", "--only", "selection"])["output_format"], "compressed");

    drop(open);
    let after = std::fs::read(folder.path().join("a.sgproj")).unwrap();
    assert!(before == after || std::fs::metadata(folder.path().join("a.sgproj-wal")).is_err(), "the project changed");
    // A scene that has moved.
    std::fs::rename(folder.path().join("in"), folder.path().join("out")).unwrap();
    let (status, _, said) = words(&run(folder.path(), &["convert", "a.sgproj", "b.toml"]));
    assert!(status == 2 && said.contains("name the scene's present place with --scene"), "{said}");
    convert(&["b.toml", "--scene", "out/scene.toml"]);
}

#[test]
fn deleted_gaussians_are_written_nowhere() {
    let folder = tempfile::tempdir().unwrap();
    let mut project = edited_project(folder.path());
    // The selection is 10..40: all of `sac`, part of both base units.
    let target = Some(Target { selection: true, ..Target::default() });
    let action = Some(Action::DeleteGaussians(DeleteGaussians { target }));
    project.apply(&Command { id: "delete".to_owned(), expected_revision: 0, action }).unwrap();
    let convert = |arguments: &[&str]| run(folder.path(), &[&["convert", "a.sgproj", "--json"], arguments].concat());
    assert_eq!(json(&convert(&["all.toml", "--only", "everything"]))["gaussians"], 20);
    assert_eq!(json(&convert(&["visible.ply"]))["gaussians"], 10);
    assert_eq!(json(&convert(&["skin.ply", "--unit", "skin"]))["gaussians"], 10);
    let (status, _, said) = words(&convert(&["sac.ply", "--unit", "sac"]));
    assert!(status == 2 && said.contains("sac has no Gaussians"), "{said}");
}

#[test]
fn a_project_is_not_written_over_its_own_files_or_without_sense() {
    let folder = tempfile::tempdir().unwrap();
    drop(edited_project(folder.path()));
    let files = || {
        let read = |path: &str| std::fs::read(folder.path().join(path)).unwrap();
        ["a.sgproj", "in/scene.toml", "in/bone.ply", "in/skin.ply"].map(read)
    };
    let before = files();
    for (arguments, reason) in [
        (["a.sgproj", "in/bone.ply", "--only=selection"], "in/bone.ply"),
        (["a.sgproj", "in/scene.toml", "--only=visible"], "in/scene.toml"),
        (["a.sgproj", "new.ply", "--unit=sack"], "sac"),
        (["a.sgproj", "new.ply", "--palette=1,0,0"], "a project has its own looks"),
        (["in/scene.toml", "new.toml", "--unit=bone"], "choose from a project"),
    ] {
        let (status, _, said) = words(&run(folder.path(), &[&["convert"], arguments.as_slice()].concat()));
        assert!(status == 2 && said.contains(reason), "{arguments:?}: {status}, {said}");
    }
    assert!(files() == before, "a file changed");
    assert!(!folder.path().join("new.ply").exists() && !folder.path().join("new.toml").exists());
}
