//! `supergaussian render` as a person types it.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test fails by panicking and says what it skips")]

use std::path::Path;
use std::process::{Command, Output};

use glam::DVec3;
use sg_scene::camera::Camera;

/// A plain 3DGS file of Gaussians in a row, red on the left to blue on the right, red nearest.
fn write_scene(path: &Path, n: usize) {
    let properties = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {n}\n").into_bytes();
    for name in properties {
        bytes.extend(format!("property float {name}\n").bytes());
    }
    bytes.extend(b"end_header\n");
    for i in 0..n {
        let t = i as f32 / (n - 1) as f32;
        let row =
            [2.0 * t - 1.0, 0.0, t, 1.7 - 3.4 * t, -1.7, 3.4 * t - 1.7, 3.0, -2.3, -2.3, -2.3, 1.0, 0.0, 0.0, 0.0];
        bytes.extend(row.iter().flat_map(|x| x.to_le_bytes()));
    }
    std::fs::write(path, bytes).unwrap();
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_supergaussian-render-node")).current_dir(folder).args(arguments).output().unwrap()
}

/// Runs what must succeed; its standard output.
fn good(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn pixels(path: &Path) -> (Vec<u64>, Vec<f32>) {
    let bytes = std::fs::read(path).unwrap();
    let npy = npyz::NpyFile::new(&bytes[..]).unwrap();
    (npy.shape().to_vec(), npy.into_vec().unwrap())
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_scene(&folder.path().join("row.ply"), 9);
    let camera = Camera {
        background: [0.0, 1.0, 0.0],
        ..Camera::look_at(DVec3::new(0.0, 0.0, -3.0), DVec3::ZERO, DVec3::NEG_Y, 60.0, 80, 40)
    };
    std::fs::write(folder.path().join("camera.json"), serde_json::to_string(&camera).unwrap()).unwrap();
    folder
}

/// Both rasterizers of a graphics device give the cores' picture.
#[test]
fn a_graphics_device_draws_the_same() {
    let folder = folder();
    let at = folder.path();
    good(at, &["row.ply", "--camera", "camera.json", "--out", "cores.npy", "--backend", "cpu"]);
    let (_, want) = pixels(&at.join("cores.npy"));
    for rasterizer in ["tiles", "quads"] {
        let arguments = ["row.ply", "--camera", "camera.json", "--out", "device.npy", "--backend", "gpu"];
        let output = run(at, &[&arguments[..], &["--rasterizer", rasterizer, "--json"]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.code() == Some(1) && said.contains("no Vulkan device") {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{said}");
            eprintln!("SKIPPED: {said}");
            return;
        }
        assert!(output.status.success(), "{said}");
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(report["backend"].as_str().unwrap().ends_with(rasterizer), "{}", report["backend"]);
        let (_, got) = pixels(&at.join("device.npy"));
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-4), "{rasterizer}");
    }
    let exact = run(at, &["row.ply", "--out", "e.npy", "--backend", "gpu", "--quality", "exact", "--width", "8"]);
    assert!(String::from_utf8_lossy(&exact.stderr).contains("drawn by the cores"));
}

#[test]
fn a_camera_gives_its_picture_in_both_formats() {
    let folder = folder();
    let at = folder.path();
    for out in ["a.npy", "a.png"] {
        let arguments =
            ["row.ply", "--camera", "camera.json", "--out", out, "--quality", "exact", "--no-dither", "--json"];
        let report: serde_json::Value = serde_json::from_str(&good(at, &arguments)).unwrap();
        assert_eq!((&report["gaussians"], &report["drawn"], &report["backend"]), (&9.into(), &9.into(), &"cpu".into()));
        assert!(report["seconds"]["total"].as_f64().unwrap() > 0.0);
    }
    let (shape, numbers) = pixels(&at.join("a.npy"));
    assert_eq!(shape, [40, 80, 4]);
    let pixel = |x: usize, y: usize| &numbers[4 * (80 * y + x)..][..4];
    assert!(pixel(0, 0)[1] > 0.999 && pixel(0, 0)[3] < 1e-3, "background in the corner");
    let [left, right] = [pixel(29, 20), pixel(48, 20)];
    assert!(left[0] > 0.5 && left[2] < 0.5 && right[2] > 0.5 && right[0] < 0.5, "{left:?} {right:?}");
    let (_, bytes) = png_bytes(&at.join("a.png"));
    let want: Vec<u8> =
        numbers.chunks(4).flat_map(|p| [p[0], p[1], p[2]]).map(|x| (255.0 * x.clamp(0.0, 1.0)).round() as u8).collect();
    assert_eq!(bytes, want);
}

/// Kind and bytes of a PNG file.
fn png_bytes(path: &Path) -> (png::ColorType, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::Cursor::new(std::fs::read(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    (reader.info().color_type, bytes)
}

#[test]
fn a_picture_has_the_background_that_is_asked_for() {
    let folder = folder();
    let at = folder.path();
    let of = |background: &str, out: &str| {
        let arguments = ["row.ply", "--camera", "camera.json", "--backend", "cpu", "--out", out];
        good(at, &[&arguments[..], &["--background", background]].concat());
    };
    of("plain", "plain.png");
    let (kind, plain) = png_bytes(&at.join("plain.png"));
    assert_eq!((kind, &plain[..3]), (png::ColorType::Rgb, &[0, 255, 0][..]), "the camera's");
    of("transparent", "none.png");
    let (kind, none) = png_bytes(&at.join("none.png"));
    assert_eq!((kind, &none[..4]), (png::ColorType::Rgba, &[0; 4][..]));
    let middle = 4 * (80 * 20 + 40);
    assert!(none[middle + 3] > 200, "the row is there: {:?}", &none[middle..middle + 4]);
    of("0,0,1", "blue.png");
    assert_eq!(png_bytes(&at.join("blue.png")).1[..3], [0, 0, 255]);
    of("1,1,1/0,0,0", "two.npy");
    let (_, two) = pixels(&at.join("two.npy"));
    let at_row = |y: usize| two[4 * 80 * y];
    assert!((at_row(0) - (1.0 - 0.5 / 40.0)).abs() < 1e-3 && at_row(39) < 0.02, "{} {}", at_row(0), at_row(39));
    of("gradient", "around.png");
    let (_, around) = png_bytes(&at.join("around.png"));
    assert!(around[0].abs_diff(around[3 * 80 * 39]) > 10, "top and bottom differ");
    of("gradient", "again.png");
    let file = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert_eq!(file("around.png"), file("again.png"), "dithering is the same every time");

    let refused = run(at, &["row.ply", "--out", "x.npy", "--background", "transparent"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("write a .png") && !at.join("x.npy").exists(), "{said}");
}

#[test]
fn without_a_camera_the_scene_is_framed() {
    let folder = folder();
    let at = folder.path();
    good(at, &["row.ply", "--out", "b.npy", "--width", "50", "--height", "30"]);
    let (shape, numbers) = pixels(&at.join("b.npy"));
    assert_eq!(shape, [30, 50, 4]);
    let column = |x: usize| numbers.chunks(4).skip(x).step_by(50).map(|p| p[3]).fold(0.0, f32::max);
    assert!(column(3) > 0.3 && column(46) > 0.3, "both ends are at their edges");
    assert!(column(0) < 0.1 && column(49) < 0.1, "nothing is cut off");
    assert!(numbers.chunks(4).take(50 * 5).all(|p| p[3] < 0.01), "nothing above it");
}

#[test]
fn a_mask_highlights() {
    let folder = folder();
    let at = folder.path();
    let mask = sg_scene::mask::Mask::from_fn(9, |i| i > 5);
    sg_formats::npy::write_mask(&at.join("mask.npy"), &mask).unwrap();
    let base = ["row.ply", "--camera", "camera.json", "--out"];
    good(at, &[&base[..], &["plain.npy"]].concat());
    good(at, &[&base[..], &["lit.npy", "--mask", "mask.npy", "--mask-color", "1,1,1", "--mask-mix", "1"]].concat());
    good(at, &[&base[..], &["gone.npy", "--mask", "mask.npy", "--mask-opacity", "0"]].concat());
    let [plain, lit, gone] = ["plain.npy", "lit.npy", "gone.npy"].map(|name| pixels(&at.join(name)).1);
    let pixel = |numbers: &[f32], x: usize| -> Vec<f32> { numbers[4 * (80 * 20 + x)..][..4].to_vec() };
    assert_eq!(pixel(&plain, 25), pixel(&lit, 25));
    assert!(pixel(&plain, 48)[0] < 0.5 && pixel(&lit, 48)[0] > 0.8 && pixel(&gone, 48)[3] < 0.1);
}

#[test]
fn planes_and_boxes_clip() {
    let folder = folder();
    let at = folder.path();
    let base = ["row.ply", "--camera", "camera.json", "--json", "--out"];
    // Centres lie at x = −1, −¾, … 1 and z = 0, ⅛, … 1. A plane cuts those within three standard deviations of 0.1.
    for (arguments, clipped) in [
        (vec!["--clip-plane", "0,0,0,1,0,0"], 3),
        (vec!["--clip-plane", "0.1,0,0,-1,0,0", "--clip-plane", "-0.6,0,0,2,0,0"], 4),
        (vec!["--clip-box", "-2,-1,0.5,0.35,1,2"], 4),
        (vec!["--clip-box", "0.35,1,2,-2,-1,0.5"], 4),
        (vec!["--cut-box", "-2,-1,-1,0.35,1,2"], 5),
        (vec!["--cut-box", "-2,-1,0.5,0.35,1,2"], 0),
    ] {
        let report = good(at, &[&base[..], &["clipped.npy"], &arguments].concat());
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["clipped"], clipped, "{arguments:?}");
        assert_eq!(report["drawn"], 9 - clipped, "{arguments:?}");
    }
}

#[test]
fn clusters_and_attributes_are_shown_outlined_and_picked() {
    let folder = folder();
    let at = folder.path();
    sg_formats::npy::write_labels(&at.join("labels.npy"), &[0, 0, 0, 1, 1, 1, 7, -1, -1]).unwrap();
    let base = ["row.ply", "--camera", "camera.json", "--json", "--out"];
    let with = |out: &str, more: &[&str]| -> (serde_json::Value, Vec<f32>) {
        let report = good(at, &[&base[..], &[out], more].concat());
        (serde_json::from_str(&report).unwrap(), pixels(&at.join(out)).1)
    };
    let labels = ["--clusters", "labels.npy"];
    let (_, first) = with("a.npy", &[&["--show", "clusters"], &labels[..]].concat());
    let (_, again) = with("b.npy", &[&["--show", "clusters"], &labels[..]].concat());
    let (_, other) = with("c.npy", &[&["--show", "clusters", "--seed", "2"], &labels[..]].concat());
    assert_eq!(first, again, "a seed gives its colours");
    assert_ne!(first, other);
    let (_, axis) = with("d.npy", &[&["--show", "first-component", "--color-map", "cividis"], &labels[..]].concat());
    let pixel = |numbers: &[f32], x: usize| -> Vec<f32> { numbers[4 * (80 * 20 + x)..][..4].to_vec() };
    assert!(pixel(&axis, 29)[2] > pixel(&axis, 29)[0] && pixel(&axis, 44)[0] > 0.5, "blue to yellow along x");
    let (report, _) = with("e.npy", &["--show", "scale", "--range", "0.01,1"]);
    assert_eq!((&report["legend"]["low"], &report["legend"]["high"]), (&0.01.into(), &1.0.into()));
    let (_, lined) = with("f.npy", &[&["--outlines", "2", "--outline-color", "1,0,1"], &labels[..]].concat());
    let lines = lined.chunks(4).filter(|p| *p == [1.0, 0.0, 1.0, 1.0]).count();
    assert!((30..1500).contains(&lines), "{lines}");
    // The first, at (−1, 0, 0), is seen at x = 40 − 34.64/3.
    let (report, _) = with("g.npy", &["--pick", "28.5,20", "--projection", "per-ray"]);
    assert_eq!(report["pick"]["gaussian"], 0);
    assert!((report["pick"]["depth"].as_f64().unwrap() - 3.0).abs() < 0.02, "{report}");
    let (report, _) = with("g.npy", &["--pick", "1,1"]);
    assert!(report["pick"].is_null() && report.get("pick").is_some());
    assert!(with("h.npy", &[]).0.get("pick").is_none());
}

/// The work of a picture, and of both eyes of a headset, without a picture and without a device.
#[test]
fn work_is_counted_without_a_picture() {
    let folder = folder();
    let at = folder.path();
    let base = ["row.ply", "--camera", "camera.json", "--counts"];
    let report: serde_json::Value = serde_json::from_str(&good(at, &[&base[..], &["--json"]].concat())).unwrap();
    assert_eq!((&report["counts"]["gaussians"], &report["counts"]["listed"]), (&9.into(), &9.into()));
    let names: Vec<&str> =
        report["passes"].as_array().unwrap().iter().map(|pass| pass["pass"].as_str().unwrap()).collect();
    assert_eq!(names, ["cull", "project", "sort", "tile-lists", "pair-sort", "blend"]);
    let pairs = report["passes"][3]["tile_pairs"].as_u64().unwrap();
    assert!((9..200).contains(&pairs) && report["passes"][5]["evaluated"].as_u64().unwrap() >= 9 * 256, "{report}");
    assert_eq!(report["predictions"].as_array().unwrap().len(), 4);
    let both = ["--both-eyes", "--rasterizer", "quads", "--card", "rtx-3090"];
    let table = good(at, &[&base[..], &both].concat());
    assert!(table.starts_with("2 views of 2064 x 2208 pixels: 9 of 9 Gaussians listed"), "{table}");
    assert!(
        table.contains("rtx-3090, ms") && !table.contains("rtx-4090") && table.contains("\ndepth layer"),
        "{table}"
    );
    let drawn = good(at, &[&base[..], &["--out", "counted.png", "--json"]].concat());
    let drawn: serde_json::Value = serde_json::from_str(&drawn).unwrap();
    assert_eq!(drawn["work"]["passes"], report["passes"]);
    assert!(at.join("counted.png").exists());
}

#[test]
fn errors_are_one_line() {
    let folder = folder();
    let at = folder.path();
    std::fs::write(at.join("broken.json"), "{\"width\": 4, \"widht\": 5}").unwrap();
    std::fs::write(at.join("text.ply"), "this is no scene").unwrap();
    sg_formats::npy::write_mask(&at.join("short.npy"), &sg_scene::mask::Mask::empty(3)).unwrap();
    let base = ["row.ply", "--camera", "camera.json", "--out"];
    for (arguments, status, want) in [
        (vec!["none.ply", "--out", "c.png"], 2, "none.ply"),
        (vec!["text.ply", "--out", "c.png"], 2, "text.ply"),
        (vec!["row.ply", "--out", "c.jpg"], 2, ".png or .npy"),
        (vec!["row.ply", "--camera", "broken.json", "--out", "c.png"], 2, "widht"),
        ([&base[..], &["c.png", "--mask", "short.npy"]].concat(), 2, "short.npy"),
        ([&base[..], &["none/c.png"]].concat(), 1, "none/c.png"),
        ([&base[..], &["c.png", "--clip-plane", "0,0,0,0,0,0"]].concat(), 2, "normal"),
        ([&base[..], &["c.png", "--show", "clusters"]].concat(), 2, "--clusters"),
        ([&base[..], &["c.png", "--clusters", "short.npy"]].concat(), 2, "short.npy"),
        ([&base[..], &["c.png", "--show", "scale", "--range", "0,1"]].concat(), 2, "above 0"),
        ([&base[..], &["c.png", "--show", "normal"]].concat(), 2, "normal"),
        (vec!["row.ply", "--counts", "--projection", "per-ray"], 2, "--projection per-ray"),
        (vec!["row.ply", "--counts", "--quality", "exact"], 2, "--quality standard"),
    ] {
        let output = run(at, &arguments);
        let line = String::from_utf8(output.stderr).unwrap();
        let line = line.lines().filter(|l| !l.starts_with("warning")).collect::<Vec<_>>();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {line:?}");
        assert!(line.len() == 1 && line[0].starts_with("error: ") && line[0].contains(want), "{line:?}");
    }
    for arguments in [
        [&base[..], &["c.png", "--backend", "abacus"]].concat(),
        [&base[..], &["c.png", "--mask-mix", "1"]].concat(),
        [&base[..], &["c.png", "--clip-plane", "0,0,0,1,0"]].concat(),
        [&base[..], &["c.png", "--clip-box", "0,0,0,1,0,nan"]].concat(),
        [&base[..], &["c.png", "--show", "taste"]].concat(),
        [&base[..], &["c.png", "--term", "fog"]].concat(),
        [&base[..], &["c.png", "--outlines"]].concat(),
        [&base[..], &["c.png", "--pick", "3"]].concat(),
        [&base[..], &["c.png", "--width", "9"]].concat(),
        vec!["row.ply"],
        vec!["row.ply", "--both-eyes", "--out", "c.png"],
        vec!["row.ply", "--counts", "--card", "abacus"],
        vec!["row.ply", "--counts", "--pick", "1,1"],
    ] {
        assert_eq!(run(at, &arguments).status.code(), Some(2), "{arguments:?}");
    }
    assert!(!at.join("c.png").exists());
    assert!(good(at, &["--help"]).contains("supergaussian render scene.toml --camera"));
    assert!(good(at, &["serve", "--help"]).contains("supergaussian-render-node serve --session demo"));
}

/// A ball in 24³ bytes, its transfer function, and a camera before it.
fn volume_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let ball = |i: usize| {
        let from_middle = |k: usize| k as f64 - 11.5;
        let [x, y, z] = [i % 24, i / 24 % 24, i / 576].map(from_middle);
        (200.0 - 14.0 * (x * x + y * y + z * z).sqrt()).clamp(0.0, 255.0) as u8
    };
    std::fs::write(at.join("ball_24x24x24_uint8.raw"), (0..24 * 24 * 24).map(ball).collect::<Vec<_>>()).unwrap();
    let function = r#"{"domain": [0, 255], "units": "raw", "scale": "linear", "points": [
        {"value": 0, "color": [1, 0, 0], "opacity": 0}, {"value": 80, "color": [1, 0, 0], "opacity": 0},
        {"value": 100, "color": [1, 0, 0], "opacity": 0.5}, {"value": 255, "color": [1, 0, 0], "opacity": 0.5}]}"#;
    std::fs::write(at.join("red.tf.json"), function).unwrap();
    folder
}

