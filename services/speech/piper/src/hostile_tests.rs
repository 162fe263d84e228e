//! Voices that are damaged, huge or of another kind: each gives one line with the file, the place and the remedy.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::json;
use sg_speech::child_process::Limits;

use crate::made_voice::{Kind, MadeVoice, SYMBOLS, Written};
use crate::piper::Piper;

const PLAIN: Kind = Kind { two: true, speakers: 3 };

fn error_at(path: &Path) -> String {
    let began = Instant::now();
    let error = Piper::open(path, None).err().unwrap().to_string();
    assert!(began.elapsed() < Duration::from_secs(2), "{error}");
    assert!(!error.contains('\n') && error.starts_with('/'), "{error}");
    error
}

/// The error of a voice after a change.
fn changed(change: impl FnOnce(&mut MadeVoice)) -> String {
    let mut voice = MadeVoice::new(PLAIN);
    change(&mut voice);
    error_at(&voice.write().path())
}

fn assert_names(error: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| error.contains(part)), "{error} lacks one of {parts:?}");
}

#[test]
fn every_truncation_and_changed_byte_is_an_error_or_a_voice() {
    let written = MadeVoice::new(PLAIN).write();
    let bytes = std::fs::read(written.path()).unwrap();
    for at in (0..bytes.len()).step_by(397).chain(0..60) {
        std::fs::write(written.path(), &bytes[..at]).unwrap();
        assert_names(&error_at(&written.path()), &["made.onnx", "not a whole ONNX file; get the voice again"]);
    }
    let limits = Limits::within(Duration::from_secs(120));
    for at in (0..bytes.len()).step_by(173).chain(0..60) {
        let mut changed = bytes.clone();
        changed[at] ^= 0x95;
        std::fs::write(written.path(), &changed).unwrap();
        // A changed weight is noticed only if it is no number. Then the voice speaks something, or says that it cannot.
        match Piper::open(&written.path(), None) {
            Ok(voice) => drop(voice.speak("abc", &limits)),
            Err(_) => drop(error_at(&written.path())),
        }
    }
}

#[test]
fn weights_that_are_no_numbers_or_have_another_shape_are_refused() {
    let nan = |node: &'static str| changed(|voice| voice.weight(node).1[5] = f32::NAN);
    assert_names(
        &nan("/dec/ups.1/ConvTranspose"),
        &["`/dec/ups.1/ConvTranspose`", "weight 5 is NaN", "get the voice again"],
    );
    assert_names(
        &nan("/flow/flows.2/enc/in_layers.1/Conv"),
        &["`/flow/flows.2/enc/in_layers.1/Conv`", "weight 5 is NaN"],
    );
    let error = changed(|voice| voice.tensors.get_mut("dp.flows.0.m").unwrap().1[0] = f32::INFINITY);
    assert_names(&error, &["`dp.flows.0.m`", "weight 0 is inf"]);
    let shaped = |node: &'static str, shape: Vec<usize>| {
        changed(|voice| {
            let (own, values) = voice.weight(node);
            values.resize(shape.iter().product(), 0.0);
            *own = shape;
        })
    };
    assert_names(&shaped("/enc_p/proj/Conv", vec![7, 8, 1]), &["`/enc_p/proj/Conv`", "12 biases for 7 outputs"]);
    assert_names(&shaped("/dp/pre/Conv", vec![10, 9, 1]), &["`/dp/pre/Conv`", "[10, 9, 1]", "outputs × 8 × kernel"]);
    assert_names(&shaped("/dp/pre/Conv", vec![10, 8]), &["[10, 8]", "3 dimensions"]);
    assert_names(&shaped("/dp/pre/Conv", vec![10, 8, 0]), &["[10, 8, 0]", "kernels to 255"]);
    assert_names(&shaped("/dec/conv_pre/Conv", vec![8, 6, 301]), &["kernels to 255"]);
    assert_names(&shaped("/dec/ups.0/ConvTranspose", vec![8, 4, 9]), &["a stride and twice a padding"]);
    assert_names(&shaped("/dp/flows.3/convs/convs_sep.0/Conv", vec![10, 2, 3]), &["10 × 1 × kernel"]);
    // A huge shape asks for no memory.
    for shape in [vec![1 << 40, 1 << 40, 1 << 40], vec![8, 6, 7, 1, 1, 1, 1]] {
        let error = changed(|voice| voice.weight("/dec/conv_pre/Conv").0 = shape);
        assert_names(&error, &["`/dec/conv_pre/Conv`"]);
    }
    let error = changed(|voice| drop(voice.tensors.remove("enc_p.encoder.attn_layers.1.emb_rel_v")));
    assert_names(&error, &["`enc_p.encoder.attn_layers.1.emb_rel_v`", "not in the file"]);
    let error =
        changed(|voice| voice.tensors.get_mut("enc_p.encoder.attn_layers.0.emb_rel_k").unwrap().0 = vec![2, 5, 2]);
    assert_names(&error, &["emb_rel_k", "one odd number of positions for all heads"]);
}

#[test]
fn attributes_out_of_bounds_are_refused() {
    let with = |node: &'static str, attribute: &'static str, numbers: Vec<i64>| {
        changed(|voice| drop(voice.nodes.get_mut(node).unwrap().attributes.insert(attribute, numbers)))
    };
    for number in [-1, 1 << 40, i64::MIN] {
        let error = with("/dec/resblocks.0/convs1.0/Conv", "dilations", vec![number]);
        assert_names(&error, &["`/dec/resblocks.0/convs1.0/Conv`", "`dilations` is out of bounds"]);
    }
    assert_names(&with("/dec/conv_post/Conv", "pads", vec![2, 3]), &["padded by [2, 3]", "needs [3, 3]"]);
    let error = with("/dp/convs/convs_sep.1/Conv", "pads", vec![6, 0]);
    assert_names(&error, &["`/dp/convs/convs_sep.1/Conv`", "padded by [6, 0]"]);
    assert_names(&with("/dec/conv_post/Conv", "strides", vec![2]), &["a stride of 1"]);
    assert_names(&with("/dec/ups.0/ConvTranspose", "pads", vec![1, 3]), &["a stride and twice a padding"]);
}

