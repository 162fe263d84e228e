//! Round trips of each format through files on disk.

use std::path::{Path, PathBuf};

use glam::{DMat4, DQuat, DVec3, Vec3};
use proptest::prelude::*;

use crate::splat::ply::{OutElement, OutProperty, OutValues, write};
use crate::splat::{Format, WarningCode, columns, palette, three_dgs};
use crate::{LoadOptions, Loaded, SaveOptions};
use crate::{load, save};
use sg_scene::model::{
    BaseUnit, Convention, ExtraColumn, ExtraValues, Gaussians, Harmonics, Scene, SceneBox, ShadingColumns, ShadingModel,
};
use sg_scene::synthetic::samples;

/// The field's constant harmonic, spelled out once more.
const C0: f64 = 0.282_094_791_773_878_14;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn through(&self, name: &str, scene: &Scene, options: &SaveOptions) -> Loaded {
        let saved = save(&self.path(name), scene, options).unwrap();
        load(&saved.files[0].with_file_name(name), &LoadOptions::default()).unwrap()
    }
}

fn as_format(format: Format) -> SaveOptions {
    SaveOptions { format: Some(format), ..SaveOptions::default() }
}

fn codes(loaded: &Loaded) -> Vec<WarningCode> {
    loaded.warnings.iter().map(|w| w.code).collect()
}

/// Any bits at all: NaN of every payload, infinities, denormals.
fn bits(n: usize) -> impl Strategy<Value = Vec<f32>> {
    proptest::collection::vec(any::<u32>().prop_map(f32::from_bits), n)
}

fn vec3s(values: &[f32]) -> Vec<Vec3> {
    values.chunks_exact(3).map(Vec3::from_slice).collect()
}

fn rows<const K: usize>(values: &[f32]) -> Vec<[f32; K]> {
    values.chunks_exact(K).map(|c| c.try_into().unwrap()).collect()
}

