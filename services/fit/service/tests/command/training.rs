//! Training on pictures, and scenes that are kept so that they are not fitted again.

use std::path::Path;

use serde_json::Value;

use crate::{fit, json, ok};

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
