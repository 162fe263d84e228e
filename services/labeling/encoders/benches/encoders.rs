//! Milliseconds for an image or a text against the error of its direction, for each precision of weights.
//!
//! The time is the shortest of many rounds, since other programs only ever add to it. Beside it stands the processors' time of all
//! cores for an item of the largest batch.
//! `beside.py` measures PyTorch and ONNX Runtime in the same way, and alone measures ONNX Runtime with ViT-B/32.
//!
//! `cargo bench -p sg-encoders [-- image text sentence]`. ViT-B/32 has random weights. The sentence encoder is all-MiniLM-L6-v2
//! where `ops/models.sh` has got it, else of its size with random weights. ONNX Runtime runs it too, where `ops/models.sh` has got
//! the library, or `SUPERGAUSSIAN_ONNXRUNTIME` names it, and `tests/fixtures/make_onnx.py --minilm FOLDER` has made the graph.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a bench prints its table and fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use serde_json::json;
use sg_encoders::{
    Embedding, ImageEncoder, ImageTextModel, OnnxRuntime, OnnxSentenceEncoder, Pixels, Precision, RgbImage,
    SentenceEncoder, TextEncoder,
};

const PRECISIONS: [Precision; 3] = [Precision::F32, Precision::F16, Precision::Int8];
const BATCHES: [usize; 3] = [1, 5, 8];
/// Repetitions, of which the shortest counts.
const ROUNDS: usize = 20;
const SEED: u64 = 1;

/// Labels as people give them.
const TEXTS: [&str; 8] = [
    "aneurysm sac",
    "the swollen part of the vessel",
    "grey matter",
    "left lung",
    "handle of the cup",
    "the bright core in the middle",
    "bone",
    "thin filaments around the shock front",
];

fn main() {
    let chosen: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let runs = |name: &str| chosen.is_empty() || chosen.iter().any(|argument| argument == name);
    let folder = tempfile::tempdir().unwrap();
    println!(
        "| input | weights | opened in | {} | cores | greatest error |",
        BATCHES.map(|n| format!("batch {n}")).join(" | ")
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    let image_text = |precision| ImageTextModel::with_random_weights(&fixture("vit-b-32"), precision, SEED).unwrap();
    if runs("image") {
        let images: Vec<RgbImage> = (0..8).map(rendering).collect();
        table("image, ViT-B/32", image_text, |model, count| model.encode_images(&images[..count]).unwrap());
    }
    if runs("text") {
        table("text, ViT-B/32", image_text, |model, count| model.encode_texts(&TEXTS[..count]).unwrap());
    }
    if runs("sentence") {
        let real = mini_lm();
        let name = if real.is_some() { "text, MiniLM" } else { "text, MiniLM with random weights" };
        let random = folder.path().join("minilm");
        write_mini_lm(&random);
        let open = |precision| match &real {
            Some(folder) => SentenceEncoder::open(folder, precision).unwrap(),
            None => SentenceEncoder::with_random_weights(&random, precision, SEED).unwrap(),
        };
        let exact = table(name, open, |model, count| model.encode_texts(&TEXTS[..count]).unwrap());
        if let Some((folder, library)) = real.filter(|folder| OnnxSentenceEncoder::is_in(folder)).zip(onnx_runtime()) {
            let runtime = OnnxRuntime::load(&library).unwrap();
            let threads = std::thread::available_parallelism().unwrap();
            let weights = format!("F32, ONNX Runtime {}", runtime.version());
            let open = || OnnxSentenceEncoder::open(&folder, &runtime, threads).unwrap();
            row(name, &weights, Some(&exact), open, |model, count| model.encode_texts(&TEXTS[..count]).unwrap());
        }
    }
}

/// Prints a row for each precision. Gives the embeddings of the first.
fn table<M>(name: &str, open: impl Fn(Precision) -> M, encode: impl Fn(&M, usize) -> Vec<Embedding>) -> Vec<Embedding> {
    let [exact, rounded @ ..] = PRECISIONS;
    let exact = row(name, &format!("{exact:?}"), None, || open(exact), &encode);
    for precision in rounded {
        row(name, &format!("{precision:?}"), Some(&exact), || open(precision), &encode);
    }
    exact
}

/// Prints a row for a model, with the error to `exact`. Gives its embeddings.
fn row<M>(
    name: &str,
    weights: &str,
    exact: Option<&[Embedding]>,
    open: impl FnOnce() -> M,
    encode: impl Fn(&M, usize) -> Vec<Embedding>,
) -> Vec<Embedding> {
    let began = Instant::now();
    let model = open();
    let opened = began.elapsed();
    let encoded = encode(&model, 8);
    let pairs = encoded.iter().zip(exact.unwrap_or(&encoded));
    let error = pairs.map(|(a, b)| 1.0 - a.cosine(b).unwrap()).fold(0.0, f32::max);
    let costs = BATCHES.map(|count| (count as f64, least(|| encode(&model, count))));
    let walls = costs.map(|(count, (wall, _))| format!("{:.1} ms", wall.as_secs_f64() * 1e3 / count));
    let cores = costs.last().map_or(0.0, |(count, (_, cores))| cores.as_secs_f64() * 1e3 / count);
    let opened = opened.as_secs_f64();
    println!("| {name} | {weights} | {opened:.1} s | {} | {cores:.0} ms | {error:.1e} |", walls.join(" | "));
    encoded
}

/// The least time of several runs, on the wall and on all cores together.
fn least<T>(run: impl Fn() -> T) -> (Duration, Duration) {
    let rounds = (0..ROUNDS).map(|_| {
        let (began, cores) = (Instant::now(), cores_time());
        std::hint::black_box(run());
        (began.elapsed(), cores_time() - cores)
    });
    rounds.fold((Duration::MAX, Duration::MAX), |least, round| (least.0.min(round.0), least.1.min(round.1)))
}

fn cores_time() -> Duration {
    clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).unwrap().into()
}

