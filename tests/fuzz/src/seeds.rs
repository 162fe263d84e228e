//! Right inputs of every target, from which the engine starts. Most come from the project's own writers.

use std::fs;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use rcgen::{CertificateParams, KeyPair};
use sg_clusters::cache::ClusterCache;
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_edit::{EditState, Editor, wire};
use sg_formats::npy::{write_array, write_labels, write_mask};
use sg_formats::{Format, SaveOptions, save};
use sg_proto::bus::Envelope;
use sg_proto::golden::Line;
use sg_proto::prost::{Message as _, Name};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::set_view::Change as ViewChange;
use sg_proto::scene::{
    AdjustTransferFunction, Changes, Color, Command, CommitSelection, ControlPoint, DeleteGaussians, DeleteUnit,
    DuplicateGaussians, Event, ForgetView, KeepView, MergeUnits, NamedView, Orbit, PatientSide, Redo, RenameUnit,
    Reset, RestoreGaussians, SaveUnit, Select, SetBackground, SetColor, SetLight, SetLock, SetOpacity, SetTerm,
    SetTone, SetTransferFunction, SetView, SetVisibility, ShowOnly, Target, TransferFunction, TransformGaussians, Undo,
    ValueColor, ValueRange, ValueScale, ValueWindow, Vector,
};
use sg_scene::mask::Mask;
use sg_scene::model::{Gaussians, Scene};
use sg_scene::synthetic::{samples, test_scene, vessel_and_sac};
use sg_speech::audio::Recording;
use sg_speech::audio::wav::encode_wav;
use supergaussian_scene::project::Project;

use crate::parts::block;
use crate::targets::arrays::LENGTH;
use crate::targets::edits;
use crate::targets::encoders;
use crate::targets::messages::message_input;
use crate::targets::sounds;

/// Gaussians of the seeds.
const GAUSSIANS: usize = 3;

/// The right inputs of a target.
#[must_use]
pub fn of(target: &str) -> Vec<Vec<u8>> {
    match target {
        "ply" => plys(),
        "compressed-ply" => vec![compressed(0), compressed(1)],
        "splat" => vec![saved("a.splat", Format::SPLAT, samples::harmonic(GAUSSIANS, 0, 1))],
        "scene-file" => scene_files(),
        "palette-zip" => vec![zipped()],
        "palette-pickle" => pickles(),
        "npy" => arrays(),
        "raw-volume" => raw_volumes(),
        "nrrd" => nrrds(),
        "nhdr" => vec![nhdr("raw", "data.raw", &voxels()), nhdr("gzip", "data.raw", &gzip(&voxels()))],
        "metaimage" => metaimages(),
        "vti" => vec![vti_ascii(), vti_base64(), vti_appended()],
        "vtu" => vec![vtu("", VTU_CELLS), vtu(" header_type=\"UInt32\"", VTU_QUADRATIC)],
        "legacy-vtk" => [LEGACY_CELLS, LEGACY_OFFSETS, LEGACY_POINTS, LEGACY_GRID].map(Into::into).to_vec(),
        "nifti" => vec![nifti(&voxels()), nifti2(&voxels())],
        "nifti-gzip" => vec![gzip(&nifti(&voxels()))],
        "dicom" => vec![dicom(2, 3, 2, &voxels()), dicom(4, 3, 1, &voxels())],
        "transfer-function" => vec![TRANSFER.into(), TRANSFER_LOG.into()],
        "camera" => vec![CAMERA.into()],
        "camera-path" => vec![CAMERA_PATH.into()],
        "strokes" => vec![STROKES.into(), OPERATIONS.into()],
        "launch-file" => {
            vec![LAUNCH.into(), LAUNCH_NODES.into(), [b"#--set defaults.stop=1\n", LAUNCH.as_bytes()].concat()]
        }
        "demo-script" => vec![SCRIPT.into()],
        "graph" => {
            vec![br#"{"nodes":3,"edges":[[0,1,1],[1,2,0.5]],"foreground":[0],"background":[2],"leak":0.1}"#.into()]
        }
        "certificate" => vec![certificate()],
        "log-line" => vec![LOG_LINE.into()],
        "clusters" => vec![cluster_entry()],
        "project" => vec![project(false), project(true)],
        "message" => messages(),
        "received" => received(),
        "replica" => vec![replica()],
        "edits" => edits(),
        "utterance" => UTTERANCES.iter().map(|text| text.as_bytes().to_vec()).collect(),
        "model-answer" => model_answers(),
        "series" => serieses(),
        "wav" => wavs(),
        "whisper-model" => {
            vec![include_bytes!("../../../services/speech/whisper/tests/fixtures/ctranslate2/model.bin").to_vec()]
        }
        "piper-voice" => vec![include_bytes!("../../../services/speech/piper/tests/fixtures/made.onnx").to_vec()],
        "speech-text" => (0..).zip(sounds::TEXTS).map(|(at, (_, text))| [&[at][..], text].concat()).collect(),
        "encoder-text" => of_models(&encoders::TEXTS),
        "encoder-weights" => of_models(&encoders::WEIGHTS),
        "query-picture" => pictures(),
        "stored-embedding" => vec![embedding(&[0.5, -2.0, 0.25]), embedding(&[1.0])],
        "chat-completion" => COMPLETIONS.map(Into::into).to_vec(),
        "transcription" => TRANSCRIPTIONS.map(Into::into).to_vec(),
        _ => Vec::new(),
    }
}

/// A right file for each choice, after the byte that chooses it.
fn of_models(choices: &[(encoders::Model, bool, &str)]) -> Vec<Vec<u8>> {
    let file = |(at, (model, _, name)): (usize, &(encoders::Model, bool, &str))| {
        let (_, bytes) = model.iter().find(|(known, _)| known == name).unwrap();
        [&[at as u8], *bytes].concat()
    };
    choices.iter().enumerate().map(file).collect()
}

/// 3 × 2 pixels of RGB, and as many of a palette with opacities.
fn pictures() -> Vec<Vec<u8>> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let content = [&kind[..], data].concat();
        let mut check = flate2::Crc::new();
        check.update(&content);
        [&(data.len() as u32).to_be_bytes()[..], &content, &check.sum().to_be_bytes()].concat()
    };
    let picture = |color: u8, rows: &[u8], palette: Vec<u8>| {
        let header = [0, 0, 0, 3, 0, 0, 0, 2, 8, color, 0, 0, 0];
        [
            b"\x89PNG\r\n\x1a\n".to_vec(),
            chunk(b"IHDR", &header),
            palette,
            chunk(b"IDAT", &zlib(rows)),
            chunk(b"IEND", &[]),
        ]
        .concat()
    };
    let palette = [chunk(b"PLTE", &[9, 8, 7, 60, 50, 40]), chunk(b"tRNS", &[0, 128])].concat();
    vec![
        picture(2, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1], Vec::new()),
        picture(3, &[0, 0, 1, 0, 0, 1, 1, 0], palette),
    ]
}

