//! Real files. `SUPERGAUSSIAN_DATA` names their folder. The library's own tests check the same numbers on generated
//! data (`splat/tests.rs`).

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a test says aloud when it does not run, and fails by panicking"
)]

use std::path::{Path, PathBuf};

use glam::DVec3;
use sg_formats::splat::{Format, WarningCode};
use sg_formats::{LoadOptions, Loaded, SaveOptions};
use sg_formats::{load, save};
use sg_scene::model::Gaussians;

/// A real file, or a loud word that this test did not run.
fn data(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("SUPERGAUSSIAN_DATA").map(|root| Path::new(&root).join("splats").join(name));
    if let Some(path) = path.filter(|p| p.is_file()) {
        return Some(path);
    }
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").is_ok_and(|v| v == "1");
    assert!(!required, "SUPERGAUSSIAN_DATA has no splats/{name}, and it is required");
    println!("SKIPPED: set SUPERGAUSSIAN_DATA to a folder with splats/{name}");
    None
}

fn open(path: &Path) -> Loaded {
    load(path, &LoadOptions::default()).unwrap()
}

fn as_format(format: Format) -> SaveOptions {
    SaveOptions { format: Some(format), ..SaveOptions::default() }
}

fn mean<const K: usize>(rows: impl Iterator<Item = [f64; K]>, n: usize) -> [f64; K] {
    let sum = rows.fold([0.0; K], |sum, row| std::array::from_fn(|k| sum[k] + row[k]));
    sum.map(|s| s / n as f64)
}

fn assert_near<const K: usize>(got: [f64; K], want: [f64; K], within: f64) {
    for (g, w) in got.iter().zip(want) {
        assert!((g - w).abs() <= within, "{got:?} is not within {within} of {want:?}");
    }
}

fn gaussians(loaded: &Loaded) -> &Gaussians {
    &loaded.scene.units[0].gaussians
}

#[test]
fn a_trained_3dgs_file_is_read_and_written_byte_for_byte() {
    let Some(path) = data("donut_fused.ply") else { return };
    let loaded = open(&path);
    assert_eq!((loaded.format, loaded.scene.len(), loaded.warnings.len()), (Format::THREE_DGS, 45_624, 0));
    let g = gaussians(&loaded);
    assert_eq!(g.harmonics.as_ref().unwrap().degree, 0);
    assert_eq!(g.position[0].to_array(), [0.018263085, 0.090_465_255, 0.040_593_795]);
    assert_eq!(g.opacity_logit[0], 6.068_385_6);
    assert_eq!(g.rotation[45_623], [1.009_541_9, -0.154_419_97, 0.114_308_94, -0.553_331_85]);
    let b = loaded.scene.bounds;
    assert_near(b.min.to_array(), [-0.1031695231795311, -0.09762744605541229, -0.009067188017070293], 0.0);
    assert_near(b.max.to_array(), [0.10532961040735245, 0.10954020172357559, 0.086201973259449], 0.0);
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("donut.ply");
    save(&copy, &loaded.scene, &SaveOptions::default()).unwrap();
    assert!(std::fs::read(&path).unwrap() == std::fs::read(copy).unwrap());
}

