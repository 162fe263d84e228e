//! Shader modules, pipelines and their bind groups.

use std::num::NonZeroU32;

use crate::device::Gpu;
use crate::textures::{BOTH_VIEWS, REJECT_DEPTH_FORMAT};

/// Declarations at the beginning of every shader.
const FRAME: &str = include_str!("shaders/frame.wgsl");

/// A prefix sum over a workgroup.
const SCAN: &str = include_str!("shaders/workgroup_scan.wgsl");

/// A shader module: the common declarations, then `text`.
pub(super) fn shader_module(gpu: &Gpu, label: &str, text: &str) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(format!("{FRAME}\n{SCAN}\n{text}").into()),
    })
}

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
        let (write, compare) = match self {
            Self::Ignore => return None,
            Self::Write => (true, wgpu::CompareFunction::Always),
            Self::Test => (false, wgpu::CompareFunction::LessEqual),
        };
        Some(wgpu::DepthStencilState {
            format: REJECT_DEPTH_FORMAT,
            depth_write_enabled: Some(write),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        })
    }
}

/// A pipeline that draws onto one target with two entry points of a module and its constants.
pub(super) fn render_pipeline(
    gpu: &Gpu,
    (module, [vertex, fragment]): (&wgpu::ShaderModule, [&str; 2]),
    constants: &[(&str, f64)],
    topology: wgpu::PrimitiveTopology,
    target: wgpu::ColorTargetState,
    (multiview_mask, depth): (Option<NonZeroU32>, DepthMode),
) -> wgpu::RenderPipeline {
    let options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: options.clone(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState { topology, ..Default::default() },
        depth_stencil: depth.state(),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: options,
            targets: &[Some(target)],
        }),
        multiview_mask,
        cache: None,
    })
}

/// One pipeline for each view, and one multiview pipeline if the device supports it.
#[derive(Clone)]
pub(super) struct ViewPipelines {
    pub(super) each: [wgpu::RenderPipeline; 2],
    pub(super) multiview: Option<wgpu::RenderPipeline>,
}

impl ViewPipelines {
    /// Pipelines of the passes for `views` views, and the multiview mask: one pass for both views, or one for each.
    pub(super) fn passes(&self, views: u32) -> (&[wgpu::RenderPipeline], Option<NonZeroU32>) {
        match &self.multiview {
            Some(both) if views == 2 => (std::slice::from_ref(both), BOTH_VIEWS),
            _ => (self.each.get(..views as usize).unwrap_or(&self.each), None),
        }
    }
}

/// One compute entry point of a module.
pub(super) struct Kernel {
    pipeline: wgpu::ComputePipeline,
    label: &'static str,
}

impl Kernel {
    pub(super) fn new(gpu: &Gpu, module: &wgpu::ShaderModule, entry: &'static str, constants: &[(&str, f64)]) -> Self {
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: None,
            module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Every kernel writes its shared memory before it reads it.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        });
        Self { pipeline, label: entry }
    }

    /// Binds buffers by binding number. The entry point must use every one of them.
    pub(super) fn bind(&self, gpu: &Gpu, buffers: &[(u32, &wgpu::Buffer)]) -> BoundKernel {
        let entries: Vec<wgpu::BindGroupEntry> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        BoundKernel { pipeline: self.pipeline.clone(), group }
    }
}

/// A compute pipeline with its bind group.
pub(super) struct BoundKernel {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

impl BoundKernel {
    /// Runs a fixed number of workgroups.
    pub(super) fn run(&self, pass: &mut wgpu::ComputePass<'_>, [x, y, z]: [u32; 3]) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(x, y, z);
    }

    /// Reads the number of workgroups from three words of `dispatches`, from word `at` on.
    pub(super) fn run_indirect(&self, pass: &mut wgpu::ComputePass<'_>, dispatches: &wgpu::Buffer, at: u64) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups_indirect(dispatches, 4 * at);
    }
}

/// A render pipeline with its bind group.
pub(super) struct BoundDraw {
    pipeline: wgpu::RenderPipeline,
    group: wgpu::BindGroup,
}

impl BoundDraw {
    /// Binds resources by binding number.
    pub(super) fn new(
        gpu: &Gpu,
        pipeline: &wgpu::RenderPipeline,
        resources: &[(u32, wgpu::BindingResource<'_>)],
    ) -> Self {
        let entries: Vec<wgpu::BindGroupEntry> = resources
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Self { pipeline: pipeline.clone(), group }
    }

    /// Draws `vertices` vertices of one instance.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, vertices: u32) {
        self.set(pass);
        pass.draw(0..vertices, 0..1);
    }

    /// Draws a triangle that covers the target.
    pub(super) fn draw_full_screen(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.draw(pass, 3);
    }

    /// Reads the draw from four words of `dispatches`, from word `at` on.
    pub(super) fn draw_indirect(&self, pass: &mut wgpu::RenderPass<'_>, dispatches: &wgpu::Buffer, at: u64) {
        self.set(pass);
        pass.draw_indirect(dispatches, 4 * at);
    }

    fn set(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
    }
}
