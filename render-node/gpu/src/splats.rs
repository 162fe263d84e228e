//! Passes from the scene to splats in depth order: mark, list, project and shade, sort.

use std::collections::HashMap;

use crate::appearance_buffers::{AppearanceBuffers, AppearanceState};
use crate::buffers::{SplatBuffers, WorkBuffers};
use crate::device::Gpu;
use crate::pipeline::{BoundKernel, Kernel, shader_module};
use crate::radix_sort::{RadixSort, SortBindings};
use crate::scene_buffers::{BLOCK, PartBuffers, SceneBuffers};
use crate::shader_layout::{BANDS, Total, dispatch};
use crate::stats::{Stage, StatsReadback};

/// Constants of the marking and projecting kernels. A scene without highlights, masks or harmonics skips their code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct PipelineKey {
    lit: bool,
    highlights: bool,
    degree: i32,
    half: bool,
    term: u32,
    directional: bool,
    masks: bool,
    overlay: bool,
    colors: bool,
    clips: bool,
    per_ray: bool,
}

impl PipelineKey {
    pub(super) fn of(scene: &SceneBuffers, state: &AppearanceState, per_ray: bool) -> Self {
        let SceneBuffers { lit, highlights, degree, half, .. } = *scene;
        let &AppearanceState { edits, sides, overlay, colors, directional, term, .. } = state;
        Self {
            lit,
            highlights,
            degree,
            half,
            term,
            directional,
            masks: edits > 0,
            overlay,
            colors,
            clips: sides > 0,
            per_ray,
        }
    }
}

/// Kernels of one key.
struct KeyedKernels {
    mark: Kernel,
    project: Kernel,
}

/// Kernels up to the depth order.
pub(super) struct SplatPasses {
    cull: wgpu::ShaderModule,
    projection: wgpu::ShaderModule,
    keyed: HashMap<PipelineKey, KeyedKernels>,
    sum_blocks: Kernel,
    list: Kernel,
    depth_sort: RadixSort,
}

impl SplatPasses {
    pub(super) fn new(gpu: &Gpu, scene: &SceneBuffers) -> Self {
        let text = format!("const BANDS: u32 = {BANDS}u;\n{}", include_str!("shaders/list.wgsl"));
        let list = shader_module(gpu, "list", &text);
        let counts = [("BLOCKS", f64::from(scene.blocks)), ("PARTS", scene.parts.len() as f64)];
        Self {
            cull: shader_module(
                gpu,
                "cull",
                concat!(include_str!("shaders/scene.wgsl"), include_str!("shaders/cull.wgsl")),
            ),
            projection: shader_module(
                gpu,
                "project",
                concat!(
                    include_str!("shaders/scene.wgsl"),
                    include_str!("shaders/ray_project.wgsl"),
                    include_str!("shaders/project.wgsl")
                ),
            ),
            keyed: HashMap::new(),
            sum_blocks: Kernel::new(gpu, &list, "sum_blocks", &counts),
            list: Kernel::new(gpu, &list, "list", &[]),
            depth_sort: RadixSort::new(gpu, Total::Listed),
        }
    }

