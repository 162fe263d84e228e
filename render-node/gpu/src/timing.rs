//! What the device says of a finished picture, without being waited for: counts, and the time of each pass.

use std::num::NonZeroU32;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use super::device::Gpu;

/// Passes that are timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Span {
    List,
    Project,
    Sort,
    Bin,
    Blend,
    Compose,
}

/// Seconds of the device in each pass.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct PassSeconds {
    /// Marking and listing what may be seen.
    pub list: f64,
    /// Projection and shading.
    pub project: f64,
    /// Ordering by depth.
    pub sort: f64,
    /// Lists of each tile.
    pub bin: f64,
    /// Blending.
    pub blend: f64,
    /// Putting the result over the background.
    pub compose: f64,
}

impl PassSeconds {
    /// All passes together.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.list + self.project + self.sort + self.bin + self.blend + self.compose
    }

    /// Two pictures together.
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            list: self.list + other.list,
            project: self.project + other.project,
            sort: self.sort + other.sort,
            bin: self.bin + other.bin,
            blend: self.blend + other.blend,
            compose: self.compose + other.compose,
        }
    }

    fn add(&mut self, span: Span, seconds: f64) {
        *match span {
            Span::List => &mut self.list,
            Span::Project => &mut self.project,
            Span::Sort => &mut self.sort,
            Span::Bin => &mut self.bin,
            Span::Blend => &mut self.blend,
            Span::Compose => &mut self.compose,
        } += seconds;
    }
}

/// What a pass draws onto.
#[derive(Debug, Clone, Copy)]
pub(super) struct Onto<'a> {
    pub(super) color: Option<&'a wgpu::TextureView>,
    /// How near what was drawn before is.
    pub(super) depths: Option<&'a wgpu::TextureView>,
    /// Whether what is there stays; else it is cleared, and nothing hides anything.
    pub(super) stays: bool,
}

/// Timed passes of one picture at most; what comes after them is not timed.
const SPANS: u32 = 64;

const IDLE: u8 = 0;
const ASKED: u8 = 1;
const THERE: u8 = 2;
const FAILED: u8 = 3;

/// Collects the totals and times of one picture at a time. While an answer is under way the pictures after it are not asked
/// about, so that no picture waits.
pub(super) struct Timing {
    queries: Option<wgpu::QuerySet>,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
    state: Arc<AtomicU8>,
    spans: Vec<Span>,
    asked: Vec<Span>,
    period: f64,
}

/// Bytes of totals, and the longest list behind them, in front of the times.
const TOTALS: u64 = 32;

impl Timing {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let queries = gpu.has(wgpu::Features::TIMESTAMP_QUERY).then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * SPANS,
            })
        });
        let bytes = 16 * u64::from(SPANS);
        Self {
            queries,
            resolved: gpu.buffer("times", bytes, wgpu::BufferUsages::QUERY_RESOLVE),
            staging: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("answers"),
                size: TOTALS + bytes,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            state: Arc::new(AtomicU8::new(IDLE)),
            spans: Vec::new(),
            asked: Vec::new(),
            period: 1e-9 * f64::from(gpu.queue.get_timestamp_period()),
        }
    }

    pub(super) fn begin(&mut self) {
        self.spans.clear();
    }

    fn next(&mut self, span: Span) -> Option<(&wgpu::QuerySet, u32)> {
        let queries = self.queries.as_ref()?;
        let at = self.spans.len() as u32;
        if at == SPANS {
            return None;
        }
        self.spans.push(span);
        Some((queries, 2 * at))
    }

    /// Begins a compute pass that is timed as `span`.
    pub(super) fn compute<'e>(&mut self, encoder: &'e mut wgpu::CommandEncoder, span: Span) -> wgpu::ComputePass<'e> {
        let timestamp_writes = self.next(span).map(|(query_set, at)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes })
    }

    /// Begins a pass that draws onto something and is timed as `span`; into several layers of it at once where a mask says so.
    pub(super) fn drawing<'e>(
        &mut self,
        encoder: &'e mut wgpu::CommandEncoder,
        span: Span,
        Onto { color, depths, stays }: Onto<'_>,
        multiview_mask: Option<NonZeroU32>,
    ) -> wgpu::RenderPass<'e> {
        let timestamp_writes = self.next(span).map(|(query_set, at)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        let color = color.map(|view| wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: if stays { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) },
                store: wgpu::StoreOp::Store,
            },
        });
        let far = if stays { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(1.0) };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: color.map(Some).as_slice(),
            depth_stencil_attachment: depths.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations { load: far, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes,
            occlusion_query_set: None,
            multiview_mask,
        })
    }

    /// Has the totals and times of what was encoded copied, unless the last answer is still under way. Whether it has.
    pub(super) fn ask(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        totals: &wgpu::Buffer,
        longest: &wgpu::Buffer,
    ) -> bool {
        if self.state.load(Ordering::Acquire) != IDLE {
            return false;
        }
        encoder.copy_buffer_to_buffer(totals, 0, &self.staging, 0, 16);
        encoder.copy_buffer_to_buffer(longest, 0, &self.staging, 16, 4);
        let count = 2 * self.spans.len() as u32;
        if let (Some(queries), true) = (&self.queries, count > 0) {
            encoder.resolve_query_set(queries, 0..count, &self.resolved, 0);
            encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, TOTALS, 8 * u64::from(count));
        }
        self.asked.clone_from(&self.spans);
        true
    }

    /// To be called once what was asked is handed in.
    pub(super) fn expect_answer(&self) {
        self.state.store(ASKED, Ordering::Release);
        let state = Arc::clone(&self.state);
        self.staging.map_async(wgpu::MapMode::Read, .., move |outcome| {
            state.store(if outcome.is_ok() { THERE } else { FAILED }, Ordering::Release);
        });
    }

    /// The newest answer, if one has arrived: the totals, and the times where the device can tell.
    pub(super) fn answer(&self) -> Option<([u32; 5], Option<PassSeconds>)> {
        match self.state.load(Ordering::Acquire) {
            THERE => {
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

    fn parse(&self, bytes: &[u8]) -> ([u32; 5], Option<PassSeconds>) {
        let mut totals = [0; 5];
        for (total, word) in totals.iter_mut().zip(bytes.chunks_exact(4)) {
            *total = word.try_into().map(u32::from_le_bytes).unwrap_or_default();
        }
        let times = bytes.get(TOTALS as usize..).unwrap_or_default();
        let seconds = self.queries.as_ref().map(|_| {
            let mut seconds = PassSeconds::default();
            for (span, pair) in self.asked.iter().zip(times.chunks_exact(16)) {
                let tick = |at: usize| {
                    pair.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes).unwrap_or_default()
                };
                seconds.add(*span, self.period * tick(8).saturating_sub(tick(0)) as f64);
            }
            seconds
        });
        (totals, seconds)
    }
}
