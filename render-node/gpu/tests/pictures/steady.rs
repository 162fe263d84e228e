//! Frames of a prepared renderer create nothing on their thread, staging memory included, and draw what another renderer draws.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3};
use sg_gpu::{
    DepthLayer, MeshCorner, MeshEye, MeshLayer, MeshLook, Options, PlacedMesh, Present, Rasterizer, Renderer, Settings,
    created_on_this_thread,
};
use sg_raster::image::Image;
use sg_raster::render::{Projection, Quality};
use sg_scene::appearance::{Appearance, Clip, Overlay, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::tone::Tone;

use crate::allocations::{Allocations, during};
use crate::scenes;
use crate::support::device;

/// Heap allocations of a frame at most. All but a few are wgpu's, for its own lists of what a submission uses, and small: they grow
/// neither with the frames nor with the Gaussians.
const MOST: Allocations = Allocations { count: 640, bytes: 128 << 10, largest: 32 << 10 };

/// Width and height at the whole edge.
const SIZE: u32 = 96;

/// The look of a frame of a session in which a person brushes, recolours units and moves clips.
fn look(scene: &Scene, frame: usize) -> Appearance {
    let mut look = Appearance::of(scene);
    let n = scene.len();
    let mask = |from: usize, to: usize| Arc::new(Mask::from_fn(n, |i| (from..to).contains(&(i % n))));
    // The highlight comes and goes, and grows while it is there.
    if frame % 100 > 20 {
        let grown = n * (frame % 100) / 200;
        let (color, mix, opacity) = (Vec3::new(0.3, 0.7, 0.9), 0.6, 1.0);
        look.overlay = Some(Overlay { mask: mask(0, grown), color, mix, opacity });
    }
    // Up to ten units, each with a colour that changes.
    for unit in 0..frame / 50 % 11 {
        let color = Some(Vec3::new((frame % 7) as f32 / 7.0, unit as f32 / 10.0, 0.5));
        let [from, to] = [unit, unit + 1].map(|k| n * k / 10);
        look.units.push(UnitAppearance {
            mask: mask(from, to),
            color,
            opacity: 0.8,
            visible: unit != 3,
            tone: Tone::NEUTRAL,
        });
    }
    for clip in 0..frame / 30 % 4 {
        let at = scene.bounds.min.lerp(scene.bounds.max, 0.05 * clip as f64 + 0.001 * (frame % 30) as f64);
        look.clips.push(Clip::plane(at, DVec3::new(1.0, 0.2 * clip as f64, 0.0)));
    }
    if frame / 200 % 2 == 1 {
        look.colors = Some((0..n).map(|i| Vec3::splat((i % 5) as f32 / 5.0)).collect());
    }
    look
}

/// Both eyes at an edge over the whole one.
fn eyes(scene: &Scene, edge: f64) -> Vec<Camera> {
    let size = (f64::from(SIZE) * edge).round() as u32;
    let left = framing::default_camera(scene, size, size);
    let mut right = left.clone();
    right.world_to_camera[3] -= 0.02 * scene.bounds.longest_edge();
    vec![left, right]
}

/// Level of a frame: its edge and quality.
fn level(frame: usize) -> (f64, Quality) {
    let step = frame / 7 % 12;
    (0.9_f64.powi(step as i32), if step == 0 { Quality::Standard } else { Quality::Fast })
}

fn worst(a: &[Image], b: &[Image]) -> f32 {
    assert_eq!(a.len(), b.len());
    let both = a.iter().zip(b).flat_map(|(a, b)| {
        assert_eq!((a.width, a.height), (b.width, b.height));
        a.rgba.iter().zip(&b.rgba)
    });
    both.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Frames without a new buffer, texture, pipeline, bind group or staging memory, and with few heap allocations, for one way to draw.
fn stays(projection: Projection, rasterizer: Rasterizer, (gaussians, frames): (usize, Range<usize>)) {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(gaussians, 7));
    let options = Options { half_pictures: true, ..Options::default() };
    let mut renderer = Renderer::with_options(&gpu, &scene, options).unwrap();
    let settings = Settings { projection, rasterizer, depths: true, ..Settings::default() };
    while !renderer.prepare(&eyes(&scene, 1.0), settings).unwrap() {}
    // The lists grow to what the first view needs.
    renderer.draw_complete(&eyes(&scene, 1.0), &look(&scene, 0), settings).unwrap();
    renderer.prepare(&eyes(&scene, 1.0), settings).unwrap();
    let before = created_on_this_thread();
    let mut heap = Allocations::default();
    // The order by ray keeps other buffers for each quality.
    let level = |frame: usize| match projection {
        Projection::Affine => level(frame),
        Projection::PerRay => (level(frame).0, settings.quality),
    };
    for frame in frames {
        let (edge, quality) = level(frame);
        let settings = Settings { quality, in_motion: frame / 5 % 2 == 1, ..settings };
        let (cameras, look) = (eyes(&scene, edge), look(&scene, frame));
        let (drawn, allocations) = during(|| renderer.draw(&cameras, &look, settings));
        drawn.unwrap();
        heap = heap.max(allocations);
        // As a display does, at most two frames wait for the device.
        if frame % 2 == 0 {
            gpu.wait().unwrap();
        }
    }
    gpu.wait().unwrap();
    assert_eq!(created_on_this_thread(), before, "{projection:?} {rasterizer:?}");
    println!(
        "{projection:?} {rasterizer:?}, {gaussians} Gaussians: {heap:?} at most a frame, {before:?} before and after"
    );
    assert!(heap.max(MOST) == MOST, "{projection:?} {rasterizer:?}: {heap:?} in a frame");
    // The pictures are those of a renderer of its own.
    for frame in [0, 48, 123, 405] {
        let (edge, quality) = level(frame);
        let (cameras, look, settings) = (eyes(&scene, edge), look(&scene, frame), Settings { quality, ..settings });
        let (kept, _) = renderer.picture(&cameras, &look, settings).unwrap();
        let depths = renderer.read_depths().unwrap();
        let mut other = Renderer::with_options(&gpu, &scene, options).unwrap();
        let (new, _) = other.picture(&cameras, &look, settings).unwrap();
        let off = worst(&kept, &new);
        assert!(off < 1e-5, "{projection:?} {rasterizer:?}, frame {frame}: {off}");
        let new = other.read_depths().unwrap();
        let same = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-4 * b.abs().max(1e-3);
        let far: usize = depths.iter().flatten().zip(new.iter().flatten()).filter(|pair| !same(*pair)).count();
        assert_eq!(depths.iter().map(Vec::len).collect::<Vec<_>>(), new.iter().map(Vec::len).collect::<Vec<_>>());
        assert_eq!(far, 0, "{projection:?} {rasterizer:?}, depths of frame {frame}");
    }
}

#[test]
fn a_thousand_frames_of_edits_and_levels_create_nothing_with_tiles() {
    stays(Projection::Affine, Rasterizer::Tiles, (400, 0..1000));
}

#[test]
fn a_thousand_frames_of_edits_and_levels_create_nothing_with_quadrilaterals() {
    stays(Projection::Affine, Rasterizer::Quads, (400, 0..1000));
    stays(Projection::Affine, Rasterizer::Bands, (400, 0..200));
}

#[test]
fn frames_of_edits_and_levels_create_nothing_by_ray() {
    stays(Projection::PerRay, Rasterizer::Tiles, (400, 0..100));
}

#[test]
fn frames_of_many_gaussians_allocate_no_more() {
    // With units, a highlight, clips, and colors that come and go. Twelve bytes for each Gaussian would be 240 kB.
    stays(Projection::Affine, Rasterizer::Tiles, (20_000, 180..230));
}

#[test]
fn occlusion_that_comes_and_goes_creates_nothing_once_it_is_expected() {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(400, 7));
    let factors: [Arc<[f32]>; 2] = [3, 5].map(|k: usize| (0..scene.len()).map(|i| (i % k) as f32 / k as f32).collect());
    let cameras = eyes(&scene, 1.0);
    let settings = Settings { depths: true, ..Settings::default() };
    let prepared = |expects: bool| {
        let mut renderer = Renderer::new(&gpu, &scene).unwrap();
        while !renderer.prepare(&cameras, settings).unwrap() {}
        renderer.draw_complete(&cameras, &look(&scene, 0), settings).unwrap();
        if expects {
            renderer.expect_occlusion();
        }
        while !renderer.prepare(&cameras, settings).unwrap() {}
        renderer
    };
    let mut renderer = prepared(true);
    let before = created_on_this_thread();
    let mut heap = Allocations::default();
    for frame in 0..80 {
        let mut look = look(&scene, frame);
        // Switched on and off, and computed anew meanwhile.
        look.occlusion = (frame / 10 % 2 == 1).then(|| Arc::clone(&factors[frame / 20 % 2]));
        let (drawn, allocations) = during(|| renderer.draw(&cameras, &look, settings));
        drawn.unwrap();
        heap = heap.max(allocations);
        if frame % 2 == 0 {
            gpu.wait().unwrap();
        }
    }
    gpu.wait().unwrap();
    assert_eq!(created_on_this_thread(), before);
    println!("occlusion: {heap:?} at most a frame");
    assert!(heap.max(MOST) == MOST, "{heap:?} in a frame");

    let mut renderer = prepared(false);
    let before = created_on_this_thread();
    let occluded = Appearance { occlusion: Some(Arc::clone(&factors[0])), ..look(&scene, 0) };
    renderer.draw(&cameras, &occluded, settings).unwrap();
    assert_ne!(created_on_this_thread(), before, "a frame compiles what nobody expected");
}

