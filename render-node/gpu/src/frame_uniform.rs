//! The uniform of a frame.

use glam::DVec3;
use sg_raster::foveation::Foveation;
use sg_raster::render::Quality;
use sg_raster::{DILATION, Limits, NEAR};
use sg_scene::camera::Camera;

use crate::appearance_buffers::AppearanceBuffers;
use crate::buffers::{WorkBuffers, tile_count};
use crate::scene_buffers::SceneBuffers;
use crate::settings::Settings;
use crate::shader_layout::{Frame, View};

/// Bits of an order in motion: four of the exponent, twelve of the mantissa.
const MOTION_ORDER_BITS: u32 = 16;

/// Bits of the mantissa of an order in motion.
const MOTION_MANTISSA_BITS: u32 = 12;

/// Depths of an order in motion, from this share of the near distance to 2¹⁶ times that.
const MOTION_ORDER_BEGINS: f32 = 0.125;

/// Keys of the depth order: `(bits − begins) >> shift`, of `bits` bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct OrderRange {
    begins: u32,
    shift: u32,
    pub(super) bits: u32,
}

impl OrderRange {
    /// The order of a picture. In motion depths are rounded down to 2⁻¹² of themselves, which takes half of the sort's passes.
    pub(super) fn of(cameras: &[Camera], settings: Settings) -> Self {
        let near = cameras.first().map_or(0.0, |c| c.near) as f32;
        let begins = MOTION_ORDER_BEGINS * near;
        // Tiles by ray sort again by the depth on their own rays.
        if !settings.in_motion || settings.sort_window().is_some() || !begins.is_normal() {
            return Self { begins: 0, shift: 0, bits: u32::BITS };
        }
        // As order_bits() in nearness.wgsl.
        let begins = begins.to_bits() | 1 << 31;
        Self { begins, shift: f32::MANTISSA_DIGITS - 1 - MOTION_MANTISSA_BITS, bits: MOTION_ORDER_BITS }
    }
}

/// The uniform of the views of `cameras` from the eye `first_eye` on, for pictures of `size` pixels.
pub(super) fn frame_uniform(
    cameras: &[Camera],
    (settings, order): (Settings, OrderRange),
    (scene, appearance, work): (&SceneBuffers, &AppearanceBuffers, &WorkBuffers),
    size: [u32; 2],
    pair_capacity: u32,
    (first_eye, is_masked): (usize, bool),
) -> Frame {
    let Limits { cut, ratio, stop } = match settings.quality {
        _ if settings.in_motion => Limits::MOTION,
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
    let (dilation, kept_dilation) = cameras.first().map_or((DILATION, 1.0), sg_raster::dilation);
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
        dilation: dilation as f32,
        kept_dilation: kept_dilation as f32,
        size: size.into(),
        tiles: tile_count(size, settings.sort_window().is_some()).into(),
        capacity: work.capacity as u32,
        pair_capacity,
        edit_count: state.edits,
        mask_words: appearance.mask_words(),
        clip_side_count: state.sides,
        first_eye: first_eye as u32,
        hides_tiles: u32::from(is_masked),
        order_begins: order.begins,
        order_shift: order.shift,
        foveal_squared_slope: settings.foveation.map_or(f32::MAX, Foveation::squared_slope),
    }
}