const BALL: &str = "ball_24x24x24_uint8.raw";

#[test]
fn a_volume_is_drawn_by_ray_marching() {
    let folder = volume_folder();
    let at = folder.path();
    let sized = ["--width", "80", "--height", "60"];
    let drawn = |name: &str, more: &[&str]| {
        let report = good(at, &[&[BALL, "--out", name, "--json"][..], &sized, more].concat());
        let (shape, pixels) = pixels(&at.join(name));
        assert_eq!(shape, [60, 80, 4]);
        (serde_json::from_str::<serde_json::Value>(&report).unwrap(), pixels)
    };
    let red = ["--transfer-function", "red.tf.json"];
    let (report, fast) = drawn("fast.npy", &red);
    assert_eq!(report["dims"], serde_json::json!([24, 24, 24]));
    let middle = |pixels: &[f32]| <[f32; 4]>::try_from(&pixels[4 * (30 * 80 + 40)..][..4]).unwrap();
    let [r, g, b, a] = middle(&fast);
    assert!(r > 0.5 && a > 0.9 && g < 0.4 * r && (g - b).abs() < 1e-6, "{:?}", middle(&fast));
    assert!(fast[..4] == [0.0; 4], "{:?}", &fast[..4]);
    let (_, exact) = drawn("exact.npy", &[&red[..], &["--quality", "exact", "--step", "0.5"]].concat());
    assert!(exact != fast && exact.iter().zip(&fast).all(|(a, b)| (a - b).abs() < 0.01));
    // The ball is farther from the eye behind a cut through its middle; a background shows where it is not.
    let cut = ["--clip-plane", "11.5,11.5,11.5,1,0,0", "--background", "0,0,1"];
    let (_, cut) = drawn("cut.npy", &[&red[..], &cut].concat());
    let covered = |pixels: &[f32]| pixels.chunks(4).filter(|pixel| pixel[3] > 0.5).count();
    assert!(covered(&cut) > 100 && covered(&cut) < covered(&fast), "{} {}", covered(&cut), covered(&fast));
    assert!(cut[..4] == [0.0, 0.0, 1.0, 0.0], "{:?}", &cut[..4]);
    // Without a transfer function there is an automatic one. Spacing stretches raw voxels.
    assert!(covered(&drawn("automatic.npy", &[]).1) > 100);
    let (_, flat) = drawn("flat.npy", &[&red[..], &["--spacing", "1,1,0.25"]].concat());
    assert!(covered(&flat) < covered(&fast) && covered(&flat) > 100, "{}", covered(&flat));
}

