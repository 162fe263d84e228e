//! Pipelines, bound to their resources by name.

use std::num::NonZeroU32;
use std::ops::Range;
use std::sync::Arc;

use crate::barriers::Kind;
use crate::device::Gpu;
use crate::recorded::{self, BoundBuffer};
use crate::resources::Resources;
use crate::shader::{Binding, Shader};
use crate::textures::{BOTH_VIEWS, REJECT_DEPTH_FORMAT};

/// Use of the depth buffer by a pipeline.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum DepthMode {
    /// No depth buffer.
    #[default]
    Ignore,
    /// Writes depth, without a test.
    Write,
    /// Tests against depth, without a write.
    Test,
}

impl DepthMode {
    pub(super) fn state(self) -> Option<wgpu::DepthStencilState> {
        match self {
            Self::Ignore => None,
            Self::Write => Some(depth_state(REJECT_DEPTH_FORMAT, true, wgpu::CompareFunction::Always)),
            Self::Test => Some(depth_state(REJECT_DEPTH_FORMAT, false, wgpu::CompareFunction::LessEqual)),
        }
    }
}

/// Use of a depth buffer of any format.
pub(super) fn depth_state(
    format: wgpu::TextureFormat,
    write: bool,
    compare: wgpu::CompareFunction,
) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(write),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// Targets of a draw pipeline.
#[derive(Debug, Clone, Default)]
pub(super) struct DrawTargets {
    pub(super) color: Option<wgpu::ColorTargetState>,
    pub(super) depth: Option<wgpu::DepthStencilState>,
    pub(super) multiview: Option<NonZeroU32>,
}

impl From<wgpu::ColorTargetState> for DrawTargets {
    fn from(color: wgpu::ColorTargetState) -> Self {
        Self { color: Some(color), ..Self::default() }
    }
}

/// A render pipeline.
#[derive(Debug, Clone)]
pub(super) struct DrawPipeline {
    pipeline: wgpu::RenderPipeline,
    label: &'static str,
    bindings: Vec<Binding>,
}

impl DrawPipeline {
    /// A pipeline of a vertex and a fragment entry point of a module, with the module's constants.
    pub(super) fn new(
        gpu: &Gpu,
        (shader, [vertex, fragment]): (&Shader, [&'static str; 2]),
        constants: &[(&str, f64)],
        topology: wgpu::PrimitiveTopology,
        targets: DrawTargets,
    ) -> Self {
        let options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
        let color = targets.color.map(Some);
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader.module,
                entry_point: Some(vertex),
                compilation_options: options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { topology, ..Default::default() },
            depth_stencil: targets.depth,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader.module,
                entry_point: Some(fragment),
                compilation_options: options,
                targets: color.as_slice(),
            }),
            multiview_mask: targets.multiview,
            cache: gpu.cache_of_pipeline(),
        });
        Self { pipeline, label: fragment, bindings: shader.bindings(&[vertex, fragment]) }
    }

    /// Binds the resources that the pipeline uses.
    pub(super) fn bind(&self, gpu: &Gpu, resources: &Resources<'_>) -> BoundDraw {
        let group = resources.bind(gpu, self.label, &self.pipeline.get_bind_group_layout(0), &self.bindings);
        let bound = resources.buffers(&self.bindings).into();
        BoundDraw { pipeline: self.pipeline.clone(), group, entry: self.label, bound }
    }
}

/// One pipeline for each view, and one multiview pipeline if the device supports it.
#[derive(Clone)]
pub(super) struct ViewPipelines {
    pub(super) each: [DrawPipeline; 2],
    pub(super) multiview: Option<DrawPipeline>,
}

impl ViewPipelines {
    /// Pipelines of the passes for `views` views, and the multiview mask: one pass for both views, or one for each.
    pub(super) fn passes(&self, views: u32) -> (&[DrawPipeline], Option<NonZeroU32>) {
        match &self.multiview {
            Some(both) if views == 2 => (std::slice::from_ref(both), BOTH_VIEWS),
            _ => (self.each.get(..views as usize).unwrap_or(&self.each), None),
        }
    }
}