/// A stored embedding of five pictures. The target adds the checksum.
fn embedding(values: &[f32]) -> Vec<u8> {
    let values: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    [&b"SGEMBED1"[..], &5_u32.to_le_bytes()[..], &values].concat()
}

const COMPLETIONS: [&str; 2] = [
    r#"{"model":"m-1","choices":[{"finish_reason":"stop","message":{"role":"assistant","content":"hello"}}],"usage":{"prompt_tokens":5,"completion_tokens":2}}"#,
    r#"{"choices":[{"message":{"content":"{\"unit\": \"sac\"}","refusal":null}}]}"#,
];
const TRANSCRIPTIONS: [&str; 3] = [
    r#"{"text":"hide the sac"}"#,
    r#"{"text":"hide","segments":[{"avg_logprob":-0.2,"no_speech_prob":0.01},{"avg_logprob":-1.5,"no_speech_prob":0.9}]}"#,
    r#"{"text":"hide","logprobs":[{"token":"hide","logprob":-0.1}]}"#,
];

/// The file that `write` makes under this name in an empty folder.
fn file(name: &str, write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path);
    fs::read(path).unwrap()
}

fn saved(name: &str, format: Format, gaussians: Gaussians) -> Vec<u8> {
    let scene = Scene::compose(vec![samples::unit("sac", gaussians)], None);
    let options = SaveOptions { format: Some(format), ..SaveOptions::default() };
    file(name, |path| drop(save(path, &scene, &options).unwrap()))
}

/// Gaussians as 3DGS.
pub(crate) fn ply() -> Vec<u8> {
    saved("a.ply", Format::THREE_DGS, samples::harmonic(GAUSSIANS, 0, 1))
}

/// Editable Gaussians.
pub(crate) fn editable_ply() -> Vec<u8> {
    saved("b.ply", Format::OURS, samples::editable_columns(GAUSSIANS, 1))
}

/// Editable Gaussians of iVR-GS whose header names no palette.
pub(crate) fn ply_without_palette() -> Vec<u8> {
    let ply = saved("c.ply", Format::IVRGS, samples::editable_columns(GAUSSIANS, 1));
    let end = b"end_header\n";
    let at = ply.windows(end.len()).position(|w| w == end).unwrap();
    let lines = ply[..at].split_inclusive(|b| *b == b'\n').filter(|line| !line.starts_with(b"comment "));
    [lines.flatten().copied().collect::<Vec<u8>>(), ply[at..].to_vec()].concat()
}

fn plys() -> Vec<Vec<u8>> {
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let properties: String = names.iter().map(|n| format!("property float {n}\n")).collect();
    let ascii = format!(
        "ply\nformat ascii 1.0\ncomment made\nelement vertex 2\n{properties}end_header\n1 0 0 0 0 0 0 -3 -3 -3 1 0 0 0\n2 0 0 0 0 0 0 -3 -3 -3 1 0 0 0\n"
    );
    let big = format!("ply\nformat binary_big_endian 1.0\nelement vertex 1\n{properties}end_header\n");
    let lists = format!(
        "ply\nformat ascii 1.0\nobj_info none\nelement face 1\nproperty list uchar int vertex_indices\n\
         element vertex 1\n{properties}end_header\n3 0 1 2\n1 0 0 0 0 0 0 -3 -3 -3 1 0 0 0\n"
    );
    vec![
        ply(),
        saved("h.ply", Format::THREE_DGS, samples::harmonic(2, 1, 1)),
        editable_ply(),
        saved("c.ply", Format::IVRGS, samples::editable_columns(GAUSSIANS, 1)),
        saved("d.ply", Format::IVRGS_QUANTISED, samples::editable_columns(GAUSSIANS, 1)),
        ascii.into_bytes(),
        [big.as_bytes(), &[0; 4 * 14]].concat(),
        lists.into_bytes(),
    ]
}