#[test]
fn a_mesh_is_drawn_from_its_tetrahedra() {
    let folder = volume_folder();
    let at = folder.path();
    // Two tetrahedra on a common face: the value rises from the face to both tips.
    let mesh = "# vtk DataFile Version 4.2\ntwo\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n\
        0 0 0 9 0 0 0 9 0 3 3 9 3 3 -9\nCELLS 2 10\n4 0 1 2 3\n4 0 1 2 4\nCELL_TYPES 2\n10 10\nPOINT_DATA 5\n\
        SCALARS far float\nLOOKUP_TABLE default\n0 0 0 255 255\nSCALARS flat float\nLOOKUP_TABLE default\n0 0 0 0 0\n";
    std::fs::write(at.join("two.vtk"), mesh).unwrap();
    let covered = |more: &[&str]| {
        let arguments = [&["two.vtk", "--width", "80", "--height", "60", "--out", "a.npy", "--json"], more].concat();
        let report: serde_json::Value = serde_json::from_str(&good(at, &arguments)).unwrap();
        assert_eq!((&report["tetrahedra"], &report["dims"]), (&2.into(), &serde_json::Value::Null));
        pixels(&at.join("a.npy")).1.chunks(4).filter(|pixel| pixel[3] > 0.5).count()
    };
    let red = ["--transfer-function", "red.tf.json"];
    let whole = covered(&red);
    assert!(whole > 100, "{whole}");
    assert_eq!(covered(&[&red[..], &["--variable", "flat"]].concat()), 0);
    let half = covered(&[&red[..], &["--clip-plane", "0,0,0,0,0,1"]].concat());
    assert!(half > 40 && half < whole, "{half} {whole}");
    let output = run(at, &["two.vtk", "--variable", "near", "--out", "no.png"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("none is called `near`; give one of far, flat"), "{said}");
}

#[test]
fn options_of_gaussians_are_refused_for_volumes_and_the_other_way_round() {
    let folder = volume_folder();
    let at = folder.path();
    write_scene(&at.join("row.ply"), 9);
    let refused = |arguments: &[&str], what: &str| {
        let output = run(at, &[arguments, &["--out", "no.png"]].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains(what) && said.lines().count() == 1, "{said}");
        assert!(!at.join("no.png").exists());
    };
    for option in [&["--pick", "1,1"][..], &["--show", "opacity"], &["--palette", "1,0,0"], &["--backend", "gpu"]] {
        refused(&[&[BALL][..], option].concat(), option[0]);
    }
    refused(&["row.ply", "--step", "0.5"], "--step");
    refused(&["row.ply", "--variable", "density"], "--variable");
    refused(&["row.ply", "--transfer-function", "red.tf.json"], "row.ply");
    refused(&[BALL, "--transfer-function", "gone.tf.json"], "gone.tf.json");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 3 4\nencoding: raw\ndata file: /etc/hostname\n";
    std::fs::write(at.join("theirs.nhdr"), header).unwrap();
    refused(&["theirs.nhdr"], "outside the folder");
}

#[test]
fn a_film_turns_around_a_volume() {
    let folder = volume_folder();
    let at = folder.path();
    let turn = ["--turntable", "--frames", "3", "--width", "40", "--height", "30", "--no-video", "--json"];
    let report = good(at, &[&[BALL, "--transfer-function", "red.tf.json", "--out", "film"][..], &turn].concat());
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["pictures"], &report["backend"]), (&3.into(), &"ray marching on the cores".into()));
    let pictures = std::fs::read_dir(at.join("film"))
        .unwrap()
        .filter(|file| file.as_ref().unwrap().path().extension().is_some_and(|ending| ending == "png"));
    assert_eq!(pictures.count(), 3);
}
