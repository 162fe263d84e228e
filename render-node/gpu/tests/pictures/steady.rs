//! Frames of a prepared renderer create nothing on their thread, staging memory included, and draw what another renderer draws.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use sg_gpu::{Options, Rasterizer, Renderer, Settings, created_on_this_thread};
use sg_raster::image::Image;
use sg_raster::render::{Projection, Quality};
use sg_scene::appearance::{Appearance, Clip, Overlay, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::framing;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use crate::scenes;
use crate::support::device;

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
        look.units.push(UnitAppearance { mask: mask(from, to), color, opacity: 0.8, visible: unit != 3 });
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

/// Frames without a new buffer, texture, pipeline or staging memory, for one way to draw.
fn stays(projection: Projection, rasterizer: Rasterizer, frames: usize) {
    let Some(gpu) = device() else { return };
    let scene = scenes::scene(&scenes::surface(400, 7));
    let options = Options { half_pictures: true, ..Options::default() };
    let mut renderer = Renderer::with_options(&gpu, &scene, options).unwrap();
    let settings = Settings { projection, rasterizer, depths: true, ..Settings::default() };
    while !renderer.prepare(&eyes(&scene, 1.0), settings).unwrap() {}
    // The lists grow to what the first view needs.
    renderer.draw_complete(&eyes(&scene, 1.0), &look(&scene, 0), settings).unwrap();
    renderer.prepare(&eyes(&scene, 1.0), settings).unwrap();
    let before = created_on_this_thread();
    // The order by ray keeps other buffers for each quality.
    let level = |frame: usize| match projection {
        Projection::Affine => level(frame),
        Projection::PerRay => (level(frame).0, settings.quality),
    };
    for frame in 0..frames {
        let (edge, quality) = level(frame);
        let settings = Settings { quality, in_motion: frame / 5 % 2 == 1, ..settings };
        renderer.draw(&eyes(&scene, edge), &look(&scene, frame), settings).unwrap();
        // As a display does, at most two frames wait for the device.
        if frame % 2 == 0 {
            gpu.wait().unwrap();
        }
    }
    gpu.wait().unwrap();
    assert_eq!(created_on_this_thread(), before, "{projection:?} {rasterizer:?}");
    println!("{projection:?} {rasterizer:?}: {frames} frames, {before:?} before and after");
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
    stays(Projection::Affine, Rasterizer::Tiles, 1000);
}

#[test]
fn a_thousand_frames_of_edits_and_levels_create_nothing_with_quadrilaterals() {
    stays(Projection::Affine, Rasterizer::Quads, 1000);
    stays(Projection::Affine, Rasterizer::Bands, 200);
}

#[test]
fn frames_of_edits_and_levels_create_nothing_by_ray() {
    stays(Projection::PerRay, Rasterizer::Tiles, 100);
}