fn compressed(degree: u8) -> Vec<u8> {
    saved("e.compressed.ply", Format::COMPRESSED, samples::harmonic(GAUSSIANS, degree, 1))
}

fn scene_files() -> Vec<Vec<u8>> {
    let whole = "schema = 1\n\n[box]\nmin = [0.0, 0.0, 0.0]\nmax = [1.0, 1.0, 1.0]\n\n[[unit]]\nname = \"sac\"\nfile = \"b.ply\"\n\
        palette = [0.5, 0.5, 0.5]\nopacity = 1.0\ntransform = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\n\
        convention = \"ours\"\nshading = \"paper\"\noriented_normals = true\ntransfer_function = \"tf.json\"\n";
    let twice = "schema = 1\n[[unit]]\nname = \"a\"\nfile = \"a.ply\"\n[[unit]]\nname = \"b\"\nfile = \"./a.ply\"\nopacity = 0.5\n";
    vec![whole.into(), twice.into()]
}

/// `((palette, optimiser state), iteration)` as PyTorch pickles it.
const PICKLE: &[u8] = b"\x80\x02((ctorch._utils\n_rebuild_parameter\nq\x00(ctorch._utils\n_rebuild_tensor_v2\nq\x01\
    ((X\x07\x00\x00\x00storageq\x02ctorch\nFloatStorage\nq\x03X\x01\x00\x00\x000q\x04X\x06\x00\x00\x00cuda:0q\x05K\x03tq\x06Q\
    K\x00K\x03\x85q\x07K\x01\x85q\x08\x89ccollections\nOrderedDict\nq\x09)Rq\x0atq\x0bRq\x0c\x88h\x09)Rq\x0dtq\x0eRq\x0f\
    }q\x10(X\x05\x00\x00\x00stateq\x11}q\x12K\x00}q\x13X\x04\x00\x00\x00stepq\x14G\x40\x28\x00\x00\x00\x00\x00\x00ssu\
    tq\x1bM\x40\x9ctq\x1c.";

fn palette_numbers() -> Vec<u8> {
    [0.25_f32, 0.5, 0.75].into_iter().flat_map(f32::to_le_bytes).collect()
}

fn pickles() -> Vec<Vec<u8>> {
    let plain = b"\x80\x02((ctorch._utils\n_rebuild_tensor_v2\n((X\x07\x00\x00\x00storagectorch\nDoubleStorage\n\
        X\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x03tQK\x00K\x03\x85K\x01\x85\x89ccollections\nOrderedDict\n)RtR}tJ\x09\x00\x00\x00t.";
    let doubles: Vec<u8> = [0.25_f64, 0.5, 0.75].into_iter().flat_map(f64::to_be_bytes).collect();
    vec![[block(PICKLE), block(b"little"), palette_numbers()].concat(), [block(plain), block(b"big"), doubles].concat()]
}

