//! Series of volumes and of meshes: a scene for each step, masks that follow, steps that are refused.

use std::path::Path;
use std::process::Command;

use crate::meshes::block;
use crate::{fit, json, npy, ok};

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
    let cases: [(&[&str], &str, &str); 17] = [
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
        (&[a, b, "--label-units"], "out", "--label-units is for one volume"),
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