prop_compose! {
    fn any_columns()(n in 0_usize..20, degree in 0_u8..4)(
        floats in bits(n * (11 + 10 + 3 * (usize::from(degree) + 1).pow(2) + 3)),
        wide in proptest::collection::vec(any::<u64>(), n),
        n in Just(n),
        degree in Just(degree),
    ) -> Gaussians {
        let mut from = floats.as_slice();
        let mut take = |k: usize| {
            let (head, tail) = from.split_at(k * n);
            from = tail;
            head
        };
        let terms = (usize::from(degree) + 1).pow(2) - 1;
        let ints = |name: &str, values| ExtraColumn { name: name.to_owned(), values };
        Gaussians {
            position: vec3s(take(3)),
            rotation: rows(take(4)),
            log_scale: vec3s(take(3)),
            opacity_logit: take(1).to_vec(),
            shading: Some(ShadingColumns {
                offset_color: vec3s(take(3)),
                normal: vec3s(take(3)),
                ambient: take(1).to_vec(),
                diffuse: take(1).to_vec(),
                specular: take(1).to_vec(),
                shininess: take(1).to_vec(),
            }),
            harmonics: Some(Harmonics { degree, dc: rows(take(3)), rest: rows(take(3 * terms)) }),
            extra: vec![
                ints("i8", ExtraValues::I8(wide.iter().map(|&x| x as i8).collect())),
                ints("u8", ExtraValues::U8(wide.iter().map(|&x| x as u8).collect())),
                ints("i16", ExtraValues::I16(wide.iter().map(|&x| x as i16).collect())),
                ints("u16", ExtraValues::U16(wide.iter().map(|&x| x as u16).collect())),
                ints("i32", ExtraValues::I32(wide.iter().map(|&x| x as i32).collect())),
                ints("u32", ExtraValues::U32(wide.iter().map(|&x| x as u32).collect())),
                ints("f32", ExtraValues::F32(take(1).to_vec())),
                ints("f64", ExtraValues::F64(wide.iter().map(|&x| f64::from_bits(x)).collect())),
            ],
            antialiased: n % 2 == 1,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn ours_keeps_every_bit_and_the_whole_unit(
        gaussians in any_columns(),
        harmonic in any::<bool>(),
        palette in proptest::array::uniform3(0.0_f32..=1.0),
        opacity in 0.0_f32..3.0,
        angle in -3.0_f64..3.0,
        oriented in any::<bool>(),
        name in "[a-zA-Z0-9 \"'#=\\\\é]{1,12}",
    ) {
        let mut unit = samples::unit(&name, gaussians);
        if !harmonic {
            unit.gaussians.harmonics = None;
        }
        unit.palette = palette.into();
        unit.opacity = opacity;
        unit.transform = DMat4::from_rotation_translation(DQuat::from_rotation_y(angle), DVec3::new(angle, 1e7, -1e-7));
        unit.oriented_normals = oriented;
        unit.shading = ShadingModel::IvrgsTrain;
        let bounds = SceneBox { min: DVec3::new(-1.0, -2.0, angle - 9.0), max: DVec3::new(0.1, 0.2, 1e9) };
        let scene = Scene::compose(vec![unit], Some(bounds));
        let folder = Folder::new();
        let loaded = folder.through("a.ply", &scene, &SaveOptions::default());
        prop_assert_eq!(loaded.format, Format::OURS);
        prop_assert_eq!(loaded.scene.content_hash(), scene.content_hash());
        prop_assert_eq!(loaded.scene.bounds, bounds);
        let (a, b) = (&loaded.scene.units[0], &scene.units[0]);
        prop_assert_eq!((&a.name, a.palette, a.opacity, a.transform), (&b.name, b.palette, b.opacity, b.transform));
        prop_assert_eq!((a.oriented_normals, a.shading, a.convention), (b.oriented_normals, b.shading, b.convention));
        folder.through("b.ply", &loaded.scene, &SaveOptions::default());
        prop_assert!(std::fs::read(folder.path("a.ply")).unwrap() == std::fs::read(folder.path("b.ply")).unwrap());
    }

    #[test]
    fn three_dgs_keeps_every_bit(gaussians in any_columns(), normals in any::<bool>()) {
        let mut unit = samples::unit("a", gaussians);
        unit.gaussians.shading = None;
        unit.oriented_normals = false;
        if normals {
            let columns = columns::normal_columns(&unit.gaussians.position);
            unit.gaussians.extra.splice(0..0, columns);
        }
        let scene = Scene::compose(vec![unit], None);
        let folder = Folder::new();
        let loaded = folder.through("a.ply", &scene, &SaveOptions::default());
        prop_assert_eq!(loaded.format, Format::THREE_DGS);
        prop_assert_eq!(loaded.scene.content_hash(), scene.content_hash());
        folder.through("b.ply", &loaded.scene, &SaveOptions::default());
        prop_assert!(std::fs::read(folder.path("a.ply")).unwrap() == std::fs::read(folder.path("b.ply")).unwrap());
    }

    #[test]
    fn damaged_files_never_panic(at in 0_usize..3000, byte in any::<u8>(), cut in 0_usize..3000, format in 0_usize..5) {
        let folder = Folder::new();
        let scene = samples::editable(20, 1);
        let path = folder.path("a.ply");
        save(&path, &scene, &as_format(Format::all().nth(format).unwrap())).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let n = bytes.len();
        bytes[at % n] = byte;
        bytes.truncate(n - cut % n / 8);
        std::fs::write(&path, bytes).unwrap();
        if let Err(error) = load(&path, &LoadOptions::default()) {
            let line = error.to_string();
            prop_assert!(line.contains("a.ply") && !line.contains('\n'), "{}", line);
        }
    }
}

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

/// The greatest error of a round trip within a chunk, per axis, in steps of the chunk's range.
fn steps(before: &[Vec3], after: &[Vec3]) -> Vec3 {
    let mut worst = Vec3::ZERO;
    for (a, b) in before.chunks(256).zip(after.chunks(256)) {
        let low = a.iter().copied().reduce(Vec3::min).unwrap();
        let high = a.iter().copied().reduce(Vec3::max).unwrap();
        // A chunk of a single Gaussian has no range and must be exact.
        let step = ((high - low) / Vec3::new(2047.0, 1023.0, 2047.0)).max(Vec3::splat(f32::MIN_POSITIVE));
        for (p, q) in a.iter().zip(b) {
            worst = worst.max((*p - *q).abs() / step);
        }
    }
    worst
}

#[test]
fn compressed_files_keep_their_steps() {
    let folder = Folder::new();
    for (degree, n) in [(0, 1000), (2, 256), (3, 513)] {
        let scene = Scene::compose(vec![samples::unit("a", samples::harmonic(n, degree, 3))], None);
        let loaded = folder.through("a.compressed.ply", &scene, &SaveOptions::default());
        assert_eq!((loaded.format, loaded.scene.len()), (Format::COMPRESSED, n));
        let (a, b) = (&scene.units[0].gaussians, &loaded.scene.units[0].gaussians);
        // Half a step, plus the rounding to f32 at these magnitudes.
        assert!(steps(&a.position, &b.position).max_element() < 0.501);
        assert!(steps(&a.log_scale, &b.log_scale).max_element() < 0.501);
        let (ha, hb) = (a.harmonics.as_ref().unwrap(), b.harmonics.as_ref().unwrap());
        let color_step = 3.0 / 255.0;
        for i in 0..n {
            assert!((a.opacity(i) - b.opacity(i)).abs() <= 0.5 / 255.0 + 1e-6);
            let turn = a.unit_rotation(i).dot(b.unit_rotation(i)).abs();
            assert!(turn > 1.0 - 4e-6, "rotation {i}: {turn}");
            for c in 0..3 {
                assert!((ha.dc[i][c] - hb.dc[i][c]).abs() <= 0.5 * color_step + 1e-5);
            }
        }
        for (x, y) in ha.rest.as_flattened().iter().zip(hb.rest.as_flattened()) {
            assert!((x - y).abs() <= 0.5 / 32.0 + 1e-6);
        }
        assert_eq!(a.extra, b.extra);
        // Packing is idempotent: the ranges are in the values.
        let again = folder.through("b.compressed.ply", &loaded.scene, &SaveOptions::default());
        assert!(steps(&b.position, &again.scene.units[0].gaussians.position).max_element() < 0.01);
        assert_eq!(again.scene.units[0].gaussians.harmonics.as_ref().unwrap().rest, hb.rest);
    }
}

#[test]
fn compressed_files_hide_gaussians_without_a_position() {
    let folder = Folder::new();
    let mut g = samples::harmonic(300, 0, 4);
    g.position[5] = Vec3::new(f32::NAN, 0.0, f32::INFINITY);
    let scene = Scene::compose(vec![samples::unit("a", g)], None);
    let saved = save(&folder.path("a.compressed.ply"), &scene, &SaveOptions::default()).unwrap();
    assert!(saved.warnings.iter().any(|w| w.code == WarningCode::Lossy && w.message.starts_with("1 Gaussians")));
    let loaded = load(&folder.path("a.compressed.ply"), &LoadOptions::default()).unwrap();
    let g = &loaded.scene.units[0].gaussians;
    assert!(g.opacity(5) < 1e-8 && g.position[5].is_finite());
    assert!(g.position.iter().all(|p| p.abs().max_element() <= 5.0), "a NaN does not spoil its chunk's range");
}

#[test]
fn morton_order_makes_compressed_errors_smaller_and_warns() {
    let folder = Folder::new();
    let scene = Scene::compose(vec![samples::unit("a", samples::harmonic(20_000, 0, 6))], None);
    let options = SaveOptions { reorder: true, ..SaveOptions::default() };
    let saved = save(&folder.path("a.compressed.ply"), &scene, &options).unwrap();
    assert!(saved.warnings.iter().any(|w| w.code == WarningCode::Reordered));
    let in_order = folder.through("b.compressed.ply", &scene, &SaveOptions::default());
    let reordered = load(&folder.path("a.compressed.ply"), &LoadOptions::default()).unwrap();
    // Sum of distances from each original centre to the nearest read one.
    let sum = |read: &Loaded| {
        let read = &read.scene.units[0].gaussians.position;
        let nearest = |p: &Vec3| read.iter().map(|q| p.distance(*q)).fold(f32::INFINITY, f32::min);
        scene.units[0].gaussians.position.iter().step_by(100).map(nearest).sum::<f32>()
    };
    assert!(sum(&reordered) < 0.6 * sum(&in_order), "{} against {}", sum(&reordered), sum(&in_order));
}

#[test]
fn ivrgs_files_keep_columns_in_every_convention() {
    let folder = Folder::new();
    let scene = samples::editable(500, 12);
    let a = &scene.units[0].gaussians;
    let sa = a.shading.as_ref().unwrap();
    for convention in [Convention::Legacy, Convention::HeadRaw, Convention::HeadActivated] {
        let options = SaveOptions { format: Some(Format::IVRGS), convention: Some(convention), reorder: false };
        let loaded = folder.through("a.ply", &scene, &options);
        assert_eq!((loaded.format, loaded.scene.units[0].convention), (Format::IVRGS, convention));
        assert!(!codes(&loaded).contains(&WarningCode::Convention), "the comment says it");
        let b = &loaded.scene.units[0].gaussians;
        let sb = b.shading.as_ref().unwrap();
        assert_eq!(
            (&a.position, &a.rotation, &a.log_scale, &a.opacity_logit),
            (&b.position, &b.rotation, &b.log_scale, &b.opacity_logit)
        );
        assert_eq!((&sa.ambient, &sa.diffuse, &a.extra), (&sb.ambient, &sb.diffuse, &b.extra));
        for i in 0..500 {
            assert!((sa.offset_color[i] - sb.offset_color[i]).abs().max_element() < 2e-7);
            assert!((sa.normal[i] - sb.normal[i]).abs().max_element() < 2e-7);
            assert!((sa.specular[i] - sb.specular[i]).abs() < 2e-6);
            assert!((sa.shininess[i] - sb.shininess[i]).abs() < 2e-5);
        }
    }
}

#[test]
fn negative_offsets_go_into_the_palette_of_an_ivrgs_file() {
    let folder = Folder::new();
    let mut scene = samples::editable(50, 2);
    let unit = &mut scene.units[0];
    let shading = unit.gaussians.shading.as_mut().unwrap();
    for (i, offset) in shading.offset_color.iter_mut().enumerate() {
        *offset = Vec3::new(-0.25, 0.25, 0.0) * (i as f32 / 49.0);
    }
    let want: Vec<Vec3> = shading.offset_color.iter().map(|o| unit.palette + *o).collect();
    let saved = save(&folder.path("a.ply"), &scene, &as_format(Format::IVRGS)).unwrap();
    assert!(saved.warnings.iter().any(|w| w.message.contains("palette was lowered")));
    assert!(!saved.warnings.iter().any(|w| w.message.contains("are cut")));
    let unit = &load(&folder.path("a.ply"), &LoadOptions::default()).unwrap().scene.units[0];
    for (want, offset) in want.iter().zip(&unit.gaussians.shading.as_ref().unwrap().offset_color) {
        assert!((*want - unit.palette - *offset).abs().max_element() < 4e-7);
    }
}

#[test]
fn quantised_files_keep_half_precision_and_256_values() {
    let folder = Folder::new();
    let scene = samples::editable(20_000, 21);
    let loaded = folder.through("a.ply", &scene, &as_format(Format::IVRGS_QUANTISED));
    assert_eq!((loaded.format, loaded.scene.units[0].convention), (Format::IVRGS_QUANTISED, Convention::HeadActivated));
    let (a, b) = (&scene.units[0].gaussians, &loaded.scene.units[0].gaussians);
    let (sa, sb) = (a.shading.as_ref().unwrap(), b.shading.as_ref().unwrap());
    for (p, q) in a.position.iter().zip(&b.position) {
        assert!((*p - *q).abs().max_element() <= 5.0 / 2048.0);
    }
    let rms = |x: &[f32], y: &[f32]| {
        let sum: f64 = x.iter().zip(y).map(|(x, y)| f64::from(x - y).powi(2)).sum();
        (sum / x.len() as f64).sqrt()
    };
    // Even steps over a uniform range would be off by range/256/√12; half precision adds its own at the larger values.
    let even = |range: f64| range / 256.0 / 12.0_f64.sqrt();
    let flat = |v: &[Vec3]| v.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
    assert!(rms(&flat(&a.log_scale), &flat(&b.log_scale)) < 1.1 * even(8.0));
    assert!(rms(&a.opacity_logit, &b.opacity_logit) < 1.1 * even(10.0));
    assert!(rms(&sa.ambient, &sb.ambient) < 1.1 * even(1.0));
    assert!(rms(&sa.specular, &sb.specular) < 1.1 * even(4.0));
    assert!(rms(&sa.shininess, &sb.shininess) < 1.2 * even(39.0));
    assert!(rms(&flat(&sa.offset_color), &flat(&sb.offset_color)) < 1.5 * even(0.45));
    let turned = (0..a.len()).map(|i| a.unit_rotation(i).dot(b.unit_rotation(i)).abs()).fold(1.0, f64::min);
    assert!(turned > 0.9999, "{turned}");
    let tilted = sa.normal.iter().zip(&sb.normal).map(|(n, m)| n.dot(*m)).fold(1.0, f32::min);
    assert!(tilted > 0.9999, "{tilted}");
    assert_eq!(a.extra, b.extra);
    // 24 bytes and the extra short of each Gaussian, the codebooks, the header.
    let size = std::fs::metadata(folder.path("a.ply")).unwrap().len();
    assert!(size < 20_000 * 26 + 5120 + 2500, "{size}");
}

#[test]
fn quantised_files_refuse_positions_beyond_half_precision() {
    let folder = Folder::new();
    let mut scene = samples::editable(10, 1);
    scene.units[0].gaussians.position[3].y = 70_000.0;
    let error = save(&folder.path("a.ply"), &scene, &as_format(Format::IVRGS_QUANTISED)).unwrap_err().to_string();
    assert!(error.contains("row 3") && error.contains("65504"), "{error}");
    assert_eq!(std::fs::read_dir(folder.0.path()).unwrap().count(), 0, "nothing is left behind");
}

#[test]
fn an_ivrgs_folder_is_a_scene() {
    let folder = Folder::new();
    let scene = samples::two_units(40);
    let root = folder.path("bonsai");
    let saved = save(&root, &scene, &as_format(Format::IVRGS)).unwrap();
    assert_eq!(saved.files[1], root.join("TF02/neilf/point_cloud/iteration_0/point_cloud.ply"));
    let loaded = load(&root, &LoadOptions::default()).unwrap();
    let names: Vec<_> = loaded.scene.units.iter().map(|u| u.name.as_str()).collect();
    assert_eq!(names, ["bone", "skin / outer"]);
    assert_eq!(loaded.scene.units[0].palette, scene.units[0].palette);
    assert_eq!(loaded.scene.units[1].transform, scene.units[1].transform);
    assert_eq!(loaded.scene.units[1].first, 40);
    assert!(loaded.scene.units[0].oriented_normals && !loaded.scene.units[1].oriented_normals);
    assert!(save(&root, &scene, &as_format(Format::IVRGS)).unwrap_err().to_string().contains("not empty"));
}

/// The bytes of an iVR-GS float file as its own program writes it: no comments.
fn foreign_ivrgs(g: &Gaussians) -> Vec<u8> {
    let mut out = Vec::new();
    let properties = crate::splat::editable_columns::properties(g, g.shading.as_ref().unwrap());
    write(&mut out, &[], &[OutElement { name: "gaussians", rows: g.len(), properties }]).unwrap();
    out
}

#[test]
fn the_palette_stands_beside_a_foreign_file() {
    let folder = Folder::new();
    let bytes = foreign_ivrgs(&samples::editable_columns(30, 5));
    for (tf, color) in [("TF02", [0.5_f32, 0.25, 0.0]), ("TF01", [1.0, 0.0, 0.75])] {
        for iteration in ["iteration_5000", "iteration_40000"] {
            let unit = folder.path("out").join(tf).join("neilf/point_cloud").join(iteration);
            std::fs::create_dir_all(&unit).unwrap();
            std::fs::write(
                unit.join("point_cloud.ply"),
                if iteration == "iteration_5000" { b"not the last".as_slice() } else { &bytes },
            )
            .unwrap();
            let storage: Vec<u8> = color.into_iter().flat_map(f32::to_le_bytes).collect();
            let checkpoint =
                palette::tests::zipped("palette_colors_chkpnt", &palette::tests::parameter_pickle(), &storage, false);
            std::fs::write(unit.join("palette_colors_chkpnt.pth"), checkpoint).unwrap();
        }
    }
    let loaded = load(&folder.path("out"), &LoadOptions::default()).unwrap();
    let got: Vec<_> = loaded.scene.units.iter().map(|u| (u.name.as_str(), u.palette.to_array())).collect();
    assert_eq!(got, [("TF01", [1.0, 0.0, 0.75]), ("TF02", [0.5, 0.25, 0.0])]);
    assert!(loaded.scene.units[0].oriented_normals, "trained");
    assert!(codes(&loaded).contains(&WarningCode::Convention) && !codes(&loaded).contains(&WarningCode::Palette));
}

#[test]
fn a_foreign_file_without_palette_is_grey_and_says_so() {
    let folder = Folder::new();
    let g = samples::editable_columns(30, 5);
    std::fs::write(folder.path("a.ply"), foreign_ivrgs(&g)).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.scene.units[0].palette, Vec3::splat(0.5));
    assert_eq!(codes(&loaded), [WarningCode::Convention, WarningCode::Palette, WarningCode::Shading]);
    // β up to 40 is no raw value, so it is the earlier form: offsets through a sigmoid, β as stored.
    let (stored, used) = (g.shading.as_ref().unwrap(), loaded.scene.units[0].gaussians.shading.as_ref().unwrap());
    assert_eq!(loaded.scene.units[0].convention, Convention::Legacy);
    assert_eq!(stored.shininess, used.shininess);
    let want = 1.0 / (1.0 + (-stored.offset_color[7].x).exp());
    assert!((used.offset_color[7].x - want).abs() < 1e-6);
    // The caller's word goes first.
    let options = LoadOptions {
        convention: Some(Convention::HeadRaw),
        palette: Some(Vec3::X),
        shading: Some(ShadingModel::IvrgsTrain),
    };
    let loaded = load(&folder.path("a.ply"), &options).unwrap();
    assert_eq!((loaded.scene.units[0].palette, loaded.warnings.len()), (Vec3::X, 0));
    let used = loaded.scene.units[0].gaussians.shading.as_ref().unwrap();
    assert!((used.shininess[7] - 50.0 / (1.0 + (-stored.shininess[7]).exp())).abs() < 1e-4);
    // A checkpoint that cannot be read is an error, not a grey scene.
    std::fs::write(folder.path("a.pth"), b"PK but no zip").unwrap();
    let error = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("a.pth"), "{error}");
}

