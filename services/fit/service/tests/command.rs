//! The command on the synthetic volume: files, reports, exit statuses and one-line errors.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use sg_scene::orientation::{LengthUnit, Orientation, PatientFrame};

fn fit(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-fit")).current_dir(folder).args(arguments).output().unwrap()
}

fn ok(folder: &Path, arguments: &[&str]) -> Output {
    let output = fit(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap()
}

/// Values of a version-1 `.npy` file whose header names this type.
fn npy(path: &Path, dtype: &str) -> Vec<u8> {
    let bytes = std::fs::read(path).unwrap();
    let header = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let text = String::from_utf8_lossy(&bytes[10..10 + header]).into_owned();
    assert!(text.contains(dtype), "{text}");
    bytes[10 + header..].to_vec()
}

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
fn training_makes_the_scene_better_and_repeats_with_its_steps() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32"]);
    let train = |out: &str| {
        let volume = ["made/phantom_32x32x32_uint8.raw", "--transfer-function", "made/phantom.tf.json"];
        let how = ["--gaussians", "600", "--views", "16", "--view-size", "64", "--iterations", "110,10", "--json"];
        json(&ok(d, &[&volume[..], &how, &["--out", out]].concat()).stdout)
    };
    let report = train("a");
    let training = &report["training"];
    assert_eq!(
        (&training["views"], &training["held_out"], &training["iterations"]),
        (&16.into(), &2.into(), &120.into())
    );
    let decibels = |measurement: &Value| measurement["footprint_psnr_db"].as_f64().unwrap();
    let before = decibels(&training["measurements"][0]);
    assert!(decibels(&training["result"]) > before + 1.0, "{training}");
    train("b");
    let read = |folder: &str| std::fs::read(d.join(folder).join("vessels.ply")).unwrap();
    assert_eq!(read("a"), read("b"));

    // Training goes on from a scene, in another folder.
    let base = ["made/phantom_32x32x32_uint8.raw", "--transfer-function", "made/phantom.tf.json"];
    let how = ["--start", "a/scene.toml", "--views", "16", "--view-size", "64", "--iterations", "40", "--json"];
    let further = json(&ok(d, &[&base[..], &how, &["--out", "further"]].concat()).stdout);
    let first = decibels(&further["training"]["measurements"][0]);
    assert!((first - decibels(&training["result"])).abs() < 0.01, "{further}");
    assert!(decibels(&further["training"]["result"]) >= first);
    std::fs::write(
        d.join("two.tf.json"),
        br#"{"domain":[0,255],"points":[{"value":9,"color":[1,1,1],"opacity":0.5}],
        "base_units":[{"name":"a","range":[0,99]},{"name":"b","range":[99,255]}]}"#,
    )
    .unwrap();
    let two = [base[0], "--transfer-function", "two.tf.json"];
    for (function, part) in
        [(&two[..], "scene.toml: 1 base unit,"), (&base[..1], "`vessels` in the place of `material`")]
    {
        let refused = fit(d, &[function, &["--start", "a/scene.toml", "--out", "none"]].concat());
        let error = String::from_utf8(refused.stderr).unwrap();
        assert!(refused.status.code() == Some(2) && error.contains(part), "{error}");
    }
    let line = String::from_utf8(
        ok(
            d,
            &[
                "made/phantom_32x32x32_uint8.raw",
                "--gaussians",
                "200",
                "--views",
                "8",
                "--view-size",
                "32",
                "--seconds",
                "0.2",
                "--out",
                "c",
            ],
        )
        .stderr,
    )
    .unwrap();
    assert!(line.contains("dB before") && line.contains("on 1 held-out picture"), "{line}");
}

