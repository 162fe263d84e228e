//! A compute shader with the constants it is specialised on.

use std::num::NonZeroU32;

use super::device::Gpu;

/// Declarations that every shader begins with.
const FRAME: &str = include_str!("shaders/frame.wgsl");

/// A sum over a workgroup, for whoever calls it.
const SCAN: &str = include_str!("shaders/scan.wgsl");

/// A shader module: the common declarations, then the text.
pub(super) fn module(gpu: &Gpu, label: &str, text: &str) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(format!("{FRAME}\n{SCAN}\n{text}").into()),
    })
}

/// What a pipeline has to do with what lies behind or before its triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Behind {
    /// Nothing.
    #[default]
    All,
    /// It hides whatever is drawn later.
    Hides,
    /// It is not drawn where it is hidden.
    Seen,
}

impl Behind {
    pub(super) fn state(self) -> Option<wgpu::DepthStencilState> {
        let (hides, compare) = match self {
            Self::All => return None,
            Self::Hides => (true, wgpu::CompareFunction::Always),
            Self::Seen => (false, wgpu::CompareFunction::LessEqual),
        };
        Some(wgpu::DepthStencilState {
            format: super::hidden::DEPTH,
            depth_write_enabled: Some(hides),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        })
    }
}

/// What draws onto one target with two entry points of a module and its constants.
pub(super) fn drawing(
    gpu: &Gpu,
    (module, [vertex, fragment]): (&wgpu::ShaderModule, [&str; 2]),
    constants: &[(&str, f64)],
    topology: wgpu::PrimitiveTopology,
    target: wgpu::ColorTargetState,
    (multiview_mask, behind): (Option<NonZeroU32>, Behind),
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
        depth_stencil: behind.state(),
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

/// One entry point of a module.
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

    /// Buffers by binding number; those that the entry point does not use must not be named.
    pub(super) fn bind(&self, gpu: &Gpu, buffers: &[(u32, &wgpu::Buffer)]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding: *binding, resource: buffer.as_entire_binding() })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }

    pub(super) fn run(&self, pass: &mut wgpu::ComputePass<'_>, group: &wgpu::BindGroup, [x, y, z]: [u32; 3]) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(x, y, z);
    }

    /// Runs as many workgroups as three words of `dispatches` from word `at` on say.
    pub(super) fn run_counted(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        group: &wgpu::BindGroup,
        dispatches: &wgpu::Buffer,
        at: u64,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups_indirect(dispatches, 4 * at);
    }
}
