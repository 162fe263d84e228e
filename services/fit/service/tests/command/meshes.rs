//! Scenes of the quantities of a mesh.

use serde_json::Value;

use crate::{fit, json, ok};

/// A block of 4 × 4 × 4 hexahedra in a legacy file, with a distance and a velocity at each point.
pub(crate) fn block() -> String {
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
        (&["--label-units"], "--label-units is for voxels"),
        (&["--spacing", "1,1,1"], "a given spacing is for raw volumes"),
        (&["--labels", "block.vtk", "--out-truth", "t.npy"], "a mesh, where voxels are needed"),
    ] {
        let refused = fit(d, &[&["block.vtk", "--initial-only", "--out", "no"], arguments].concat());
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(2) && said.contains(what), "{said}");
        assert!(said.lines().count() == 1 && !d.join("no").exists(), "{said}");
    }
}