#[test]
fn voices_of_other_kinds_are_refused_by_name() {
    let error = changed(|voice| drop(voice.nodes.remove("/flow/flows.0/pre/Conv")));
    assert_names(&error, &["`/flow/flows.0/pre/Conv`", "there are 0 such nodes", "Piper's own exporter"]);
    let error = changed(|voice| {
        let node = voice.nodes["/dp/pre/Conv"].clone();
        voice.nodes.insert("/dp/conv_1/Conv".into(), node);
    });
    assert_names(&error, &["`/dp/conv_1/Conv`", "without noise", "stochastic duration predictor"]);
    let error = changed(|voice| drop(voice.nodes.remove("/dec/resblocks.3/convs1.0/Conv")));
    assert_names(&error, &["3 residual blocks are no equal number for 2 stages"]);
    // Voices whose sound would take all memory.
    let error = changed(|voice| {
        for (node, kernel) in [("/dec/ups.0/ConvTranspose", 255), ("/dec/ups.1/ConvTranspose", 255)] {
            let (shape, values) = voice.weight(node);
            shape[2] = kernel;
            values.resize(shape.iter().product(), 0.0);
            let attributes = &mut voice.nodes.get_mut(node).unwrap().attributes;
            attributes.extend([("strides", vec![255]), ("pads", vec![0, 0])]);
        }
    });
    assert_names(&error, &["`/dec/ups.1`", "a frame would have 65025 samples"]);
    let error = changed(|voice| {
        let (shape, values) = voice.weight("/dec/ups.1/ConvTranspose");
        shape[2] = 255;
        values.resize(shape.iter().product(), 0.0);
        let attributes = &mut voice.nodes.get_mut("/dec/ups.1/ConvTranspose").unwrap().attributes;
        attributes.extend([("strides", vec![255]), ("pads", vec![0, 0])]);
        let node = "/dec/resblocks.0/convs1.0/Conv";
        voice.nodes.get_mut(node).unwrap().attributes.extend([("dilations", vec![1000]), ("pads", vec![0, 0])]);
        let (shape, values) = voice.weight(node);
        shape[2] = 255;
        values.resize(shape.iter().product(), 0.0);
    });
    assert_names(&error, &["`/dec/ups.1`", "too much memory"]);
    let error = changed(|voice| drop(voice.nodes.remove("/dp/cond/Conv")));
    assert_names(&error, &["`/dp/cond/Conv`", "no such node"]);
}

#[test]
fn millions_of_empty_parts_take_no_memory() {
    let written = MadeVoice::new(PLAIN).write();
    // A graph of empty nodes, two bytes each.
    let graph = [0x0a, 0x00].repeat(1 << 22);
    let length = [0x80, 0x80, 0x80, 0x04];
    std::fs::write(written.path(), [&[0x3a][..], &length, &graph].concat()).unwrap();
    assert_names(&error_at(&written.path()), &["made.onnx", "more than 131072 parts"]);
}

#[test]
fn configurations_are_checked() {
    let with =
        |key: &'static str, value: serde_json::Value| changed(|voice| *voice.config.pointer_mut(key).unwrap() = value);
    assert_names(&with("/audio/sample_rate", json!(7)), &["made.onnx.json", "`audio.sample_rate`", "4000 to 192000"]);
    assert_names(&with("/inference/noise_scale", json!(-1)), &["`inference.noise_scale`", "0 to 4"]);
    assert_names(&with("/inference/length_scale", json!(1e9)), &["`inference.length_scale`", "0.1 to 10"]);
    assert_names(&with("/phoneme_type", json!("pinyin")), &["made.onnx.json", "pinyin", "espeak"]);
    assert_names(&with("/phoneme_id_map/a", json!([SYMBOLS])), &["`phoneme_id_map`", "`a`", "knows 40 symbols"]);
    assert_names(&with("/phoneme_id_map", json!({"^": [1], "_": [0]})), &["`phoneme_id_map`", "no `$`"]);
    let long = json!({"^": [1], "_": [0], "$": [2], "abcde": [3]});
    assert_names(&with("/phoneme_id_map", long), &["`abcde`", "1 to 4 characters"]);
    let voice = |name: &'static str| {
        changed(|voice| {
            voice.config["phoneme_type"] = json!("espeak");
            voice.config["espeak"] = json!({ "voice": name });
        })
    };
    assert_names(&voice(""), &["`espeak.voice`", "missing"]);
    for name in ["-w", "../x", "a b", "en\n"] {
        assert_names(&voice(name), &["`espeak.voice`", "no name of a voice of espeak-ng"]);
    }
    let Written { folder } = MadeVoice::new(PLAIN).write();
    assert_names(&error_at(&folder.path().join("none.onnx")), &["none.onnx.json", "No such file"]);
    std::fs::remove_file(folder.path().join("made.onnx")).unwrap();
    assert_names(&error_at(&folder.path().join("made.onnx")), &["made.onnx", "No such file"]);
}

#[test]
fn a_missing_program_names_its_package() {
    let mut voice = MadeVoice::new(PLAIN);
    voice.config["phoneme_type"] = json!("espeak");
    let error = Piper::open(&voice.write().path(), Some("/no/such/folder".as_ref())).err().unwrap();
    assert_eq!(error.to_string(), "espeak-ng is not installed; on Debian install espeak-ng");
}
