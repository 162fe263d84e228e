//! Asynchronous readback of the counts and pass times of a finished picture.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use encase::ShaderSize;

use crate::device::Gpu;
use crate::recorded;
use crate::shader_layout::Totals;

/// Stages of a frame with separate times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    List,
    Project,
    Sort,
    Bin,
    PairSort,
    Blend,
    Compose,
}

/// Device seconds of each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct PassSeconds {
    /// Mark and list visible Gaussians.
    pub list: f64,
    /// Projection and shading.
    pub project: f64,
    /// Sort by depth.
    pub sort: f64,
    /// Pairs of a splat and a tile, and each tile's list.
    pub bin: f64,
    /// Sort of the pairs by tile.
    pub pair_sort: f64,
    /// Blending.
    pub blend: f64,
    /// Compose over the background.
    pub compose: f64,
}

impl PassSeconds {
    /// Sum of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.list + self.project + self.sort + self.bin + self.pair_sort + self.blend + self.compose
    }

    /// Share of the stages whose work grows with the number of pixels: lists of the tiles, blending, composing. `None` if
    /// nothing took any time.
    #[must_use]
    pub fn pixel_share(&self) -> Option<f64> {
        let total = self.total();
        (total > 0.0).then(|| (self.bin + self.pair_sort + self.blend + self.compose) / total)
    }

    /// Sum of two pictures.
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            list: self.list + other.list,
            project: self.project + other.project,
            sort: self.sort + other.sort,
            bin: self.bin + other.bin,
            pair_sort: self.pair_sort + other.pair_sort,
            blend: self.blend + other.blend,
            compose: self.compose + other.compose,
        }
    }

    fn add(&mut self, stage: Stage, seconds: f64) {
        *match stage {
            Stage::List => &mut self.list,
            Stage::Project => &mut self.project,
            Stage::Sort => &mut self.sort,
            Stage::Bin => &mut self.bin,
            Stage::PairSort => &mut self.pair_sort,
            Stage::Blend => &mut self.blend,
            Stage::Compose => &mut self.compose,
        } += seconds;
    }
}

/// Attachments of a render pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attachments<'a> {
    pub(super) color: Option<&'a wgpu::TextureView>,
    pub(super) depth: Option<&'a wgpu::TextureView>,
    /// Whether to load the attachments; else the pass clears them.
    pub(super) keep: bool,
}

/// Limit of the timed passes of one picture. Later passes have no time.
const TIMED_PASSES: u32 = 64;

/// States of a readback.
const IDLE: u8 = 0;
const PENDING: u8 = 1;
const READY: u8 = 2;
const FAILED: u8 = 3;

/// Bytes of the totals, the first thing of a readback. The length of the longest list and the number of Gaussians that rays
/// evaluate follow.
const TOTAL_BYTES: u64 = Totals::SHADER_SIZE.get();

/// Bytes of a length or a number.
const LENGTH_BYTES: u64 = u32::SHADER_SIZE.get();

/// Bytes of the counts in front of the timestamps.
const COUNT_BYTES: u64 = (TOTAL_BYTES + 2 * LENGTH_BYTES).next_multiple_of(wgpu::QUERY_SIZE as u64);

/// Bytes of the two timestamps of a pass.
const PASS_BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// Counts and times of one picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct PictureStats {
    pub(super) totals: Totals,
    /// Length of the longest list of a tile.
    pub(super) longest: u32,
    /// Number of Gaussians in view that rays evaluate in the affine mode, over all views.
    pub(super) near_rays: u32,
    /// Times, if the device has timestamps.
    pub(super) seconds: Option<PassSeconds>,
    /// Seconds from the first timestamp to the last one.
    pub(super) device_seconds: Option<f64>,
    /// Number of the picture.
    pub(super) picture: u64,
}

/// Reads the counts and times of one picture at a time. While a readback is pending, later pictures are not measured, so that
/// no picture waits.
pub(super) struct StatsReadback {
    queries: Option<wgpu::QuerySet>,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
    state: Arc<AtomicU8>,
    /// Stages of the passes encoded so far.
    stages: Vec<Stage>,
    /// Stages of the pending readback.
    pending: Vec<Stage>,
    /// Its picture.
    picture: u64,
    /// Width and height of the pictures in their targets, pixels.
    size: [u32; 2],
    /// Seconds of one tick.
    period: f64,
}