#[test]
fn wrong_input_ends_with_status_2_and_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "16"]);
    let volume = "made/phantom_16x16x16_uint8.raw";
    let write = |name: &str, text: &[u8]| std::fs::write(d.join(name), text).unwrap();
    write("cut_16x16x16_uint8.raw", &[0; 4000]);
    write("flat_4x4x4_uint8.raw", &[7; 64]);
    write("labels_4x4x4_uint8.raw", &[1; 64]);
    write("half_16x16x16_float32.raw", &0.5_f32.to_le_bytes().repeat(4096));
    write("clear.tf.json", br#"{"domain":[0,255],"points":[{"value":0,"color":[1,1,1],"opacity":0}]}"#);
    write("broken.tf.json", b"{\"domain\":[0,255],\n\"points\":}");
    write("order.tf.json", br#"{"domain":[255,0],"points":[{"value":0,"color":[1,1,1],"opacity":0}]}"#);
    let base = |volume: &'static str| vec![volume, "--initial-only", "--out", "out"];
    let with = |more: &[&'static str]| [base("made/phantom_16x16x16_uint8.raw"), more.to_vec()].concat();
    let cases: Vec<(Vec<&str>, &[&str])> = vec![
        (base("absent_1x1x1_uint8.raw"), &["absent_1x1x1_uint8.raw"]),
        (base("cut_16x16x16_uint8.raw"), &["cut_16x16x16", "expected 4096 bytes", "found 4000"]),
        (base("flat_4x4x4_uint8.raw"), &["every voxel has the value 7", "transfer function"]),
        (with(&["--transfer-function", "clear.tf.json"]), &["nothing is visible", "opacity 0"]),
        (with(&["--transfer-function", "broken.tf.json"]), &["broken.tf.json", "line 2"]),
        (with(&["--transfer-function", "order.tf.json"]), &["order.tf.json", "domain"]),
        (with(&["--transfer-function", "absent.json"]), &["absent.json"]),
        (with(&["--labels", "labels_4x4x4_uint8.raw", "--out-truth", "t.npy"]), &["labels_4x4x4", "same place"]),
        (
            with(&["--labels", "half_16x16x16_float32.raw", "--out-truth", "t.npy"]),
            &["half_16", "0.5", "whole numbers"],
        ),
    ];
    for (arguments, parts) in cases {
        let output = fit(d, &arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert_eq!(error.trim_end().lines().count(), 1, "{arguments:?}: {error}");
        for part in parts {
            assert!(error.contains(part), "{arguments:?}: `{part}` is not in: {error}");
        }
        assert!(output.stdout.is_empty());
        assert!(!d.join("out").exists(), "{arguments:?}: a failed run leaves nothing");
    }
    // Errors of the argument parser have the same status.
    for arguments in [
        vec![],
        vec!["--initial-only"],
        with(&["--iterations", "5"]),
        with(&["--target-psnr", "30"]),
        vec![volume, "--out", "out", "--seconds", "0"],
        vec![volume, "--out", "out", "--iterations", "0"],
        vec![volume, "--out", "out", "--iterations", "5,x"],
        vec![volume, "--out", "out", "--iterations", "5,1,2"],
        vec![volume, "--out", "out", "--seconds", "1", "--iterations", "5"],
        vec![volume, "--keep-in", "kept", "--iterations", "5"],
        with(&["--start", "scene.toml"]),
        with(&["--gaussians", "0"]),
        with(&["--flattening", "2"]),
        with(&["--interior", "-1"]),
        with(&["--hidden", "2"]),
        with(&["--suggest-units", "99"]),
        with(&["--suggest-units", "--transfer-function", "tf.json"]),
        with(&["--labels", volume]),
        vec!["phantom", "--out", "x", "--size", "3"],
    ] {
        assert_eq!(fit(d, &arguments).status.code(), Some(2), "{arguments:?}");
    }
    // An output folder that cannot be written is failed work.
    write("file", b"");
    let output = fit(d, &[volume, "--initial-only", "--out", "file/scene"]);
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn a_hostile_header_reaches_no_file_of_others() {
    if !matches!(sg_confinement::support(), sg_confinement::Support::Version(_)) {
        eprintln!("SKIPPED: {}; the command is not confined", sg_confinement::support());
        return;
    }
    let (dir, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "48"]);
    let voxels = d.join("made/phantom_48x48x48_uint8.raw");
    let header = |name: &str, data: &Path| {
        let text = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 48 48 48\nencoding: raw\nspacings: 1 1 1\ndata file: {}\n",
            data.display()
        );
        std::fs::write(d.join(name), text).unwrap();
    };
    let secret = other.path().join("secret.raw");
    std::fs::copy(&voxels, &secret).unwrap();
    header("own.nhdr", Path::new("made/phantom_48x48x48_uint8.raw"));
    header("hostile.nhdr", &secret);
    let fitted = |volume: &str, out: &str, more: &[&str]| {
        let words = [volume, "--transfer-function", "made/phantom.tf.json", "--initial-only", "--gaussians", "500"];
        fit(d, &[&words[..], &["--out", out], more].concat())
    };
    assert!(fitted("own.nhdr", "a/b/own", &[]).status.success());
    let refused = fitted("hostile.nhdr", "c/d/hostile", &[]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(
        refused.status.code() == Some(2) && said.lines().count() == 1 && said.contains("ermission denied"),
        "{said}"
    );
    assert!(said.contains("secret.raw") && !d.join("c").exists() && d.join("a/b/own/scene.toml").is_file());
    assert!(fitted("hostile.nhdr", "hostile", &["--unconfined"]).status.success());
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

#[test]
fn help_shows_an_example() {
    for arguments in [vec!["--help"], vec!["phantom", "--help"], vec!["carry", "--help"]] {
        let output = ok(Path::new("."), &arguments);
        assert!(String::from_utf8_lossy(&output.stdout).contains(":\n  supergaussian fit "));
    }
    let help = String::from_utf8_lossy(&ok(Path::new("."), &["--help"]).stdout).into_owned();
    assert!(sg_volume::ENDINGS.iter().all(|ending| help.contains(ending)), "{help}");
}

#[test]
fn a_kept_scene_is_not_fitted_again() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "32", "--seed", "1"]);
    let volume = "made/phantom_32x32x32_uint8.raw";
    let keep = |volume: &str, more: &[&str]| {
        let arguments =
            [&[volume, "--initial-only", "--gaussians", "500", "--keep-in", "kept", "--json"], more].concat();
        json(&ok(d, &arguments).stdout)
    };
    let first = keep(volume, &[]);
    let scene = first["scene"].as_str().unwrap().to_owned();
    assert!(Path::new(&scene).is_file() && scene.ends_with("/phantom_32x32x32_uint8/scene.toml"), "{first}");
    assert!(
        first["kept"].is_null()
            && first["files"].as_array().unwrap().iter().all(|f| Path::new(f.as_str().unwrap()).is_file()),
        "{first}"
    );
    let made = std::fs::metadata(&scene).unwrap().modified().unwrap();
    // The same values under another name and at another place.
    std::fs::copy(d.join(volume), d.join("copy_32x32x32_uint8.raw")).unwrap();
    for same in [volume, "copy_32x32x32_uint8.raw"] {
        let again = keep(same, &[]);
        assert_eq!((again["scene"].as_str(), &again["kept"]), (Some(scene.as_str()), &true.into()));
        assert_eq!(again["gaussians"], first["gaussians"]);
    }
    assert_eq!(std::fs::metadata(&scene).unwrap().modified().unwrap(), made);
    let other = keep(volume, &["--seed", "1"]);
    assert_ne!(other["scene"], first["scene"]);
    assert_eq!(std::fs::read_dir(d.join("kept")).unwrap().count(), 2);
    // A refused volume leaves no folder.
    std::fs::write(d.join("short_9x9x9_uint8.raw"), "four").unwrap();
    let refused = fit(d, &["short_9x9x9_uint8.raw", "--initial-only", "--keep-in", "none/kept"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(!d.join("none").exists());
}

/// A block of 4 × 4 × 4 hexahedra in a legacy file, with a distance and a velocity at each point.
fn block() -> String {
    let points: Vec<[f64; 3]> = (0..125).map(|i| [i % 5, i / 5 % 5, i / 25].map(f64::from)).collect();
    let line = |numbers: &[f64]| numbers.iter().map(|x| format!("{x} ")).collect::<String>();
    let lines = |of: &dyn Fn(&[f64; 3]) -> Vec<f64>| points.iter().map(|p| line(&of(p)) + "\n").collect::<String>();
    let distance = |p: &[f64; 3]| vec![p.iter().map(|x| (x - 2.0).powi(2)).sum::<f64>().sqrt()];
    format!(
        "# vtk DataFile Version 4.2\nblock\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 5 5 5\nPOINTS 125 float\n{}\
         POINT_DATA 125\nSCALARS distance float\nLOOKUP_TABLE default\n{}VECTORS velocity float\n{}",
        lines(&|p| p.to_vec()),
        lines(&distance),
        lines(&|p| vec![p[0], 0.0, -p[1]])
    )
}

#[test]
fn a_mesh_becomes_a_scene_of_one_of_its_quantities() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("block.vtk"), block()).unwrap();
    let run = |more: &[&str]| {
        let arguments = [&["block.vtk", "--initial-only", "--gaussians", "300", "--json"], more].concat();
        json(&ok(d, &arguments).stdout)
    };
    let report = run(&["--out", "a"]);
    assert_eq!(report["mesh"], serde_json::json!({"points": 125, "tetrahedra": 384, "flat": 0, "non_finite": 0}));
    assert_eq!((&report["dims"], report["variable"].as_str()), (&Value::Null, Some("distance")));
    let scene = sg_formats::load(&d.join("a/scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene;
    assert!(scene.len() > 250 && scene.len() <= 300, "{}", scene.len());
    assert_eq!((scene.bounds.min, scene.bounds.max), (glam::DVec3::ZERO, glam::DVec3::splat(4.0)));
    assert!(d.join("a/automatic.tf.json").is_file());

    // A transfer function names its quantity; an option goes before it.
    let function = r#"{"domain": [0, 6], "variable": "velocity", "points": [{"value": 0, "color": [1, 0, 0], "opacity": 0},
        {"value": 6, "color": [1, 0, 0], "opacity": 0.5}]}"#;
    std::fs::write(d.join("fast.tf.json"), function).unwrap();
    let fast = ["--transfer-function", "fast.tf.json"];
    assert_eq!(run(&[&fast[..], &["--out", "b"]].concat())["variable"], "velocity");
    assert_eq!(run(&[&fast[..], &["--variable", "distance", "--out", "c"]].concat())["variable"], "distance");

    // Kept scenes of two quantities are two.
    let keep = |variable: &str| run(&["--keep-in", "kept", "--variable", variable]);
    let (x, z, again) = (keep("velocity:x"), keep("velocity:z"), keep("velocity:x"));
    assert!(x["kept"].is_null() && z["kept"].is_null() && again["kept"] == true && again["scene"] == x["scene"]);

    for (arguments, what) in [
        (&["--variable", "heat"][..], "none is called `heat`; give one of distance, velocity (3 components)"),
        (&["--variable", "velocity:3"], "no component `3` among 3"),
        (&["--suggest-units"], "--suggest-units is for voxels"),
        (&["--spacing", "1,1,1"], "a given spacing is for raw volumes"),
        (&["--labels", "block.vtk", "--out-truth", "t.npy"], "a mesh, where voxels are needed"),
    ] {
        let refused = fit(d, &[&["block.vtk", "--initial-only", "--out", "no"], arguments].concat());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && said.contains(what), "{said}");
        assert!(said.lines().count() == 1 && !d.join("no").exists(), "{said}");
    }
}

