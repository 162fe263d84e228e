//! Contents that are cut off, damaged, or promise what does not follow.

use crate::case::Case;
use crate::readers::{self, READERS, RIGHT, Reader};

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for reader in READERS {
        let mut add = |name: &str, bytes: Vec<u8>| cases.push(one(reader, name, bytes));
        // No header tells these from right files.
        let has_header = !matches!(reader.name, "splat" | "raw" | "truth volume");
        if has_header {
            add("zeros", vec![0; 5000]);
            add("every byte", (0..=255_u8).collect());
            add("text", b"no such thing\n".repeat(50));
            add("bytes of no text", vec![0xff; 3000]);
        } else {
            add("one byte more", [RIGHT.of(reader.name), vec![0]].concat());
        }
        let right = RIGHT.of(reader.name);
        // Of a launch file or a script a part can be right, too.
        if !matches!(reader.name, "launch" | "script" | "palette" | "splat") {
            for (name, keep) in [
                ("cut at a tenth", right.len() / 10),
                ("cut in the middle", right.len() / 2),
                ("cut at its end", right.len() - 2),
            ] {
                // The last bytes of a picture or a project may hold nothing.
                if name != "cut at its end" || !matches!(reader.ending, ".png" | ".sgproj") {
                    add(name, right[..keep].to_vec());
                }
            }
        } else if reader.name == "splat" {
            for keep in [1, 31, 33, right.len() - 1] {
                add(&format!("cut at {keep}"), right[..keep].to_vec());
            }
        }
        // Another reader's file.
        if has_header {
            let other = if matches!(reader.name, "nrrd" | "nhdr" | "nifti" | "vti" | "vtu" | "legacy vtk" | "metaimage")
            {
                "ply"
            } else {
                "nrrd"
            };
            add("another format", RIGHT.of(other));
        }
    }
    cases.extend(ply());
    cases.extend(arrays());
    cases.extend(volumes());
    cases.extend(texts());
    cases.extend(models());
    cases
}

fn one(reader: Reader, name: &str, bytes: Vec<u8>) -> Case {
    let file = reader.file();
    let ending = reader.mistakes();
    reader.case("contents", name, &file).bytes(&file, bytes).ending(ending)
}

/// Headers of PLY files that do not fit their rows.
fn ply() -> Vec<Case> {
    let mut cases = Vec::new();
    let right = RIGHT.of("ply");
    let count = format!("element vertex {}", readers::GAUSSIANS);
    let with = |bytes: &[u8], from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    for number in [
        "61",
        "1000000000000",
        "18446744073709551615",
        "18446744073709551616",
        "-1",
        "1e9",
        "0x10",
        "",
        "NaN",
        "9223372036854775807",
    ] {
        let lie = format!("element vertex {number}");
        cases.push(one(readers::named("ply"), &format!("{number} rows"), with(&right, &count, &lie)));
        let ascii = RIGHT.of("ascii");
        cases.push(one(readers::named("ascii"), &format!("{number} rows"), with(&ascii, &count, &lie)));
        for name in ["editable", "ivrgs", "quantised"] {
            let bytes = RIGHT.of(name);
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let line = text
                .lines()
                .find(|l| l.starts_with("element") && l.ends_with(&format!(" {}", readers::GAUSSIANS)))
                .unwrap();
            let lie = line.replace(&readers::GAUSSIANS.to_string(), number);
            cases.push(one(readers::named(name), &format!("{number} rows"), with(&bytes, line, &lie)));
        }
    }
    let reader = readers::named("ply");
    let mut add = |name: &str, bytes: Vec<u8>| cases.push(one(reader, name, bytes));
    let header = |body: &str| format!("ply\nformat binary_little_endian 1.0\n{body}end_header\n").into_bytes();
    add("rows without a property", header("element vertex 1000000000000\n"));
    add("a list of a billion", [header("element vertex 1\nproperty list uint float x\n"), vec![0xff; 64]].concat());
    add(
        "lists without end",
        [header("element face 999999999999\nproperty list uchar int v\n"), vec![0; 4096]].concat(),
    );
    add("a list count of float", [header("element face 1\nproperty list float int v\n"), vec![0; 64]].concat());
    add("no end of the header", b"ply\nformat ascii 1.0\n".repeat(1000));
    add("a header without line ends", [b"ply\n".to_vec(), vec![b'a'; 3 << 20]].concat());
    add("no format", b"ply\nelement vertex 0\nend_header\n".to_vec());
    add("a property before an element", header("property float x\n"));
    add("columns missing", [header("element vertex 2\nproperty float x\n"), vec![0; 8]].concat());
    add("columns of a wrong type", with(&right, "property float opacity", "property uchar opacity"));
    add("big endian and cut", with(&right[..right.len() / 2], "little", "big"));
    add(
        "too many elements",
        header(&(0..100).map(|i| format!("element e{i} 0\nproperty char x\n")).collect::<String>()),
    );
    add("comments without end", [b"ply\n".to_vec(), b"comment palette = \n".repeat(60_000)].concat());
    cases
}