impl StatsReadback {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let queries = gpu.has(wgpu::Features::TIMESTAMP_QUERY).then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * TIMED_PASSES,
            })
        });
        let bytes = PASS_BYTES * u64::from(TIMED_PASSES);
        Self {
            queries,
            resolved: gpu.buffer("times", bytes, wgpu::BufferUsages::QUERY_RESOLVE),
            staging: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("stats"),
                size: COUNT_BYTES + bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            state: Arc::new(AtomicU8::new(IDLE)),
            stages: Vec::new(),
            pending: Vec::new(),
            picture: 0,
            size: [1, 1],
            period: 1e-9 * f64::from(gpu.queue.get_timestamp_period()),
        }
    }

    /// Whether a readback is under way.
    pub(super) fn is_pending(&self) -> bool {
        self.state.load(Ordering::Acquire) == PENDING
    }

    /// Starts pictures of `size` pixels, the upper left part of their targets.
    pub(super) fn begin(&mut self, size: [u32; 2]) {
        self.size = size;
        self.stages.clear();
    }

    /// Reserves the two timestamps of a pass.
    fn next(&mut self, stage: Stage) -> Option<(&wgpu::QuerySet, u32)> {
        let queries = self.queries.as_ref()?;
        let at = self.stages.len() as u32;
        if at == TIMED_PASSES {
            return None;
        }
        self.stages.push(stage);
        Some((queries, 2 * at))
    }

    /// Begins a compute pass of a stage.
    pub(super) fn compute_pass<'e>(
        &mut self,
        encoder: &'e mut wgpu::CommandEncoder,
        stage: Stage,
    ) -> wgpu::ComputePass<'e> {
        let timestamp_writes = self.next(stage).map(|(query_set, at)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        recorded::open_pass();
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes })
    }

    /// Begins a render pass of a stage; with a mask it draws into several layers at once.
    pub(super) fn render_pass<'e>(
        &mut self,
        encoder: &'e mut wgpu::CommandEncoder,
        stage: Stage,
        Attachments { color, depth, keep }: Attachments<'_>,
        multiview_mask: Option<NonZeroU32>,
    ) -> wgpu::RenderPass<'e> {
        let [width, height] = self.size;
        let timestamp_writes = self.next(stage).map(|(query_set, at)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        let color = color.map(|view| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: if keep { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) },
                store: wgpu::StoreOp::Store,
            },
        });
        let load = if keep { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(1.0) };
        recorded::open_pass();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: color.map(Some).as_slice(),
            depth_stencil_attachment: depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes,
            occlusion_query_set: None,
            multiview_mask,
        });
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass
    }

    /// Encodes the copy of the counts and times of a picture. Returns false while an earlier readback is pending.
    pub(super) fn copy(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        [totals, longest, near_rays]: [&wgpu::Buffer; 3],
        picture: u64,
    ) -> bool {
        if self.state.load(Ordering::Acquire) != IDLE {
            return false;
        }
        encoder.copy_buffer_to_buffer(totals, 0, &self.staging, 0, TOTAL_BYTES);
        encoder.copy_buffer_to_buffer(longest, 0, &self.staging, TOTAL_BYTES, LENGTH_BYTES);
        encoder.copy_buffer_to_buffer(near_rays, 0, &self.staging, TOTAL_BYTES + LENGTH_BYTES, LENGTH_BYTES);
        let passes = self.stages.len() as u32;
        if let (Some(queries), true) = (&self.queries, passes > 0) {
            encoder.resolve_query_set(queries, 0..2 * passes, &self.resolved, 0);
            let bytes = PASS_BYTES * u64::from(passes);
            encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, COUNT_BYTES, bytes);
        }
        self.pending.clone_from(&self.stages);
        self.picture = picture;
        true
    }

    /// Starts the readback. Call it after the submission of the copy.
    pub(super) fn map(&self) {
        self.state.store(PENDING, Ordering::Release);
        let state = Arc::clone(&self.state);
        self.staging.map_async(wgpu::MapMode::Read, .., move |outcome| {
            state.store(if outcome.is_ok() { READY } else { FAILED }, Ordering::Release);
        });
    }

    /// The result of the readback, if it is complete.
    pub(super) fn take(&self) -> Option<PictureStats> {
        match self.state.load(Ordering::Acquire) {
            READY => {
                let parsed = self.staging.get_mapped_range(..).ok().map(|bytes| self.parse(&bytes));
                self.staging.unmap();
                self.state.store(IDLE, Ordering::Release);
                parsed
            }
            FAILED => {
                self.state.store(IDLE, Ordering::Release);
                None
            }
            _ => None,
        }
    }

    fn parse(&self, bytes: &[u8]) -> PictureStats {
        let (totals, rest) = bytes.split_at(bytes.len().min(TOTAL_BYTES as usize));
        let times = bytes.get(COUNT_BYTES as usize..).unwrap_or_default();
        let mut device_seconds = None;
        let seconds = self.queries.as_ref().map(|_| {
            let mut seconds = PassSeconds::default();
            let (mut first, mut last) = (u64::MAX, 0);
            for (stage, pass) in self.pending.iter().zip(times.chunks_exact(PASS_BYTES as usize)) {
                let [begin, end]: [u64; 2] = bytemuck::pod_read_unaligned(pass);
                seconds.add(*stage, self.period * end.saturating_sub(begin) as f64);
                (first, last) = (first.min(begin), last.max(end));
            }
            device_seconds = Some(self.period * last.saturating_sub(first) as f64);
            seconds
        });
        PictureStats {
            device_seconds,
            picture: self.picture,
            totals: encase::StorageBuffer::new(totals).create().unwrap_or_default(),
            longest: encase::StorageBuffer::new(rest).create().unwrap_or_default(),
            near_rays: encase::StorageBuffer::new(rest.get(LENGTH_BYTES as usize..).unwrap_or_default())
                .create()
                .unwrap_or_default(),
            seconds,
        }
    }
}
