//! The readers of the command line: a right file for each, and the words that make a command read a file.

use std::path::Path;
use std::sync::LazyLock;

use sg_formats::npy::{write_array, write_labels, write_mask};
use sg_formats::{Format, SaveOptions, save};
use sg_scene::mask::Mask;
use sg_scene::synthetic::samples;
use sg_speech::audio::Recording;
use sg_speech::audio::wav::encode_wav;

use crate::case::{Case, Content, Ending};

/// Gaussians of the right scenes.
pub(crate) const GAUSSIANS: usize = 60;

/// A reader of the command line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader {
    /// Its name in titles.
    pub(crate) name: &'static str,
    /// The ending of its files, or the whole name where the command knows the name itself.
    pub(crate) ending: &'static str,
    /// The folder of a model, and names of files in it, that stand beside the hostile file in `model`.
    beside: (&'static str, &'static [&'static str]),
    /// Words of the command; `{}` stands for the file.
    words: &'static [&'static str],
    /// Whether mistakes come with lines of the file.
    pub(crate) shows_lines: bool,
}

const fn reader(name: &'static str, ending: &'static str, words: &'static [&'static str]) -> Reader {
    Reader { name, ending, beside: ("", &[]), words, shows_lines: false }
}

/// The reader of a file in a model's folder.
const fn in_model(
    name: &'static str,
    ending: &'static str,
    beside: (&'static str, &'static [&'static str]),
    words: &'static [&'static str],
) -> Reader {
    Reader { beside, ..reader(name, ending, words) }
}

/// Small models whose weights are random, by their folder below `services`.
const CLIP: (&str, &[&str]) = (
    "labeling/encoders/tests/fixtures/clip-gelu",
    &["config.json", "preprocessor_config.json", "tokenizer.json", "model.safetensors"],
);
const OPEN_CLIP: (&str, &[&str]) = (
    "labeling/encoders/tests/fixtures/open-clip",
    &["open_clip_config.json", "tokenizer.json", "open_clip_model.safetensors"],
);
const BERT: (&str, &[&str]) =
    ("labeling/encoders/tests/fixtures/bert", &["config.json", "tokenizer.json", "model.safetensors"]);
const WHISPER: (&str, &[&str]) = (
    "speech/whisper/tests/fixtures/english",
    &["config.json", "generation_config.json", "tokenizer.json", "model.safetensors"],
);
const WHISPER_CTRANSLATE2: (&str, &[&str]) =
    ("speech/whisper/tests/fixtures/ctranslate2", &["config.json", "tokenizer.json", "model.bin"]);
const PIPER: (&str, &[&str]) = ("speech/piper/tests/fixtures", &["made.onnx", "made.onnx.json"]);

/// Words that make a command read a model.
const LISTEN: &[&str] = &["speech", "listen", "right.wav", "--recognizer", "whisper", "--model", "model"];
const SPEAK: &[&str] =
    &["speech", "speak", "abc", "--synthesizer", "piper", "--voice-model", "model", "--out", "to.wav"];
const LOOK: &[&str] = &["labeling", "find", "right.ply", "--picture", "right.png", "--image-encoder", "model"];
const MEAN: &[&str] = &["labeling", "find", "right.ply", "bone", "--text-encoder", "model"];

/// Every reader.
pub(crate) const READERS: [Reader; 57] = [
    reader("ply", ".ply", &["scene", "info", "{}"]),
    reader("ascii", ".ply", &["scene", "convert", "{}", "to.splat"]),
    reader("editable", ".ply", &["scene", "info", "{}", "--json"]),
    reader("ivrgs", ".ply", &["scene", "convert", "{}", "to.ply"]),
    reader("quantised", ".ply", &["scene", "info", "{}"]),
    reader("compressed", ".compressed.ply", &["render", "{}", "--out", "to.png", "--backend", "cpu"]),
    reader("splat", ".splat", &["selection", "cluster", "{}", "--out", "to.npy"]),
    reader("scene", ".toml", &["scene", "info", "{}"]),
    reader("palette", "palette.pth", &["scene", "info", "palette.ply"]),
    reader("labels", ".npy", &["render", "right.ply", "--out", "to.png", "--show", "clusters", "--clusters", "{}"]),
    reader("mask", ".npy", &["render", "right.ply", "--out", "to.png", "--mask", "{}"]),
    reader("seeds", ".npy", &["selection", "cluster", "right.ply", "--out", "to.npy", "--seeds", "{}", "--cell", "1"]),
    reader(
        "truth",
        ".npy",
        &["selection", "select", "right.ply", "--strokes", "right.json", "--out", "to.npy", "--truth", "{}"],
    ),
    reader(
        "clusters",
        ".npy",
        &["selection", "select", "right.ply", "--strokes", "right.json", "--out", "to.npy", "--clusters", "{}"],
    ),
    reader("camera", ".json", &["render", "right.ply", "--out", "to.png", "--camera", "{}"]),
    reader(
        "camera path",
        ".txt",
        &[
            "render",
            "right.ply",
            "--out",
            "to",
            "--camera-path",
            "{}",
            "--frames",
            "2",
            "--width",
            "16",
            "--height",
            "16",
        ],
    ),
    reader("strokes", ".json", &["selection", "select", "right.ply", "--strokes", "{}", "--out", "to.npy"]),
    reader("graph", ".json", &["selection", "solve", "{}", "--out", "to.json"]),
    reader(
        "transfer",
        ".json",
        &["fit", "right_8x8x8_uint8.raw", "--initial-only", "--out", "to", "--transfer-function", "{}"],
    ),
    reader("raw", "_8x8x8_uint8.raw", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("raw.gz", "_8x8x8_uint8.raw.gz", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("raw.zst", "_8x8x8_uint8.raw.zst", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("nrrd", ".nrrd", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("metaimage", ".mha", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("vti", ".vti", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("vtu", ".vtu", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("legacy vtk", ".vtk", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("nifti", ".nii", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("dicom", ".dcm", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader(
        "truth volume",
        "_8x8x8_uint8.raw",
        &["fit", "right_8x8x8_uint8.raw", "--initial-only", "--out", "to", "--labels", "{}", "--out-truth", "to.npy"],
    ),
    reader(
        "label names",
        ".txt",
        &["fit", "right_8x8x8_uint8.raw", "--initial-only", "--out", "to", "--label-units", "--label-names", "{}"],
    ),
    reader("nhdr", ".nhdr", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("collection", ".pvd", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("series", ".vti.series", &["fit", "{}", "--initial-only", "--out", "to"]),
    reader("steps", ".toml", &["fit", "carry", "{}", "--mask", "right.npy", "--to", "1", "--out", "to.npy"]),
    reader("project", ".sgproj", &["scene", "convert", "{}", "to.ply"]),
    reader("described project", ".sgproj", &["scene", "projects", "describe", "{}"]),
    reader("project to copy", ".sgproj", &["backup", "{}", "to.sgproj"]),
    reader("backup", ".sgproj", &["restore", "{}", "./to.sgproj"]),
    reader("utterances", ".toml", &["eval", "language", "--utterances", "{}", "--out", "to"]),
    in_model("wav", ".wav", WHISPER, &["speech", "listen", "{}", "--recognizer", "whisper", "--model", "model"]),
    in_model("whisper config", "model/config.json", WHISPER, LISTEN),
    in_model("whisper tokenizer", "model/tokenizer.json", WHISPER, LISTEN),
    in_model("whisper weights", "model/model.safetensors", WHISPER, LISTEN),
    in_model("whisper of CTranslate2", "model/model.bin", WHISPER_CTRANSLATE2, LISTEN),
    in_model("voice", "model/made.onnx", PIPER, SPEAK),
    in_model("voice's description", "model/made.onnx.json", PIPER, SPEAK),
    in_model("encoder's config", "model/config.json", CLIP, LOOK),
    in_model("encoder's preprocessor", "model/preprocessor_config.json", CLIP, LOOK),
    in_model("encoder's tokenizer", "model/tokenizer.json", CLIP, LOOK),
    in_model("encoder's weights", "model/model.safetensors", CLIP, LOOK),
    in_model("OpenCLIP's config", "model/open_clip_config.json", OPEN_CLIP, LOOK),
    in_model("sentence encoder's weights", "model/model.safetensors", BERT, MEAN),
    in_model(
        "picture",
        ".png",
        CLIP,
        &["labeling", "find", "right.ply", "--picture", "{}", "--image-encoder", "model"],
    ),
    in_model(
        "queries",
        ".tsv",
        CLIP,
        &[
            "labeling",
            "retrieval",
            "right.ply",
            "--image-encoder",
            "model",
            "--text-encoder",
            "none",
            "--queries",
            "{}",
        ],
    ),
    Reader { shows_lines: true, ..reader("launch", ".toml", &["check", "{}"]) },
    Reader { shows_lines: true, ..reader("script", ".toml", &["demo", "right.ply", "--script", "{}", "--out", "to"]) },
];

/// The reader of this name.
pub(crate) fn named(name: &str) -> Reader {
    READERS.into_iter().find(|r| r.name == name).unwrap()
}

impl Reader {
    /// The ending for a file with mistakes.
    pub(crate) fn mistakes(self) -> Ending {
        if self.shows_lines { Ending::Mistakes } else { Ending::Refused }
    }

    /// A case of this reader with its other, right files. The hostile file, `file`, is still to be added.
    pub(crate) fn case(self, family: &'static str, name: &str, file: &str) -> Case {
        let words: Vec<&str> = self.words.iter().map(|w| if *w == "{}" { file } else { w }).collect();
        let mut case = Case::new(family, format!("{}: {name}", self.name), &words);
        let right = &*RIGHT;
        if words.contains(&"right.ply") {
            case = case.bytes("right.ply", right.of("ply"));
        }
        if words.contains(&"right.json") {
            case = case.bytes("right.json", right.of("strokes"));
        }
        if words.contains(&"right_8x8x8_uint8.raw") {
            case = case.bytes("right_8x8x8_uint8.raw", right.of("raw"));
        }
        if words.contains(&"right.npy") {
            case = case.bytes("right.npy", right.of("mask of three"));
        }
        if words.contains(&"right.wav") {
            case = case.bytes("right.wav", right.of("wav"));
        }
        if words.contains(&"right.png") {
            case = case.bytes("right.png", right.of("picture"));
        }
        for name in self.beside.1.iter().map(|name| format!("model/{name}")).filter(|name| *name != file) {
            case = case.with(&name, Content::Link(fixture(self.beside.0, &name)));
        }
        if self.name == "palette" {
            // Its unit names no palette, so the file beside it is read.
            case = case.bytes("palette.ply", without_comments(&right.of("ivrgs")));
        }
        case
    }

    /// Whether the hostile file may have any name with its ending.
    pub(crate) fn takes_any_name(self) -> bool {
        self.ending.starts_with(['.', '_'])
    }

    /// The name of the hostile file.
    pub(crate) fn file(self) -> String {
        if self.takes_any_name() { format!("in{}", self.ending) } else { self.ending.to_owned() }
    }
}

/// The path of a file of a small model. `name` may begin with a folder, which is left out.
fn fixture(folder: &str, name: &str) -> String {
    let name = name.rsplit('/').next().unwrap_or(name);
    format!("{}/../services/{folder}/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A file of a small model.
fn model_file(reader: &str) -> Vec<u8> {
    let reader = named(reader);
    std::fs::read(fixture(reader.beside.0, reader.ending)).unwrap()
}

/// A project as fuzzing keeps it.
fn project() -> Vec<u8> {
    use std::io::Read;
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/corpus/project.zip");
    let mut kept = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let mut inputs = (0..kept.len()).map(|at| {
        let mut bytes = Vec::new();
        kept.by_index(at).unwrap().read_to_end(&mut bytes).unwrap();
        bytes
    });
    inputs.find(|bytes| bytes.starts_with(b"SQLite format 3\0")).unwrap()
}

/// A picture of 16 × 16 pixels.
fn picture() -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, 16, 16);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().unwrap();
    let pixels: Vec<u8> = (0..3 * 256_u32).map(|at| (at * 7 % 256) as u8).collect();
    writer.write_image_data(&pixels).unwrap();
    writer.finish().unwrap();
    file
}

/// Half a second of sound.
fn sound() -> Vec<u8> {
    let samples = (0..8000).map(|at| (at as f32 * 0.1).sin() * 0.1).collect();
    encode_wav(&Recording { rate: 16_000, samples }).unwrap()
}

/// The bytes of a right file for each reader.
pub(crate) struct Right(Vec<(&'static str, Vec<u8>)>);

impl Right {
    pub(crate) fn of(&self, reader: &str) -> Vec<u8> {
        self.0.iter().find(|(name, _)| *name == reader).map(|(_, bytes)| bytes.clone()).unwrap()
    }
}

pub(crate) static RIGHT: LazyLock<Right> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let saved = |name: &str, format: Format, editable: bool| {
        let unit = if editable { samples::editable_columns(GAUSSIANS, 1) } else { samples::harmonic(GAUSSIANS, 1, 1) };
        let scene = sg_scene::model::Scene::compose(vec![samples::unit("sac", unit)], None);
        let path = at(name);
        save(&path, &scene, &SaveOptions { format: Some(format), ..SaveOptions::default() }).unwrap();
        std::fs::read(path).unwrap()
    };
    let read = |path: &Path| std::fs::read(path).unwrap();
    let array = |name: &str, write: &dyn Fn(&Path)| {
        write(&at(name));
        read(&at(name))
    };
    let labels: Vec<i32> = (0..GAUSSIANS as i32).map(|i| i % 4).collect();
    let mask = Mask::from_fn(GAUSSIANS, |i| i % 2 == 0);
    let voxels: Vec<u8> = (0..512_u32).map(|i| (i * 37 % 251) as u8).collect();
    let gzip = |bytes: &[u8]| {
        use std::io::Write;
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        out.write_all(bytes).unwrap();
        out.finish().unwrap()
    };
    let masks = array("mask.npy", &|p| write_mask(p, &mask).unwrap());
    let label_array = array("labels.npy", &|p| write_labels(p, &labels).unwrap());
    let vti = |data: &str| {
        format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 7 0 7 0 7\" \
             Origin=\"0 0 0\" Spacing=\"1 1 1\"><Piece Extent=\"0 7 0 7 0 7\"><PointData Scalars=\"d\">\
             <DataArray type=\"UInt8\" Name=\"d\" format=\"ascii\">{data}</DataArray></PointData></Piece></ImageData></VTKFile>"
        )
    };
    let numbers: Vec<String> = voxels.iter().map(u8::to_string).collect();
    Right(vec![
        ("ply", saved("a.ply", Format::THREE_DGS, false)),
        ("ascii", ascii_ply(GAUSSIANS).into_bytes()),
        ("editable", saved("b.ply", Format::OURS, true)),
        ("ivrgs", saved("c.ply", Format::IVRGS, true)),
        ("quantised", saved("d.ply", Format::IVRGS_QUANTISED, true)),
        ("compressed", saved("e.compressed.ply", Format::COMPRESSED, false)),
        ("splat", saved("f.splat", Format::SPLAT, false)),
        ("scene", scene_file(&["right.ply"]).into_bytes()),
        ("palette", Vec::new()),
        ("labels", label_array.clone()),
        ("mask", masks.clone()),
        ("seeds", array("seeds.npy", &|p| write_array(p, &[2], &[1_i64, 30]).unwrap())),
        ("truth", masks),
        ("clusters", label_array),
        ("camera", camera(64, 64).into_bytes()),
        ("camera path", CAMERA_PATH.into()),
        ("strokes", strokes(1).into_bytes()),
        ("graph", br#"{"nodes":3,"edges":[[0,1,1],[1,2,1]],"foreground":[0],"background":[2],"leak":0}"#.to_vec()),
        ("transfer", transfer(1).into_bytes()),
        ("raw", voxels.clone()),
        ("raw.gz", gzip(&voxels)),
        ("raw.zst", zstd::encode_all(&voxels[..], 3).unwrap()),
        ("nrrd", [nrrd("8 8 8", "uint8", "raw").into_bytes(), voxels.clone()].concat()),
        ("metaimage", [metaimage("8 8 8", "MET_UCHAR", "").into_bytes(), voxels.clone()].concat()),
        ("vti", vti(&numbers.join(" ")).into_bytes()),
        ("vtu", VTU.into()),
        ("legacy vtk", LEGACY_VTK.into()),
        ("nifti", nifti([8, 8, 8], &voxels)),
        ("dicom", dicom(8, 8, 8, &voxels)),
        ("truth volume", voxels.iter().map(|v| v % 3).collect()),
        ("label names", b"1 255 0 0 1 1 1 \"a\"\n".to_vec()),
        ("nhdr", format!("{}\ndata file: d.raw\n", nrrd("8 8 8", "uint8", "raw").trim_end()).into_bytes()),
        ("collection", COLLECTION.into()),
        ("series", br#"{"file-series-version":"1.0","files":[{"name":"a.vti","time":0}]}"#.to_vec()),
        (
            "steps",
            b"step = [{ previous = \"a.npy\", gaussians = 3 }, { previous = \"b.npy\", gaussians = 3 }]\n".to_vec(),
        ),
        ("project", project()),
        ("described project", project()),
        ("project to copy", project()),
        ("backup", project()),
        ("utterances", b"[[utterance]]\nkind = \"a\"\nsay = [\"hide it\"]\nexpect = [\"unchanged\"]\n".to_vec()),
        ("wav", sound()),
        ("whisper config", model_file("whisper config")),
        ("whisper tokenizer", model_file("whisper tokenizer")),
        ("whisper weights", model_file("whisper weights")),
        ("whisper of CTranslate2", model_file("whisper of CTranslate2")),
        ("voice", model_file("voice")),
        ("voice's description", model_file("voice's description")),
        ("encoder's config", model_file("encoder's config")),
        ("encoder's preprocessor", model_file("encoder's preprocessor")),
        ("encoder's tokenizer", model_file("encoder's tokenizer")),
        ("encoder's weights", model_file("encoder's weights")),
        ("OpenCLIP's config", model_file("OpenCLIP's config")),
        ("sentence encoder's weights", model_file("sentence encoder's weights")),
        ("picture", picture()),
        ("queries", b"the hard part\tright\n".to_vec()),
        ("mask of three", array("three.npy", &|p| write_mask(p, &Mask::from_fn(3, |i| i == 1)).unwrap())),
        ("launch", b"schema = 1\n[service.scene]\nexec = \"/bin/true\"\n".to_vec()),
        ("script", b"[[step]]\nsay = \"help\"\n".to_vec()),
    ])
});

/// A collection of one step.
const COLLECTION: &str = "<?xml version=\"1.0\"?><VTKFile type=\"Collection\" version=\"0.1\"><Collection>\
    <DataSet timestep=\"0\" file=\"a.vti\"/></Collection></VTKFile>";

/// Two tetrahedra with a value at each point.
pub(crate) const VTU: &str = "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
    <Piece NumberOfPoints=\"5\" NumberOfCells=\"2\"><PointData Scalars=\"d\">\
    <DataArray type=\"Float32\" Name=\"d\" format=\"ascii\">0 1 2 3 4</DataArray></PointData>\
    <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\
    0 0 0 1 0 0 0 1 0 0 0 1 1 1 1</DataArray></Points>\
    <Cells><DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 3 1 2 3 4</DataArray>\
    <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">4 8</DataArray>\
    <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10 10</DataArray></Cells>\
    </Piece></UnstructuredGrid></VTKFile>";

/// The same in a legacy file.
pub(crate) const LEGACY_VTK: &str = "# vtk DataFile Version 4.2\ntwo cells\nASCII\nDATASET UNSTRUCTURED_GRID\n\
    POINTS 5 float\n0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n\
    POINT_DATA 5\nSCALARS d float\nLOOKUP_TABLE default\n0 1 2 3 4\n";

/// A PLY without the comments of its header.
pub(crate) fn without_comments(ply: &[u8]) -> Vec<u8> {
    let end = b"end_header\n";
    let at = ply.windows(end.len()).position(|w| w == end).unwrap();
    let lines = ply[..at].split_inclusive(|b| *b == b'\n').filter(|line| !line.starts_with(b"comment "));
    [lines.flatten().copied().collect::<Vec<u8>>(), ply[at..].to_vec()].concat()
}

/// A PLY of text with the columns of 3DGS.
pub(crate) fn ascii_ply(rows: usize) -> String {
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let properties: String = names.iter().map(|n| format!("property float {n}\n")).collect();
    let row = |i: usize| format!("{i} 0 0 0 0 0 0 -3 -3 -3 1 0 0 0\n");
    let body: String = (0..rows).map(row).collect();
    format!("ply\nformat ascii 1.0\nelement vertex {rows}\n{properties}end_header\n{body}")
}

/// A scene file of units with these files.
pub(crate) fn scene_file(files: &[&str]) -> String {
    let unit = |(at, file): (usize, &&str)| format!("[[unit]]\nname = \"u{at}\"\nfile = \"{file}\"\n");
    format!("schema = 1\n{}", files.iter().enumerate().map(unit).collect::<String>())
}

pub(crate) fn camera(width: u64, height: u64) -> String {
    format!(
        "{{\"width\":{width},\"height\":{height},\"fx\":50,\"fy\":50,\"cx\":32,\"cy\":32,\
         \"world_to_camera\":[1,0,0,0,0,1,0,0,0,0,1,5,0,0,0,1]}}"
    )
}

/// A camera path of two poses.
pub(crate) const CAMERA_PATH: &str = "up 0 0 1\nnear 0.1\nfov 80\npose 0 -3 0 0 0 0\npose 1 -2 0.5 0 0 0\n";

pub(crate) fn strokes(count: usize) -> String {
    let one = r#"{"mode":"walk","kind":"foreground","radius":0.1,"points":[[0.5,0.5,0.5]]}"#;
    format!("{{\"strokes\":[{}]}}", vec![one; count].join(","))
}

/// A transfer function with this number of base units.
pub(crate) fn transfer(units: usize) -> String {
    let unit = |i: usize| format!("{{\"name\":\"u{i}\",\"range\":[{i},{}]}}", i + 1);
    let units: Vec<String> = (0..units).map(unit).collect();
    format!(
        "{{\"domain\":[0,255],\"points\":[{{\"value\":0,\"color\":[0,0,0],\"opacity\":0}},{{\"value\":255,\"color\":[1,1,1],\"opacity\":1}}],\"base_units\":[{}]}}",
        units.join(",")
    )
}

pub(crate) fn nrrd(sizes: &str, kind: &str, encoding: &str) -> String {
    format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {sizes}\nencoding: {encoding}\nendian: little\n\n")
}

/// The header of a MetaImage with these lines before the last.
pub(crate) fn metaimage(sizes: &str, kind: &str, lines: &str) -> String {
    format!("ObjectType = Image\nNDims = 3\nDimSize = {sizes}\nElementType = {kind}\n{lines}ElementDataFile = LOCAL\n")
}

/// A NIfTI-1 file of uint8.
pub(crate) fn nifti(dims: [i16; 3], voxels: &[u8]) -> Vec<u8> {
    let mut header = vec![0_u8; 352];
    header[..4].copy_from_slice(&348_i32.to_le_bytes());
    for (at, size) in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1].into_iter().enumerate() {
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
pub(crate) fn dicom(columns: u16, rows: u16, frames: u16, voxels: &[u8]) -> Vec<u8> {
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