fn arrays() -> Vec<Case> {
    let mut cases = Vec::new();
    let array = |header: &str, data: &[u8]| {
        let mut text = header.to_owned();
        while !(text.len() + 11).is_multiple_of(64) {
            text.push(' ');
        }
        text.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    };
    let header = |kind: &str, shape: &str| format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    for name in ["labels", "mask", "seeds", "truth", "clusters"] {
        let reader = readers::named(name);
        let kind = if matches!(name, "mask" | "truth") { "|u1" } else { "<i4" };
        let deep = format!("{}1{}", "(".repeat(300), ")".repeat(300));
        for (what, bytes) in [
            ("a trillion values", array(&header(kind, "(1000000000000,)"), &[0; 64])),
            (
                "a product beyond 64 bits",
                array(&header(kind, "(18446744073709551615, 18446744073709551615)"), &[0; 64]),
            ),
            ("a negative length", array(&header(kind, "(-1,)"), &[0; 64])),
            ("another type", array(&header("<f8", "(8,)"), &[0; 64])),
            ("a type of objects", array(&header("|O", "(8,)"), &[0; 64])),
            ("a type of a terabyte", array(&header("|V1000000000000", "(8,)"), &[0; 64])),
            ("another length", array(&header(kind, "(3,)"), &[0; 12])),
            ("deep brackets", array(&header(kind, &deep), &[0; 64])),
            ("two axes", array(&header(kind, "(2, 2)"), &[0; 16])),
            ("a header of four gigabytes", [b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec(), vec![b' '; 4000]].concat()),
            ("a header of a later version", [b"\x93NUMPY\x09\x00".to_vec(), vec![0; 100]].concat()),
        ] {
            // A list of seeds has any length.
            if (name, what) != ("seeds", "another length") {
                cases.push(one(reader, what, bytes));
            }
        }
        let out_of_range = if matches!(name, "mask" | "truth") {
            array(&header("|u1", &format!("({},)", readers::GAUSSIANS)), &[7; readers::GAUSSIANS])
        } else {
            array(&header("<i8", "(2,)"), &[0xff; 16])
        };
        cases.push(one(reader, "values out of range", out_of_range));
    }
    cases
}

