//! Scenes of volumes: their truth, their units, their place and their bytes.

use std::io::Write as _;
use std::path::Path;

use sg_scene::orientation::{LengthUnit, Orientation, PatientFrame};

use crate::{fit, json, npy, ok};

const FIT: [&str; 8] = [
    "made/phantom_48x48x48_uint8.raw",
    "--transfer-function",
    "made/phantom.tf.json",
    "--initial-only",
    "--gaussians",
    "4000",
    "--out",
    "scene",
];

#[test]
fn a_volume_becomes_a_scene_folder_with_its_truth() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let truth = json(&ok(d, &["phantom", "--out", "made", "--size", "48", "--seed", "1", "--json"]).stdout);
    assert_eq!(json(&std::fs::read(d.join("made/truth.json")).unwrap()), truth);
    assert_eq!(truth["volume"], "phantom_48x48x48_uint8.raw");

    let labels = ["--labels", "made/phantom_labels_48x48x48_uint8.raw", "--out-truth", "labels.npy"];
    let output = ok(d, &[&FIT[..], &labels, &["--report", "report.json", "--json"]].concat());
    let report = json(&output.stdout);
    assert_eq!(report, json(&std::fs::read(d.join("report.json")).unwrap()));
    let n = report["gaussians"].as_u64().unwrap() as usize;
    assert!((3800..=4000).contains(&n), "{report}");
    assert_eq!(report["units"][0]["name"], "vessels");
    assert_eq!(report["dims"], serde_json::json!([48, 48, 48]));
    assert!(report["seconds"]["total"].as_f64().unwrap() > 0.0);

    let scene = sg_formats::load(&d.join("scene/scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene;
    assert_eq!(scene.len(), n);
    assert_eq!(scene.bounds.min, glam::DVec3::splat(-0.5));
    assert_eq!(scene.bounds.max, glam::DVec3::splat(47.5));
    assert!(scene.units[0].oriented_normals);
    assert_eq!(scene.units[0].transfer_function.as_deref(), Some(Path::new("phantom.tf.json")));
    assert_eq!(
        std::fs::read(d.join("scene/phantom.tf.json")).unwrap(),
        std::fs::read(d.join("made/phantom.tf.json")).unwrap()
    );
    let mut names: Vec<_> =
        std::fs::read_dir(d.join("scene")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["phantom.tf.json", "scene.toml", "vessels.ply"], "no temporary file is left");

    // The labels are those of the analytic shape.
    let tree = sg_volume::phantom::VesselTree::new();
    let labels = npy(&d.join("labels.npy"), "<i4");
    let labels: Vec<i32> = labels.chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!(labels.len(), n);
    let agreeing = (0..n)
        .filter(|&i| {
            let p = scene.bounds.normalize(scene.position(i).unwrap());
            labels[i] == if tree.on_sac_side(p) { 1 } else { 2 }
        })
        .count();
    assert!(agreeing as f64 > 0.99 * n as f64, "{agreeing} of {n}");
    assert!(labels.iter().filter(|&&l| l == 1).count() > n / 8);

    let mask = [&FIT[..], &["--labels", "made/phantom_labels_48x48x48_uint8.raw", "--out-truth", "sac.npy"]];
    ok(d, &[&mask.concat()[..], &["--truth-value", "1"]].concat());
    let mask = npy(&d.join("sac.npy"), "|u1");
    assert!(mask.iter().zip(&labels).all(|(&m, &l)| (m == 1) == (l == 1)));
}

#[test]
fn base_units_are_suggested_and_scored_against_labels() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "48", "--seed", "1"]);
    let suggest = ["made/phantom_48x48x48_uint8.raw", "--suggest-units", "3", "--hidden", "0.3", "--initial-only"];
    let labels =
        ["--gaussians", "2000", "--labels", "made/phantom_labels_48x48x48_uint8.raw", "--out", "scene", "--json"];
    let output = ok(d, &[&suggest[..], &labels].concat());
    let report = json(&output.stdout);
    let units = report["suggested"].as_array().unwrap();
    assert_eq!((units.len(), &units[0]["name"]), (1, &report["units"][0]["name"]), "{report}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("suggested base unit `"));
    let scores = report["label_scores"].as_array().unwrap();
    let sum: f64 = scores.iter().map(|score| score["iou"].as_f64().unwrap()).sum();
    assert!(scores.len() == 2 && sum > 0.4, "the vessels are two labels of one material: {report}");
    assert!(report["units"][0]["hidden"].as_u64().unwrap() > 100, "{report}");
    let file = std::fs::read(d.join("scene/automatic.tf.json")).unwrap();
    assert_eq!(json(&file)["base_units"][0]["name"], units[0]["name"]);
    let scene = std::fs::read_to_string(d.join("scene/scene.toml")).unwrap();
    assert!(scene.contains("values = ["), "{scene}");
}

/// A gzipped NIfTI-1 file of uint8 voxels whose sform gives the spacing and the origin.
fn nifti(size: usize, spacing: f32, origin: f32, voxels: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348_i32.to_le_bytes());
    for (k, n) in [3, size as i16, size as i16, size as i16].into_iter().enumerate() {
        put(40 + 2 * k, &n.to_le_bytes());
    }
    put(70, &2_i16.to_le_bytes());
    put(72, &8_i16.to_le_bytes());
    put(108, &352_f32.to_le_bytes());
    put(254, &1_i16.to_le_bytes());
    for row in 0..3 {
        put(280 + 20 * row, &spacing.to_le_bytes());
        put(292 + 16 * row, &origin.to_le_bytes());
    }
    put(344, b"n+1\0");
    bytes.extend(voxels);
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(&bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn a_gzipped_nifti_file_becomes_a_scene_in_its_world_frame() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "24"]);
    let voxels = std::fs::read(d.join("made/phantom_24x24x24_uint8.raw")).unwrap();
    std::fs::write(d.join("x.nii.gz"), nifti(24, 2.0, -10.0, &voxels)).unwrap();
    let report = ok(d, &["x.nii.gz", "--initial-only", "--gaussians", "500", "--out", "scene", "--json"]).stdout;
    let report = json(&report);
    assert_eq!((&report["dims"], &report["scalar_type"]), (&serde_json::json!([24, 24, 24]), &"uint8".into()));
    let scene = sg_formats::load(&d.join("scene/scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene;
    assert_eq!(scene.bounds.min, glam::DVec3::splat(-11.0));
    assert_eq!(scene.bounds.max, glam::DVec3::splat(37.0));
    assert!((400..=500).contains(&scene.len()), "{}", scene.len());

    std::fs::write(d.join("cut.nii.gz"), nifti(24, 2.0, -10.0, &voxels[1..])).unwrap();
    let output = fit(d, &["cut.nii.gz", "--initial-only", "--out", "out"]);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("cut.nii.gz") && error.contains("expected 13824 bytes"), "{error}");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    for (seed, out) in [("1", "a"), ("1", "b"), ("2", "c")] {
        ok(d, &["phantom", "--out", out, "--size", "24", "--seed", seed]);
        let volume = format!("{out}/phantom_24x24x24_uint8.raw");
        let scene = format!("{out}/scene");
        ok(d, &[&volume, "--initial-only", "--gaussians", "500", "--seed", seed, "--out", &scene]);
    }
    let same = |name: &str| {
        let read = |folder: &str| std::fs::read(d.join(folder).join(name)).unwrap();
        (read("a") == read("b"), read("a") == read("c"))
    };
    assert_eq!(same("phantom_24x24x24_uint8.raw"), (true, false));
    assert_eq!(same("phantom_labels_24x24x24_uint8.raw"), (true, true));
    // Without a transfer function the command stores an automatic one with the unit "material".
    assert_eq!(same("scene/material.ply"), (true, false));
    let made = sg_volume::TransferFunction::load(&d.join("a/scene/automatic.tf.json")).unwrap();
    assert!(made.ignored_keys.is_empty());
}

#[test]
fn the_scene_file_tells_the_orientation_of_its_volume() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "16"]);
    let raw = "made/phantom_16x16x16_uint8.raw";
    std::fs::write(
        d.join("made/head.nhdr"),
        "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 16 16 16\n\
         space directions: (0.5,0,0) (0,0.5,0) (0,0,1.25)\nspace origin: (-4,-4,100)\nencoding: raw\n\
         data file: phantom_16x16x16_uint8.raw\n",
    )
    .unwrap();
    let scene = |volume: &str, out: &str, more: &[&str]| {
        let words = [volume, "--transfer-function", "made/phantom.tf.json", "--initial-only", "--gaussians", "200"];
        ok(d, &[&words[..], &["--out", out], more].concat());
        sg_formats::load(&d.join(out).join("scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene
    };
    let head = scene("made/head.nhdr", "head", &[]);
    let mm = Orientation { unit: Some(LengthUnit::Millimetre), ..Orientation::default() };
    assert_eq!(head.orientation, Orientation { patient: Some(PatientFrame::Lps), ..mm });
    assert_eq!(scene(raw, "plain", &[]).orientation, Orientation::default());
    // A raw file has the spacing and the unit that it is given.
    let spaced = scene(raw, "spaced", &["--spacing", "0.5,0.5,1.25"]);
    assert_eq!(spaced.orientation, mm);
    let size = glam::DVec3::new(8.0, 8.0, 20.0);
    assert_eq!((spaced.bounds.size(), head.bounds.size()), (size, size));
    let refused = fit(d, &["made/head.nhdr", "--initial-only", "--out", "none", "--spacing", "1,1,1"]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.lines().count() == 1 && said.contains("leave it out"), "{said}");
    let zero = fit(d, &[raw, "--initial-only", "--out", "none", "--spacing", "0,1,1"]);
    assert!(zero.status.code() == Some(2) && String::from_utf8_lossy(&zero.stderr).contains("above 0"));
    assert!(!d.join("none").exists());
}
