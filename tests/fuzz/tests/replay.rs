//! Every kept input, and every input that once failed, through its reader.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

// The engine holds what instrumented code calls.
#[cfg(feature = "libfuzzer")]
use libfuzzer_sys as _;

use sg_fuzz::{Stage, TARGETS, corpus, seeds};

/// One test, because the limits on memory hold for the whole process.
#[test]
fn every_reader_takes_its_corpus() {
    for target in TARGETS {
        let stage = Stage::open().unwrap();
        let seeds = seeds::of(target.name);
        assert!(!seeds.is_empty(), "{}: no seeds", target.name);
        for (number, seed) in seeds.iter().enumerate() {
            assert!(target.check(&stage, seed), "{}: its right input {number} is refused", target.name);
        }
        let kept = corpus::inputs(target.name).unwrap();
        assert!(kept.len() >= seeds.len() / 4, "{}: {} kept inputs", target.name, kept.len());
        assert!(kept.iter().all(|input| input.bytes.len() <= target.longest.max(100_000)), "{}", target.name);
        let accepted = kept.iter().filter(|input| target.check(&stage, &input.bytes)).count();
        assert!(accepted > 0 && accepted < kept.len(), "{}: {accepted} of {} accepted", target.name, kept.len());
    }
}

#[test]
fn every_kept_input_belongs_to_a_target() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for (kind, ending) in [("corpus", ".zip"), ("found", "")] {
        let Ok(entries) = std::fs::read_dir(folder.join(kind)) else { continue };
        for entry in entries {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let target = name.strip_suffix(ending).unwrap_or_default();
            assert!(sg_fuzz::named(target).is_some(), "{kind}/{name}");
        }
    }
}