    /// Binds all passes. Compiles the kernels of a new key.
    pub(super) fn bind(
        &mut self,
        gpu: &Gpu,
        frame: &wgpu::Buffer,
        (scene, appearance, work): (&SceneBuffers, &AppearanceBuffers, &WorkBuffers),
        key: PipelineKey,
    ) -> SplatBindings {
        let Self { cull, projection, keyed, sum_blocks, list, depth_sort } = self;
        let sort = depth_sort.bind(gpu, &work.totals, &work.depth_keys, u32::BITS);
        let sum_blocks = sum_blocks.bind(
            gpu,
            &[
                (0, frame),
                (3, &work.block_counts),
                (4, &work.part_ranges),
                (5, &work.totals),
                (6, &work.dispatches),
                (8, &scene.part_table),
            ],
        );
        let blocks = |p: &PartBuffers| p.part.count.div_ceil(BLOCK as u32);
        let list = scene.parts.iter().map(|p| {
            let buffers = [(0, frame), (1, &p.uniform), (2, &work.marked), (3, &work.block_counts), (7, &work.listed)];
            (list.bind(gpu, &buffers), blocks(p))
        });
        let list = list.collect();
        let kernels = keyed.entry(key).or_insert_with(|| KeyedKernels::new(gpu, cull, projection, key));
        // Bindings of scene.wgsl, then those of the pass itself.
        let of_scene = |kernel: &Kernel, p: &PartBuffers, own: &[(u32, &wgpu::Buffer)]| {
            let shared = [
                (0, frame),
                (1, &p.uniform),
                (2, &p.centers),
                (3, &p.shapes),
                (4, &appearance.units),
                (5, &appearance.edits),
                (6, &appearance.masks),
            ];
            kernel.bind(gpu, &[&shared, own].concat())
        };
        let mark = scene.parts.iter().map(|p| {
            let own = [(7, &appearance.sides), (8, &work.marked), (9, &work.block_counts)];
            (of_scene(&kernels.mark, p, &own), blocks(p))
        });
        let SplatBuffers { ellipses, levels, tints } = &work.splats;
        let project = scene.parts.iter().map(|p| {
            let own = [
                (7, &p.surfaces),
                (8, &p.harmonics),
                (9, &appearance.colors),
                (10, &work.part_ranges),
                (11, &work.listed),
                (12, ellipses),
                (13, levels),
                (14, tints),
                (15, &work.depth_keys.keys[0]),
                (16, &work.depth_keys.values[0]),
            ];
            of_scene(&kernels.project, p, &own)
        });
        SplatBindings { mark: mark.collect(), sum_blocks, list, project: project.collect(), sort }
    }
}

impl KeyedKernels {
    fn new(gpu: &Gpu, cull: &wgpu::ShaderModule, projection: &wgpu::ShaderModule, key: PipelineKey) -> Self {
        let flag = |on: bool| f64::from(u8::from(on));
        let per_ray = ("PER_RAY", flag(key.per_ray));
        let mark = [("MASKS", flag(key.masks)), ("CLIPS", flag(key.clips)), per_ray];
        let project = [
            ("LIT", flag(key.lit)),
            ("DEGREE", f64::from(key.degree)),
            ("HIGHLIGHTS", flag(key.highlights)),
            ("TERM", f64::from(key.term)),
            ("DIRECTIONAL", flag(key.directional)),
            ("MASKS", flag(key.masks)),
            ("OVERLAY", flag(key.overlay)),
            ("COLORS", flag(key.colors)),
            ("HALF", flag(key.half)),
            per_ray,
        ];
        Self { mark: Kernel::new(gpu, cull, "mark", &mark), project: Kernel::new(gpu, projection, "project", &project) }
    }
}

/// The bound passes up to the depth order.
pub(super) struct SplatBindings {
    /// One for each part of the scene, with its number of workgroups.
    mark: Vec<(BoundKernel, u32)>,
    sum_blocks: BoundKernel,
    /// One for each part of the scene, with its number of workgroups.
    list: Vec<(BoundKernel, u32)>,
    /// One for each part of the scene.
    project: Vec<BoundKernel>,
    /// The depth order.
    pub(super) sort: SortBindings,
}

impl SplatBindings {
    /// Encodes mark, list, project and sort.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        dispatches: &wgpu::Buffer,
    ) {
        {
            let mut pass = stats.compute_pass(encoder, Stage::List);
            for (mark, blocks) in &self.mark {
                mark.run(&mut pass, [*blocks, 1, 1]);
            }
            self.sum_blocks.run(&mut pass, [1, 1, 1]);
            for (list, blocks) in &self.list {
                list.run(&mut pass, [*blocks, 1, 1]);
            }
        }
        {
            let mut pass = stats.compute_pass(encoder, Stage::Project);
            for (project, at) in self.project.iter().zip((dispatch::PARTS..).step_by(3)) {
                project.run_indirect(&mut pass, dispatches, at);
            }
        }
        let mut pass = stats.compute_pass(encoder, Stage::Sort);
        self.sort.run(&mut pass, dispatches, dispatch::DEPTH_SORT);
    }
}
