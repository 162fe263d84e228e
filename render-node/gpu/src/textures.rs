//! Formats and views of the textures of a picture.

use std::num::NonZeroU32;

use crate::device::Gpu;

/// Format of the target that quadrilaterals are blended in, and of pictures in full precision.
pub(super) const BLEND_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Precision of the numbers of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PicturePrecision {
    /// f32.
    Full,
    /// f16, of half the bytes.
    Half,
}

impl PicturePrecision {
    pub(super) fn of(half: bool) -> Self {
        if half { Self::Half } else { Self::Full }
    }

    pub(super) fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Full => BLEND_FORMAT,
            Self::Half => wgpu::TextureFormat::Rgba16Float,
        }
    }

    /// Bytes of a pixel.
    pub(super) fn pixel_bytes(self) -> u32 {
        match self {
            Self::Full => 16,
            Self::Half => 8,
        }
    }

    /// Declaration of the type of a picture that a shader writes.
    pub(super) fn declaration(self) -> &'static str {
        match self {
            Self::Full => "alias PictureStore = texture_storage_2d<rgba32float, write>;",
            Self::Half => "alias PictureStore = texture_storage_2d<rgba16float, write>;",
        }
    }
}

/// Format of the depth buffer that rejects masked and saturated pixels.
pub(super) const REJECT_DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth16Unorm;

/// Multiview mask of both layers of a texture.
pub(super) const BOTH_VIEWS: Option<NonZeroU32> = NonZeroU32::new(0b11);

/// A target that quadrilaterals are blended in, with `layers` layers, `size` in pixels.
pub(super) fn blend_texture(gpu: &Gpu, size: [u32; 2], layers: u32) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    gpu.texture("blended", (size, layers), BLEND_FORMAT, usage)
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
    wgpu::ColorTargetState { format: BLEND_FORMAT, blend, write_mask: wgpu::ColorWrites::ALL }
}