/// Float voxels of a soft ball at x, as a raw file.
fn ball(folder: &Path, name: &str, x: f64) {
    let value = |i: usize| {
        let p = glam::DVec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64);
        100.0 / (1.0 + (1.5 * ((p - glam::DVec3::new(x, 8.0, 8.0)).length() - 4.0)).exp())
    };
    raw(folder, name, &(0..4096).map(|i| value(i) as f32).collect::<Vec<_>>());
}

fn raw(folder: &Path, name: &str, values: &[f32]) {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(folder.join(format!("{name}_16x16x16_float32.raw")), bytes).unwrap();
}

/// Files below a folder, and their content.
fn content(folder: &Path) -> std::collections::BTreeMap<std::path::PathBuf, Vec<u8>> {
    let mut found = std::collections::BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.insert(path.clone(), std::fs::read(path).unwrap());
            }
        }
    }
    found
}

const SERIES: [&str; 10] =
    ["--gaussians", "300", "--views", "8", "--view-size", "48", "--iterations", "30", "--out", "series"];

#[test]
fn a_series_becomes_a_scene_for_each_step() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    for (name, x) in [("a", 6.0), ("b", 6.5), ("same", 6.5), ("last", 7.0)] {
        ball(d, name, x);
    }
    raw(d, "nan", &[f32::NAN; 4096]);
    let names = ["a", "b", "same", "nan", "last"].map(|name| format!("{name}_16x16x16_float32.raw"));
    let volumes: Vec<&str> = names.iter().map(String::as_str).collect();
    let report = json(&ok(d, &[&volumes[..], &SERIES, &["--json", "--report", "report.json"]].concat()).stdout);
    assert_eq!(report, json(&std::fs::read(d.join("report.json")).unwrap()));
    let starts: Vec<&str> =
        report["step"].as_array().unwrap().iter().map(|step| step["start"].as_str().unwrap()).collect();
    assert_eq!(starts, ["direct", "warm", "unchanged", "empty", "direct"], "{report}");
    let file: toml::Table = std::fs::read_to_string(d.join("series/series.toml")).unwrap().parse().unwrap();
    assert_eq!((file["steps"].as_integer(), file["step"].as_array().unwrap().len()), (Some(5), 5));
    assert_eq!(serde_json::to_value(&file).unwrap()["step"][1]["gaussians"], report["step"][1]["gaussians"]);

    let scene = |k: usize| {
        let path = d.join(format!("series/step-{k:04}/scene.toml"));
        sg_formats::load(&path, &sg_formats::LoadOptions::default()).unwrap().scene
    };
    let looks: Vec<_> =
        (0..5).map(|k| scene(k).units.into_iter().map(|u| (u.name, u.palette, u.values)).collect::<Vec<_>>()).collect();
    assert!(!looks[0].is_empty() && looks.iter().all(|look| *look == looks[0]), "{looks:?}");
    let functions = (0..5).map(|k| std::fs::read(d.join(format!("series/step-{k:04}/automatic.tf.json"))).unwrap());
    assert!(functions.collect::<std::collections::HashSet<_>>().len() == 1);
    let previous = |k: usize| -> Vec<i32> {
        let bytes = npy(&d.join(format!("series/step-{k:04}/previous.npy")), "<i4");
        bytes.chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    for k in 0..5 {
        assert_eq!(previous(k).len(), scene(k).len(), "{k}");
    }
    assert!(previous(0).iter().chain(&previous(4)).all(|p| *p == -1) && scene(3).is_empty());
    assert_eq!(previous(2), (0..scene(1).len() as i32).collect::<Vec<_>>());
    assert!(previous(1).iter().filter(|p| **p >= 0).count() as f64 > 0.95 * scene(1).len() as f64);
    let ply = |k: usize| content(&d.join(format!("series/step-{k:04}"))).into_values().collect::<Vec<_>>();
    assert_eq!(ply(1).len(), ply(2).len());
    assert_eq!(scene(1).content_hash(), scene(2).content_hash());

    // A mask follows, step by step or at once.
    let mask: Vec<u8> = (0..scene(0).len()).map(|i| u8::from(i % 3 == 0)).collect();
    sg_formats::npy::write_array(&d.join("m.npy"), &[mask.len()], &mask).unwrap();
    let carry = |arguments: &[&str]| fit(d, &[&["carry", "series/series.toml"], arguments].concat());
    assert!(carry(&["--mask", "m.npy", "--to", "1", "--out", "m1.npy"]).status.success());
    assert!(carry(&["--mask", "m1.npy", "--from", "1", "--to", "2", "--out", "m2.npy"]).status.success());
    assert!(carry(&["--mask", "m.npy", "--to", "2", "--out", "at_once.npy"]).status.success());
    let found = npy(&d.join("m1.npy"), "|u1");
    let expected: Vec<u8> =
        previous(1).iter().map(|p| usize::try_from(*p).map_or(0, |p| u8::from(p % 3 == 0))).collect();
    assert_eq!(found, expected);
    assert_eq!(npy(&d.join("m2.npy"), "|u1"), npy(&d.join("at_once.npy"), "|u1"));
    for (arguments, part) in [
        (&["--mask", "m.npy", "--to", "5", "--out", "x.npy"][..], "no way from step 0 to 5"),
        (&["--mask", "m.npy", "--from", "2", "--to", "1", "--out", "x.npy"], "no way from step 2 to 1"),
        (&["--mask", "m.npy", "--from", "3", "--to", "4", "--out", "x.npy"], "for a scene of 0 Gaussians"),
        (&["--mask", "m.npy", "--to", "1", "--out", "m.npy"], "the command reads this file"),
    ] {
        let refused = carry(arguments);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && said.contains(part) && said.lines().count() == 1, "{said}");
    }
    assert!(!d.join("x.npy").exists());

    // The same again replaces its own files, and gives the same.
    let scenes = || content(&d.join("series")).into_iter().filter(|(path, _)| !path.ends_with("series.toml"));
    let before: Vec<_> = scenes().collect();
    let again = ok(d, &[&volumes[..], &SERIES].concat());
    assert!(scenes().eq(before));
    let said = String::from_utf8(again.stderr).unwrap();
    assert!(said.contains("step 3: ") && said.contains("nothing is visible") && said.contains("5 steps"), "{said}");
    // Fewer steps leave the others, and say so.
    let fewer = String::from_utf8(ok(d, &[&volumes[..2], &SERIES].concat()).stderr).unwrap();
    assert!(fewer.contains("step-0002 is of an earlier series"), "{fewer}");
}

