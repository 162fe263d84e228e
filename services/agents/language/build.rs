//! Learns the sentence model from the example sentences, so that programs carry it and none learns when it starts.

use std::error::Error;
use std::path::PathBuf;

use sg_sentence_model::{Examples, Model};

/// Seed of the values that fill the slots of the sentences.
const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=sentences");
    let mut files = Vec::new();
    for entry in std::fs::read_dir("sentences")? {
        let path = entry?.path();
        if path.extension().is_some_and(|ending| ending == "tsv") {
            files.push((path.display().to_string(), std::fs::read_to_string(&path)?));
        }
    }
    files.sort();
    let examples = Examples::parse(files.iter().map(|(name, text)| (name.as_str(), text.as_str())))?;
    let model = Model::train(&examples, SEED);
    let out = PathBuf::from(std::env::var("OUT_DIR")?).join("sentences.bin");
    std::fs::write(&out, model.encode()).map_err(|error| format!("{}: {error}", out.display()))?;
    Ok(())
}
