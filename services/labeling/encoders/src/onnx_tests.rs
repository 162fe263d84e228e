//! Graphs of ONNX, those of `tests/fixtures/make_onnx.py`, beside the models of the same weights, and damaged ones.

#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test fails by panicking, and one that is skipped says so"
)]

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use serde_json::json;

use crate::encoder::{ImageEncoder, ImageTextEncoder, TextEncoder};
use crate::hostile_tests::{Copy, assert_names, one_line};
use crate::parity_tests::{Expected, assert_near, fixtures, mini_lm, test_images, texts};
use crate::{ImageTextModel, OnnxImageTextModel, OnnxRuntime, OnnxSentenceEncoder, Precision, SentenceEncoder};

const THREADS: NonZeroUsize = NonZeroUsize::new(2).unwrap();

/// ONNX Runtime of `SUPERGAUSSIAN_ONNXRUNTIME` or of `ops/models.sh`. Without it the test skips, after a message. With
/// `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, that is a failure.
fn runtime() -> Option<OnnxRuntime> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian").unwrap().cache_dir().to_owned();
    let named = std::env::var_os("SUPERGAUSSIAN_ONNXRUNTIME").map(PathBuf::from);
    let library = named.clone().unwrap_or_else(|| cache.join("models/onnxruntime/libonnxruntime.so"));
    if named.is_some() || library.is_file() {
        return Some(OnnxRuntime::load(&library).unwrap());
    }
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1");
    assert!(!required, "no ONNX Runtime, and SUPERGAUSSIAN_REQUIRE_TOOLS=1; run ops/models.sh");
    eprintln!("SKIPPED: no ONNX Runtime, run ops/models.sh");
    None
}

#[test]
fn graphs_give_the_embeddings_of_the_models() {
    let Some(runtime) = runtime() else { return };
    for name in ["clip-gelu", "siglip"] {
        let folder = fixtures().join(name);
        assert!(OnnxImageTextModel::is_in(&folder));
        let graphs = OnnxImageTextModel::open(&folder, &runtime, THREADS).unwrap();
        let model = ImageTextModel::open(&folder, Precision::F32).unwrap();
        assert_eq!(ImageEncoder::dimension(&graphs), ImageEncoder::dimension(&model));
        assert_eq!((graphs.layout(), graphs.logit(0.3)), (model.layout(), model.logit(0.3)));
        // More than one pass.
        let images: Vec<_> = test_images().into_iter().cycle().take(19).collect();
        let raw = |embeddings: Vec<crate::Embedding>| embeddings.iter().map(crate::Embedding::raw).collect::<Vec<_>>();
        let (found, expected) = (graphs.encode_images(&images).unwrap(), model.encode_images(&images).unwrap());
        assert_near(name, &found, &raw(expected));
        assert_near(name, &found[..1], &raw(graphs.encode_images(&images[..1]).unwrap()));
        let texts = texts(&folder);
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        let found = graphs.encode_texts(&texts).unwrap();
        assert_near(name, &found, &raw(model.encode_texts(&texts).unwrap()));
        assert_near(name, &found, &Expected::open(&folder).rows("texts"));
        let many: Vec<&str> = texts.iter().copied().cycle().take(83).collect();
        assert_near(name, &graphs.encode_texts(&many).unwrap(), &raw(model.encode_texts(&many).unwrap()));
        assert!(graphs.encode_images(&[]).unwrap().is_empty() && graphs.encode_texts(&[]).unwrap().is_empty());
    }
}

#[test]
fn a_graph_gives_the_embeddings_of_a_sentence_encoder() {
    let Some(runtime) = runtime() else { return };
    let copy = Copy::of("bert");
    let texts = texts(copy.path());
    let texts: Vec<&str> = texts.iter().map(String::as_str).cycle().take(37).collect();
    for first in [false, true] {
        if first {
            std::fs::create_dir(copy.path().join("1_Pooling")).unwrap();
            copy.write("1_Pooling/config.json", json!({"pooling_mode_cls_token": true}).to_string().as_bytes());
            // The other place of a graph.
            copy.write("model.onnx", &copy.bytes("onnx/model.onnx"));
            copy.remove("onnx/model.onnx");
        }
        assert!(OnnxSentenceEncoder::is_in(copy.path()));
        let graph = OnnxSentenceEncoder::open(copy.path(), &runtime, THREADS).unwrap();
        let model = SentenceEncoder::open(copy.path(), Precision::F32).unwrap();
        let expected: Vec<Vec<f32>> = model.encode_texts(&texts).unwrap().iter().map(crate::Embedding::raw).collect();
        assert_near("bert", &graph.encode_texts(&texts).unwrap(), &expected);
    }
    copy.remove("model.onnx");
    assert!(!OnnxSentenceEncoder::is_in(copy.path()) && !OnnxImageTextModel::is_in(copy.path()));
}

