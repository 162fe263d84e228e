//! Damaged files, refused saves, warnings, and empty scenes.

use std::path::Path;

use proptest::prelude::*;
use sg_scene::model::Scene;
use sg_scene::synthetic::samples;

use super::{Folder, as_format, codes};
use crate::splat::ply::{OutElement, write};
use crate::splat::{Format, WarningCode};
use crate::{LoadOptions, SaveOptions, load, save};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn damaged_files_never_panic(
        at in 0_usize..3000,
        byte in any::<u8>(),
        cut in 0_usize..3000,
        format in proptest::sample::select(unit_file_formats()),
    ) {
        let folder = Folder::new();
        let scene = samples::editable(20, 1);
        let name = format!("a{}", format.extensions()[0]);
        let path = folder.path(&name);
        save(&path, &scene, &as_format(format)).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let n = bytes.len();
        bytes[at % n] = byte;
        bytes.truncate(n - cut % n / 8);
        std::fs::write(&path, bytes).unwrap();
        if let Err(error) = load(&path, &LoadOptions::default()) {
            let line = error.to_string();
            prop_assert!(line.contains(&name) && !line.contains('\n'), "{}", line);
        }
    }
}

/// The writable formats that hold a unit in one file: all but `scene.toml`.
fn unit_file_formats() -> Vec<Format> {
    Format::all().filter(|f| f.is_writable() && *f != Format::SCENE).collect()
}

#[test]
fn foreign_comments_are_ignored_and_broken_ones_give_warnings() {
    let folder = Folder::new();
    let g = samples::editable_columns(3, 3);
    let mut out = Vec::new();
    let comments = [
        "made = by hand",
        "convention = \"theirs\"",
        "palette = [0.5, 2]",
        "opacity = nan",
        "convention = \"ours\"",
        "transform = [1, 2]",
        "orientation = { up = \"sideways\" }",
    ];
    let properties = crate::splat::editable_columns::properties(&g, g.shading.as_ref().unwrap());
    write(&mut out, &comments.map(str::to_owned), &[OutElement { name: "gaussians", rows: 3, properties }]).unwrap();
    std::fs::write(folder.path("a.ply"), out).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.format, Format::OURS);
    assert_eq!(loaded.warnings.iter().filter(|w| w.code == WarningCode::Ignored).count(), 5);
    assert!(codes(&loaded).contains(&WarningCode::Palette));
}

#[test]
fn unreadable_files_give_place_and_remedy() {
    let folder = Folder::new();
    let good = {
        save(&folder.path("good.ply"), &samples::editable(100, 1), &SaveOptions::default()).unwrap();
        std::fs::read(folder.path("good.ply")).unwrap()
    };
    let header = |lines: &str| format!("ply\nformat binary_little_endian 1.0\n{lines}end_header\n").into_bytes();
    let floats = |names: &str| names.split(' ').map(|n| format!("property float {n}\n")).collect::<String>();
    let whole = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let vertex = |names: &str| header(&format!("element vertex 0\n{}", floats(names)));
    let table: Vec<(Vec<u8>, &str, &str)> = vec![
        (good[..good.len() - 10].to_vec(), "element gaussians, row 99", "cut off"),
        (good[..300].to_vec(), "header line", "cut off"),
        (b"PLY is what this is not".to_vec(), "byte 0", "give a PLY"),
        (b"ply\nformat binary_middle_endian 1.0\nend_header\n".to_vec(), "header line 2", "binary_little_endian"),
        (b"ply\nelement vertex 1\nend_header\n".to_vec(), "header", "format"),
        (
            header("element vertex 99999999999999\nproperty float x\n"),
            "element vertex, row 0",
            "99999999999999 rows of 4 bytes",
        ),
        (header("element vertex 18446744073709551615\nproperty double x\n"), "element vertex", "cut off"),
        (header("element vertex -5\nproperty float x\n"), "header line 3", "`-5`"),
        (header("element vertex 1\nproperty half x\n"), "header line 4", "unknown type `half`"),
        (header("element vertex 1\nproperty float x\nproperty float x\n"), "header line 5", "second property `x`"),
        (header("element vertex 3\n"), "element vertex", "no property"),
        (header("element face 0\nproperty list uchar int v\n"), "header", "only: face"),
        (header("property float x\n"), "header line 3", "before any element"),
        (header("elephant vertex 1\n"), "header line 3", "elephant"),
        (vertex(&whole.replace(" rot_3", "").replace("f_dc_1 ", "")), "element vertex", "`f_dc_1`, `rot_3`"),
        (vertex(&format!("{whole} f_rest_0 f_rest_1")), "element vertex", "0, 9, 24 or 45"),
        (vertex(&format!("{whole} f_offset_0")), "element vertex", "Scaffold-GS"),
        (vertex("x y z opacity normal_0 scale_0 scale_1 rot_0 diffuse_factor mappings_0"), "element vertex", "TexGS"),
        (header("element vertex 0\nproperty uchar x\nproperty float y\n").to_vec(), "element vertex", "no property"),
        (
            header(&format!("element vertex 0\n{}", floats(whole).replace("float x", "int x"))),
            "element vertex, property x",
            "must be float",
        ),
        (header("element vertex_0 0\nproperty float x\n"), "header", "reduced 3DGS"),
        (header("element vertex 1\nproperty list uchar float x\n\n"), "element vertex, row 0", "ends inside"),
        (header("element gaussians 0\nproperty float x\n"), "element gaussians", "`opacity`"),
        (
            header("element chunk 7\nproperty float min_x\nelement vertex 0\nproperty uint packed_position\n")
                .into_iter()
                .chain([0; 28])
                .collect(),
            "element chunk",
            "0 are needed",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty int n\nend_header\n1 2\n3 4.5\n"
                .to_vec(),
            "line 8, property n",
            "`4.5` is no int",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1 2\n".to_vec(),
            "line 6",
            "more than 1",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n2    \n".to_vec(),
            "element vertex, row 2",
            "the file ends",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n1\n".to_vec(),
            "element vertex",
            "do not fit the text",
        ),
    ];
    for (k, (bytes, place, remedy)) in table.into_iter().enumerate() {
        std::fs::write(folder.path("bad.ply"), bytes).unwrap();
        let error = load(&folder.path("bad.ply"), &LoadOptions::default())
            .expect_err(&format!("row {k}: {remedy}"))
            .to_string();
        assert!(
            error.contains("bad.ply") && error.contains(place) && error.contains(remedy) && !error.contains('\n'),
            "row {k}: {error}"
        );
    }
}