fn zipped() -> Vec<u8> {
    use std::io::Write;
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, bytes) in [("a/data.pkl", PICKLE), ("a/byteorder", b"little"), ("a/data/0", &palette_numbers())] {
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn arrays() -> Vec<Vec<u8>> {
    let of = |kind: u8, write: &dyn Fn(&Path)| [vec![kind], file("a.npy", write)].concat();
    vec![
        of(0, &|p| write_mask(p, &Mask::from_fn(LENGTH, |i| i % 3 == 0)).unwrap()),
        of(1, &|p| write_labels(p, &[0, -1, 5]).unwrap()),
        of(1, &|p| write_array(p, &[2], &[1_i64, 30]).unwrap()),
        of(2, &|p| write_array(p, &[2], &[1_u64, 3]).unwrap()),
        of(2, &|p| write_array(p, &[2], &[1_u8, 3]).unwrap()),
        of(3, &|p| write_array(p, &[2, 1], &[1.0_f32, 3.0]).unwrap()),
        of(3, &|p| write_array(p, &[2], &[1.0_f64, 3.0]).unwrap()),
    ]
}

/// The first byte chooses the kind of series: a collection, or JSON.
fn serieses() -> Vec<Vec<u8>> {
    let collection = "<?xml version=\"1.0\"?><VTKFile type=\"Collection\" version=\"0.1\"><Collection>\
        <DataSet timestep=\"0\" part=\"0\" file=\"a.vti\"/><DataSet timestep=\"1.5\" group=\"\" file=\"b.vti\"/></Collection></VTKFile>";
    let list = r#"{"file-series-version":"1.0","files":[{"name":"a.vti","time":0},{"name":"b.vti","time":1.5}]}"#;
    vec![[b"\0", collection.as_bytes()].concat(), [b"\x01", list.as_bytes()].concat()]
}

fn wavs() -> Vec<Vec<u8>> {
    let sound = |rate| Recording { rate, samples: (0..40).map(|at| (at as f32 * 0.3).sin()).collect() };
    let whole = encode_wav(&sound(16_000)).unwrap();
    let mut streamed = encode_wav(&sound(24_000)).unwrap();
    let data = streamed.windows(4).position(|name| name == b"data").unwrap();
    streamed[data + 4..data + 8].fill(0xFF);
    // A tone of 32-bit floats in two channels.
    let header = b"RIFF\x3c\0\0\0WAVEfmt \x10\0\0\0\x03\0\x02\0\x80\xbb\0\0\0\xdc\x05\0\x08\0\x20\0data\x10\0\0\0";
    let floats = [0.5_f32, -0.5, 0.25, 1.0].map(f32::to_le_bytes).concat();
    vec![whole, streamed, [&header[..], &floats].concat()]
}

/// 2 × 3 × 2 voxels of a byte.
fn voxels() -> Vec<u8> {
    (0..12).map(|i| i * 20).collect()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

fn raw_volumes() -> Vec<Vec<u8>> {
    let of = |name: &str, bytes: &[u8]| [block(name.as_bytes()), bytes.to_vec()].concat();
    let wide: Vec<u8> = voxels().into_iter().flat_map(|v| [v, 1]).collect();
    vec![
        of("2x3x2_uint8.raw", &voxels()),
        of("2x3x2_int16_be.raw", &wide),
        of("2x3x1_float32.raw", &wide),
        of("2x3x2_uint8.raw.gz", &gzip(&voxels())),
        of("2x3x2_uint8.raw.zst", &zstd::encode_all(&voxels()[..], 3).unwrap()),
    ]
}

fn nrrds() -> Vec<Vec<u8>> {
    let header = |encoding: &str| {
        format!(
            "NRRD0005\n# made\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 3 2\n\
             space directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,0,1)\nencoding: {encoding}\nendian: little\ncontent: sac\n\n"
        )
    };
    let text: Vec<String> = voxels().iter().map(u8::to_string).collect();
    let short = "NRRD0001\ntype: short\ndimension: 4\nsizes: 1 2 3 2\nspacings: NaN 1 2 3\nencoding: raw\nendian: big\nbyte skip: -1\n\n";
    vec![
        [header("raw").into_bytes(), voxels()].concat(),
        [header("gzip").into_bytes(), gzip(&voxels())].concat(),
        [header("ascii"), text.join(" ")].concat().into_bytes(),
        [short.as_bytes(), &[1; 24]].concat(),
    ]
}

fn nhdr(encoding: &str, file: &str, data: &[u8]) -> Vec<u8> {
    let header = format!(
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 3 2\nspacings: 1 1 2\nencoding: {encoding}\ndata file: {file}\n"
    );
    [block(header.as_bytes()), data.to_vec()].concat()
}

fn metaimages() -> Vec<Vec<u8>> {
    let header = |lines: &str, file: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 1\n\
             AnatomicalOrientation = RAI\nElementSpacing = 1 1 2\nDimSize = 2 3 2\nElementType = MET_UCHAR\n{lines}ElementDataFile = {file}\n"
        )
    };
    let image = |lines: &str, file: &str, data: &[u8]| [block(header(lines, file).as_bytes()), data.to_vec()].concat();
    let text: Vec<String> = voxels().iter().map(u8::to_string).collect();
    vec![
        image("", "LOCAL", &voxels()),
        image("CompressedData = True\n", "LOCAL", &zlib(&voxels())),
        image("BinaryData = False\n", "LOCAL", text.join(" ").as_bytes()),
        image("HeaderSize = -1\nElementByteOrderMSB = True\nName = sac\n", "data.raw", &voxels()),
    ]
}

fn vti(header: &str, arrays: &str, after: &str) -> Vec<u8> {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\"{header}>\
         <ImageData WholeExtent=\"0 1 0 2 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 2\"><Piece Extent=\"0 1 0 2 0 1\">\
         <PointData Scalars=\"d\">{arrays}</PointData></Piece></ImageData>{after}</VTKFile>"
    )
    .into_bytes()
}

fn vti_ascii() -> Vec<u8> {
    let text: Vec<String> = voxels().iter().map(u8::to_string).collect();
    let array = format!("<DataArray type=\"UInt8\" Name=\"d\" format=\"ascii\">{}</DataArray>", text.join(" "));
    vti("", &array, "")
}

fn vti_base64() -> Vec<u8> {
    // Twelve bytes, with their length in front.
    let array = "<DataArray type=\"UInt8\" Name=\"d\" format=\"binary\">DAAAAAAUKDxQZHiMoLTI3A==</DataArray>";
    vti(" header_type=\"UInt32\"", array, "")
}

fn vti_appended() -> Vec<u8> {
    let array = "<DataArray type=\"UInt8\" Name=\"d\" format=\"appended\" offset=\"0\"/>";
    let after = "<AppendedData encoding=\"base64\">_DAAAAAAUKDxQZHiMoLTI3A==</AppendedData>";
    vti(" header_type=\"UInt32\"", array, after)
}

