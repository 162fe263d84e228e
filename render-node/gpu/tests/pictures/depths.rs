//! Depths of a picture, on the device against the cores.

use glam::{DVec2, Vec3};
use sg_gpu::{DEPTH_FAR, DEPTH_NEAR, DepthLayer, Gpu, Rasterizer, Renderer, Settings};
use sg_raster::pick::{SURFACE, drawn_center, front_ids, hit_of};
use sg_raster::render::{Options, Projection, Quality, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::cases::{self, Case};
use crate::scenes::{Blob, camera, fog, scene, side_view, surface};
use crate::support::device;

/// Pixels of depths of the device for one of the quadrilaterals', each way.
const COARSE: u32 = 4;

/// Depths of one picture.
fn depths(gpu: &Gpu, case: &Case, settings: Settings) -> Vec<f32> {
    let mut renderer = Renderer::new(gpu, &case.scene).unwrap();
    let settings = Settings { depths: true, ..settings };
    renderer.picture(std::slice::from_ref(&case.camera), &case.appearance, settings).unwrap();
    renderer.read_depths().unwrap().remove(0)
}

/// View z of the front of each pixel, as picking finds it; 0 if there is none. In the affine projection that of the centre.
fn picked(case: &Case, projection: Projection) -> Vec<f64> {
    let Case { scene, appearance, camera, .. } = case;
    let (ids, _) = front_ids(scene, appearance, camera, projection, SURFACE).unwrap();
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let depth = |(x, y)| {
        let front = ids.at(x, y)?;
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        // A centre behind the eye has no depth.
        let center = drawn_center(scene, appearance, camera, front).filter(|center| center.z > 0.0);
        match (projection, center) {
            (Projection::Affine, Some(center)) => Some(center.z),
            _ => hit_of(scene, appearance, camera, front, at).map(|hit| hit.depth),
        }
    };
    pixels.map(|pixel| depth(pixel).unwrap_or(0.0)).collect()
}

fn center_depth(scene: &Scene, camera: &Camera, gaussian: usize) -> f64 {
    camera.view().transform_point3(scene.position(gaussian).unwrap()).z
}

/// Pixels whose depths differ by more than a thousandth, those in which one alone finds a front, and how many have one.
fn compare(got: &[f32], want: &[f64]) -> [usize; 3] {
    assert_eq!(got.len(), want.len());
    let (mut off, mut missed, mut fronts) = (0, 0, 0);
    for (got, want) in got.iter().zip(want) {
        let got = f64::from(*got);
        fronts += usize::from(*want > 0.0);
        missed += usize::from((got > 0.0) != (*want > 0.0));
        off += usize::from(got > 0.0 && *want > 0.0 && (got - want).abs() > 1e-3 * want);
    }
    [off, missed, fronts]
}

#[test]
fn tiles_and_rays_depths_equal_exact_picking() {
    let Some(gpu) = device() else { return };
    let (mut compared, mut broken) = (0, Vec::new());
    for case in cases::all() {
        // Squares of its coordinates leave f32.
        let beyond = case.name == "mixture of extremes";
        let colors_alone = ["ivrgs", "directional", "shown", "normals", "harmonics", "ambient", "diffuse", "specular"];
        if beyond || colors_alone.iter().any(|what| case.name.starts_with(what)) {
            continue;
        }
        for projection in [Projection::Affine, Projection::PerRay] {
            let got = depths(&gpu, &case, Settings { projection, ..Settings::default() });
            let want = picked(&case, projection);
            let [off, missed, fronts] = compare(&got, &want);
            let line = format!("{:30} {projection:?}: {off} off, {missed} missed of {fronts}", case.name);
            println!("{line}");
            compared += fronts;
            // The device leaves out layers fainter than the cut. If rounding or many such layers decide the one that reaches the
            // level, the device finds another one.
            let few = match (case.name, projection) {
                ("thousand-layer cloud", _) => fronts / 10,
                // Discs cross at the eye, and their order changes within a pixel.
                ("eye touches a surface", _) => fronts / 100,
                _ => fronts / 200 + 1,
            };
            if off > few || missed > fronts / 200 + 1 {
                broken.push(line);
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
    assert!(compared > 50_000, "there is something in front: {compared}");
}

#[test]
fn quadrilaterals_tell_the_mean_depth_of_all_that_a_pixel_shows() {
    let Some(gpu) = device() else { return };
    let case = |blobs: &[Blob], camera: Camera| {
        let scene = scene(blobs);
        Case { name: "", appearance: Appearance::of(&scene), scene, camera }
    };
    let solid: Vec<Blob> = surface(20_000, 3).iter().map(|b| Blob { logit: 6.0, ..*b }).collect();
    for (blobs, camera) in [(solid, side_view(161, 118, 45.0)), (fog(3000, 0.05, 14), side_view(100, 80, 30.0))] {
        let case = case(&blobs, camera);
        let got = depths(&gpu, &case, Settings { rasterizer: Rasterizer::Quads, ..Settings::default() });
        let Camera { width, height, .. } = case.camera;
        let coarse = [width, height].map(|pixels| pixels.div_ceil(COARSE));
        // The exact picture of as many pixels, each colour the depth of its centre. Without a background that is the mean depth
        // times the opacity. The dilation stays that of the whole picture, so each pixel is drawn by itself.
        let appearance = Appearance {
            background: Vec3::ZERO,
            colors: Some(
                (0..case.scene.len()).map(|i| Vec3::splat(center_depth(&case.scene, &case.camera, i) as f32)).collect(),
            ),
            ..case.appearance.clone()
        };
        let options = Options { quality: Quality::Exact, projection: Projection::Affine, ..Options::default() };
        let (mut off, mut fronts) = (0, 0);
        for (k, got) in got.iter().enumerate().step_by(7) {
            let at = DVec2::new((k as u32 % coarse[0]).into(), (k as u32 / coarse[0]).into()) + 0.5;
            let at = at * DVec2::new(width.into(), height.into()) / DVec2::new(coarse[0].into(), coarse[1].into());
            let Camera { cx, cy, .. } = case.camera;
            let one = Camera { width: 1, height: 1, cx: cx - at.x + 0.5, cy: cy - at.y + 0.5, ..case.camera.clone() };
            let pixel = render(&case.scene, &appearance, &one, options).unwrap().image.pixel(0, 0).unwrap();
            let want = if f64::from(pixel[3]) >= SURFACE { pixel[0] / pixel[3] } else { 0.0 };
            fronts += usize::from(want > 0.0);
            off += usize::from((got - want).abs() > 1e-3 * want);
        }
        println!("{off} of {fronts} pixels are off by a thousandth");
        assert!(fronts > 50 && off <= fronts / 50, "{off} of {fronts}");
    }
}

/// At a solid surface the mean lies behind the front, by less than the thickness.
#[test]
fn the_mean_depth_of_a_solid_surface_is_near_its_front() {
    let Some(gpu) = device() else { return };
    let solid: Vec<Blob> = surface(20_000, 3).iter().map(|b| Blob { logit: 6.0, ..*b }).collect();
    let scene = scene(&solid);
    let case = Case { name: "", appearance: Appearance::of(&scene), scene, camera: side_view(160, 120, 45.0) };
    let mean = depths(&gpu, &case, Settings { rasterizer: Rasterizer::Quads, ..Settings::default() });
    let front = depths(&gpu, &case, Settings::default());
    let mut differences: Vec<f32> = (0..40 * 30)
        .map(|k| (mean[k], front[(4 * (k / 40) + 2) * 160 + 4 * (k % 40) + 2]))
        .filter(|(mean, front)| *mean > 0.0 && *front > 0.0)
        .map(|(mean, front)| (mean - front).abs() / front)
        .collect();
    differences.sort_by(f32::total_cmp);
    let at = |share: f64| differences[(share * (differences.len() - 1) as f64) as usize];
    println!("{} pixels: median {:.4}, nine in ten below {:.4}", differences.len(), at(0.5), at(0.9));
    assert!(differences.len() > 200 && at(0.5) < 0.01 && at(0.9) < 0.05);
}

#[test]
fn depths_are_optional_and_change_no_picture() {
    let Some(gpu) = device() else { return };
    let scene = scene(&surface(3000, 9));
    let look = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let right = side_view(96, 64, 40.0);
    let left = Camera { cx: right.cx + 1.0, ..right.clone() };
    let rays = Settings { projection: Projection::PerRay, ..Settings::default() };
    let quads = Settings { rasterizer: Rasterizer::Quads, ..Settings::default() };
    for settings in [Settings::default(), quads, rays, quads] {
        let eyes = [left.clone(), right.clone()];
        let (plain, _) = renderer.picture(&eyes, &look, settings).unwrap();
        assert!(renderer.depths().is_empty());
        let (asked, _) = renderer.picture(&eyes, &look, Settings { depths: true, ..settings }).unwrap();
        assert_eq!(plain, asked, "{settings:?}");
        let both = renderer.read_depths().unwrap();
        assert!(both.len() == 2 && both[0] != both[1] && both.iter().all(|eye| eye.iter().any(|d| *d > 0.0)));
        for (eye, camera) in both.iter().zip(&eyes) {
            let alone = std::slice::from_ref(camera);
            renderer.picture(alone, &look, Settings { depths: true, ..settings }).unwrap();
            assert_eq!(&renderer.read_depths().unwrap()[0], eye, "{settings:?}");
        }
    }
}

/// Lists that are blended in windows and stretches note the depth once.
#[test]
fn the_front_depth_is_found_in_every_sort_window() {
    let Some(gpu) = device() else { return };
    let scene = scene(&fog(6000, 0.01, 14));
    let look = Appearance::of(&scene);
    let camera = [side_view(100, 80, 30.0)];
    let settings = Settings { depths: true, ..Settings::default() };
    let mut whole = Renderer::new(&gpu, &scene).unwrap();
    whole.picture(&camera, &look, settings).unwrap();
    let windows = sg_gpu::Options { listed_pairs: 4096, ..Default::default() };
    let mut parts = Renderer::with_options(&gpu, &scene, windows).unwrap();
    let (_, drawn) = parts.picture(&camera, &look, settings).unwrap();
    assert!(drawn.tile_pairs > 8 * 4096, "several windows: {} pairs", drawn.tile_pairs);
    assert_eq!(whole.read_depths().unwrap(), parts.read_depths().unwrap());
}

#[test]
fn a_depth_image_equals_the_projection_between_its_planes() {
    let Some(gpu) = device() else { return };
    // In units of half a metre, the last two nearer and farther than the planes.
    let depths = [0.0_f32, 0.2, 1.0, 4.0, 30.0, 900.0, 0.01, 5000.0];
    let extent = |width, height| wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = |format, size, usage| {
        gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    };
    let source = texture(
        wgpu::TextureFormat::R32Float,
        extent(8, 1),
        wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
    );
    let bytes: &[u8] = bytemuck::cast_slice(&depths);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(32), rows_per_image: None };
    gpu.queue().write_texture(source.as_image_copy(), bytes, layout, source.size());
    let [width, height] = [64, 2];
    let target = texture(
        wgpu::TextureFormat::Depth32Float,
        extent(width, height),
        wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
    );
    let read = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(4 * width * height),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layer = DepthLayer::new(&gpu, wgpu::TextureFormat::Depth32Float);
    let view = target.create_view(&wgpu::TextureViewDescriptor::default());
    layer.encode(&mut encoder, (&source, [8, 1]), (&view, [width, height]), 0.5);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
    let copy = wgpu::TexelCopyBufferInfo { buffer: &read, layout };
    encoder.copy_texture_to_buffer(target.as_image_copy(), copy, target.size());
    gpu.queue().submit([encoder.finish()]);
    read.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device().poll(wgpu::PollType::wait_indefinitely()).unwrap();
    gpu.check().unwrap();
    let stored: Vec<f32> = bytemuck::pod_collect_to_vec(&read.get_mapped_range(..).unwrap());
    for (k, stored) in stored.iter().enumerate() {
        let metres = 0.5 * depths[k % 64 / 8];
        let seen = if metres > 0.0 { metres.clamp(DEPTH_NEAR, DEPTH_FAR) } else { DEPTH_FAR };
        let [n, f, z] = [DEPTH_NEAR, DEPTH_FAR, seen].map(f64::from);
        let want = f / (f - n) * (1.0 - n / z);
        assert!((f64::from(*stored) - want).abs() < 1e-6, "{k}: {stored}, not {want}");
    }
}

/// A camera inside a Gaussian has it at the near plane, not far away.
#[test]
fn gaussians_around_the_eye_are_near() {
    let Some(gpu) = device() else { return };
    let around = Blob { position: Vec3::ZERO, log_scale: Vec3::splat(0.0), logit: 9.0, ..Blob::default() };
    // Of each the half before the eye is seen.
    let scene = scene(&[around; 3]);
    let case = Case { name: "", appearance: Appearance::of(&scene), scene, camera: camera(40.0, 16, 16) };
    let got = depths(&gpu, &case, Settings { projection: Projection::PerRay, ..Settings::default() });
    assert!(got.iter().all(|d| *d > 0.0 && *d < 0.1), "{got:?}");
}

/// The cost of depths beside a pair of pictures, in seconds. Run by hand.
#[test]
#[ignore = "a measurement"]
fn what_depths_cost() {
    let Some(gpu) = device() else { return };
    let scene = scene(&surface(20_000, 5));
    let look = Appearance::of(&scene);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let right = side_view(480, 480, 45.0);
    let eyes = [Camera { cx: right.cx + 4.0, ..right.clone() }, right];
    let rays = Settings { projection: Projection::PerRay, ..Settings::default() };
    let quads = Settings { rasterizer: Rasterizer::Quads, ..Settings::default() };
    for (name, settings) in [("tiles", Settings::default()), ("rays", rays), ("quadrilaterals", quads)] {
        let mut seconds = [const { Vec::new() }; 2];
        for _ in 0..9 {
            // One after another, so that other load of the machine falls on both alike.
            for (depths, seconds) in [false, true].into_iter().zip(&mut seconds) {
                let settings = Settings { depths, ..settings };
                renderer.draw(&eyes, &look, settings).unwrap();
                renderer.finish().unwrap();
                let begun = std::time::Instant::now();
                renderer.draw(&eyes, &look, settings).unwrap();
                renderer.finish().unwrap();
                seconds.push(begun.elapsed().as_secs_f64());
            }
        }
        let [plain, with] = seconds.map(|mut all| {
            all.sort_by(f64::total_cmp);
            format!("least {:.1} ms, median {:.1} ms", 1e3 * all[0], 1e3 * all[4])
        });
        println!("{}, {name}: {plain}; with depths {with}", gpu.name());
    }
}
