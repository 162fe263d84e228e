//! `scene.toml` and the files of its units.

use glam::{DVec3, Vec3};
use sg_scene::model::{Scene, SceneBox};
use sg_scene::synthetic::samples;

use super::{Folder, as_format};
use crate::splat::Format;
use crate::{LoadOptions, SaveOptions, load, save};

#[test]
fn a_scene_file_keeps_everything() {
    let folder = Folder::new();
    let mut scene = samples::two_units(300);
    scene.bounds = SceneBox { min: DVec3::splat(-7.25), max: DVec3::splat(1.0 / 3.0) };
    let loaded = folder.through("scene.toml", &scene, &SaveOptions::default());
    assert_eq!(
        (loaded.format, loaded.unit_formats.as_slice()),
        (Format::SCENE, [Format::OURS, Format::THREE_DGS].as_slice())
    );
    assert_eq!(loaded.warnings, []);
    let mut read = loaded.scene;
    assert_eq!(read.units[1].file, Some(folder.path("skin___outer.ply")));
    read.units.iter_mut().for_each(|u| u.file = None);
    assert_eq!(read, scene);
    let by_folder = load(folder.0.path(), &LoadOptions::default()).unwrap();
    assert_eq!(by_folder.scene.content_hash(), scene.content_hash());
}

#[test]
fn units_of_like_names_get_files_of_their_own() {
    let folder = Folder::new();
    let units = ["a b", "a_b", "A b", "名"].map(|n| samples::unit(n, samples::editable_columns(5, n.len() as u64)));
    let scene = Scene::compose(units.into(), None);
    let saved = save(&folder.path("s.toml"), &scene, &SaveOptions::default()).unwrap();
    let names: Vec<_> = saved.files.iter().map(|f| f.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["s.toml", "a_b.ply", "a_b-2.ply", "A_b-3.ply", "_.ply"]);
    assert_eq!(
        load(&folder.path("s.toml"), &LoadOptions::default()).unwrap().scene.content_hash(),
        scene.content_hash()
    );
}

#[test]
fn a_scene_file_stores_the_palette_of_converted_units() {
    let folder = Folder::new();
    let mut unit = samples::unit("a", samples::harmonic(20, 0, 1));
    unit.palette = Vec3::ONE;
    let scene = Scene::compose(vec![unit], None);
    let loaded = folder.through("s.toml", &scene, &as_format(Format::OURS));
    assert_eq!(loaded.unit_formats, [Format::OURS]);
    assert_eq!(loaded.scene.units[0].palette, Vec3::ZERO);
}
