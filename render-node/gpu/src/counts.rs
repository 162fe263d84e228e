//! The work of a frame on a graphics device, counted without one: pass by pass fragments, pairs, bytes, commands and barriers.
//!
//! [`sg_raster::counts`] counts the splats, pairs and fragments of a scene on the cores. A table of all passes turns them into
//! bytes and commands (`pass_table`), by the layouts that the shaders use. [`Card`] turns those into milliseconds.

mod cards;
mod pass_table;
#[cfg(test)]
mod tests;

use glam::DMat3;
use serde::Serialize;
use sg_raster::counts::{Blending, Counting, Counts, count};
use sg_raster::render::{Projection, Quality, RenderError};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::barriers::{Commands, Use};
use crate::settings::{Options, Rasterizer, Settings};
use crate::shader_layout::{BANDS, COARSE, SURFACE_NUMBERS};
pub use cards::Card;

/// A row of the table of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pass {
    /// Mark and list Gaussians that may be visible.
    Cull,
    /// Project and shade; rays of Gaussians near the eye.
    Project,
    /// Sort by depth.
    Sort,
    /// Pairs of a splat and a tile, and each tile's list.
    TileLists,
    /// Sort of the pairs by tile.
    PairSort,
    /// Blend by tiles, quadrilaterals or bands.
    Blend,
    /// Compose over the background.
    Compose,
    /// Depths of the pictures.
    Depths,
    /// Copy to a window's or a headset's image.
    Present,
    /// Copy of the depths to a headset.
    DepthLayer,
}

impl Pass {
    /// All rows.
    pub const ALL: [Self; 10] = [
        Self::Cull,
        Self::Project,
        Self::Sort,
        Self::TileLists,
        Self::PairSort,
        Self::Blend,
        Self::Compose,
        Self::Depths,
        Self::Present,
        Self::DepthLayer,
    ];

    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cull => "cull",
            Self::Project => "project",
            Self::Sort => "sort by depth",
            Self::TileLists => "tile lists",
            Self::PairSort => "sort by tile",
            Self::Blend => "blend",
            Self::Compose => "compose",
            Self::Depths => "depths",
            Self::Present => "present",
            Self::DepthLayer => "depth layer",
        }
    }
}

/// Numbers of a pixel of a target or a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetFormat {
    /// Four f32.
    Float32,
    /// Four f16.
    Float16,
}

impl TargetFormat {
    fn bytes(self) -> u64 {
        match self {
            Self::Float32 => 16,
            Self::Float16 => 8,
        }
    }
}

/// What is counted.
#[derive(Debug, Clone, Copy)]
pub struct WorkOptions {
    /// Quality, method of blending and depths. Only [`Projection::Affine`] is counted.
    pub settings: Settings,
    /// Half precision and the capacity of the list of pairs.
    pub renderer: Options,
    /// Whether the pictures are copied to images of a window or a headset.
    pub presented: bool,
    /// Format of the pixels that quadrilaterals are blended in: f32 as on a device, or another to compare with.
    pub target: TargetFormat,
    /// Whether wgpu validates indirect calls: see [`validates_indirect_calls`].
    pub validates: bool,
    /// Evaluations are counted in one tile out of so many: see [`Counting::sample`].
    pub sample: u32,
}

impl Default for WorkOptions {
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            renderer: Options::default(),
            presented: false,
            target: TargetFormat::Float32,
            validates: validates_indirect_calls(),
            sample: 1,
        }
    }
}

/// Whether wgpu validates the indirect calls of devices that this crate opens.
#[must_use]
pub fn validates_indirect_calls() -> bool {
    crate::device::Gpu::instance_descriptor().flags.contains(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL)
}

/// Work of one pass.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PassWork {
    /// The pass.
    pub pass: Pass,
    /// Fragments that are blended.
    pub blended: u64,
    /// Fragments that are stored without blending.
    pub stored: u64,
    /// Evaluated pairs of a splat and a pixel, of tiles.
    pub evaluated: u64,
    /// See [`Counts::in_step`].
    pub in_step: u64,
    /// See [`Counts::in_step_by_rays`].
    pub in_step_by_rays: u64,
    /// See [`Counts::in_step_in_blocks`].
    pub in_step_in_blocks: u64,
    /// Pairs of a splat and a tile.
    pub tile_pairs: u64,
    /// Bytes that shaders and blending read, each address once for a workgroup or draw.
    pub bytes_read: u64,
    /// Bytes that they write.
    pub bytes_written: u64,
    /// Dispatches, draws and barriers.
    #[serde(flatten)]
    pub commands: Commands,
}

