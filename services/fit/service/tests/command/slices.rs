//! Slices of DICOM: a scene of a folder and of one of its files, without a word about the person.

use std::path::Path;

use sg_scene::orientation::{LengthUnit, PatientFrame};

use crate::{fit, ok};

/// What stands in every tag about a person.
const MARKER: &str = "MEIER^MARKER";

/// A slice of 16 x 16 bytes, as explicit little endian.
fn slice(at: u16, voxels: &[u8]) -> Vec<u8> {
    let element = |tag: [u16; 2], kind: &str, value: &[u8]| {
        let filled = [value, &b" "[..value.len() % 2]].concat();
        let length = (filled.len() as u32).to_le_bytes();
        let head = [tag[0].to_le_bytes(), tag[1].to_le_bytes()].concat();
        match kind {
            "OB" => [&head[..], b"OB\0\0", &length, &filled].concat(),
            _ => [&head[..], kind.as_bytes(), &length[..2], &filled].concat(),
        }
    };
    let number = |tag: [u16; 2], value: u16| element(tag, "US", &value.to_le_bytes());
    [
        vec![0; 128],
        b"DICM".to_vec(),
        element([0x0002, 0x0010], "UI", b"1.2.840.10008.1.2.1\0"),
        element([0x0008, 0x0080], "LO", MARKER.as_bytes()),
        element([0x0008, 0x103E], "LO", MARKER.as_bytes()),
        element([0x0010, 0x0010], "PN", MARKER.as_bytes()),
        element([0x0010, 0x0020], "LO", MARKER.as_bytes()),
        element([0x0020, 0x000E], "UI", b"1.2.777.888\0"),
        element([0x0020, 0x0032], "DS", format!("0\\0\\{at}").as_bytes()),
        element([0x0020, 0x0037], "DS", b"1\\0\\0\\0\\1\\0"),
        element([0x0028, 0x0004], "CS", b"MONOCHROME2"),
        number([0x0028, 0x0010], 16),
        number([0x0028, 0x0011], 16),
        element([0x0028, 0x0030], "DS", b"0.5\\0.5"),
        number([0x0028, 0x0100], 8),
        number([0x0028, 0x0101], 8),
        number([0x0028, 0x0102], 7),
        number([0x0028, 0x0103], 0),
        element([0x7FE0, 0x0010], "OB", voxels),
    ]
    .concat()
}

/// Whether a file or a text tells of the person.
fn tells(bytes: &[u8]) -> bool {
    [MARKER, "MEIER", "1.2.777"].iter().any(|word| bytes.windows(word.len()).any(|part| part == word.as_bytes()))
}

fn none_tells(folder: &Path) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        assert!(!tells(path.display().to_string().as_bytes()) && !tells(&std::fs::read(&path).unwrap()), "{path:?}");
    }
}

#[test]
fn a_folder_of_slices_becomes_a_scene_that_tells_nothing_of_the_person() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    ok(d, &["phantom", "--out", "made", "--size", "16"]);
    let voxels = std::fs::read(d.join("made/phantom_16x16x16_uint8.raw")).unwrap();
    std::fs::create_dir(d.join("ct")).unwrap();
    for (at, voxels) in voxels.chunks(256).enumerate() {
        // Names in another order than places.
        std::fs::write(d.join("ct").join(format!("IM{:02}", 40 - at)), slice(at as u16, voxels)).unwrap();
    }
    let words = ["--transfer-function", "made/phantom.tf.json", "--initial-only", "--gaussians", "200", "--json"];
    let mut scenes = Vec::new();
    for (path, out) in [("ct", "folder"), ("ct/IM33", "file")] {
        let output = ok(d, &[&[path][..], &words, &["--out", out, "--report", "report.json"]].concat());
        assert!(
            !tells(&output.stdout) && !tells(&output.stderr) && !tells(&std::fs::read(d.join("report.json")).unwrap())
        );
        none_tells(&d.join(out));
        let mut scene =
            sg_formats::load(&d.join(out).join("scene.toml"), &sg_formats::LoadOptions::default()).unwrap().scene;
        // Each scene has its own folder.
        scene.units.iter_mut().for_each(|unit| unit.file = None);
        let (patient, unit) = (scene.orientation.patient, scene.orientation.unit);
        assert_eq!((patient, unit), (Some(PatientFrame::Lps), Some(LengthUnit::Millimetre)));
        assert_eq!(scene.bounds.size(), glam::DVec3::new(8.0, 8.0, 16.0));
        scenes.push(scene);
    }
    assert_eq!(scenes[0], scenes[1], "a file stands for its series");
    // An error tells of files alone.
    std::fs::remove_file(d.join("ct/IM33")).unwrap();
    let refused = fit(d, &[&["ct"][..], &words, &["--out", "none"]].concat());
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && said.contains("1 missing between IM34 and IM32"), "{said}");
    assert!(!tells(&refused.stderr) && !tells(&refused.stdout));
    let refused = fit(d, &[&["ct/IM40"][..], &words, &["--out", "none", "--series", "2"]].concat());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("give a number from 1 to 1"));
}
