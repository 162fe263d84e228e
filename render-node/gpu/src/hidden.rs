//! What of a picture nobody can see: pixels that a headset's lenses hide are not blended.
//!
//! The hidden triangles are put nearer than everything before the quadrilaterals are drawn, and the depth test does the rest:
//! a hidden pixel costs no shading and no blending, and a visible one is what it was to the last bit. Tiles know nothing of it.

use glam::{Vec2, Vec4};

use super::device::Gpu;
use super::kernel::{Behind, drawing, module};
use super::passes::{BOTH, Blending, PICTURE};

/// How near things are, coarsely: hidden triangles, quadrilaterals, nothing.
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth16Unorm;

/// What draws hidden triangles.
pub(super) struct Hiding {
    pipelines: Blending,
}

/// Most corners of what is hidden of an eye.
const CORNERS: usize = 3 << 16;

impl Hiding {
    /// `both` says whether both eyes are drawn in one pass.
    pub(super) fn new(gpu: &Gpu, both: bool) -> Self {
        let target = wgpu::ColorTargetState { format: PICTURE, blend: None, write_mask: wgpu::ColorWrites::empty() };
        let text = include_str!("shaders/hidden.wgsl");
        let shader = module(gpu, "hidden", text);
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let each = [0.0, 1.0].map(|view| {
            let view = [("VIEW", view)];
            drawing(gpu, (&shader, ["hide", "leave"]), &view, triangles, target.clone(), (None, Behind::Hides))
        });
        let together = both.then(|| {
            let text = format!("{text}\n{}", include_str!("shaders/hidden_together.wgsl"));
            let shader = module(gpu, "hidden, both eyes", &text);
            let entries = (&shader, ["hide_together", "leave"]);
            drawing(gpu, entries, &[], triangles, target.clone(), (BOTH, Behind::Hides))
        });
        Self { pipelines: Blending { each, together } }
    }
}

/// The hidden triangles of two eyes on the device.
pub(super) struct Hidden {
    /// Left by itself, right by itself, both.
    corners: [(wgpu::Buffer, u32); 3],
}

impl Hidden {
    /// Corners of triangles as shares of the picture's width and height, from its upper left; `None` where nothing is hidden.
    pub(super) fn upload(gpu: &Gpu, eyes: [&[[Vec2; 3]]; 2]) -> Option<Self> {
        let corners = |eye: usize, view: f32| {
            let sound = eyes[eye].iter().filter(|t| t.iter().all(|c| c.is_finite()));
            sound.flatten().take(CORNERS).map(move |c| Vec4::new(c.x, c.y, view, 0.0))
        };
        let [left, right] = [0, 1].map(|eye| corners(eye, 0.0).collect::<Vec<_>>());
        if left.is_empty() && right.is_empty() {
            return None;
        }
        let both = corners(0, 0.0).chain(corners(1, 1.0)).collect::<Vec<_>>();
        let corners = [left, right, both].map(|all| {
            // A binding cannot be empty.
            let bytes = size_of::<Vec4>() as u64 * all.len().max(1) as u64;
            let buffer = gpu.storage("hidden", bytes);
            gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&all));
            (buffer, all.len() as u32)
        });
        Some(Self { corners })
    }

    /// Draws them into a pass: of the eyes from `first` on, `views` of them, the one that the pass is for, or both.
    pub(super) fn encode(
        &self,
        gpu: &Gpu,
        hiding: &Hiding,
        pass: &mut wgpu::RenderPass<'_>,
        (first, views, at): (usize, u32, usize),
    ) {
        let of = if views == 2 { 2 } else { first.min(1) };
        let (buffer, count) = &self.corners[of];
        let Some(pipeline) = hiding.pipelines.of(views).0.get(at) else { return };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("hidden"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..*count, 0..1);
    }
}

/// A texture for how near things are, a layer for each view.
pub(super) fn depths(gpu: &Gpu, size: [u32; 2], layers: u32) -> wgpu::Texture {
    gpu.texture("hidden", (size, layers), DEPTH, wgpu::TextureUsages::RENDER_ATTACHMENT)
}
