//! Pixels that lenses hide are not drawn, and visible pixels are drawn as ever.

use glam::{DQuat, DVec2, DVec3, Vec2};
use sg_gpu::{DeviceClass, Gpu, Options, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::render::Projection;
use sg_scene::appearance::Appearance;
use sg_scene::camera::{Camera, Light};
use sg_viewer::hands::{Eye, Fov, Placement, Pose};

use crate::{NEAR, scenes};

const SIZE: [u32; 2] = [200, 160];

fn device() -> Option<Gpu> {
    match Gpu::open(DeviceClass::Any) {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var_os("SUPERGAUSSIAN_REQUIRE_GPU").is_none_or(|v| v != "1"), "{error}");
            println!("SKIPPED: {error}");
            None
        }
    }
}

/// The four corners of an eye's picture, as lenses hide them. The rest is an octagon.
fn corners(share: f64) -> Vec<[DVec2; 3]> {
    let corner = |x: f64, y: f64| {
        let inward = |at: f64| if at > 0.5 { at - share } else { at + share };
        [DVec2::new(x, y), DVec2::new(inward(x), y), DVec2::new(x, inward(y))]
    };
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| corner(x, y)).into()
}

/// Whether one of the triangles hides a pixel, and whether the answer is certain: its middle is not on an edge.
fn hidden(triangles: &[[DVec2; 3]], x: u32, y: u32) -> Option<bool> {
    hidden_in(triangles, SIZE, x, y)
}

/// The same in a picture of any size.
fn hidden_in(triangles: &[[DVec2; 3]], [width, height]: [u32; 2], x: u32, y: u32) -> Option<bool> {
    let size = DVec2::new(width.into(), height.into());
    let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let mut inside = false;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|corner| corner * size);
        let side = |a: DVec2, b: DVec2| (b - a).perp_dot(at - a) / a.distance(b);
        let sides = [side(a, b), side(b, c), side(c, a)];
        let turn = (b - a).perp_dot(c - a).signum();
        if sides.iter().any(|s| s.abs() < 0.02) && sides.iter().all(|s| s * turn > -0.02) {
            return None;
        }
        inside |= sides.iter().all(|s| s * turn > 0.0);
    }
    Some(inside)
}

fn eye(x: f64, yaw: f64) -> Eye {
    let fov = Fov { left: -0.8, right: 0.6, up: 0.7, down: -0.75 };
    Eye { pose: Pose { position: DVec3::new(x, 1.2, 0.0), orientation: DQuat::from_rotation_y(yaw) }, fov }
}

#[test]
fn masked_pixels_are_not_drawn_and_the_rest_is_bit_for_bit_equal() {
    if let Some(gpu) = device() {
        hides(&gpu, Some(false));
    }
}

/// In one pass for both eyes, with the driver of the runtime's folder: older ones draw the right eye wrongly so.
#[cfg(feature = "xr")]
#[test]
fn one_stereo_pass_skips_the_hidden_pixels_of_each_eye() {
    crate::monado::run_inside("mask::inside_one_stereo_pass_skips_the_hidden_pixels_of_each_eye");
}

#[cfg(feature = "xr")]
#[test]
#[ignore = "run by the test without `inside`"]
fn inside_one_stereo_pass_skips_the_hidden_pixels_of_each_eye() {
    if crate::monado::is_inside()
        && let Some(gpu) = device()
    {
        hides(&gpu, Some(true));
    }
}

fn hides(gpu: &Gpu, multiview: Option<bool>) {
    let scene = scenes::scene(&scenes::surface(3000, 5));
    let appearance = Appearance { background: glam::Vec3::new(0.1, 0.2, 0.3), ..Appearance::of(&scene) };
    let mut renderer = Renderer::with_options(gpu, &scene, Options { multiview, ..Options::default() }).unwrap();
    if !renderer.blends_quads() {
        println!("SKIPPED: this device blends no quadrilaterals");
        return;
    }
    let mut placement = Placement::fit(scene.bounds, DVec3::Y, DVec3::NEG_Z, Default::default(), Default::default());
    // Near enough to fill both eyes' pictures.
    placement = placement.scaled(DVec3::new(0.0, 1.2, -0.8), 3.0 * placement.scale);
    let cameras = |eyes: &[Eye]| -> Vec<Camera> {
        eyes.iter()
            .map(|e| e.camera(SIZE, &placement, NEAR, appearance.background.to_array(), Light::default()))
            .collect()
    };
    let settings = Settings { rasterizer: Rasterizer::Quads, ..Settings::default() };
    let meshes = [corners(0.35), corners(0.2)];
    let told = [0, 1].map(|k| meshes[k].iter().map(|t| t.map(DVec2::as_vec2)).collect::<Vec<[Vec2; 3]>>());
    let cases: [&[Eye]; 3] =
        [&[eye(-0.03, 0.0), eye(0.03, 0.0)], &[eye(-0.03, 0.1), eye(0.03, -0.1)], &[eye(0.0, 0.0)]];
    for eyes in cases {
        let cameras = cameras(eyes);
        renderer.hide([&[], &[]]);
        let (whole, _) = renderer.picture(&cameras, &appearance, settings).unwrap();
        renderer.hide([&told[0], &told[1]]);
        let (masked, _) = renderer.picture(&cameras, &appearance, settings).unwrap();
        for (k, mesh) in meshes.iter().enumerate().take(eyes.len()) {
            compare(&whole[k], &masked[k], mesh, appearance.background);
        }
        // It is taken back as well.
        renderer.hide([&[[Vec2::NAN; 3]], &[]]);
        let (again, _) = renderer.picture(&cameras, &appearance, settings).unwrap();
        assert!(whole.iter().zip(&again).all(|(a, b)| a.rgba == b.rgba));
    }
}