fn vtu(header: &str, piece: &str) -> Vec<u8> {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\"{header}>\
         <UnstructuredGrid>{piece}</UnstructuredGrid></VTKFile>"
    )
    .into_bytes()
}

/// A tetrahedron and a wedge, with values of points and of cells.
const VTU_CELLS: &str = "<Piece NumberOfPoints=\"7\" NumberOfCells=\"2\"><PointData Scalars=\"d\">\
    <DataArray type=\"Float32\" Name=\"d\" format=\"ascii\">0 1 2 3 4 5 6</DataArray></PointData><CellData>\
    <DataArray type=\"UInt8\" Name=\"m\" format=\"ascii\">1 2</DataArray></CellData><Points>\
    <DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\
    0 0 0 1 0 0 0 1 0 0 0 1 1 0 1 0 1 1 0 0 -1</DataArray></Points><Cells>\
    <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 2 1 6 0 1 2 3 4 5</DataArray>\
    <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4 10</DataArray>\
    <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10 13</DataArray></Cells></Piece>";

/// A quadratic tetrahedron with a vector at each point, and its types in base64.
const VTU_QUADRATIC: &str = "<Piece NumberOfPoints=\"10\" NumberOfCells=\"1\"><PointData>\
    <DataArray type=\"Int16\" Name=\"v\" NumberOfComponents=\"2\" format=\"ascii\">\
    0 1 2 3 4 5 6 7 8 9 0 1 2 3 4 5 6 7 8 9</DataArray></PointData><Points>\
    <DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">\
    0 0 0 2 0 0 0 2 0 0 0 2 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 0 1 1</DataArray></Points><Cells>\
    <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 3 4 5 6 7 8 9</DataArray>\
    <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">10</DataArray>\
    <DataArray type=\"UInt8\" Name=\"types\" format=\"binary\">AQAAABg=</DataArray></Cells></Piece>";

const LEGACY_CELLS: &str = "# vtk DataFile Version 3.0\ntwo cells\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n\
    0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10 10\nCELL_DATA 2\n\
    SCALARS m int\nLOOKUP_TABLE default\n1 2\nPOINT_DATA 5\nFIELD f 1\nd 1 5 double\n0 1 2 3 nan\n";

const LEGACY_OFFSETS: &str = "# vtk DataFile Version 5.1\none cell\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
    0 0 0 1 0 0 0 1 0 0 0 1\nMETADATA\nINFORMATION 0\n\nCELLS 2 4\nOFFSETS vtktypeint64\n0 4\n\
    CONNECTIVITY vtktypeint64\n0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nVECTORS v float\n0 1 2 3 4 5 6 7 8 9 0 1\n";

const LEGACY_POINTS: &str = "# vtk DataFile Version 2.0\nvoxels\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n\
    ORIGIN 0 0 0\nSPACING 1 1 2\nPOINT_DATA 8\nSCALARS d unsigned_char 1\nLOOKUP_TABLE default\nabcdefgh\n";

const LEGACY_GRID: &str = "# vtk DataFile Version 4.2\nbricks\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 2 2 3\n\
    X_COORDINATES 2 float\n0 1\nY_COORDINATES 2 float\n0 2\nZ_COORDINATES 3 float\n0 1 4\nPOINT_DATA 12\n\
    SCALARS d%20e short\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7 8 9 10 11\n";

fn nifti(voxels: &[u8]) -> Vec<u8> {
    let mut header = vec![0_u8; 352];
    header[..4].copy_from_slice(&348_i32.to_le_bytes());
    for (at, size) in [3_i16, 2, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        header[40 + 2 * at..][..2].copy_from_slice(&size.to_le_bytes());
    }
    header[70..72].copy_from_slice(&2_i16.to_le_bytes());
    header[72..74].copy_from_slice(&8_i16.to_le_bytes());
    for at in 0..4 {
        header[76 + 4 * at..][..4].copy_from_slice(&1_f32.to_le_bytes());
    }
    header[108..112].copy_from_slice(&352_f32.to_le_bytes());
    header[344..348].copy_from_slice(b"n+1\0");
    [&header[..], voxels].concat()
}

