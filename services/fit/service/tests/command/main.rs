//! The command on the synthetic volume: files, reports, exit statuses and one-line errors.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

mod interruption;
mod label_units;
mod meshes;
mod refusals;
mod series;
mod slices;
mod training;
mod volumes;

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

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

#[test]
fn help_shows_an_example() {
    for arguments in [vec!["--help"], vec!["phantom", "--help"], vec!["carry", "--help"]] {
        let output = ok(Path::new("."), &arguments);
        assert!(String::from_utf8_lossy(&output.stdout).contains(":\n  supergaussian fit "));
    }
    let help = String::from_utf8_lossy(&ok(Path::new("."), &["--help"]).stdout).into_owned();
    assert!(sg_volume::ENDINGS.iter().all(|ending| help.contains(ending)), "{help}");
}