fn compare(whole: &Image, masked: &Image, mesh: &[[DVec2; 3]], background: glam::Vec3) {
    let (mut drawn, mut left) = (0, 0);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let at = 4 * (y * SIZE[0] + x) as usize;
            let (a, b) = (&whole.rgba[at..at + 4], &masked.rgba[at..at + 4]);
            match hidden(mesh, x, y) {
                Some(true) => {
                    left += 1;
                    drawn += usize::from(a[3] > 0.0);
                    assert_eq!(b, [background.x, background.y, background.z, 0.0], "hidden and drawn: {x}, {y}");
                }
                Some(false) => assert_eq!(a, b, "seen and touched: {x}, {y}"),
                None => (),
            }
        }
    }
    println!("{left} of {} pixels hidden, {drawn} of them drawn without a mask", SIZE[0] * SIZE[1]);
    assert!(left > 1000 && drawn > 500, "the scene is not where the mask is: {left}, {drawn}");
}

/// Tiles that the lenses hide whole cost no pair and stay background; visible pixels are those of the picture without a mask.
#[test]
fn hidden_tiles_cost_no_pair_and_visible_pixels_stay() {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(3000, 5));
    let appearance = Appearance { background: glam::Vec3::new(0.1, 0.2, 0.3), ..Appearance::of(&scene) };
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let mut placement = Placement::fit(scene.bounds, DVec3::Y, DVec3::NEG_Z, Default::default(), Default::default());
    placement = placement.scaled(DVec3::new(0.0, 1.2, -0.8), 3.0 * placement.scale);
    let cameras = |eyes: &[Eye], size: [u32; 2]| -> Vec<Camera> {
        eyes.iter()
            .map(|e| e.camera(size, &placement, NEAR, appearance.background.to_array(), Light::default()))
            .collect()
    };
    let everything = [[DVec2::splat(-3.0), DVec2::new(9.0, -3.0), DVec2::new(-3.0, 9.0)]];
    let meshes = [corners(0.45), corners(0.3)];
    let told = |meshes: &[Vec<[DVec2; 3]>; 2]| {
        meshes.each_ref().map(|mesh| mesh.iter().map(|t| t.map(DVec2::as_vec2)).collect::<Vec<[Vec2; 3]>>())
    };
    let cases: [&[Eye]; 3] =
        [&[eye(-0.03, 0.0), eye(0.03, 0.0)], &[eye(-0.03, 0.1), eye(0.03, -0.1)], &[eye(0.0, 0.0)]];
    for (projection, edge) in [(Projection::Affine, 16), (Projection::PerRay, 8)] {
        let settings = Settings { rasterizer: Rasterizer::Tiles, projection, depths: true, ..Settings::default() };
        for eyes in cases {
            // A smaller picture after a larger one uses the same tables.
            for size in [SIZE, [SIZE[0] / 2 + 3, SIZE[1] / 2 + 1]] {
                let cameras = cameras(eyes, size);
                renderer.hide([&[], &[]]);
                let (whole, all) = renderer.picture(&cameras, &appearance, settings).unwrap();
                let depths = renderer.read_depths().unwrap();
                let [left, right] = told(&meshes);
                renderer.hide([&left, &right]);
                let (masked, some) = renderer.picture(&cameras, &appearance, settings).unwrap();
                let masked_depths = renderer.read_depths().unwrap();
                assert!(some.tile_pairs < all.tile_pairs, "{} of {} pairs", some.tile_pairs, all.tile_pairs);
                let (mut hidden_tiles, mut tiles) = (0, 0);
                for (k, mesh) in meshes.iter().enumerate().take(eyes.len()) {
                    let pictures = (&whole[k], &masked[k], depths[k].as_slice(), masked_depths[k].as_slice());
                    let [hidden, drawn] = compare_tiles(pictures, mesh, edge, appearance.background);
                    (hidden_tiles, tiles) = (hidden_tiles + hidden, tiles + drawn);
                }
                println!(
                    "{projection:?}, {} eyes of {size:?}: {} of {} pairs, {hidden_tiles} of {tiles} tiles hidden",
                    eyes.len(),
                    some.tile_pairs,
                    all.tile_pairs
                );
                assert!(hidden_tiles > 0, "no tile is hidden");
                // A mask over everything leaves no pair.
                let [left, right] = told(&[everything.to_vec(), everything.to_vec()]);
                renderer.hide([&left, &right]);
                let (none, stats) = renderer.picture(&cameras, &appearance, settings).unwrap();
                assert_eq!(stats.tile_pairs, 0);
                let [r, g, b] = appearance.background.to_array();
                assert!(none.iter().flat_map(|p| p.rgba.chunks_exact(4)).all(|p| p == [r, g, b, 0.0]));
            }
        }
    }
}