#[test]
fn inconsistent_scenes_are_refused_with_a_reason() {
    let folder = Folder::new();
    let load_text = |text: &str| {
        std::fs::write(folder.path("s.toml"), text).unwrap();
        load(&folder.path("s.toml"), &LoadOptions::default()).unwrap_err().to_string()
    };
    let missing = load_text("schema = 1\n[[unit]]\nname = \"a\"\nfile = \"none.ply\"\n");
    assert!(missing.contains("none.ply") && missing.contains("give the path"), "{missing}");
    assert!(
        load_text("schema = 1\n[[unit]]\nname = \"a\"\nfile = \"a.ply\"\ncolor = 1\n").contains("line 5, column 1")
    );
    assert!(
        load(Path::new("no/such/scene"), &LoadOptions::default()).unwrap_err().to_string().contains("no/such/scene")
    );
    std::fs::create_dir_all(folder.path("empty")).unwrap();
    assert!(load(&folder.path("empty"), &LoadOptions::default()).unwrap_err().to_string().contains("TF*"));
    std::fs::create_dir_all(folder.path("half/TF01/neilf/point_cloud/iteration_3")).unwrap();
    let error = load(&folder.path("half"), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("folder TF01") && error.contains("iteration_*"), "{error}");
}

#[test]
fn a_refused_save_leaves_no_file() {
    let folder = Folder::new();
    let scene = samples::editable(10, 1);
    let refused = |name: &str, scene: &Scene, options: &SaveOptions| {
        save(&folder.path(name), scene, options).unwrap_err().to_string()
    };
    assert!(refused("none/a.ply", &scene, &SaveOptions::default()).contains("nothing was written"));
    assert!(refused("a.obj", &scene, &SaveOptions::default()).contains(".compressed.ply"));
    assert!(refused("a.toml", &scene, &as_format(Format::COMPRESSED)).contains("does not fit"));
    assert!(refused("a", &scene, &SaveOptions::default()).contains("--format ivrgs"));
    assert!(
        refused("a.ply", &scene, &SaveOptions { reorder: true, ..SaveOptions::default() }).contains("keeps the order")
    );
    let mut short = scene.clone();
    short.units[0].gaussians.opacity_logit.pop();
    assert!(refused("a.ply", &short, &SaveOptions::default()).contains("opacity_logit"));
    let mut named = scene.clone();
    named.units[0].gaussians.extra[0].name = "two words".to_owned();
    assert!(refused("a.toml", &named, &SaveOptions::default()).contains("two words"));
    assert_eq!(std::fs::read_dir(folder.0.path()).unwrap().count(), 0);
}

#[test]
fn an_empty_scene_is_a_scene() {
    let folder = Folder::new();
    for format in Format::all().filter(|f| f.is_writable()) {
        let name = format!("a{}", format.extensions()[0]);
        let loaded = folder.through(&name, &samples::editable(0, 1), &as_format(format));
        assert!(loaded.scene.is_empty() && codes(&loaded).contains(&WarningCode::Empty), "{format}");
    }
}

#[test]
fn well_known_formats_without_a_reader_get_a_way() {
    let folder = Folder::new();
    for (name, content, line) in [
        ("a.spz", &b"\x1f\x8b\x08"[..], ": SPZ cannot be read; convert it to .ply"),
        ("a.bin", b"glTF\x02", "content: glTF cannot be read; export it as STL"),
        ("a.ksplat", b"", "file name: KSPLAT cannot be read; convert it to .ply"),
    ] {
        let path = folder.path(name);
        std::fs::write(&path, content).unwrap();
        let said = load(&path, &LoadOptions::default()).unwrap_err().to_string();
        assert!(said.starts_with(&path.display().to_string()) && said.contains(line), "{said}");
    }
    let slices = folder.path("slices");
    std::fs::create_dir(&slices).unwrap();
    std::fs::write(slices.join("1"), [&[0; 128][..], b"DICM"].concat()).unwrap();
    let said = load(&slices, &LoadOptions::default()).unwrap_err().to_string();
    assert!(
        said.contains("folder: DICOM as a scene cannot be read; make a scene of it with `supergaussian fit`"),
        "{said}"
    );
}
