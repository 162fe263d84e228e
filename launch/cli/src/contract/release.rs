//! `contract release`: saves the present contract, for later checks.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use prost_reflect::prost_types::FileDescriptorSet;
use sg_proto::prost::Message as _;

use super::check::proto_folder;
use crate::terminal::{self, CommandResult, Failure};

/// Writes `released/v<version>.binpb` and `.golden`. Never overwrites a release.
pub(super) fn release(version: &str, proto: Option<PathBuf>) -> CommandResult {
    let parts: Vec<_> = version.split('.').collect();
    if parts.len() != 3 || parts.iter().any(|p| p.parse::<u32>().is_err()) {
        return Err(Failure::Input(format!("version `{version}`: write three numbers, such as 0.2.0")));
    }
    let proto = proto_folder(proto)?;
    let Some(proto) = proto else {
        return Err(Failure::Input("no proto/ here or in a parent folder; give it with --proto".to_owned()));
    };
    let target = |extension: &str| proto.join("released").join(format!("v{version}.{extension}"));
    let (image, golden) = (target("binpb"), target("golden"));
    if image.exists() {
        return Err(Failure::Input(format!("{}: this release exists; a release never changes", image.display())));
    }
    write(&golden, golden_parts(&proto.join("golden"))?.as_bytes())?;
    write(&image, &image_without_comments()?)?;
    terminal::print_line(&format!("{}\n{}", image.display(), golden.display()));
    Ok(())
}

/// The compiled schema without comments and source positions.
fn image_without_comments() -> Result<Vec<u8>, Failure> {
    let compiled = FileDescriptorSet::decode(sg_proto::DESCRIPTORS);
    let mut files = compiled.map_err(|e| Failure::Work(format!("the compiled schema cannot be read: {e}")))?;
    for file in &mut files.file {
        file.source_code_info = None;
    }
    Ok(files.encode_to_vec())
}

/// Package, length and hash of every golden file.
fn golden_parts(folder: &Path) -> Result<String, Failure> {
    let mut text = String::new();
    for (package, bytes) in super::check::golden_files(folder)? {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{package} {} {}", bytes.len(), blake3::hash(&bytes).to_hex());
    }
    Ok(text)
}

/// Writes a temporary file and renames it.
fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let part = path.with_extension("part");
    let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
    written.map_err(|e| Failure::Work(format!("{}: {e}", path.display())))
}