/// Compares a picture and its depths without a mask and with one. Returns the numbers of hidden tiles and of all.
fn compare_tiles(
    (whole, masked, depths, masked_depths): (&Image, &Image, &[f32], &[f32]),
    mesh: &[[DVec2; 3]],
    edge: u32,
    background: glam::Vec3,
) -> [usize; 2] {
    let size = [whole.width, whole.height];
    let (mut hidden_tiles, mut tiles) = (0, 0);
    for top in (0..size[1]).step_by(edge as usize) {
        for left in (0..size[0]).step_by(edge as usize) {
            let pixels =
                (top..(top + edge).min(size[1])).flat_map(|y| (left..(left + edge).min(size[0])).map(move |x| (x, y)));
            let is_hidden = pixels.clone().all(|(x, y)| hidden_in(mesh, size, x, y) == Some(true));
            tiles += 1;
            hidden_tiles += usize::from(is_hidden);
            for (x, y) in pixels {
                let at = (y * size[0] + x) as usize;
                let (a, b) = (&whole.rgba[4 * at..4 * at + 4], &masked.rgba[4 * at..4 * at + 4]);
                if is_hidden {
                    assert_eq!(b, [background.x, background.y, background.z, 0.0], "hidden and drawn: {x}, {y}");
                    assert_eq!(masked_depths[at], 0.0, "hidden with a depth: {x}, {y}");
                } else if hidden_in(mesh, size, x, y) == Some(false) {
                    assert_eq!((a, depths[at]), (b, masked_depths[at]), "seen and touched: {x}, {y}");
                }
            }
        }
    }
    [hidden_tiles, tiles]
}

/// The cost and the saving of a mask, in seconds for a pair of pictures. Run by hand.
#[test]
#[ignore = "a measurement"]
fn savings_of_a_visibility_mask() {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(4000, 5));
    let appearance = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let fitted = Placement::fit(scene.bounds, DVec3::Y, DVec3::NEG_Z, Default::default(), Default::default());
    let settings = Settings { rasterizer: Rasterizer::Quads, ..Settings::default() };
    for (size, nearer) in [(480, 1.0), (480, 3.0)] {
        let placement = fitted.scaled(DVec3::new(0.0, 1.2, -0.8), nearer * fitted.scale);
        let cameras = [eye(-0.03, 0.0), eye(0.03, 0.0)]
            .map(|e| e.camera([size; 2], &placement, NEAR, appearance.background.to_array(), Light::default()));
        let shares = [0.0, 0.1, 0.3, 0.5];
        let mut seconds = [const { Vec::new() }; 4];
        for _ in 0..7 {
            // One after another, so that other load of the machine falls on all alike.
            for (k, share) in shares.into_iter().enumerate() {
                let mesh: Vec<[Vec2; 3]> = corners(share).iter().map(|t| t.map(DVec2::as_vec2)).collect();
                let mesh = if share > 0.0 { &mesh[..] } else { &[] };
                renderer.hide([mesh, mesh]);
                renderer.draw(&cameras, &appearance, settings).unwrap();
                renderer.finish().unwrap();
                let begun = std::time::Instant::now();
                renderer.draw(&cameras, &appearance, settings).unwrap();
                renderer.finish().unwrap();
                seconds[k].push(begun.elapsed().as_secs_f64());
            }
        }
        for (share, mut all) in shares.into_iter().zip(seconds) {
            all.sort_by(f64::total_cmp);
            let hidden = 100.0 * 2.0 * share * share;
            println!(
                "{size}², scene {nearer} times as large, {hidden:.0} % hidden: least {:.1} ms, median {:.1} ms",
                1e3 * all[0],
                1e3 * all[3]
            );
        }
    }
}
