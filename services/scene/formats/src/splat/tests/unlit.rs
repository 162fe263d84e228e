//! Editable scenes as scenes of fixed colours, and back.

use glam::{DVec3, Vec3};
use sg_scene::model::{BaseUnit, Convention, ExtraColumn, ExtraValues, Scene};
use sg_scene::synthetic::samples;

use super::{C0, Folder, as_format};
use crate::splat::Format;
use crate::{SaveOptions, save};

/// The unlit colour of a Gaussian as a renderer takes it.
fn unlit_color(unit: &BaseUnit, i: usize) -> DVec3 {
    match (&unit.gaussians.shading, &unit.gaussians.harmonics) {
        (Some(s), _) => (unit.palette + s.offset_color[i]).as_dvec3(),
        (None, Some(h)) => DVec3::from_array(h.dc[i].map(f64::from)) * C0 + 0.5,
        (None, None) => DVec3::splat(0.5),
    }
}

#[test]
fn two_units_become_one_of_fixed_colours() {
    let folder = Folder::new();
    let mut scene = samples::two_units(100);
    // Other programs get no column that only a transfer function reads.
    let shaded = scene.units.iter_mut().find(|unit| unit.gaussians.shading.is_some()).unwrap();
    let values = ExtraValues::F32(vec![7.0; shaded.gaussians.len()]);
    shaded.gaussians.extra.push(ExtraColumn { name: "source_value".to_owned(), values });
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
