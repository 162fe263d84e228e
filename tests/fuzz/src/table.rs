//! The table of targets. A new reader is one function and one row here, and a line in [`crate::seeds`].

use crate::stage::Stage;
use crate::target::{Memory, Target};
use crate::targets::{
    arrays, clusters, edits, encoders, endpoints, language, messages, projects, scenes, sounds, texts, volumes,
};

const fn target(
    name: &'static str,
    about: &'static str,
    memory: Memory,
    longest: usize,
    read: fn(&Stage, &[u8]) -> bool,
) -> Target {
    Target { name, about, longest, memory, read }
}

/// Every target.
pub const TARGETS: &[Target] = &[
    target("ply", "PLY of text and binary: 3DGS, editable, iVR-GS", Memory::NUMBERS, 4096, scenes::ply),
    target("compressed-ply", "compressed PLY", Memory::NUMBERS, 8192, scenes::compressed_ply),
    target("splat", "`.splat`", Memory::NUMBERS, 1024, scenes::splat),
    target("scene-file", "scene.toml", Memory::PARTS, 4096, scenes::scene_file),
    target(
        "palette-zip",
        "the zip around a palette's checkpoint",
        Memory { free: 32 << 20, each: 1024 },
        4096,
        scenes::palette_zip,
    ),
    target("palette-pickle", "the pickle of a palette", Memory::PARTS, 2048, scenes::palette_pickle),
    target("npy", "NumPy arrays: masks, labels, indices, numbers", Memory::NUMBERS, 2048, arrays::npy),
    target("raw-volume", "raw voxels, plain, gzip and zstd, with their names", Memory::EXPANDED, 2048, volumes::raw),
    target("nrrd", "NRRD with its voxels", Memory::EXPANDED, 2048, volumes::nrrd),
    target("nhdr", "NRRD header with voxels in another file", Memory::EXPANDED, 2048, volumes::nhdr),
    target(
        "metaimage",
        "MetaImage, with its voxels and with voxels in another file",
        Memory::EXPANDED,
        2048,
        volumes::metaimage,
    ),
    target("vti", "VTK image data", Memory::EXPANDED, 4096, volumes::vti),
    target("vtu", "VTK unstructured grids", Memory::EXPANDED, 4096, volumes::vtu),
    target("legacy-vtk", "legacy VTK files", Memory::EXPANDED, 4096, volumes::legacy_vtk),
    target("nifti", "NIfTI-1 and NIfTI-2", Memory::EXPANDED, 2048, volumes::nifti),
    target("nifti-gzip", "compressed NIfTI", Memory::EXPANDED, 2048, volumes::nifti_gzip),
    target("dicom", "DICOM slices and files of many frames", Memory::EXPANDED, 2048, volumes::dicom),
    target("transfer-function", "transfer functions", Memory::PARTS, 4096, volumes::transfer_function),
    target("camera", "cameras", Memory::PARTS, 2048, scenes::camera),
    target("camera-path", "camera paths", Memory::PARTS, 4096, scenes::camera_path),
    target("strokes", "stroke files", Memory::PARTS, 4096, texts::strokes),
    target(
        "launch-file",
        "launch files, their overrides, and the first steps of the supervisor",
        Memory::PARTS,
        4096,
        texts::launch_file,
    ),
    target("demo-script", "scripts of the demo", Memory::PARTS, 4096, texts::demo_script),
    target("graph", "graphs for a random walk", Memory::PARTS, 2048, texts::graph),
    target("certificate", "certificates in PEM form", Memory::PARTS, 4096, texts::certificate),
    target("log-line", "lines of services' logs", Memory::PARTS, 1024, texts::log_line),
    target("clusters", "entries of the cache of clusters", Memory::NUMBERS, 8192, clusters::cache),
    target("project", "project files", Memory::EXPANDED, 65_536, projects::project),
    target("message", "every message of the contract, typed and as JSON", Memory::PARTS, 4096, messages::message),
    target(
        "received",
        "key, encoding, envelope and payload as the bus receives them",
        Memory::PARTS,
        2048,
        messages::received,
    ),
    target(
        "replica",
        "snapshots and events, as replicas of the scene take them",
        Memory::PARTS,
        4096,
        messages::replica,
    ),
    target(
        "edits",
        "sequences of commands to the scene, compared with replicas, undo and restarts",
        Memory { free: 16 << 20, each: 16_384 },
        2048,
        edits::commands,
    ),
    target(
        "utterance",
        "sentences, and the commands that they mean",
        Memory { free: 16 << 20, each: 16_384 },
        160,
        language::utterance,
    ),
    target("model-answer", "answers of language models", Memory::PARTS, 2048, language::model_answer),
    target("series", "files that name the time steps of a series", Memory::PARTS, 2048, volumes::series),
    target("wav", "WAV files, and streams of unknown length", Memory::NUMBERS, 2048, sounds::wav),
    target(
        "whisper-model",
        "models of speech in CTranslate2's layout",
        Memory { free: 32 << 20, each: 64 },
        65_536,
        sounds::whisper_model,
    ),
    target(
        "piper-voice",
        "voices of Piper in ONNX files",
        Memory { free: 256 << 20, each: 256 },
        65_536,
        sounds::piper_voice,
    ),
    target(
        "speech-text",
        "configurations and tokenizers of models of speech, and descriptions of voices",
        Memory { free: 256 << 20, each: 4096 },
        16_384,
        sounds::speech_text,
    ),
    target(
        "encoder-text",
        "configurations and tokenizers of encoders",
        Memory { free: 32 << 20, each: 4096 },
        4096,
        encoders::encoder_text,
    ),
    target(
        "encoder-weights",
        "weights of encoders in safetensors files",
        Memory { free: 32 << 20, each: 64 },
        65_536,
        encoders::encoder_weights,
    ),
    target(
        "query-picture",
        "pictures of queries in PNG files",
        // 4096 × 4096 pixels of four bytes, and then of three.
        Memory { free: 160 << 20, each: 64 },
        2048,
        encoders::query_picture,
    ),
    target("stored-embedding", "stored embeddings", Memory::NUMBERS, 2048, encoders::stored_embedding),
    target("chat-completion", "answers of servers of language models", Memory::PARTS, 2048, endpoints::chat_completion),
    target("transcription", "answers of servers of speech", Memory::PARTS, 2048, endpoints::transcription),
];

/// The target of this name.
#[must_use]
pub fn named(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}
