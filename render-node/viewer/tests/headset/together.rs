//! Both eyes in one pass, with the driver of Monado's folder: that of Debian 12 draws the right eye wrongly.

use glam::{DMat4, DQuat, DVec3};
use sg_gpu::{DeviceClass, Gpu, Options, Rasterizer, Renderer, Settings};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::monado::{is_inside, run_inside};
use crate::scenes::{cloud, scene, side_view};

/// A camera beside another, turned inwards by `turn`.
fn eye(camera: &Camera, right: f64, turn: f64) -> Camera {
    let moved = DMat4::from_quat(DQuat::from_rotation_y(turn))
        * DMat4::from_translation(DVec3::new(-right, 0.0, 0.0))
        * camera.view();
    Camera { world_to_camera: moved.transpose().to_cols_array(), ..camera.clone() }
}

/// Both eyes in one pass get the same pictures as each in its own.
#[test]
fn both_eyes_together_are_each_by_itself() {
    run_inside("together::inside_both_eyes_together_are_each_by_itself");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_both_eyes_together_are_each_by_itself() {
    if !is_inside() {
        return;
    }
    let gpu = Gpu::open(DeviceClass::Any).unwrap();
    let scene = scene(&cloud(6_000, 6));
    let middle = side_view(240, 180, 30.0);
    let eyes = [eye(&middle, -0.03, 0.0), eye(&middle, 0.03, 0.0)];
    let canted = [eye(&middle, -0.03, 0.1), eye(&middle, 0.03, -0.1)];
    for rasterizer in [Rasterizer::Quads, Rasterizer::Bands] {
        agree(&gpu, &scene, (&eyes, &canted), Settings { rasterizer, ..Settings::default() });
    }
}

/// One pass for both eyes and one for each give the same pictures.
fn agree(gpu: &Gpu, scene: &Scene, (eyes, canted): (&[Camera; 2], &[Camera; 2]), settings: Settings) {
    let appearance = Appearance::of(scene);
    let mut drawn = [false, true].map(|multiview| {
        let options = Options { multiview: Some(multiview), ..Options::default() };
        let mut renderer = Renderer::with_options(gpu, scene, options).unwrap();
        assert!(renderer.blends_quads());
        let mut seconds = Vec::new();
        for _ in 0..3 {
            let (_, drawn) = renderer.picture(eyes, &appearance, settings).unwrap();
            seconds.extend(drawn.seconds.map(|s| s.blend));
        }
        seconds.sort_by(f64::total_cmp);
        println!(
            "{:?}, one pass for both eyes {multiview}: blending took {:?} s at least, {:?} s in the median of 5",
            settings.rasterizer,
            seconds.first(),
            seconds.get(2)
        );
        let pictures =
            |renderer: &mut Renderer, eyes: &[Camera]| renderer.picture(eyes, &appearance, settings).unwrap().0;
        // A picture of one eye in between: targets for two eyes must not be confused with it.
        let parallel = pictures(&mut renderer, eyes);
        let one = pictures(&mut renderer, &eyes[1..]);
        let canted = pictures(&mut renderer, canted);
        [parallel, one, canted, pictures(&mut renderer, eyes)].concat()
    });
    let together = std::mem::take(&mut drawn[1]);
    assert_eq!(together.len(), drawn[0].len());
    for (k, (together, apart)) in together.iter().zip(&drawn[0]).enumerate() {
        assert!(together.rgba.iter().any(|x| *x > 0.1));
        let off = together.rgba.iter().zip(&apart.rgba).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= 1e-6, "picture {k}: {off}");
    }
}
