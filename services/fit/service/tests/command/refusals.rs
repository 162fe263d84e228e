//! Wrong input, and files that the command may not reach.

use std::path::Path;

use crate::{fit, ok};

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
        with(&["--resume"]),
        with(&["--checkpoint-every", "9"]),
        vec![volume, "--out", "out", "--checkpoint-every", "-1"],
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