#[test]
fn a_3dgs_file_with_harmonics_and_normals_is_written_byte_for_byte() {
    let Some(path) = data("playbot_lod4_8406.ply.zst") else { return };
    let bytes = zstd::decode_all(std::fs::File::open(path).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (plain, copy) = (folder.path().join("playbot.ply"), folder.path().join("copy.ply"));
    std::fs::write(&plain, &bytes).unwrap();
    let loaded = open(&plain);
    assert_eq!((loaded.scene.len(), gaussians(&loaded).harmonics.as_ref().unwrap().degree), (8406, 2));
    let extra: Vec<_> = gaussians(&loaded).extra.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(extra, ["nx", "ny", "nz"]);
    save(&copy, &loaded.scene, &SaveOptions::default()).unwrap();
    assert!(bytes == std::fs::read(&copy).unwrap());
    // Compressed: the cost of 3.4 times fewer bytes.
    let small = folder.path().join("playbot.compressed.ply");
    save(&small, &loaded.scene, &SaveOptions::default()).unwrap();
    let packed = open(&small);
    let (a, b) = (gaussians(&loaded).harmonics.as_ref().unwrap(), gaussians(&packed).harmonics.as_ref().unwrap());
    let worst = a.rest.as_flattened().iter().zip(b.rest.as_flattened()).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    assert!(worst <= 0.5 / 32.0 + 1e-6, "{worst}");
}

/// The means come from an independent decoder of this file. They agree with those of the same capture's SPZ file to that format's
/// steps. The SPZ means are position 0.0486 1.6050 0.0023 in its axes, colour 0.3189 0.3077 0.3007, and opacity 0.296625.
#[test]
fn a_supersplat_file_is_decoded_as_by_other_programs() {
    let Some(path) = data("biker.compressed.ply") else { return };
    let loaded = open(&path);
    let g = gaussians(&loaded);
    let n = 152_746;
    assert_eq!((loaded.format, g.len(), loaded.warnings.len()), (Format::COMPRESSED, n, 0));
    let position = mean(g.position.iter().map(|p| p.as_dvec3().to_array()), n);
    assert_near(position, [-0.04857341763548457, -1.6050461397013993, 0.002285777408419114], 1e-7);
    let scale = mean(g.log_scale.iter().map(|p| p.as_dvec3().to_array()), n);
    assert_near(scale, [-6.131259780148296, -5.379001018599014, -6.047572202737919], 1e-6);
    let dc = &g.harmonics.as_ref().unwrap().dc;
    let color = dc.iter().map(|c| (DVec3::from_array(c.map(f64::from)) * 0.282_094_791_773_878_14 + 0.5).to_array());
    assert_near(mean(color, n), [0.3188881020136502, 0.3077311846913277, 0.3007243741278166], 1e-7);
    assert_near(mean((0..n).map(|i| [f64::from(g.opacity(i))]), n), [0.29662533443334627], 1e-7);
    let rotation = mean(g.rotation.iter().map(|q| q.map(|x| f64::from(x.abs()))), n);
    assert_near(rotation, [0.8981888700302273, 0.18772083995877006, 0.2009836616944915, 0.19400305517457905], 1e-6);
    assert_near(
        g.position[1000].as_dvec3().to_array(),
        [-0.10450396327548453, -2.181177199644311, -0.32972749154860065],
        1e-7,
    );

    // Packed again it is the same picture: the ranges are still in the values.
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("biker.compressed.ply");
    save(&copy, &loaded.scene, &SaveOptions::default()).unwrap();
    let again = open(&copy);
    let g2 = gaussians(&again);
    let moved = g.position.iter().zip(&g2.position).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(moved < 2e-6, "{moved}");
    let turned = (0..n).map(|i| g.unit_rotation(i).dot(g2.unit_rotation(i)).abs()).fold(1.0, f64::min);
    assert!(turned > 1.0 - 4e-6, "{turned}");
    assert_eq!(std::fs::metadata(&copy).unwrap().len() / 1000, std::fs::metadata(&path).unwrap().len() / 1000);
}

#[test]
fn a_trained_scene_goes_through_every_format() {
    let Some(path) = data("donut_fused.ply") else { return };
    let loaded = open(&path);
    let folder = tempfile::tempdir().unwrap();
    let g = gaussians(&loaded);
    let n = g.len();
    let color = |g: &Gaussians, palette: glam::Vec3, i: usize| match (&g.shading, &g.harmonics) {
        (Some(s), _) => (palette + s.offset_color[i]).as_dvec3(),
        (None, Some(h)) => DVec3::from_array(h.dc[i].map(f64::from)) * 0.282_094_791_773_878_14 + 0.5,
        (None, None) => DVec3::splat(0.5),
    };
    // Largest errors of position (absolute, the donut is 0.2 wide), colour within 0 to 1, and opacity.
    let table = [
        (Format::OURS, 0.0, 1e-7, 0.0),
        (Format::COMPRESSED, 2e-4, 0.02, 0.0021),
        (Format::IVRGS, 0.0, 1e-6, 0.0),
        (Format::IVRGS_QUANTISED, 4e-5, 0.05, 0.02),
    ];
    for (format, position, shade, opacity) in table {
        let copy = folder.path().join(format!("{format}.ply"));
        save(&copy, &loaded.scene, &as_format(format)).unwrap();
        let read = open(&copy);
        assert_eq!((read.format, read.scene.len()), (format, n));
        let unit = &read.scene.units[0];
        for i in 0..n {
            let off = (unit.gaussians.position[i] - g.position[i]).abs().max_element();
            assert!(off <= position, "{format}: position {i} is off by {off}");
            let (want, got) = (color(g, glam::Vec3::ZERO, i), color(&unit.gaussians, unit.palette, i));
            let is_in_range = want.min_element() >= 0.0 && want.max_element() <= 1.0;
            let off = (want - got).abs().max_element();
            assert!(!is_in_range || off <= shade, "{format}: colour {i} is off by {off}");
            let off = (unit.gaussians.opacity(i) - g.opacity(i)).abs();
            assert!(off <= opacity, "{format}: opacity {i} is off by {off}");
        }
    }
    let scene = folder.path().join("scene.toml");
    save(&scene, &loaded.scene, &SaveOptions::default()).unwrap();
    let read = open(&scene);
    assert_eq!(read.scene.content_hash(), loaded.scene.content_hash());
    assert_eq!(read.scene.bounds, loaded.scene.bounds);
    assert!(!read.warnings.iter().any(|w| w.code == WarningCode::NonFinite));
}

#[test]
fn a_splat_file_of_another_program_keeps_all_bytes_but_the_scales() {
    let Some(path) = data("fixtures/minimal.splat") else { return };
    let loaded = open(&path);
    assert_eq!((loaded.format, loaded.scene.len(), loaded.warnings.len()), (Format::SPLAT, 4, 0));
    let g = gaussians(&loaded);
    assert_eq!(g.position[0].to_array(), [-1.0, 0.0, -1.0]);
    assert!((g.scale(0) - 0.1).abs().max_element() < 1e-7);
    assert!((g.opacity(0) - 230.0 / 255.0).abs() < 1e-6);
    assert_eq!(g.rotation[0], [0.0, 0.0, 0.0, 127.0 / 128.0]);
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.splat");
    save(&copy, &loaded.scene, &SaveOptions::default()).unwrap();
    // A scale goes through its logarithm, so it keeps its value to the rounding of `f32`.
    let (was, is) = (std::fs::read(&path).unwrap(), std::fs::read(copy).unwrap());
    assert_eq!(was.len(), is.len());
    for (was, is) in was.chunks(32).zip(is.chunks(32)) {
        assert!(was[..12] == is[..12] && was[24..] == is[24..]);
    }
    for (was, is) in g.log_scale.iter().zip(&gaussians(&open(&folder.path().join("copy.splat"))).log_scale) {
        assert!((*was - *is).abs().max_element() < 1e-6);
    }
}
