//! The uniform of a frame.

use glam::{DVec3, Vec4};
use sg_raster::render::Quality;
use sg_raster::{Limits, NEAR};
use sg_scene::camera::Camera;

use crate::appearance_buffers::AppearanceBuffers;
use crate::buffers::{WorkBuffers, tile_count};
use crate::scene_buffers::SceneBuffers;
use crate::settings::Settings;
use crate::shader_layout::{FrameUniform, ViewUniform};

/// The uniform of the views of `cameras`, for pictures of `size` pixels.
pub(super) fn frame_uniform(
    cameras: &[Camera],
    settings: Settings,
    (scene, appearance, work): (&SceneBuffers, &AppearanceBuffers, &WorkBuffers),
    size: [u32; 2],
    pair_capacity: u32,
) -> FrameUniform {
    let Limits { cut, ratio, stop } = match settings.quality {
        Quality::Exact | Quality::Standard => Limits::STANDARD,
        Quality::Fast => Limits::FAST,
    };
    let mut views = [ViewUniform::default(); 2];
    for (view, camera) in views.iter_mut().zip(cameras) {
        *view = ViewUniform::of(camera, scene.origin);
    }
    let middle = cameras.iter().map(Camera::eye).sum::<DVec3>() / cameras.len() as f64 - scene.origin;
    let shared = settings.shared_shading && cameras.len() > 1;
    let state = &appearance.state;
    FrameUniform {
        views,
        shading_eye: middle.as_vec3().extend(f32::from(u8::from(shared))),
        light: state.light,
        overlay: state.overlay_color,
        background: state.background,
        limits: Vec4::new(cut as f32, ratio as f32, stop, NEAR as f32),
        size,
        tiles: tile_count(size, settings.sort_window().is_some()),
        view_count: cameras.len() as u32,
        capacity: work.capacity as u32,
        pair_capacity,
        edits: state.edits,
        mask_words: appearance.mask_words(),
        clips: state.sides,
        spare: [0; 2],
    }
}