/// A render pipeline with its bind group.
#[derive(Debug)]
pub(super) struct BoundDraw {
    pipeline: wgpu::RenderPipeline,
    group: wgpu::BindGroup,
    entry: &'static str,
    bound: Arc<[BoundBuffer]>,
}

impl BoundDraw {
    /// Draws `vertices` vertices of one instance.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, vertices: u32) {
        self.set(pass);
        recorded::command(self.entry, Kind::Draw, &self.bound, None);
        pass.draw(0..vertices, 0..1);
    }

    /// Draws these vertices of these instances.
    pub(super) fn draw_instances(&self, pass: &mut wgpu::RenderPass<'_>, vertices: Range<u32>, instances: Range<u32>) {
        self.set(pass);
        pass.draw(vertices, instances);
    }

    /// Draws a triangle that covers the target.
    pub(super) fn draw_full_screen(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.draw(pass, 3);
    }

    /// Draws the upper left `part` of a texture, its width and height in pixels, to an area of the target: left, top, width and
    /// height. Nothing if one of them is empty.
    pub(super) fn draw_part(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        (texture, part): (&wgpu::Texture, [u32; 2]),
        [left, top, width, height]: [u32; 4],
    ) {
        if width == 0 || height == 0 || part.contains(&0) {
            return;
        }
        // The viewport shows the whole texture, the scissor its part.
        let across = width as f32 * (texture.width() as f32 / part[0] as f32);
        let down = height as f32 * (texture.height() as f32 / part[1] as f32);
        pass.set_viewport(left as f32, top as f32, across, down, 0.0, 1.0);
        pass.set_scissor_rect(left, top, width, height);
        self.draw_full_screen(pass);
    }

    /// Draws with the [`crate::shader_layout::DrawArguments`] at byte `offset` of `arguments`.
    pub(super) fn draw_indirect(&self, pass: &mut wgpu::RenderPass<'_>, arguments: &wgpu::Buffer, offset: usize) {
        self.set(pass);
        recorded::command(self.entry, Kind::DrawIndirect, &self.bound, Some(arguments));
        pass.draw_indirect(arguments, offset as u64);
    }

    fn set(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
    }
}

/// A compute pipeline.
pub(super) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    label: &'static str,
    bindings: Vec<Binding>,
}

impl Kernel {
    /// A pipeline of one entry point of a module, with the module's constants.
    pub(super) fn new(gpu: &Gpu, shader: &Shader, entry: &'static str, constants: &[(&str, f64)]) -> Self {
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: None,
            module: &shader.module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Every kernel writes its shared memory before it reads it.
                zero_initialize_workgroup_memory: false,
            },
            cache: gpu.cache_of_pipeline(),
        });
        Self { pipeline, label: entry, bindings: shader.bindings(&[entry]) }
    }

    /// Binds the resources that the entry point uses.
    pub(super) fn bind(&self, gpu: &Gpu, resources: &Resources<'_>) -> BoundKernel {
        let group = resources.bind(gpu, self.label, &self.pipeline.get_bind_group_layout(0), &self.bindings);
        let bound = resources.buffers(&self.bindings).into();
        BoundKernel { pipeline: self.pipeline.clone(), group, entry: self.label, bound }
    }
}

/// A compute pipeline with its bind group.
pub(super) struct BoundKernel {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    entry: &'static str,
    bound: Arc<[BoundBuffer]>,
}

impl BoundKernel {
    /// Runs a fixed number of workgroups.
    pub(super) fn run(&self, pass: &mut wgpu::ComputePass<'_>, [x, y, z]: [u32; 3]) {
        self.set(pass);
        recorded::command(self.entry, Kind::Dispatch, &self.bound, None);
        pass.dispatch_workgroups(x, y, z);
    }

    /// Runs the [`crate::shader_layout::DispatchArguments`] at byte `offset` of `arguments`.
    pub(super) fn run_indirect(&self, pass: &mut wgpu::ComputePass<'_>, arguments: &wgpu::Buffer, offset: usize) {
        self.set(pass);
        recorded::command(self.entry, Kind::DispatchIndirect, &self.bound, Some(arguments));
        pass.dispatch_workgroups_indirect(arguments, offset as u64);
    }

    fn set(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
    }
}