#[test]
fn a_first_stage_file_is_put_right() {
    let folder = Folder::new();
    for (degree, rest) in [(3_u8, 45_usize), (0, 0)] {
        let g = samples::harmonic(64, degree, 31);
        let normals: Vec<f32> = g.position.iter().flat_map(|p| p.normalize_or_zero().to_array()).collect();
        let h = g.harmonics.as_ref().unwrap();
        // The rows in their true order, under the header that the program writes for them.
        let mut names: Vec<String> = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned).into();
        names.extend((0..rest).map(|i| format!("f_rest_{i}")));
        names.extend(
            ["opacity", "normal_0", "normal_1", "normal_2", "scale_0", "scale_1", "scale_2"].map(str::to_owned),
        );
        names.extend(["rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned));
        let vector = |v: &[Vec3], i: usize| v[i].to_array();
        let mut floats = Vec::new();
        for i in 0..64 {
            floats.extend(vector(&g.position, i));
            floats.extend(&normals[3 * i..3 * i + 3]);
            floats.extend(h.dc[i]);
            for channel in 0..3 {
                floats.extend((0..rest / 3).map(|k| h.rest[i * rest / 3 + k][channel]));
            }
            floats.push(g.opacity_logit[i]);
            floats.extend(vector(&g.log_scale, i));
            floats.extend(g.rotation[i]);
        }
        let width = names.len();
        let property =
            |(at, name): (usize, &String)| OutProperty::new(name.clone(), OutValues::F32(&floats), width, at);
        let mut out = Vec::new();
        write(
            &mut out,
            &[],
            &[OutElement { name: "vertex", rows: 64, properties: names.iter().enumerate().map(property).collect() }],
        )
        .unwrap();
        std::fs::write(folder.path("a.ply"), out).unwrap();
        let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
        assert_eq!(codes(&loaded), [WarningCode::Remapped]);
        let b = &loaded.scene.units[0].gaussians;
        assert_eq!(
            (&g.position, &g.rotation, &g.log_scale, &g.opacity_logit),
            (&b.position, &b.rotation, &b.log_scale, &b.opacity_logit)
        );
        assert_eq!(g.harmonics, b.harmonics);
        let ny: Vec<f32> = normals.iter().skip(1).step_by(3).copied().collect();
        assert_eq!(b.extra[1], ExtraColumn { name: "ny".to_owned(), values: ExtraValues::F32(ny) });
    }
}

#[test]
fn flat_gaussians_get_a_thickness() {
    let folder = Folder::new();
    let g = samples::harmonic(10, 0, 2);
    let properties = three_dgs::properties(&g).into_iter().filter(|p| p.name != "scale_2").collect();
    let mut out = Vec::new();
    write(&mut out, &[], &[OutElement { name: "vertex", rows: 10, properties }]).unwrap();
    std::fs::write(folder.path("a.ply"), out).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(codes(&loaded), [WarningCode::Flattened]);
    let b = &loaded.scene.units[0].gaussians;
    for i in 0..10 {
        assert_eq!(b.log_scale[i].truncate(), g.log_scale[i].truncate());
        let thinner = b.scale(i).x.min(b.scale(i).y);
        assert!((b.scale(i).z / thinner - 1e-3).abs() < 1e-8);
    }
}

/// A little-endian file's text and big-endian twins, made without the writer.
#[test]
fn all_encodings_read_the_same() {
    let folder = Folder::new();
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let header = |format: &str, end: &str| {
        let mut text = format!(
            "ply{end}format {format} 1.0{end}comment é{end}obj_info x{end}element face 2{end}property list uchar int v{end}element vertex 2{end}"
        );
        for name in names {
            text.push_str(&format!("property float {name}{end}"));
        }
        text.push_str(&format!("property double weight{end}property short id{end}end_header{end}"));
        text
    };
    let floats: Vec<f32> = (0..28).map(|i| (i as f32 - 3.5) * 0.37).collect();
    let mut text = header("ascii", "\n");
    text.push_str("3 0 1 2\n\n2 7 8\n");
    let (mut little, mut big) =
        (header("binary_little_endian", "\r\n").into_bytes(), header("binary_big_endian", "\n").into_bytes());
    for face in [[3_i32, 0, 1, 2].as_slice(), &[2, 7, 8]] {
        for out in [&mut little, &mut big] {
            out.push(face[0] as u8);
        }
        for v in &face[1..] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
    }
    for (k, row) in floats.chunks(14).enumerate() {
        for x in row {
            text.push_str(&format!("{x} "));
            little.extend(x.to_le_bytes());
            big.extend(x.to_be_bytes());
        }
        let (weight, id) = (0.1 * k as f64 - 7.0, -300 * k as i16);
        text.push_str(&format!("  {weight} {id} \r\n"));
        little.extend([&weight.to_le_bytes()[..], &id.to_le_bytes()].concat());
        big.extend([&weight.to_be_bytes()[..], &id.to_be_bytes()].concat());
    }
    let mut read = Vec::new();
    for bytes in [text.into_bytes(), little, big] {
        std::fs::write(folder.path("a.ply"), bytes).unwrap();
        let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
        assert_eq!(codes(&loaded), [WarningCode::Ignored], "the faces");
        read.push(loaded.scene);
    }
    assert_eq!(read[0].units[0].gaussians.position[1].to_array(), floats[14..17]);
    assert_eq!(read[0].units[0].gaussians.extra[0].values, ExtraValues::F64(vec![-7.0, 0.1 - 7.0]));
    assert_eq!(read[0].units[0].gaussians.extra[1].values, ExtraValues::I16(vec![0, -300]));
    assert_eq!(read[0], read[1]);
    assert_eq!(read[0], read[2]);
}

#[test]
fn double_columns_are_narrowed_with_a_warning() {
    let folder = Folder::new();
    let mut text =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty float z\n".to_owned();
    for name in
        ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    {
        text.push_str(&format!("property float {name}\n"));
    }
    text.push_str("end_header\n0.1 1e400 3 nan 0 0 0 0 0 0 0 0 0 inf\n");
    std::fs::write(folder.path("a.ply"), text).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.scene.units[0].gaussians.position[0].x, 0.1);
    assert_eq!(
        codes(&loaded),
        [WarningCode::Narrowed, WarningCode::NonFinite, WarningCode::NonFinite, WarningCode::NonFinite]
    );
    let messages: Vec<_> = loaded.warnings.iter().skip(1).map(|w| w.message.as_str()).collect();
    assert_eq!(
        messages,
        [
            "centres that are not finite and not drawn: 1",
            "rotations that are not finite and read as none: 1",
            "rows of harmonics that are not finite: 1"
        ]
    );
}