/// The graph of all-MiniLM-L6-v2 is made by `make_onnx.py --minilm`. No package has it, so no test requires it.
#[test]
fn a_real_sentence_encoder_is_the_same_as_a_graph() {
    let (Some(runtime), Some(folder)) = (runtime(), mini_lm()) else { return };
    if !OnnxSentenceEncoder::is_in(&folder) {
        eprintln!(
            "SKIPPED: no graph of all-MiniLM-L6-v2, run tests/fixtures/make_onnx.py --minilm {}",
            folder.display()
        );
        return;
    }
    let graph = OnnxSentenceEncoder::open(&folder, &runtime, THREADS).unwrap();
    let model = SentenceEncoder::open(&folder, Precision::F32).unwrap();
    let texts = ["grey matter", "the swollen part", "", "thin filaments around the shock front", "bone"];
    let pairs = graph.encode_texts(&texts).unwrap().into_iter().zip(model.encode_texts(&texts).unwrap());
    for (found, expected) in pairs {
        assert!(found.unit().iter().zip(expected.unit()).all(|(a, b)| (a - b).abs() <= 1e-5), "{found:?}");
    }
}

fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut bytes = bytes.to_vec();
    while let Some(at) = bytes.windows(from.len()).position(|part| part == from.as_bytes()) {
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    }
    bytes
}

#[test]
fn other_graphs_are_refused_by_the_names_in_them() {
    let Some(runtime) = runtime() else { return };
    let error = |copy: &Copy| one_line(|| OnnxImageTextModel::open(copy.path(), &runtime, THREADS).err());
    let (vision, text) = ("onnx/vision_model.onnx", "onnx/text_model.onnx");
    let copy = Copy::of("clip-gelu");
    let (of_vision, of_text) = (copy.bytes(vision), copy.bytes(text));
    for (graph, bytes, parts) in [
        (
            vision,
            replaced(&of_vision, "pixel_values", "pixel_valuez"),
            &["input `pixel_valuez` is unknown", "`pixel_values`"][..],
        ),
        (vision, replaced(&of_vision, "image_embeds", "image_embedz"), &["`image_embedz`", "`image_embeds` is needed"]),
        (vision, of_text.clone(), &["input `input_ids` is unknown"]),
        (vision, copy.bytes("onnx/vision_model_fp16.onnx"), &["input `pixel_values`", "elements of f16, not of f32"]),
        (vision, of_vision[..of_vision.len() / 2].to_vec(), &["does not read it", "get it again"]),
        (vision, b"none".to_vec(), &["does not read it"]),
        (vision, Vec::new(), &["does not read it"]),
        (
            text,
            replaced(&of_text, "attention_mask", "attention_musk"),
            &["`attention_musk` is unknown", "`attention_mask`"],
        ),
        (text, replaced(&of_text, "input_ids", "input_idz"), &["`input_idz` is unknown"]),
    ] {
        copy.write(graph, &bytes);
        assert_names(&error(&copy), parts);
        assert_names(&error(&copy), &[graph]);
        copy.write(vision, &of_vision);
        copy.write(text, &of_text);
    }
    for (pointer, value, parts) in [
        ("/projection_dim", json!(13), &[vision, "output `image_embeds`", "not a batch of [13]"][..]),
        ("/vision_config/image_size", json!(40), &["size"]),
        ("/vision_config/patch_size", json!(64), &["patch_size"]),
    ] {
        let copy = Copy::of("clip-gelu");
        copy.set("config.json", pointer, value);
        assert_names(&error(&copy), parts);
    }
    // The library would wait for the writer of a pipe that a graph takes its weights from.
    nix::unistd::mkfifo(&copy.path().join("onnx/weights"), nix::sys::stat::Mode::S_IRWXU).unwrap();
    assert_names(&error(&copy), &["onnx/weights", "it is a pipe"]);
    copy.remove("onnx/weights");
    copy.remove(text);
    assert!(!OnnxImageTextModel::is_in(copy.path()));
    assert_names(&error(&copy), &[text, "No such file"]);
}

#[test]
fn texts_of_a_fixed_length_are_those_of_the_context() {
    let Some(runtime) = runtime() else { return };
    let copy = Copy::of("siglip");
    copy.set("config.json", "/text_config/max_position_embeddings", json!(20));
    let error = one_line(|| OnnxImageTextModel::open(copy.path(), &runtime, THREADS).err());
    assert_names(&error, &["text_model.onnx", "input `input_ids`", "not a batch of [20]"]);
    // The weights of this graph are a file of their own.
    let copy = Copy::of("siglip");
    copy.remove("onnx/text_model.onnx_data");
    let error = one_line(|| OnnxImageTextModel::open(copy.path(), &runtime, THREADS).err());
    assert_names(&error, &["onnx/text_model.onnx", "does not read it", "text_model.onnx_data"]);
    let copy = Copy::of("bert");
    copy.set("config.json", "/hidden_size", json!(32));
    let error = one_line(|| OnnxSentenceEncoder::open(copy.path(), &runtime, THREADS).err());
    assert_names(&error, &["model.onnx", "output `last_hidden_state`", "not a batch of [16, 32]"]);
}

#[test]
fn several_threads_share_a_graph() {
    let Some(runtime) = runtime() else { return };
    let graph = OnnxSentenceEncoder::open(&fixtures().join("bert"), &runtime, NonZeroUsize::MAX).unwrap();
    let expected = graph.encode_texts(&["bone"]).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| (0..20).for_each(|_| assert_eq!(graph.encode_texts(&["bone"]).unwrap(), expected)));
        }
    });
}

#[test]
fn an_absent_library_is_named() {
    let error = one_line(|| OnnxRuntime::load(Path::new("/nowhere/libonnxruntime.so")).err());
    assert_names(&error, &["/nowhere/libonnxruntime.so", "No such file", "pip download onnxruntime"]);
}