impl PassWork {
    fn of(pass: Pass) -> Self {
        Self {
            pass,
            blended: 0,
            stored: 0,
            evaluated: 0,
            in_step: 0,
            in_step_by_rays: 0,
            in_step_in_blocks: 0,
            tile_pairs: 0,
            bytes_read: 0,
            bytes_written: 0,
            commands: Commands::default(),
        }
    }

    /// Sum with the same pass of another submission.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            pass: self.pass,
            blended: self.blended + other.blended,
            stored: self.stored + other.stored,
            evaluated: self.evaluated + other.evaluated,
            in_step: self.in_step + other.in_step,
            in_step_by_rays: self.in_step_by_rays + other.in_step_by_rays,
            in_step_in_blocks: self.in_step_in_blocks + other.in_step_in_blocks,
            tile_pairs: self.tile_pairs + other.tile_pairs,
            bytes_read: self.bytes_read + other.bytes_read,
            bytes_written: self.bytes_written + other.bytes_written,
            commands: self.commands.plus(&other.commands),
        }
    }
}

/// Work of a frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameWork {
    /// Counts of the scene.
    pub counts: Counts,
    /// Format of blended pixels.
    pub target: TargetFormat,
    /// Passes that do something, in their order.
    pub passes: Vec<PassWork>,
    #[serde(skip)]
    submissions: Vec<(Frame, Counts)>,
}

impl FrameWork {
    /// The work of submissions that share nothing but the scene.
    fn of(submissions: Vec<(Frame, Counts)>, target: TargetFormat, validates: bool) -> Self {
        let rows = |(frame, counts): &(Frame, Counts)| rows(&Frame { target, ..*frame }, counts, validates);
        let sum = |a: Vec<PassWork>, b: Vec<PassWork>| a.iter().zip(&b).map(|(a, b)| a.plus(b)).collect();
        let rows = submissions.iter().map(rows).reduce(sum).unwrap_or_default();
        let passes = rows.into_iter().filter(|row| row.commands != Commands::default()).collect();
        let counts = submissions.iter().map(|(_, counts)| *counts).reduce(|a, b| a.plus(&b)).unwrap_or_default();
        Self { counts, target, passes, submissions }
    }

    /// The same counts with blended pixels of another format, and with or without wgpu's validation of indirect calls.
    #[must_use]
    pub fn with(&self, target: TargetFormat, validates: bool) -> Self {
        Self::of(self.submissions.clone(), target, validates)
    }

    /// Predicted seconds of each pass on a card.
    #[must_use]
    pub fn seconds(&self, card: &Card) -> Vec<f64> {
        self.passes.iter().map(|work| card.seconds(work, self.target)).collect()
    }

    /// Sum of all commands.
    #[must_use]
    pub fn commands(&self) -> Commands {
        self.passes.iter().fold(Commands::default(), |sum, work| sum.plus(&work.commands))
    }
}

/// The shape of a frame: what the table of passes depends on besides the counts.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Frame {
    rasterizer: Rasterizer,
    size: [u32; 2],
    views: u32,
    depths: bool,
    presented: bool,
    /// Whether one draw blends the quadrilaterals of both eyes.
    multiview: bool,
    /// Whether tiles are blended from workgroup memory.
    staged: bool,
    target: TargetFormat,
    /// That of [`Options::half_pictures`].
    picture: TargetFormat,
    /// Ranges of Gaussians with buffers of their own.
    parts: u64,
    /// Bits of all masks for one Gaussian.
    mask_bits: u64,
    colors: bool,
    surface_bytes: u64,
    harmonic_bytes: u64,
    listed_pairs: u64,
}

impl Frame {
    /// Pixels of one view.
    fn pixels(&self) -> u64 {
        self.size.iter().map(|pixels| u64::from(*pixels)).product()
    }

    /// Pixels of the depths of one view.
    fn depth_pixels(&self) -> u64 {
        let edge = if self.rasterizer == Rasterizer::Tiles { 1 } else { COARSE };
        self.size.iter().map(|pixels| u64::from(pixels.div_ceil(edge))).product()
    }

    /// Windows of the list of pairs, once the lists have grown.
    fn windows(&self, counts: &Counts) -> u64 {
        counts.tile_pairs.div_ceil(self.listed_pairs.max(1)).max(1)
    }