#[test]
fn files_of_paraview_name_the_steps() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("one.vtk"), block()).unwrap();
    std::fs::write(d.join("two.vtk"), block().replace("LOOKUP_TABLE default\n3.4", "LOOKUP_TABLE default\n3.6"))
        .unwrap();
    std::fs::write(
        d.join("flow.pvd"),
        r#"<VTKFile type="Collection"><Collection><DataSet timestep="2" file="two.vtk"/><DataSet timestep="0.5" file="one.vtk"/></Collection></VTKFile>"#,
    )
    .unwrap();
    std::fs::write(
        d.join("flow.vtk.series"),
        r#"{"file-series-version": "1.0", "files": [{"name": "one.vtk", "time": 0.5}, {"name": "two.vtk", "time": 2}]}"#,
    )
    .unwrap();
    let run = |source: &str, out: &str, more: &[&str]| {
        let arguments = [&[source, "--gaussians", "200", "--initial-only", "--json", "--out", out], more].concat();
        json(&ok(d, &arguments).stdout)
    };
    let (pvd, list) = (run("flow.pvd", "a", &[]), run("flow.vtk.series", "b", &[]));
    for report in [&pvd, &list] {
        let times: Vec<f64> =
            report["step"].as_array().unwrap().iter().map(|step| step["time"].as_f64().unwrap()).collect();
        assert_eq!((times, report["variable"].as_str()), (vec![0.5, 2.0], Some("distance")));
    }
    assert_ne!(pvd["step"][1]["start"], "unchanged");
    let scenes = |out: &str| {
        let files = content(&d.join(out));
        files.into_iter().filter(|(path, _)| path.extension() == Some("ply".as_ref())).map(|(_, bytes)| bytes)
    };
    assert!(scenes("a").eq(scenes("b")));
    assert_eq!(run("flow.pvd", "c", &["--variable", "velocity:x"])["variable"], "velocity");
    let both = fit(d, &["flow.pvd", "one.vtk", "--initial-only", "--out", "none"]);
    assert!(String::from_utf8_lossy(&both.stderr).contains("give it alone") && !d.join("none").exists());
}

