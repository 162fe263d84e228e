//! The uniform of a frame.

use glam::DVec3;
use sg_raster::render::Quality;
use sg_raster::{Limits, NEAR};
use sg_scene::camera::Camera;

use crate::appearance_buffers::AppearanceBuffers;
use crate::buffers::{WorkBuffers, tile_count};
use crate::scene_buffers::SceneBuffers;
use crate::settings::Settings;
use crate::shader_layout::{Frame, View};

/// The uniform of the views of `cameras`, for pictures of `size` pixels.
pub(super) fn frame_uniform(
    cameras: &[Camera],
    settings: Settings,
    (scene, appearance, work): (&SceneBuffers, &AppearanceBuffers, &WorkBuffers),
    size: [u32; 2],
    pair_capacity: u32,
) -> Frame {
    let Limits { cut, ratio, stop } = match settings.quality {
        Quality::Exact | Quality::Standard => Limits::STANDARD,
        Quality::Fast => Limits::FAST,
    };
    let mut views = [View::default(); 2];
    for (view, camera) in views.iter_mut().zip(cameras) {
        *view = View::of(camera, scene.origin);
    }
    let middle = cameras.iter().map(Camera::eye).sum::<DVec3>() / cameras.len() as f64 - scene.origin;
    let shared = settings.shared_shading && cameras.len() > 1;
    let state = &appearance.state;
    Frame {
        views,
        shading_eye: middle.as_vec3(),
        shared_shading: u32::from(shared),
        light: state.light,
        view_count: cameras.len() as u32,
        highlight_color: state.highlight_color,
        highlight_mix: state.highlight_mix,
        background: state.background,
        highlight_opacity: state.highlight_opacity,
        least_alpha: cut as f32,
        alpha_ratio: ratio as f32,
        least_transmittance: stop,
        near_plane: NEAR as f32,
        near: cameras.first().map_or(0.0, |c| c.near) as f32,
        size: size.into(),
        tiles: tile_count(size, settings.sort_window().is_some()).into(),
        capacity: work.capacity as u32,
        pair_capacity,
        edit_count: state.edits,
        mask_words: appearance.mask_words(),
        clip_side_count: state.sides,
    }
}
