//! Formats and views of the textures of a picture.

use std::num::NonZeroU32;

use crate::device::Gpu;

/// Format of pictures and of the target that quadrilaterals are blended in.
pub(super) const PICTURE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Format of the depth buffer that rejects masked and saturated pixels.
pub(super) const REJECT_DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth16Unorm;

/// Multiview mask of both layers of a texture.
pub(super) const BOTH_VIEWS: Option<NonZeroU32> = NonZeroU32::new(0b11);

/// A texture of [`PICTURE_FORMAT`] with `layers` layers, `size` in pixels.
pub(super) fn picture_texture(gpu: &Gpu, size: [u32; 2], layers: u32, usage: wgpu::TextureUsages) -> wgpu::Texture {
    gpu.texture("picture", (size, layers), PICTURE_FORMAT, usage)
}

/// A two-dimensional view of one layer.
pub(super) fn layer_view(texture: &wgpu::Texture, layer: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..wgpu::TextureViewDescriptor::default()
    })
}

/// A view for one pass: all layers as an array with multiview, else one layer.
pub(super) fn pass_view(texture: &wgpu::Texture, layer: u32, multiview: bool) -> wgpu::TextureView {
    if !multiview {
        return layer_view(texture, layer);
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..wgpu::TextureViewDescriptor::default()
    })
}

/// A color target for front-to-back blending: target alpha is 1 − transmittance.
pub(super) fn front_to_back_target() -> wgpu::ColorTargetState {
    let under = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::OneMinusDstAlpha,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let blend = Some(wgpu::BlendState { color: under, alpha: under });
    wgpu::ColorTargetState { format: PICTURE_FORMAT, blend, write_mask: wgpu::ColorWrites::ALL }
}
