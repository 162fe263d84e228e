//! Compiles the `.proto` files without a system `protoc`, and writes the list of all messages.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use prost::Message as _;

const FILES: [&str; 10] = [
    "supergaussian/bus/v1/bus.proto",
    "supergaussian/scene/v1/scene.proto",
    "supergaussian/selection/v1/selection.proto",
    "supergaussian/speech/v1/speech.proto",
    "supergaussian/render/v1/render.proto",
    "supergaussian/labeling/v1/labeling.proto",
    "supergaussian/language/v1/language.proto",
    "supergaussian/launch/v1/launch.proto",
    "supergaussian/backend/v1/backend.proto",
    "supergaussian/backend/v1/speech.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    for file in FILES {
        println!("cargo::rerun-if-changed={file}");
    }
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let descriptors = protox::compile(FILES, ["."])?;
    std::fs::write(out.join("descriptors.binpb"), descriptors.encode_to_vec())?;
    write_message_list(&out, &descriptors)?;
    write_released(&out)?;
    prost_build::Config::new().enable_type_names().compile_fds(descriptors)?;
    Ok(())
}

/// Writes a macro that lists every message with its schema name and Rust type.
fn write_message_list(out: &Path, descriptors: &prost_types::FileDescriptorSet) -> Result<(), Box<dyn Error>> {
    let mut list = String::from("macro_rules! for_each_message { ($m:ident) => { $m! {\n");
    for file in &descriptors.file {
        let domain = file.package().split('.').nth(1).ok_or("package is not supergaussian.<domain>.v1")?;
        for message in &file.message_type {
            writeln!(list, "\"{}.{}\" => $crate::{domain}::{},", file.package(), message.name(), message.name())?;
        }
    }
    list.push_str("} } }\n");
    std::fs::write(out.join("messages.rs"), list)?;
    Ok(())
}

/// Writes constants of the newest release, the greatest version in `released/`.
fn write_released(out: &Path) -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=released");
    let mut releases = Vec::new();
    for entry in std::fs::read_dir("released")? {
        let name = entry?.file_name();
        releases.extend(name.to_str().and_then(|n| n.strip_suffix(".binpb")).map(str::to_owned));
    }
    let numbers = |name: &String| -> Vec<u64> {
        name.trim_start_matches('v').split('.').map(|part| part.parse().unwrap_or(0)).collect()
    };
    let newest = releases.into_iter().max_by_key(numbers).ok_or("no release in released/")?;
    let here = std::env::current_dir()?;
    let file = |extension: &str| here.join(format!("released/{newest}.{extension}")).display().to_string();
    let mut text = String::new();
    writeln!(
        text,
        "/// Version of the last release.\npub const VERSION: &str = {:?};",
        newest.trim_start_matches('v')
    )?;
    writeln!(
        text,
        "/// The schema of the last release, a serialized `google.protobuf.FileDescriptorSet` without comments.\n\
         pub const IMAGE: &[u8] = include_bytes!({:?});",
        file("binpb")
    )?;
    writeln!(text, "const GOLDEN_PARTS: &str = include_str!({:?});", file("golden"))?;
    std::fs::write(out.join("released.rs"), text)?;
    Ok(())
}