    fn of(scene: &Scene, appearance: &Appearance, cameras: &[Camera], options: &WorkOptions) -> Self {
        let Settings { depths, rasterizer, .. } = options.settings;
        let number = if options.renderer.half { 2 } else { 4 };
        let lit = scene.has_shading();
        let of_harmonics = scene.units.iter().filter(|u| u.gaussians.shading.is_none());
        let degree = of_harmonics.filter_map(|u| u.gaussians.harmonics.as_ref().map(|h| u64::from(h.degree))).max();
        let coefficients = degree.map_or(0, |degree| 3 * (degree + 1) * (degree + 1));
        Self {
            rasterizer,
            size: cameras.first().map_or([1, 1], |c| [c.width, c.height]),
            views: cameras.len() as u32,
            depths,
            presented: options.presented,
            multiview: cameras.len() > 1 && options.renderer.multiview.unwrap_or(true),
            staged: options.renderer.staged_blending.unwrap_or(true),
            target: options.target,
            picture: if options.renderer.half_pictures { TargetFormat::Float16 } else { TargetFormat::Float32 },
            parts: 1,
            mask_bits: appearance.units.len() as u64 + u64::from(appearance.overlay.is_some()),
            colors: appearance.colors.is_some(),
            surface_bytes: if lit { number * u64::from(SURFACE_NUMBERS) } else { 0 },
            harmonic_bytes: number * coefficients,
            listed_pairs: u64::from(options.renderer.listed_pairs),
        }
    }
}

/// Settings that are not counted, or invalid input.
#[derive(Debug, thiserror::Error)]
pub enum WorkError {
    /// The ray-consistent projection.
    #[error("only the affine projection is counted; leave out `--projection per-ray`")]
    Projection,
    /// The reference, which cores draw.
    #[error("a graphics device draws no reference; count `--quality standard` or `fast`")]
    Quality,
    /// Invalid input.
    #[error(transparent)]
    Input(#[from] RenderError),
}

/// Counts the work of one frame: a picture for each camera, one eye or two.
///
/// Two eyes whose axes differ are two submissions, as [`crate::Renderer::draw`] makes them. The scene's columns are taken to fit one
/// binding each, as on every graphics card.
///
/// # Errors
/// [`WorkError`] for [`Projection::PerRay`] and [`Quality::Exact`], an invalid camera, or parts that belong to different scenes.
pub fn frame_work(
    scene: &Scene,
    appearance: &Appearance,
    cameras: &[Camera],
    options: WorkOptions,
) -> Result<FrameWork, WorkError> {
    if options.settings.projection == Projection::PerRay {
        return Err(WorkError::Projection);
    }
    if options.settings.quality == Quality::Exact {
        return Err(WorkError::Quality);
    }
    let Settings { quality, rasterizer, depths, foveation, .. } = options.settings;
    let counting = Counting {
        quality,
        blending: match rasterizer {
            Rasterizer::Tiles => Blending::Tiles,
            Rasterizer::Quads => Blending::Quads,
            Rasterizer::Bands => Blending::Bands(BANDS),
        },
        depth_edge: if depths { COARSE } else { 0 },
        sample: options.sample,
        foveation,
    };
    let each = if are_parallel(cameras) { cameras.len().max(1) } else { 1 };
    let submission = |cameras: &[Camera]| {
        let counts = count(scene, appearance, cameras, counting)?;
        Ok((Frame::of(scene, appearance, cameras, &options), counts))
    };
    let submissions = cameras.chunks(each).map(submission).collect::<Result<_, RenderError>>()?;
    Ok(FrameWork::of(submissions, options.target, options.validates))
}

/// Eyes that share a depth order: see `Renderer::draws_together`.
fn are_parallel(cameras: &[Camera]) -> bool {
    let forward = |c: &Camera| DMat3::from_mat4(c.view()).row(2);
    match cameras {
        [left, right] => (forward(right) - forward(left)).abs().max_element() <= crate::renderer::PARALLEL,
        _ => true,
    }
}

/// All rows of the table of work.
fn rows(frame: &Frame, counts: &Counts, validates: bool) -> Vec<PassWork> {
    let commands = pass_table::commands(frame, counts);
    let uses = commands.iter().map(|command| {
        let uses = command.resources.iter().map(|r| Use { resource: r.name, access: r.access });
        (command.opens_pass, command.kind, uses.collect())
    });
    let numbers = Commands::count(uses.collect(), validates);
    let row = |pass: Pass| {
        let mut row = PassWork::of(pass);
        for (command, numbers) in commands.iter().zip(&numbers).filter(|(command, _)| command.pass == pass) {
            row.blended += command.blended;
            row.stored += command.stored;
            row.bytes_read += command.resources.iter().map(|r| r.read).sum::<u64>();
            row.bytes_written += command.resources.iter().map(|r| r.written).sum::<u64>();
            row.commands = row.commands.plus(numbers);
        }
        match pass {
            Pass::Blend => PassWork {
                evaluated: counts.evaluated,
                in_step: counts.in_step,
                in_step_by_rays: counts.in_step_by_rays,
                in_step_in_blocks: counts.in_step_in_blocks,
                ..row
            },
            Pass::TileLists => PassWork { tile_pairs: counts.tile_pairs, ..row },
            _ => row,
        }
    };
    Pass::ALL.map(row).to_vec()
}