/// The unlit colour of a Gaussian as a renderer takes it.
fn unlit_color(unit: &BaseUnit, i: usize) -> DVec3 {
    match (&unit.gaussians.shading, &unit.gaussians.harmonics) {
        (Some(s), _) => (unit.palette + s.offset_color[i]).as_dvec3(),
        (None, Some(h)) => DVec3::from_array(h.dc[i].map(f64::from)) * C0 + 0.5,
        (None, None) => DVec3::splat(0.5),
    }
}

#[test]
fn two_units_become_one_picture_of_fixed_colours() {
    let folder = Folder::new();
    let scene = samples::two_units(100);
    let loaded = folder.through("a.ply", &scene, &as_format(Format::THREE_DGS));
    let one = &loaded.scene.units[0];
    assert_eq!(one.gaussians.len(), 200);
    assert_eq!(one.gaussians.harmonics.as_ref().unwrap().degree, 1);
    for i in 0..200 {
        let (unit, k) = scene.locate(i).unwrap();
        assert!((unlit_color(unit, k) - unlit_color(one, i)).abs().max_element() < 2e-7, "colour {i}");
        assert!((scene.position(i).unwrap() - one.gaussians.position[i].as_dvec3()).length() < 2e-6, "position {i}");
        let opacity = unit.gaussians.opacity(k) * unit.opacity;
        assert!((opacity - one.gaussians.opacity(i)).abs() < 1e-6, "opacity {i}");
        let linear = glam::DMat3::from_mat4(unit.transform);
        let want = linear * unit.gaussians.covariance(k) * linear.transpose();
        let size = want.to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let got = one.gaussians.covariance(i);
        let off = (got - want).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(off < 1e-5 * size, "covariance {i}");
    }
    let normals: Vec<_> = one.gaussians.extra.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(normals, ["nx", "ny", "nz"]);
    let error = save(&folder.path("b.ply"), &scene, &SaveOptions::default()).unwrap_err().to_string();
    assert!(error.contains("scene.toml") && error.contains("has 2"), "{error}");
}