#[test]
fn the_layers_of_a_headset_create_nothing_in_a_frame() {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(400, 7));
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let settings = Settings { depths: true, ..Settings::default() };
    while !renderer.prepare(&eyes(&scene, 1.0), settings).unwrap() {}
    let (color, depth) = (wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Depth32Float);
    let target = |format| {
        let texture = gpu.texture("target", ([SIZE; 2], 1), format, wgpu::TextureUsages::RENDER_ATTACHMENT);
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    };
    let targets = [(); 2].map(|()| (target(color), target(depth)));
    let corner = |x: f32, y: f32| MeshCorner { position: Vec3::new(x, y, 0.0), normal: Vec3::Z };
    let triangle = vec![corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.0, 0.5)];
    let (present, layer) = (Present::new(&gpu, color), DepthLayer::new(&gpu, depth));
    let meshes = MeshLayer::new(&gpu, color, Some(depth), [SIZE; 2], &[triangle]);
    let placed = |k: u32| {
        let look = [MeshLook::Solid, MeshLook::Hole, MeshLook::Beam, MeshLook::Ball][k as usize % 4];
        let to_room = DMat4::from_translation(DVec3::new(0.0, 0.1 * f64::from(k), -1.0));
        PlacedMesh { mesh: 0, look, to_room, color: [0.5; 4], size: [1.0; 2], softness: 0.1, ghost: 0.1, corner: 0.0 }
    };
    let (mut heap, mut before) = (Allocations::default(), None);
    for frame in 0..60 {
        let (cameras, look) = (eyes(&scene, level(frame).0), look(&scene, frame));
        renderer.draw(&cameras, &look, settings).unwrap();
        let part = [cameras[0].width, cameras[0].height];
        let all: Vec<PlacedMesh> = (0..frame as u32 % 12).map(placed).collect();
        let ((), allocations) = during(|| {
            let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            for (k, (color, depth)) in targets.iter().enumerate() {
                let [picture, depths] = [&renderer.pictures()[k], &renderer.depths()[k]];
                let seen = MeshEye {
                    camera: &cameras[k],
                    right: k == 1,
                    picture,
                    depths: (depths, part),
                    scale: 1.0,
                    middle: DVec3::NEG_Z,
                    reveals: frame % 2 == 0,
                };
                let load = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
                present.encode_part(&mut encoder, (picture, part), color, [0, 0, part[0], part[1]], load);
                meshes.encode(&mut encoder, color, &seen, &all);
                layer.encode(&mut encoder, (depths, part), (depth, part), 1.0);
                meshes.encode_depths(&mut encoder, depth, &seen, &all);
            }
            gpu.submit([encoder.finish()]);
        });
        gpu.wait().unwrap();
        gpu.check().unwrap();
        // The first frame binds the pictures.
        if frame > 0 {
            heap = heap.max(allocations);
            assert_eq!(*before.get_or_insert_with(created_on_this_thread), created_on_this_thread(), "frame {frame}");
        }
    }
    println!("layers: {heap:?} at most a frame");
    assert!(heap.max(MOST) == MOST, "{heap:?}");
}