#[test]
fn wrong_steps_end_with_one_line_and_change_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ball(d, "a", 6.0);
    ball(d, "b", 7.0);
    raw(d, "constant", &[3.0; 4096]);
    raw(d, "nan", &[f32::NAN; 4096]);
    std::fs::write(d.join("cut_16x16x16_float32.raw"), [0; 99]).unwrap();
    std::fs::write(d.join("small_8x8x8_float32.raw"), [0; 2048]).unwrap();
    std::fs::write(d.join("block.vtk"), block()).unwrap();
    std::fs::write(d.join("other.vtk"), block().replace("distance", "heat")).unwrap();
    std::fs::write(d.join("x.nc"), b"CDF\x01").unwrap();
    std::fs::write(
        d.join("clear.tf.json"),
        br#"{"domain":[0,100],"points":[{"value":500,"color":[1,1,1],"opacity":0}]}"#,
    )
    .unwrap();
    std::fs::create_dir(d.join("taken")).unwrap();
    std::fs::write(d.join("taken/series.toml"), "mine = true").unwrap();
    std::fs::create_dir_all(d.join("full/step-0001")).unwrap();
    std::fs::write(d.join("full/step-0001/scene.toml"), "mine = true").unwrap();
    let before = content(d);
    let (a, b) = ("a_16x16x16_float32.raw", "b_16x16x16_float32.raw");
    let (constant, nan) = ("constant_16x16x16_float32.raw", "nan_16x16x16_float32.raw");
    let cases: [(&[&str], &str, &str); 16] = [
        (&[a, b, "cut_16x16x16_float32.raw"], "out", "step 2: cut_16x16x16_float32.raw: expected 16384 bytes"),
        (&[a, "absent_1x1x1_uint8.raw"], "out", "step 1: absent_1x1x1_uint8.raw: No such file"),
        (&[a, "x.nc"], "out", "step 1: x.nc: content: NetCDF cannot be read; open it in ParaView"),
        (&[a, "block.vtk"], "out", "step 1: block.vtk: a mesh, but step 0 is voxels"),
        (&[a, "small_8x8x8_float32.raw"], "out", "step 1: small_8x8x8_float32.raw: it fills the box"),
        (&["block.vtk", "other.vtk"], "out", "step 1: other.vtk: the quantity `heat`, but step 0 has `distance`"),
        (&["block.vtk", "other.vtk", "--variable", "distance"], "out", "step 1: other.vtk: "),
        (&[constant, constant], "out", "every voxel has the value 3"),
        (&[nan, nan], "out", "no voxel has a finite value"),
        (&[a, b, "--transfer-function", "clear.tf.json"], "out", "nothing is visible in any of the 2 steps"),
        (&[a, b], "taken", "series.toml: the file there is no series file"),
        (&[a, b], "full", "no scene file"),
        (&[a, b, "--suggest-units"], "out", "--suggest-units is for one volume"),
        (&[a, b, "--labels", a, "--out-truth", "t.npy"], "out", "--labels is for one volume"),
        (&[a, b, "--report", a], "out", "the command reads this file"),
        (&["absent.pvd"], "out", "absent.pvd: No such file"),
    ];
    for (arguments, out, part) in cases {
        let output = fit(d, &[arguments, &["--initial-only", "--gaussians", "100", "--out", out]].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
        assert!(error.contains(part) && error.trim_end().lines().count() == 1, "{arguments:?}: {error}");
        assert_eq!(content(d), before, "{arguments:?}");
        assert!(!d.join("out").exists(), "{arguments:?}");
    }
}

#[test]
fn an_interrupted_series_leaves_its_finished_steps() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ball(d, "a_10", 6.0);
    ball(d, "a_9", 7.0);
    let mut child = Command::new(env!("CARGO_BIN_EXE_supergaussian-fit"))
        .current_dir(d)
        .args(["a_10_16x16x16_float32.raw", "a_9_16x16x16_float32.raw", "--gaussians", "100", "--views", "8"])
        .args(["--view-size", "32", "--seconds", "3", "--out", "series"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let file = d.join("series/series.toml");
    let began = std::time::Instant::now();
    while !file.exists() && began.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    child.kill().unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("a_10_16x16x16_float32.raw stands before a_9_"), "{said}");
    let table: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
    assert_eq!((table["steps"].as_integer(), table["step"].as_array().unwrap().len()), (Some(2), 1));
    let scene = d.join("series").join(table["step"][0]["scene"].as_str().unwrap());
    assert!(!sg_formats::load(&scene, &sg_formats::LoadOptions::default()).unwrap().scene.is_empty());
}