#[test]
fn a_scene_of_fixed_colours_becomes_editable_and_looks_the_same() {
    let folder = Folder::new();
    let mut unit = samples::unit("a", samples::harmonic(200, 1, 17));
    unit.gaussians.log_scale[0] = Vec3::new(-1.0, -3.0, -2.0);
    let scene = Scene::compose(vec![unit], None);
    let loaded = folder.through("a.ply", &scene, &as_format(Format::OURS));
    let made = &loaded.scene.units[0];
    let s = made.gaussians.shading.as_ref().unwrap();
    assert_eq!((made.palette, made.oriented_normals, made.convention), (Vec3::ZERO, false, Convention::Ours));
    for i in 0..200 {
        // The paper's model with these factors: ka·c_d.
        assert_eq!((s.ambient[i], s.diffuse[i], s.specular[i], s.shininess[i]), (1.0, 0.0, 0.0, 1.0));
        let drawn = (made.palette + s.offset_color[i]).as_dvec3() * f64::from(s.ambient[i]);
        assert!((drawn - unlit_color(&scene.units[0], i)).abs().max_element() < 2e-7);
        let normal = s.normal[i].as_dvec3();
        let variance = normal.dot(scene.units[0].gaussians.covariance(i) * normal);
        let least = scene.units[0].gaussians.scale(i).min_element() as f64;
        assert!((variance.sqrt() / least - 1.0).abs() < 1e-3, "the normal is the shortest axis");
    }
    // And back: the colours are the same as before.
    let back = folder.through("b.ply", &loaded.scene, &as_format(Format::THREE_DGS));
    for i in 0..200 {
        assert!((unlit_color(&back.scene.units[0], i) - unlit_color(&scene.units[0], i)).abs().max_element() < 4e-7);
    }
}