/// A DICOM file of 8-bit frames with places of their own, one millimetre apart.
fn dicom(columns: u16, rows: u16, frames: u16, voxels: &[u8]) -> Vec<u8> {
    let element = |tag: [u16; 2], kind: &str, value: &[u8]| {
        let is_text = !matches!(kind, "US" | "SQ" | "OB");
        let filler = if is_text { b" " } else { b"\0" };
        let filled = [value, &filler[..value.len() % 2]].concat();
        let mut bytes = [tag[0].to_le_bytes(), tag[1].to_le_bytes()].concat();
        bytes.extend(kind.as_bytes());
        if matches!(kind, "SQ" | "OB") {
            bytes.extend([0, 0]);
            bytes.extend((filled.len() as u32).to_le_bytes());
        } else {
            bytes.extend((filled.len() as u16).to_le_bytes());
        }
        [bytes, filled].concat()
    };
    let item =
        |content: Vec<u8>| [&[0xFE, 0xFF, 0, 0xE0][..], &(content.len() as u32).to_le_bytes(), &content].concat();
    let number = |tag: [u16; 2], value: u16| element(tag, "US", &value.to_le_bytes());
    let plane = item(element([0x0020, 0x0037], "DS", b"1\\0\\0\\0\\1\\0"));
    let measures = item(element([0x0028, 0x0030], "DS", b"1\\1"));
    let shared = [element([0x0020, 0x9116], "SQ", &plane), element([0x0028, 0x9110], "SQ", &measures)].concat();
    let frame = |at: u16| {
        let place = item(element([0x0020, 0x0032], "DS", format!("0\\0\\{at}").as_bytes()));
        item(element([0x0020, 0x9113], "SQ", &place))
    };
    let places: Vec<u8> = (0..frames).flat_map(frame).collect();
    [
        vec![0; 128],
        b"DICM".to_vec(),
        element([0x0002, 0x0010], "UI", b"1.2.840.10008.1.2.1"),
        element([0x0020, 0x000E], "UI", b"1.2.3"),
        number([0x0028, 0x0002], 1),
        element([0x0028, 0x0004], "CS", b"MONOCHROME2"),
        element([0x0028, 0x0008], "IS", frames.to_string().as_bytes()),
        number([0x0028, 0x0010], rows),
        number([0x0028, 0x0011], columns),
        number([0x0028, 0x0100], 8),
        number([0x0028, 0x0101], 8),
        number([0x0028, 0x0102], 7),
        number([0x0028, 0x0103], 0),
        element([0x5200, 0x9229], "SQ", &item(shared)),
        element([0x5200, 0x9230], "SQ", &places),
        element([0x7FE0, 0x0010], "OB", voxels),
    ]
    .concat()
}

fn nifti2(voxels: &[u8]) -> Vec<u8> {
    let mut header = vec![0_u8; 544];
    header[..4].copy_from_slice(&540_i32.to_le_bytes());
    header[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    header[12..14].copy_from_slice(&2_i16.to_le_bytes());
    header[14..16].copy_from_slice(&8_i16.to_le_bytes());
    for (at, size) in [3_i64, 2, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        header[16 + 8 * at..][..8].copy_from_slice(&size.to_le_bytes());
    }
    for at in 0..4 {
        header[104 + 8 * at..][..8].copy_from_slice(&1_f64.to_le_bytes());
    }
    header[168..176].copy_from_slice(&544_i64.to_le_bytes());
    [&header[..], voxels].concat()
}

const TRANSFER: &str = r#"{"domain":[0,255],"units":"raw","variable":"v","points":[{"value":0,"color":[0,0,0],"opacity":0},{"value":255,"color":[1,1,1],"opacity":1}],"base_units":[{"name":"a","range":[0,9]},{"name":"b","range":[9,255]}]}"#;
const TRANSFER_LOG: &str = r#"{"domain":[0.1,1],"units":"normalized","scale":"log10","points":[{"value":0.1,"color":[0,0,0],"opacity":0},{"value":1,"color":[1,0.5,1],"opacity":1}],"extra":1}"#;
const CAMERA: &str = r#"{"width":64,"height":48,"fx":50,"fy":50,"cx":32,"cy":24,"world_to_camera":[1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1],"background":[0,0,0]}"#;
const CAMERA_PATH: &str = "# a way\nup 0 0 1\nnear 0.1\nfov 80\npose 0 -3 0 0 0 0\npose 1 -2 0.5 0 0 0\npose 1 -2 0.5 1 0 0\npose 2 0 0 0 0 0\n";

const STROKES: &str = r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[[0.5,0.5,0.5],[1,1,1]],"pressure":[1,0.5],"depth":{"eye":[0,0,0],"reach":0.1}},{"mode":"cluster","kind":"toggle","radius":0,"points":[[0,0,0]]},{"leak":0.03,"threshold":0.5}]}"#;
const OPERATIONS: &str = r#"{"strokes":[{"operation":"grow","distance":0.01},{"operation":"invert"},{"operation":"box","min":[0,0,0],"max":[1,1,1],"combine":"add"},{"operation":"lasso","polygon":[[0,0],[9,0],[9,9]],"camera":{"width":64,"height":64,"fx":64,"fy":64,"cx":32,"cy":32,"world_to_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}}]}"#;
const LAUNCH: &str = "schema = 1\nname = \"demo\"\n[defaults]\nstop = 3\n[service.scene]\nexec = \"program\"\nparams = { scene = \"a.ply\" }\nrestart = \"always\"\nbackoff = { initial_ms = 100, max_ms = 5000 }\nintensity = { restarts = 5, within_s = 30 }\nready = 60\nliveness = 5\nprogress = 300\ncritical = true\nmemory_mib = 4096\nenv = { A = \"b\" }\n[service.selection]\nexec = \"program\"\nafter = { scene = \"ready\" }\n";
const LAUNCH_NODES: &str = "schema = 1\n[bus]\nlisten = \"tls/0.0.0.0:7447\"\nauthority = \"key.pem\"\ncertificate = \"key.pem\"\nkey = \"key.pem\"\n[node.gpu1]\nlease = 5\n[service.render-view]\nexec = \"program\"\non = \"gpu1\"\n";
const SCRIPT: &str = "[[step]]\nstrokes = \"sac.json\"\nrestart = true\n[[step]]\ncapture = \"brushed\"\nhighlight = true\nonly = [\"sac\"]\n[[step]]\nsave = \"sac\"\n[[step]]\nsay = \"make it red\"\n[[step]]\nview = { eye = [-3, 3, -1], target = [1, 1, 1], up = [0, 1, 0], fov_y_degrees = 35 }\n[[step]]\nchaos = true\n";
const LOG_LINE: &str = r#"{"timestamp":"2026-11-21T09:30:05.123456Z","level":"WARN","message":"slow","ms":12.5,"file":"a b","target":"x","span":{"trace_id":"0197a000000000000000000012345678"}}"#;
const UTTERANCES: [&str; 12] = [
    "hide the sac, then frame the parent vessel",
    "make bone 2 half transparent and red",
    "undo the last three changes",
    "show only the selection",
    "turn left by 30 degrees and zoom in twice",
    "save this as “neck”",
    "rename bone 2 to femur",
    "what is visible?",
    "dim the light, blue background",
    "show everything except the sac and undo that",
    "delete it",
    "reset and look from the top",
];

