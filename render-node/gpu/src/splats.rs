//! Passes from the scene to splats in depth order: mark, list, project and shade, sort.

use std::collections::HashMap;
use std::mem::offset_of;

use crate::appearance_buffers::AppearanceState;
use crate::buffers::{NEAR_RAYS_HEAD, WorkBuffers};
use crate::device::Gpu;
use crate::pipeline::{BoundKernel, Kernel};
use crate::radix_sort::{RadixSort, SortBindings};
use crate::recorded;
use crate::resources::Resources;
use crate::scene_buffers::SceneBuffers;
use crate::shader::{Shader, running_sums};
use crate::shader_layout::{DispatchArguments, Dispatches};
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
    occluded: bool,
    clips: bool,
    per_ray: bool,
}

impl PipelineKey {
    pub(super) fn of(scene: &SceneBuffers, state: &AppearanceState, per_ray: bool) -> Self {
        let SceneBuffers { lit, highlights, degree, half, .. } = *scene;
        let &AppearanceState { edits, sides, overlay, colors, occluded, directional, term, .. } = state;
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
            occluded: occluded && lit && !colors,
            clips: sides > 0,
            per_ray,
        }
    }
}

impl PipelineKey {
    /// The keys that edits of this appearance can lead to: units, clips, a highlight, colors of their own, either light.
    pub(super) fn of_edits(scene: &SceneBuffers, state: &AppearanceState, per_ray: bool) -> impl Iterator<Item = Self> {
        let edited = move |bits: u32| {
            let is = |bit: u32| bits >> bit & 1 == 1;
            let [edits, sides] = [0, 1].map(|bit| u32::from(is(bit)));
            let state = AppearanceState { edits, sides, overlay: is(2), colors: is(3), directional: is(4), ..*state };
            Self::of(scene, &state, per_ray)
        };
        (0..32).map(edited)
    }
}

/// Kernels of one key.
struct KeyedKernels {
    mark: Kernel,
    project: Kernel,
}

/// Kernels up to the depth order.
pub(super) struct SplatPasses {
    cull: Shader,
    projection: Shader,
    keyed: HashMap<PipelineKey, KeyedKernels>,
    sum_blocks: Kernel,
    list: Kernel,
    depth_sort: RadixSort,
}

impl SplatPasses {
    pub(super) fn new(gpu: &Gpu, scene: &SceneBuffers) -> Self {
        let of_scene = include_str!("shaders/scene.wgsl");
        let cull = [of_scene, include_str!("shaders/cull.wgsl")];
        let project = [
            of_scene,
            include_str!("shaders/cut.wgsl"),
            include_str!("shaders/ray_project.wgsl"),
            include_str!("shaders/project.wgsl"),
        ];
        let list = Shader::new(gpu, "list", &[&running_sums("block_counts"), include_str!("shaders/list.wgsl")]);
        let counts = [("BLOCKS", f64::from(scene.blocks)), ("PARTS", scene.parts.len() as f64)];
        Self {
            cull: Shader::new(gpu, "cull", &cull),
            projection: Shader::new(gpu, "project", &project),
            keyed: HashMap::new(),
            sum_blocks: Kernel::new(gpu, &list, "sum_blocks", &counts),
            list: Kernel::new(gpu, &list, "list", &[]),
            depth_sort: RadixSort::new(gpu, "listed"),
        }
    }

    /// Whether the kernels of a key are compiled.
    pub(super) fn is_compiled(&self, key: PipelineKey) -> bool {
        self.keyed.contains_key(&key)
    }

    /// Binds the sort by depth.
    pub(super) fn bind_sort(&self, gpu: &Gpu, work: &WorkBuffers) -> SortBindings {
        self.depth_sort.bind(gpu, &work.totals, &work.depth_keys, u32::BITS)
    }

    /// Binds the passes before the sort. Compiles the kernels of a new key.
    pub(super) fn bind(
        &mut self,
        gpu: &Gpu,
        resources: &Resources<'_>,
        scene: &SceneBuffers,
        key: PipelineKey,
    ) -> SplatBindings {
        let Self { cull, projection, keyed, sum_blocks, list, .. } = self;
        let kernels = keyed.entry(key).or_insert_with(|| KeyedKernels::new(gpu, cull, projection, key));
        let mut bindings = SplatBindings { parts: Vec::new(), sum_blocks: sum_blocks.bind(gpu, resources) };
        for part in &scene.parts {
            let resources = resources.and(&part.resources());
            bindings.parts.push(PartBindings {
                blocks: part.blocks(),
                mark: kernels.mark.bind(gpu, &resources),
                list: list.bind(gpu, &resources),
                project: kernels.project.bind(gpu, &resources),
            });
        }
        bindings
    }
}

impl KeyedKernels {
    fn new(gpu: &Gpu, cull: &Shader, projection: &Shader, key: PipelineKey) -> Self {
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
            ("OCCLUDED", flag(key.occluded)),
            ("HALF", flag(key.half)),
            ("CLIPS", flag(key.clips)),
            per_ray,
        ];
        Self { mark: Kernel::new(gpu, cull, "mark", &mark), project: Kernel::new(gpu, projection, "project", &project) }
    }
}

/// The bound passes before the sort by depth.
pub(super) struct SplatBindings {
    parts: Vec<PartBindings>,
    sum_blocks: BoundKernel,
}

/// The bound passes of a part of the scene.
struct PartBindings {
    /// Number of workgroups of the first two passes.
    blocks: u32,
    mark: BoundKernel,
    list: BoundKernel,
    project: BoundKernel,
}

impl SplatBindings {
    /// Encodes mark, list, project and sort by the lowest `order_bits` bits of the depths.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stats: &mut StatsReadback,
        work: &WorkBuffers,
        (sort, order_bits): (&SortBindings, u32),
    ) {
        recorded::clear(work.near_rays());
        encoder.clear_buffer(work.near_rays(), 0, Some(NEAR_RAYS_HEAD));
        {
            let mut pass = stats.compute_pass(encoder, Stage::List);
            for part in &self.parts {
                part.mark.run(&mut pass, [part.blocks, 1, 1]);
            }
            self.sum_blocks.run(&mut pass, [1, 1, 1]);
            for part in &self.parts {
                part.list.run(&mut pass, [part.blocks, 1, 1]);
            }
        }
        {
            let mut pass = stats.compute_pass(encoder, Stage::Project);
            for (k, part) in self.parts.iter().enumerate() {
                part.project.run_indirect(&mut pass, &work.part_dispatches, k * size_of::<DispatchArguments>());
            }
        }
        let mut pass = stats.compute_pass(encoder, Stage::Sort);
        sort.run_lowest(&mut pass, &work.dispatches, offset_of!(Dispatches, depth_sort), order_bits);
    }
}