#[test]
fn a_scene_file_of_ours_only_says_the_palette_that_the_units_got() {
    let folder = Folder::new();
    let mut unit = samples::unit("a", samples::harmonic(20, 0, 1));
    unit.palette = Vec3::ONE;
    let scene = Scene::compose(vec![unit], None);
    let loaded = folder.through("s.toml", &scene, &as_format(Format::OURS));
    assert_eq!(loaded.unit_formats, [Format::OURS]);
    assert_eq!(loaded.scene.units[0].palette, Vec3::ZERO);
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
    ];
    let properties = crate::splat::editable_columns::properties(&g, g.shading.as_ref().unwrap());
    write(&mut out, &comments.map(str::to_owned), &[OutElement { name: "gaussians", rows: 3, properties }]).unwrap();
    std::fs::write(folder.path("a.ply"), out).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.format, Format::OURS);
    assert_eq!(loaded.warnings.iter().filter(|w| w.code == WarningCode::Ignored).count(), 4);
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
    for format in Format::all() {
        let name = format!("a{}", format.extensions()[0]);
        let loaded = folder.through(&name, &samples::editable(0, 1), &as_format(format));
        assert!(loaded.scene.is_empty() && codes(&loaded).contains(&WarningCode::Empty), "{format}");
    }
}
