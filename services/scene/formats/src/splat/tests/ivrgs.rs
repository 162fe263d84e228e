//! iVR-GS's float and quantised files, its folder, and files of its own program.

use glam::Vec3;
use sg_scene::model::{Convention, Gaussians, ShadingModel};
use sg_scene::synthetic::samples;

use super::{Folder, as_format, codes};
use crate::splat::ply::{OutElement, write};
use crate::splat::{Format, WarningCode, palette};
use crate::{LoadOptions, SaveOptions, load, save};

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
fn a_foreign_file_takes_the_palette_of_the_checkpoint_beside_it() {
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
fn a_foreign_file_without_palette_is_grey_with_a_warning() {
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
