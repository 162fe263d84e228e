//! Links of libraries: no bus, no async runtime, no database and no user interface unless that is their subject.

use std::path::Path;
use std::process::Command;

/// Crates that a library links only if they are its subject, by kind.
const HEAVY: [&str; 10] = ["zenoh", "tokio", "rusqlite", "egui", "winit", "openxr", "wgpu", "reqwest", "tonic", "clap"];

/// Library, and the crates of [`HEAVY`] that are its subject.
pub(crate) const LIBRARIES: [(&str, &[&str]); 25] = [
    ("sg-input", &[]),
    ("sg-proto", &[]),
    ("sg-scene", &[]),
    ("sg-formats", &[]),
    ("sg-reclassify", &[]),
    ("sg-edit", &[]),
    ("sg-volume", &[]),
    ("sg-fit", &[]),
    ("sg-walk", &[]),
    ("sg-clusters", &[]),
    ("sg-selection", &[]),
    ("sg-color", &[]),
    ("sg-labeling", &[]),
    ("sg-layers", &[]),
    ("sg-encoders", &[]),
    ("sg-speech", &[]),
    ("sg-whisper", &[]),
    ("sg-piper", &[]),
    ("sg-language", &[]),
    ("sg-sentence-model", &[]),
    ("sg-raster", &[]),
    ("sg-gpu", &["wgpu"]),
    ("sg-viewer", &["egui", "winit", "openxr", "wgpu"]),
    ("sg-endpoint", &["tokio", "reqwest", "tonic"]),
    ("sg-llm", &["tokio", "reqwest", "tonic"]),
];

/// The names of all crates that a package links, itself included, as `cargo tree` lists them.
fn linked(package: &str) -> Result<Vec<String>, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("the tests have no parent folder")?;
    let arguments =
        ["tree", "--locked", "--offline", "-e", "normal", "--prefix", "none", "--all-features", "-p", package];
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(root).output().map_err(|e| e.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(text.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect())
}

/// Whether `name` is the crate `heavy` or one of its family, such as `zenoh-protocol`.
fn is_of_family(name: &str, heavy: &str) -> bool {
    name == heavy || matches!(heavy, "zenoh" | "egui") && name.strip_prefix(heavy).is_some_and(|r| r.starts_with('-'))
}

fn complaints(package: &str, subject: &[&str], crates: &[String]) -> Vec<String> {
    let barred = HEAVY.iter().filter(|heavy| !subject.contains(heavy));
    barred
        .filter_map(|heavy| crates.iter().find(|name| is_of_family(name, heavy)))
        .map(|name| format!("{package} links {name}; a library links it only if it is the library's subject"))
        .collect()
}

#[test]
fn libraries_link_nothing_beside_their_subject() {
    let mut all = Vec::new();
    for (package, subject) in LIBRARIES {
        let crates = linked(package).unwrap();
        assert!(crates.iter().any(|name| name == package), "{package}: {crates:?}");
        all.extend(complaints(package, subject, &crates));
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
    let crates = ["sg-walk", "zenoh-protocol", "tokio"].map(str::to_owned);
    assert_eq!(complaints("sg-walk", &[], &crates).len(), 2);
    assert_eq!(complaints("sg-walk", &["tokio"], &crates).len(), 1);
    assert_eq!(linked("supergaussian-scene").unwrap().iter().filter(|name| *name == "zenoh").count().min(1), 1);
}
