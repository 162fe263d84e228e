//! Formats that keep every bit of a scene.

use glam::{DMat4, DQuat, DVec3};
use proptest::prelude::*;
use sg_scene::model::{Scene, SceneBox, ShadingModel};
use sg_scene::synthetic::samples;

use super::{Folder, any_columns};
use crate::SaveOptions;
use crate::splat::{Format, columns};

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
}