fn certificate() -> Vec<u8> {
    // The bytes are in the corpus: a new key gives other bytes, and the same structure.
    static KEY: LazyLock<KeyPair> = LazyLock::new(|| KeyPair::generate().unwrap());
    let params = CertificateParams::new(vec!["gpu1".to_owned()]).unwrap();
    params.self_signed(&*KEY).unwrap().pem().into_bytes()
}

fn cluster_entry() -> Vec<u8> {
    let (scene, _) = vessel_and_sac(60, 1);
    let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
    let options = ClusteringOptions { max_clusters: 4, ..ClusteringOptions::default() };
    let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cache = ClusterCache::new(folder.path());
    let key = blake3::Hash::from_bytes([0; 32]);
    cache.store(&key, &clustering, &graph).unwrap();
    let mut bytes = fs::read(cache.path(&key)).unwrap();
    // The target adds the checksum.
    bytes.truncate(bytes.len() - blake3::OUT_LEN);
    bytes
}

/// The scene of the project files.
pub(crate) fn project_scene() -> Scene {
    test_scene(&[("bone", 9), ("skin", 4)])
}

fn project(stored: bool) -> Vec<u8> {
    file("a.sgproj", |path| {
        let mut project = Project::open(path, Arc::new(project_scene()), "").unwrap();
        for command in some_commands().into_iter().take(6) {
            let _ = project.apply(&command);
        }
        if stored {
            project.checkpoint().unwrap();
        }
    })
}

fn messages() -> Vec<Vec<u8>> {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../proto/golden");
    let files = fs::read_dir(golden).unwrap().map(|file| fs::read_to_string(file.unwrap().path()).unwrap());
    let mut lines: Vec<Line> =
        files.flat_map(|text| text.lines().map(|line| Line::parse(line).unwrap()).collect::<Vec<_>>()).collect();
    lines.sort_by(|a, b| (&a.message, &a.variant).cmp(&(&b.message, &b.variant)));
    lines.dedup_by(|a, b| a.message == b.message);
    lines.iter().filter_map(|line| message_input(&line.message, &line.bytes)).collect()
}

fn received() -> Vec<Vec<u8>> {
    let envelope = Envelope {
        id: "1".into(),
        traceparent: "00-0197a000000000000000000012345678-0197a00000000000-01".into(),
        sender: "cli".into(),
        epoch: 7,
        deadline_ms: 900,
        ..Envelope::default()
    };
    let payload = some_commands().swap_remove(0).encode_to_vec();
    let encoding = format!("application/protobuf;{}", Command::full_name());
    let of = |key: &str| {
        [block(key.as_bytes()), block(encoding.as_bytes()), block(&envelope.encode_to_vec()), payload.clone()].concat()
    };
    vec![of("sg/demo/scene/cmd/apply"), of("sg/demo/@node/gpu1/render-view/view.3/scene/cmd/apply")]
}

fn editor() -> Editor {
    let scene = edits::scene();
    let state = EditState::of_scene(&scene, "scene.toml", "hash");
    Editor::new(scene, state)
}

fn replica() -> Vec<u8> {
    let mut editor = editor();
    let snapshot = Some(editor.message(true));
    let events: Vec<Event> =
        some_commands().iter().filter_map(|command| editor.apply(command).ok()).map(|applied| applied.event).collect();
    Changes { revision: editor.state().revision(), events: events.into_iter().take(8).collect(), snapshot }
        .encode_to_vec()
}

fn edits() -> Vec<Vec<u8>> {
    let commands: Vec<Vec<u8>> = some_commands().iter().map(|command| block(&command.encode_to_vec())).collect();
    commands.chunks(5).map(<[Vec<u8>]>::concat).chain([commands.concat()]).collect()
}

