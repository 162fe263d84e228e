//! Base units of labels: of a volume and its label map, and of a map alone.

use std::path::Path;

use serde_json::Value;

use crate::{fit, json, ok};

const VOLUME: &str = "made/phantom_32x32x32_uint8.raw";
const LABELS: &str = "made/phantom_labels_32x32x32_uint8.raw";
const FIT: [&str; 6] = [VOLUME, "--transfer-function", "made/phantom.tf.json", "--gaussians", "1500", "--label-units"];

/// Names of the base units of a report, with their labels.
fn units(report: &Value) -> Vec<(&str, i64)> {
    let units = report["units"].as_array().unwrap();
    units.iter().map(|unit| (unit["name"].as_str().unwrap(), unit["label"].as_i64().unwrap())).collect()
}

fn scene_file(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("scene.toml")).unwrap()
}

#[test]
fn labels_of_a_volume_become_base_units() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32", "--seed", "1"]);
    let names = "# ITK-SnAP\n1 255 0 0 1 1 1 \"the sac\"\n5 0 0 255 1 1 1 \"vein\"\n";
    std::fs::write(d.join("names.txt"), names).unwrap();

    let output = ok(d, &[&FIT[..], &["--labels", LABELS, "--initial-only", "--out", "a", "--json"]].concat());
    let report = json(&output.stdout);
    assert_eq!(units(&report), [("label 1", 1), ("label 2", 2)]);
    assert_eq!(report["labels_left_out"], 0);
    assert!(d.join("a/phantom.tf.json").is_file() && scene_file(&d.join("a")).contains("values = ["));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!said.contains("note: labels") && !said.contains("not trained"), "{said}");

    // Without --initial-only the scene is the same, and a line says why.
    let named = ["--labels", LABELS, "--label-names", "names.txt", "--rest-unit", "--out", "b", "--json"];
    let output = ok(d, &[&FIT[..], &named].concat());
    let report = json(&output.stdout);
    assert_eq!(units(&report)[..2], [("the sac", 1), ("label 2", 2)]);
    assert_eq!(report["units"][0]["palette"], serde_json::json!([1.0, 0.0, 0.0]));
    assert!(report["training"].is_null());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("note: base units of labels are not trained"), "{said}");
    let counted = said.lines().filter(|line| line.contains("note: labels without a base unit: 1 of the table"));
    assert_eq!(counted.count(), 1, "{said}");

    // Kept scenes of other labels are others.
    let keep = |more: &[&str]| {
        let words = ["--initial-only", "--keep-in", "kept", "--json", "--labels", LABELS];
        json(&ok(d, &[&FIT[..], &words, more].concat()).stdout)
    };
    let (first, other, again) = (keep(&[]), keep(&["--label-names", "names.txt"]), keep(&[]));
    assert!(first["kept"].is_null() && other["kept"].is_null() && other["scene"] != first["scene"]);
    assert_eq!((&again["kept"], &again["scene"]), (&true.into(), &first["scene"]));
}

#[test]
fn a_label_map_alone_becomes_surfaces() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    std::fs::write(
        d.join("made/labels.nhdr"),
        "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 32 32 32\n\
         space directions: (0.5,0,0) (0,0.5,0) (0,0,0.5)\nspace origin: (0,0,0)\nencoding: raw\n\
         Segment0_Name:=sac \u{1b}[31m\nSegment0_Color:=0 1 0\nSegment0_LabelValue:=1\n\
         data file: phantom_labels_32x32x32_uint8.raw\n",
    )
    .unwrap();
    let words = ["made/labels.nhdr", "--label-units", "--initial-only", "--gaussians", "1000", "--out", "s", "--json"];
    let report = json(&ok(d, &words).stdout);
    assert_eq!(units(&report), [("sac [31m", 1), ("label 2", 2)]);
    assert_eq!(report["units"][0]["palette"], serde_json::json!([0.0, 1.0, 0.0]));
    let scene = scene_file(&d.join("s"));
    assert!(!scene.contains("transfer_function") && !scene.contains("values = "), "{scene}");
    assert!(!d.join("s/automatic.tf.json").exists());
    let loaded = sg_formats::load(&d.join("s/scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene;
    assert_eq!((loaded.units.len(), loaded.bounds.size()), (2, glam::DVec3::splat(16.0)));
}

#[test]
fn wrong_label_maps_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    let write = |name: &str, values: Vec<u8>| std::fs::write(d.join(name), values).unwrap();
    write("half_32x32x32_float32.raw", 0.5_f32.to_le_bytes().repeat(32_768));
    write("empty_32x32x32_uint8.raw", vec![0; 32_768]);
    write("small_8x8x8_uint8.raw", vec![1; 512]);
    write("many_32x32x32_uint16.raw", (0..32_768_u16).flat_map(|i| (i % 301).to_le_bytes()).collect());
    write("wrong.txt", b"1 2 3\n".to_vec());
    let cases: [(&[&str], &[&str]); 11] = [
        (&["--labels", "half_32x32x32_float32.raw"], &["half_32x32x32", "0.5", "whole numbers"]),
        (&["--labels", "empty_32x32x32_uint8.raw"], &["no voxel has a label"]),
        (&["--labels", "small_8x8x8_uint8.raw"], &["8 x 8 x 8 voxels", "32 x 32 x 32 voxels"]),
        (&["--labels", "many_32x32x32_uint16.raw"], &["300 labels; at most 255"]),
        (&["--labels", LABELS, "--label-names", "wrong.txt"], &["wrong.txt: line 1", "ITK-SNAP"]),
        (&["--labels", LABELS, "--label-names", "absent.txt"], &["absent.txt: No such file"]),
        (&[], &["--transfer-function", "stands alone"]),
        (&["--rest-unit"], &["--labels"]),
        (&["--labels", LABELS, "--suggest-units"], &["cannot be used with"]),
        (&["--labels", LABELS, "--seconds", "5"], &["cannot be used with"]),
        (&["--labels", LABELS, "--start", "made/scene.toml"], &["cannot be used with"]),
    ];
    for (more, parts) in cases {
        let output = fit(d, &[&FIT[..], &["--out", "out"], more].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{more:?}: {error}");
        assert!(parts.iter().all(|part| error.contains(part)), "{more:?}: {error}");
        assert!(!d.join("out").exists(), "{more:?}: a failed run leaves nothing");
        // Errors of the argument parser have more lines.
        assert!(error.contains("Usage") || error.trim_end().lines().count() == 1, "{more:?}: {error}");
    }
    for (more, part) in [
        (&["--rest-unit", "--labels", LABELS][..], "--rest-unit is for --label-units"),
        (&["--label-names", "wrong.txt"], "--label-names is for --label-units"),
        (&["--labels", LABELS], "--labels is for --label-units"),
    ] {
        let output = fit(d, &[&[VOLUME, "--initial-only", "--out", "out"], more].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(2) && error.contains(part) && !d.join("out").exists(),
            "{more:?}: {error}"
        );
    }
}