fn volumes() -> Vec<Case> {
    let mut cases = Vec::new();
    let voxels = RIGHT.of("raw");
    for (name, sizes) in [
        ("a terabyte", "10000 10000 10000"),
        ("a product beyond 64 bits", "4294967295 4294967295 4294967295"),
        ("nothing", "0 0 0"),
        ("a negative size", "8 8 -8"),
        ("one voxel more", "8 8 9"),
        ("two axes", "8 64"),
        ("a fraction", "8 8 8.5"),
    ] {
        for encoding in ["raw", "gzip", "ascii"] {
            let bytes = [readers::nrrd(sizes, "uint8", encoding).into_bytes(), voxels.clone()].concat();
            cases.push(one(readers::named("nrrd"), &format!("{name}, {encoding}"), bytes));
        }
        let extent = sizes.split(' ').map(|n| format!("0 {n}")).collect::<Vec<_>>().join(" ");
        let vti = String::from_utf8(RIGHT.of("vti")).unwrap();
        cases.push(one(readers::named("vti"), name, vti.replace("0 7 0 7 0 7", &extent).into_bytes()));
    }
    for (name, text) in [
        ("no type", "NRRD0004\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n".to_owned()),
        ("a thousand axes", readers::nrrd("8 8 8", "uint8", "raw").replace("dimension: 3", "dimension: 1000")),
        (
            "a line skip without end",
            readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "line skip: 18446744073709551615\nendian"),
        ),
        (
            "a byte skip without end",
            readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "byte skip: 9223372036854775807\nendian"),
        ),
        ("a list of files", readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "data file: LIST\nendian")),
        (
            "a data file that is not there",
            readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "data file: none\nendian"),
        ),
        ("itself as data file", readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "data file: in.nrrd\nendian")),
        ("a spacing of nothing", readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "spacings: 0 0 0\nendian")),
        ("an infinite spacing", readers::nrrd("8 8 8", "uint8", "raw").replace("endian", "spacings: inf 1 1\nendian")),
        ("a header without end", "NRRD0004\n".to_owned() + &"# a\n".repeat(600_000)),
        ("a line without end", "NRRD0004\n".to_owned() + &"a".repeat(3 << 20)),
    ] {
        cases.push(one(readers::named("nrrd"), name, [text.into_bytes(), voxels.clone()].concat()));
    }
    let image = |lines: &str| readers::metaimage("8 8 8", "MET_UCHAR", lines);
    for (name, text) in [
        ("a terabyte", readers::metaimage("10000 10000 10000", "MET_UCHAR", "")),
        ("a product beyond 64 bits", readers::metaimage("4294967295 4294967295 4294967295", "MET_UCHAR", "")),
        ("a negative size", readers::metaimage("8 8 -8", "MET_UCHAR", "")),
        ("two sizes", readers::metaimage("8 64", "MET_UCHAR", "")),
        ("a type that is none", readers::metaimage("8 8 8", "MET_STRING", "")),
        ("a zlib stream that is none", image("CompressedData = True\n")),
        ("text that is none", image("BinaryData = False\n")),
        ("a header size without end", image("HeaderSize = 18446744073709551615\n")),
        ("a header size of minus two", image("HeaderSize = -2\n")),
        ("three channels", image("ElementNumberOfChannels = 3\n")),
        ("a spacing of nothing", image("ElementSpacing = 0 0 0\n")),
        ("axes in a plane", image("TransformMatrix = 1 0 0 0 1 0 1 1 0\n")),
        ("an origin that is no number", image("Offset = nan 0 0\n")),
        ("a list of files", image("").replace("LOCAL", "LIST")),
        ("a pattern of files", image("").replace("LOCAL", "%03d.raw 1 8 1")),
        ("a data file that is not there", image("").replace("LOCAL", "none")),
        ("no data file", image("").replace("ElementDataFile = LOCAL\n", "")),
        ("a header without end", "NDims = 3\n".to_owned() + &"a = b\n".repeat(300_000)),
        ("a line without end", "NDims = ".to_owned() + &"3".repeat(3 << 20)),
    ] {
        cases.push(one(readers::named("metaimage"), name, [text.into_bytes(), voxels.clone()].concat()));
    }
    for (name, dims) in [
        ("a volume of 2^45 voxels", [32767, 32767, 32767]),
        ("a negative size", [8, -8, 8]),
        ("nothing", [0, 0, 0]),
        ("a voxel more", [8, 8, 9]),
    ] {
        cases.push(one(readers::named("nifti"), name, readers::nifti(dims, &voxels)));
    }
    for (name, at, bytes) in [
        ("an offset of nothing", 108, f32::NAN.to_le_bytes()),
        ("an offset past the end", 108, 1e9_f32.to_le_bytes()),
        ("a negative offset", 108, (-352_f32).to_le_bytes()),
        ("a type of colours", 70, [128, 0, 24, 0]),
        ("an unknown type", 70, [0xff, 0x7f, 8, 0]),
        ("another header", 0, 1000_i32.to_le_bytes()),
        ("eight axes", 40, [9, 0, 8, 0]),
        ("no magic", 344, *b"none"),
    ] {
        let mut nifti = readers::nifti([8, 8, 8], &voxels);
        nifti[at..at + 4].copy_from_slice(&bytes);
        cases.push(one(readers::named("nifti"), name, nifti));
    }
    for name in [
        "a_100000x100000x100000_float64.raw",
        "a_0x0x0_uint8.raw",
        "a_8x8x8.raw",
        "a_8x8_uint8.raw",
        "a.raw",
        "a_99999999999999999999x1x1_uint8.raw",
        "a_8x8x9_uint8.raw",
        "a_8x8x8_uint9.raw",
        "a_8x8x8_float64.raw",
        "a_1000x1000x1000_uint8.raw.gz",
        "a_1000x1000x1000_uint8.raw.zst",
        "a_8x8x9_uint8.raw.zst",
    ] {
        let case = Case::new("contents", format!("raw: {name}"), &["fit", name, "--initial-only", "--out", "to"]);
        cases.push(case.bytes(name, voxels.clone()));
    }
    cases
}