/// Commands of every kind.
fn some_commands() -> Vec<Command> {
    let on =
        |names: &[&str]| Some(Target { units: names.iter().map(|n| (*n).to_owned()).collect(), ..Target::default() });
    let selection = || Some(Target { selection: true, ..Target::default() });
    let others = Some(Target { complement: true, ..on(&["bone"]).unwrap_or_default() });
    let everything = Target { everything: true, ..Target::default() };
    let red = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    let mask = Some(wire::encode_mask(&Mask::from_fn(60, |i| (10..30).contains(&i))));
    let view = |change| Action::SetView(SetView { change: Some(change) });
    let orbit = ViewChange::Orbit(Orbit { azimuth_degrees: 30.0, elevation_degrees: -10.0 });
    let actions = [
        Action::SetColor(SetColor { target: on(&["bone"]), color: red }),
        Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() }),
        Action::SaveUnit(SaveUnit { name: "sac".into(), replace: false }),
        Action::SetVisibility(SetVisibility { target: on(&["sac"]), visible: false }),
        Action::Undo(Undo { steps: 2 }),
        Action::Redo(Redo { steps: 1 }),
        Action::SetOpacity(SetOpacity { target: others, factor: 0.5, relative: true }),
        Action::ShowOnly(ShowOnly { target: selection() }),
        Action::Select(Select { target: Some(everything.clone()), operation: 1 }),
        Action::RenameUnit(RenameUnit { name: "sac".into(), new_name: "neck".into() }),
        Action::SetLight(SetLight { ambient: Some(0.5), relative: false, ..SetLight::default() }),
        Action::SetBackground(SetBackground { color: red }),
        Action::SetTerm(SetTerm { term: 2 }),
        view(ViewChange::Named(NamedView::Top.into())),
        view(orbit),
        view(ViewChange::Zoom(1.5)),
        view(ViewChange::Focus(everything)),
        Action::DeleteUnit(DeleteUnit { name: "neck".into() }),
        Action::DeleteGaussians(DeleteGaussians { target: selection() }),
        Action::RestoreGaussians(RestoreGaussians {}),
        Action::TransformGaussians(TransformGaussians {
            target: selection(),
            pivot: Some(Vector { x: 1.0, y: 2.0, z: 3.0 }),
            shift: Some(Vector { x: 0.5, y: 0.0, z: -0.5 }),
            axis: Some(Vector { x: 0.0, y: 0.0, z: 1.0 }),
            degrees: 30.0,
            factor: Some(1.5),
            ..TransformGaussians::default()
        }),
        Action::TransformGaussians(TransformGaussians {
            target: selection(),
            restore: true,
            ..TransformGaussians::default()
        }),
        Action::SetLock(SetLock { target: selection(), locked: true }),
        Action::Reset(Reset {}),
        Action::MergeUnits(MergeUnits { units: vec!["bone".to_owned(), "skin".to_owned()], name: "c".to_owned() }),
        Action::SetTone(SetTone {
            target: on(&["bone"]),
            saturation: Some(0.5),
            brightness: Some(1.5),
            temperature: Some(-0.25),
            relative: true,
        }),
        Action::TransformGaussians(TransformGaussians {
            target: selection(),
            towards: PatientSide::Anterior.into(),
            distance: 5.0,
            millimetres: true,
            ..TransformGaussians::default()
        }),
        Action::DuplicateGaussians(DuplicateGaussians { target: selection(), name: String::new() }),
        Action::DuplicateGaussians(DuplicateGaussians { target: on(&["bone"]), name: "twin".to_owned() }),
        Action::KeepView(KeepView { name: "entry".to_owned() }),
        Action::ForgetView(ForgetView { name: "entry".to_owned() }),
        Action::SetTransferFunction(SetTransferFunction::default()),
        Action::AdjustTransferFunction(AdjustTransferFunction {
            change: Some(Change::Window(ValueWindow {
                level: Some(500.0),
                window_factor: Some(2.0),
                ..ValueWindow::default()
            })),
        }),
        Action::AdjustTransferFunction(AdjustTransferFunction {
            change: Some(Change::Color(ValueColor {
                range: Some(ValueRange { low: Some(20.0), high: Some(900.0) }),
                color: red,
            })),
        }),
        Action::SetTransferFunction(SetTransferFunction {
            function: Some(TransferFunction {
                low: 1.0,
                high: 1000.0,
                normalized: false,
                scale: ValueScale::Log10.into(),
                points: vec![
                    ControlPoint { value: 10.0, color: red, opacity: 0.0 },
                    ControlPoint { value: 100.0, color: red, opacity: 0.8 },
                ],
            }),
        }),
    ];
    let numbered = (1..).zip(actions);
    numbered.map(|(n, action)| Command { id: format!("c{n}"), expected_revision: 0, action: Some(action) }).collect()
}

fn model_answers() -> Vec<Vec<u8>> {
    let of = |question: u8, spoken: &str, answer: &str| {
        [vec![question], block(spoken.as_bytes()), answer.as_bytes().to_vec()].concat()
    };
    let hide =
        r#"{"clauses":[{"words":"hide the sac","act":"ACT_HIDE","target":{"names":["sac"]}}],"not_understood":[]}"#;
    vec![
        of(0, "hide the sac", hide),
        of(0, "hide the sac", &format!("```json\n{hide}\n```")),
        of(1, "bag", r#"{"unit": "sac"}"#),
        of(1, "bag", r#"{"unit": null}"#),
        of(2, "make the sac red", "The sac is #ff0000 now: coloured sac #ff0000."),
    ]
}
