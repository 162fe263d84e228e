//! Files of Gaussians, scene files, palettes and cameras.

use std::io::{Cursor, Write};
use std::path::Path;

use sg_formats::{Format, LoadOptions, Loaded, SaveOptions, load, save, scene_file::SceneFile};
use sg_scene::camera::Camera;
use sg_scene::camera_path::{CameraPath, MAX_POSES};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::accepted;
use crate::parts::Parts;
use crate::seeds;
use crate::stage::Stage;

/// Scenes of more Gaussians are not written again.
const MAX_SAVED: usize = 200;

pub(crate) fn ply(stage: &Stage, input: &[u8]) -> bool {
    scene(stage, &stage.write("in.ply", input))
}

pub(crate) fn compressed_ply(stage: &Stage, input: &[u8]) -> bool {
    scene(stage, &stage.write("in.compressed.ply", input))
}

pub(crate) fn splat(stage: &Stage, input: &[u8]) -> bool {
    scene(stage, &stage.write("in.splat", input))
}

/// The scene's units may name two files that are there, and themselves.
pub(crate) fn scene_file(stage: &Stage, input: &[u8]) -> bool {
    stage.keep("a.ply", seeds::ply);
    stage.keep("b.ply", seeds::editable_ply);
    if let Ok(text) = std::str::from_utf8(input)
        && let Ok(parsed) = SceneFile::parse(text, Path::new("scene.toml"))
    {
        let again = SceneFile::parse(&parsed.to_text(), Path::new("scene.toml"));
        assert_eq!(again.ok().as_ref(), Some(&parsed), "a scene file reads back");
    }
    let path = stage.write("scene.toml", input);
    let loaded = load(&path, &LoadOptions::default());
    if let Ok(loaded) = &loaded {
        check(loaded);
    }
    loaded.is_ok()
}

/// A checkpoint beside a PLY that does not hold its palette itself.
pub(crate) fn palette_zip(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.keep("palette.ply", seeds::ply_without_palette);
    stage.write("palette.pth", input);
    load(&path, &LoadOptions::default()).is_ok()
}

/// The parts of a checkpoint in a right zip: the pickle, then the storage of its numbers.
pub(crate) fn palette_pickle(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let (pickle, byte_order, numbers) = (parts.block(), parts.block(), parts.rest());
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in [("a/data.pkl", pickle), ("a/byteorder", byte_order), ("a/data/0", numbers)] {
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    palette_zip(stage, &zip.finish().unwrap().into_inner())
}

pub(crate) fn camera(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.write("camera.json", input);
    let Some(camera) = accepted(Camera::read(&path), &path) else { return false };
    assert!(camera.check("camera.json").is_ok());
    let _ = (camera.view(), camera.eye(), camera.background());
    true
}

pub(crate) fn camera_path(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.write("path.txt", input);
    let Some(way) = accepted(CameraPath::read(&path), &path) else { return false };
    assert!((1..=MAX_POSES).contains(&way.poses.len()) && way.views().all(|view| view.check().is_ok()));
    assert_eq!(way.frames([16, 16], 9).len(), 9);
    true
}

fn scene(stage: &Stage, path: &Path) -> bool {
    let Some(loaded) = accepted(load(path, &LoadOptions::default()), path) else { return false };
    check(&loaded);
    let scene = &loaded.scene;
    // The one format that keeps every bit.
    if loaded.unit_formats == [Format::OURS] && scene.len() <= MAX_SAVED {
        let copy = stage.folder().join("copy.ply");
        if save(&copy, scene, &SaveOptions { format: Some(Format::OURS), ..SaveOptions::default() }).is_ok() {
            let again = load(&copy, &LoadOptions::default()).unwrap();
            assert_eq!(again.scene.content_hash(), scene.content_hash(), "a saved scene reads back");
        }
    }
    true
}

fn check(loaded: &Loaded) {
    let scene = &loaded.scene;
    assert_eq!(scene.units.iter().map(|u| u.gaussians.len()).sum::<usize>(), scene.len());
    for unit in &scene.units {
        let (n, of) = (unit.gaussians.len(), &unit.gaussians);
        assert_eq!([of.position.len(), of.rotation.len(), of.log_scale.len(), of.opacity_logit.len()], [n; 4]);
    }
    let warnings: usize = loaded.warnings.iter().map(|w| w.to_string().len()).sum();
    assert!(warnings < 1 << 20, "{warnings} bytes of warnings");
    let _ = scene.content_hash();
}