/// A picture of 512 × 512 pixels, as a capture of a region has.
fn rendering(number: usize) -> RgbImage {
    let side = 512;
    let level = |at: usize| {
        let (x, y, channel) = (at / 3 % side, at / 3 / side, at % 3);
        let (dx, dy) = (x as f32 - 256.0 - 9.0 * number as f32, y as f32 - 256.0);
        let distance = (dx * dx + dy * dy).sqrt() / 128.0;
        (255.0 * (-distance * distance).exp() / (1 + channel + number % 3) as f32) as u8
    };
    RgbImage::new(side, side, Pixels::Bytes((0..3 * side * side).map(level).collect())).unwrap()
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn write_mini_lm(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let config = json!({
        "model_type": "bert", "vocab_size": 30522, "hidden_size": 384, "intermediate_size": 1536, "num_hidden_layers": 6,
        "num_attention_heads": 12, "hidden_act": "gelu", "layer_norm_eps": 1e-12, "max_position_embeddings": 512,
        "type_vocab_size": 2,
    });
    std::fs::write(folder.join("config.json"), config.to_string()).unwrap();
    std::fs::copy(fixture("bert/tokenizer.json"), folder.join("tokenizer.json")).unwrap();
}

fn onnx_runtime() -> Option<PathBuf> {
    let named = std::env::var_os("SUPERGAUSSIAN_ONNXRUNTIME").map(PathBuf::from);
    let cache = directories::ProjectDirs::from("", "", "supergaussian")?.cache_dir().to_owned();
    named.or_else(|| Some(cache.join("models/onnxruntime/libonnxruntime.so")).filter(|library| library.is_file()))
}

fn mini_lm() -> Option<PathBuf> {
    let cache = directories::ProjectDirs::from("", "", "supergaussian")?.cache_dir().to_owned();
    Some(cache.join("models/all-MiniLM-L6-v2")).filter(|folder| folder.join("model.safetensors").is_file())
}