/// Whether a reader takes a text in JSON.
fn is_json(reader: &Reader) -> bool {
    matches!(reader.name, "camera" | "strokes" | "graph" | "transfer" | "series")
        || reader.ending.ends_with("/config.json")
        || reader.ending.ends_with("_config.json")
        || reader.ending.ends_with("/tokenizer.json")
        || reader.ending.ends_with(".onnx.json")
}

fn texts() -> Vec<Case> {
    let mut cases = Vec::new();
    for reader in READERS.into_iter().filter(is_json) {
        for (name, text) in [
            ("deep lists", "[".repeat(200_000)),
            ("deep tables", "{\"a\":".repeat(100_000)),
            ("a number without end", format!("{{\"a\":{}}}", "9".repeat(500_000))),
            ("null", "null".to_owned()),
            ("a list", "[]".to_owned()),
            ("an empty table", "{}".to_owned()),
            ("a table twice", "{}{}".to_owned()),
            ("a key without end", format!("{{\"{}\":1}}", "k".repeat(500_000))),
        ] {
            cases.push(one(reader, name, text.into_bytes()));
        }
    }
    for reader in
        READERS.into_iter().filter(|r| matches!(r.name, "scene" | "launch" | "script" | "utterances" | "steps"))
    {
        for (name, text) in [
            ("deep lists", format!("a = {}", "[".repeat(200_000))),
            ("deep tables", format!("a = {}", "{a=".repeat(100_000))),
            ("a key of a thousand parts", format!("{} = 1\n", vec!["a"; 1000].join("."))),
            ("a number without end", format!("schema = {}\n", "9".repeat(500_000))),
            ("a key without end", format!("{} = 1\n", "k".repeat(500_000))),
            ("a list of zeros", format!("a = [{}]\n", "0,".repeat(400_000))),
            ("a table twice", "[a]\n[a]\n".to_owned()),
            ("tables in tables", format!("a = [{}]\n", "{b={c=1}},".repeat(95_000))),
        ] {
            cases.push(one(reader, name, text.into_bytes()));
        }
    }
    for (name, camera) in [
        ("no pixels", readers::camera(0, 64)),
        ("pixels without end", readers::camera(4_000_000_000, 4_000_000_000)),
        ("a picture of four gigabytes", readers::camera(16_384, 16_384)),
        ("a flat projection", readers::camera(64, 64).replace("\"fx\":50", "\"fx\":0")),
        ("an infinite number", readers::camera(64, 64).replace("\"cx\":32", "\"cx\":1e999")),
        ("no map", readers::camera(64, 64).replace("[1,0,0,0,", "[0,0,0,0,")),
        ("fifteen numbers", readers::camera(64, 64).replace("[1,0,0,0,", "[0,0,0,")),
    ] {
        cases.push(one(readers::named("camera"), name, camera.into_bytes()));
    }
    let pose = "pose 0 -3 0 0 0 0\n";
    for (name, path) in [
        ("no pose", "up 0 0 1\n".to_owned()),
        ("one pose", pose.to_owned()),
        ("five numbers", format!("{pose}pose 0 -3 0 0 0\n")),
        ("an infinite number", format!("{pose}pose 0 1e999 0 0 0 0\n")),
        ("no number", format!("{pose}pose 0 NaN 0 0 0 0\n")),
        ("an eye at its target", format!("{pose}pose 1 1 1 1 1 1\n")),
        ("a view along up", format!("up 0 1 0\n{pose}{pose}")),
        ("no up", format!("up 0 0 0\n{pose}{pose}")),
        ("a flat field of view", format!("fov 180\n{pose}{pose}")),
        ("a negative distance", format!("near -1\n{pose}{pose}")),
        ("an unknown key", format!("speed 3\n{pose}{pose}")),
        ("poses without end", pose.repeat(50_000)),
        ("a line without end", "pose ".to_owned() + &"1 ".repeat(400_000)),
    ] {
        cases.push(one(readers::named("camera path"), name, path.into_bytes()));
    }
    for (name, graph) in [
        ("nodes without edges", r#"{"nodes":50000000,"edges":[],"foreground":[0],"background":[1]}"#),
        ("nodes without end", r#"{"nodes":18446744073709551615,"edges":[]}"#),
        ("a node out of range", r#"{"nodes":2,"edges":[[0,2,1]]}"#),
        ("a negative node", r#"{"nodes":2,"edges":[[0,-1,1]]}"#),
        ("a negative weight", r#"{"nodes":2,"edges":[[0,1,-1]]}"#),
        ("an infinite weight", r#"{"nodes":2,"edges":[[0,1,1e999]]}"#),
        ("a seed out of range", r#"{"nodes":2,"edges":[[0,1,1]],"foreground":[9]}"#),
        ("a negative leak", r#"{"nodes":2,"edges":[[0,1,1]],"foreground":[0],"leak":-1}"#),
    ] {
        cases.push(one(readers::named("graph"), name, graph.into()));
    }
    for (name, strokes) in [
        ("no points", r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":0.1,"points":[]}]}"#),
        (
            "an infinite radius",
            r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":1e999,"points":[[0,0,0]]}]}"#,
        ),
        ("two coordinates", r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":1,"points":[[0,0]]}]}"#),
        ("an unknown key", r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":1,"points":[[0,0,0]],"x":1}]}"#),
        (
            "more pressures than points",
            r#"{"strokes":[{"mode":"walk","kind":"foreground","radius":1,"points":[[0,0,0]],"pressure":[1,2]}]}"#,
        ),
        ("no operation", r#"{"strokes":[{"operation":"explode"}]}"#),
    ] {
        cases.push(one(readers::named("strokes"), name, strokes.into()));
    }
    for (name, scene) in [
        ("no units", "schema = 1\n".to_owned()),
        ("another schema", "schema = 2\n".to_owned()),
        ("an empty name", "schema = 1\n[[unit]]\nname = \"\"\nfile = \"a.ply\"\n".to_owned()),
        ("itself as a unit", readers::scene_file(&["in.toml"])),
        ("a unit that is not there", readers::scene_file(&["none.ply"])),
        ("a folder as a unit", readers::scene_file(&["."])),
        ("an infinite box", readers::scene_file(&["a.ply"]) + "[box]\nmin = [0, 0, 0]\nmax = [inf, 0, 0]\n"),
        ("a flat transform", readers::scene_file(&["a.ply"]) + "transform = [0.0, 0.0]\n"),
    ] {
        cases.push(one(readers::named("scene"), name, scene.into_bytes()));
    }
    cases
}

/// Sounds, pictures and weights whose headers promise what does not follow, and series that lead elsewhere.
fn models() -> Vec<Case> {
    let mut cases = Vec::new();
    let sound = RIGHT.of("wav");
    let with = |bytes: &[u8], at: usize, new: &[u8]| {
        let mut bytes = bytes.to_vec();
        bytes[at..at + new.len()].copy_from_slice(new);
        bytes
    };
    for (name, at, new) in [
        ("no channel", 22, &[0, 0][..]),
        ("65,535 channels", 22, &[0xff, 0xff]),
        ("no samples in a second", 24, &[0, 0, 0, 0]),
        ("four billion samples in a second", 24, &[0xff; 4]),
        ("samples of no bit", 34, &[0, 0]),
        ("samples of 65,535 bits", 34, &[0xff, 0xff]),
        ("an unknown kind of samples", 20, &[0x77, 0x77]),
    ] {
        cases.push(one(readers::named("wav"), name, with(&sound, at, new)));
    }
    let picture = RIGHT.of("picture");
    for (name, at, new) in [
        ("pixels without end", 16, &[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff][..]),
        ("no pixels", 16, &[0; 8]),
        ("a long chunk", 8, &[0x7f, 0xff, 0xff, 0xff]),
        ("an unknown kind of pixels", 25, &[9]),
    ] {
        cases.push(one(readers::named("picture"), name, with(&picture, at, new)));
    }
    let of_header = |text: &str| [&(text.len() as u64).to_le_bytes(), text.as_bytes()].concat();
    let tensor = |shape: &str, to: u64| {
        of_header(&format!("{{\"a\":{{\"dtype\":\"F32\",\"shape\":[{shape}],\"data_offsets\":[0,{to}]}}}}"))
    };
    for reader in ["whisper weights", "encoder's weights", "sentence encoder's weights"] {
        let whole = RIGHT.of(reader);
        for (name, bytes) in [
            ("a header without end", with(&whole, 0, &[0xff; 8])),
            ("a header of eight megabytes", with(&whole, 0, &(8_u64 << 20).to_le_bytes())),
            ("four terabytes", tensor("1099511627776", 4 << 40)),
            ("a product beyond 64 bits", tensor("4611686018427387904,4611686018427387904", 4)),
            ("deep lists", of_header(&"[".repeat(200_000))),
            ("no tensor", of_header("{}")),
        ] {
            cases.push(one(readers::named(reader), name, bytes));
        }
    }
    let collection = String::from_utf8(RIGHT.of("collection")).unwrap();
    for (name, file) in [("a step of another folder", "../a.vti"), ("a step that is not there", "none.vti")] {
        cases.push(one(readers::named("collection"), name, collection.replace("a.vti", file).into_bytes()));
    }
    for (name, path) in [("a map of another folder", "../a.npy"), ("a map of no folder", "/dev/zero")] {
        let text = String::from_utf8(RIGHT.of("steps")).unwrap().replace("b.npy", path);
        cases.push(one(readers::named("steps"), name, text.into_bytes()));
    }
    cases.push(one(
        readers::named("queries"),
        "a text without end",
        [vec![b'a'; 900_000], b"\tright\n".to_vec()].concat(),
    ));
    cases.push(one(readers::named("queries"), "a line without end", vec![b'a'; 3 << 20]));
    cases
}
