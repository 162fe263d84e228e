//! Makes the compact index of WordNet's nouns and adjectives that `sg-labeling` contains.
//!
//! `cargo run --release -p sg-labeling --example wordnet_index -- /usr/share/wordnet services/labeling/wordnet/index.zst`
//!
//! The folder is that of Debian's package `wordnet-base` (WordNet 3.0).
#![allow(clippy::print_stdout, reason = "a program tells what it did")]

mod source;

use std::path::PathBuf;

/// The compression that gives the smallest file.
const LEVEL: i32 = 22;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(folder), Some(target)) = (arguments.next(), arguments.next()) else {
        return Err("give WordNet's folder and the file to write".into());
    };
    let raw = source::index(&folder)?;
    let packed = zstd::bulk::compress(&raw, LEVEL)?;
    let beside = target.with_extension("part");
    std::fs::write(&beside, &packed)?;
    std::fs::rename(&beside, &target)?;
    println!("{} bytes, {} unpacked", packed.len(), raw.len());
    Ok(())
}
