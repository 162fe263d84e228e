//! What a graphics device works through for pictures of a scene, counted on cores: a twin of the device's passes without their
//! colors.
//!
//! [`count`] finds the listed Gaussians, the pairs of a Gaussian and a tile, the evaluations until the early stop of each pixel, and
//! the fragments of quadrilaterals. The rules are those of the shaders (`cull.wgsl`, `tiles.wgsl`, `quads.wgsl` of sg-gpu): the same
//! cut-offs, tiles and stop. Bounds on rounding differ by some hundredths of a pixel.

mod fragments;
mod headset;
mod listed;
mod tile_work;

use glam::DVec2;
use rayon::prelude::*;
use serde::Serialize;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::cutoffs::Limits;
use crate::foveation::{Foveation, Periphery};
use crate::project::Ellipse;
use crate::raster::rasterize;
use crate::render::{Quality, RenderError, check};
use crate::report::Report;
use crate::splat_f32::{Drawn, splats};
use crate::tiles::TILE;
use fragments::fragments;
use tile_work::{Covered, TileWork, Visits};

pub use headset::{EYES_APART, FIELD_OF_VIEW, HEADSET_SIZE, headset};

/// Method of blending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blending {
    /// A list for each tile; each pixel stops when it is opaque.
    Tiles,
    /// A quadrilateral for each Gaussian.
    Quads,
    /// Quadrilaterals in so many bands, near to far. Each band but the first is as long as all before it. Pixels that are opaque at
    /// the begin of a band take no more fragments.
    Bands(u32),
}

/// What is counted, and how exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counting {
    /// Cut-offs. Devices draw [`Quality::Standard`] in the place of `Exact`.
    pub quality: Quality,
    /// Method of blending.
    pub blending: Blending,
    /// Edge in pixels of one depth pixel of quadrilaterals; 0 without depths.
    pub depth_edge: u32,
    /// The evaluations of one tile out of so many are counted, at least 1. The others are taken to have as many: the sampled tiles lie
    /// evenly over the picture.
    pub sample: u32,
    /// Half resolution of tiles far from the optical axis.
    pub foveation: Option<Foveation>,
}

impl Default for Counting {
    fn default() -> Self {
        Self { quality: Quality::Standard, blending: Blending::Tiles, depth_edge: 0, sample: 1, foveation: None }
    }
}

/// Counts of the pictures of one frame, over all views.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Gaussians in the scene.
    pub gaussians: u64,
    /// Gaussians that may reach a picture: all later passes go through them.
    pub listed: u64,
    /// Pictures.
    pub views: u64,
    /// Pixels of all pictures.
    pub pixels: u64,
    /// Gaussians that reach a picture, once for each view.
    pub splats: u64,
    /// Those of them that rays evaluate.
    pub by_rays: u64,
    /// Pairs of a splat and a tile.
    pub tile_pairs: u64,
    /// Length of the longest list of a tile.
    pub longest_list: u64,
    /// Entries of the tiles' lists up to the stop of each tile's last pixel.
    pub visited: u64,
    /// Those of them that rays evaluate.
    pub visited_by_rays: u64,
    /// Evaluated pairs of a splat and a pixel.
    pub evaluated: u64,
    /// The same for hardware that runs 32 pixels of a tile in step: all 32 count until the last one stops.
    pub in_step: u64,
    /// Those of them that rays evaluate.
    pub in_step_by_rays: u64,
    /// Those of them that evaluate an ellipse at a block of pixels.
    pub in_step_in_blocks: u64,
    /// Pixels and blocks of pixels that tiles evaluate.
    pub samples: u64,
    /// Fragments of the quadrilaterals.
    pub fragments: u64,
    /// Those of them that pass the depth test of the bands, and blend.
    pub blended: u64,
    /// Blended fragments of splats that rays evaluate, without the depth test.
    pub fragments_by_rays: u64,
    /// Fragments of the depths of quadrilaterals.
    pub depth_fragments: u64,
}

impl Counts {
    /// Sum of two frames that share nothing but the scene: eyes with separate depth orders.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            gaussians: self.gaussians + other.gaussians,
            listed: self.listed + other.listed,
            ..self.plus_view(other)
        }
    }

    fn plus_view(&self, other: &Self) -> Self {
        Self {
            gaussians: self.gaussians,
            listed: self.listed,
            views: self.views + other.views,
            pixels: self.pixels + other.pixels,
            splats: self.splats + other.splats,
            by_rays: self.by_rays + other.by_rays,
            tile_pairs: self.tile_pairs + other.tile_pairs,
            longest_list: self.longest_list.max(other.longest_list),
            visited: self.visited + other.visited,
            visited_by_rays: self.visited_by_rays + other.visited_by_rays,
            evaluated: self.evaluated + other.evaluated,
            in_step: self.in_step + other.in_step,
            in_step_by_rays: self.in_step_by_rays + other.in_step_by_rays,
            in_step_in_blocks: self.in_step_in_blocks + other.in_step_in_blocks,
            samples: self.samples + other.samples,
            fragments: self.fragments + other.fragments,
            blended: self.blended + other.blended,
            fragments_by_rays: self.fragments_by_rays + other.fragments_by_rays,
            depth_fragments: self.depth_fragments + other.depth_fragments,
        }
    }
}

/// Counts the work of pictures in the affine projection, one for each camera: one eye, or two of one size that share a depth order.
///
/// # Errors
/// [`RenderError`] for an invalid camera, or parts that belong to different scenes.
pub fn count(
    scene: &Scene,
    appearance: &Appearance,
    cameras: &[Camera],
    counting: Counting,
) -> Result<Counts, RenderError> {
    for camera in cameras {
        check(scene, appearance, camera)?;
    }
    let limits = match counting.quality {
        Quality::Exact | Quality::Standard => Limits::STANDARD,
        Quality::Fast => Limits::FAST,
    };
    let listed = listed::listed(scene, appearance, cameras, limits);
    let whole = Counts { gaussians: scene.len() as u64, listed, ..Counts::default() };
    let views = cameras.iter().map(|camera| view(scene, appearance, camera, (counting, limits), listed));
    Ok(views.fold(whole, |sum, view| sum.plus_view(&view)))
}

/// Counts of one view.
fn view(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    (counting, limits): (Counting, Limits),
    listed: u64,
) -> Counts {
    let (layers, _) = splats(scene, appearance, camera, limits);
    let counts = Counts {
        views: 1,
        pixels: u64::from(camera.width) * u64::from(camera.height),
        splats: layers.len() as u64,
        by_rays: layers.par_iter().filter(|layer| layer.is_by_rays()).count() as u64,
        ..Counts::default()
    };
    let size = [camera.width, camera.height];
    match counting.blending {
        Blending::Tiles => {
            let periphery = counting.foveation.map(|foveation| Periphery::of(camera, foveation));
            tiles(&layers, size, (limits.stop, counting.sample.max(1), periphery), counts)
        }
        Blending::Quads => quads(&layers, size, counting.depth_edge, counts),
        Blending::Bands(bands) => {
            let ends = band_ends(bands, listed);
            let whole = quads(&layers, size, counting.depth_edge, counts);
            let open = open_shares(&layers, size, (limits.stop, counting.sample.max(1)), &ends);
            let each = layers.iter().enumerate().map(|(k, layer)| {
                let share = open.get(ends.partition_point(|end| *end <= k as u64)).copied().unwrap_or(1.0);
                share * of_layer(layer, size, DVec2::ONE) as f64
            });
            Counts { blended: each.sum::<f64>().round() as u64, ..whole }
        }
    }
}

/// Places in the depth order at which the bands end: see `sum_blocks` of `list.wgsl`.
fn band_ends(bands: u32, listed: u64) -> Vec<u64> {
    (1..=bands).map(|band| listed >> (bands - band)).collect()
}

fn of_layer(layer: &Drawn, size: [u32; 2], scale: DVec2) -> u64 {
    let (ellipse, radius): (Ellipse, f64) = layer.level();
    fragments(&ellipse, radius, size, scale)
}

/// Counts of the quadrilaterals, all of them blended.
fn quads(layers: &[Drawn], size: [u32; 2], depth_edge: u32, counts: Counts) -> Counts {
    let sum = |size: [u32; 2], scale: DVec2, of: &(dyn Fn(&Drawn) -> bool + Sync)| -> u64 {
        layers.par_iter().filter(|layer| of(layer)).map(|layer| of_layer(layer, size, scale)).sum()
    };
    let all = sum(size, DVec2::ONE, &|_| true);
    let depth_fragments = match depth_edge {
        0 => 0,
        edge => {
            let coarse = size.map(|pixels| pixels.div_ceil(edge));
            let [across, down] = [0, 1].map(|k| f64::from(coarse[k]) / f64::from(size[k]));
            sum(coarse, DVec2::new(across, down), &|_| true)
        }
    };
    Counts {
        fragments: all,
        blended: all,
        fragments_by_rays: sum(size, DVec2::ONE, &Drawn::is_by_rays),
        depth_fragments,
        ..counts
    }
}

/// Whether the work of a tile is counted.
fn is_sampled([x, y]: [usize; 2], sample: u32) -> bool {
    (x / TILE + 5 * (y / TILE)).is_multiple_of(sample as usize)
}

/// Counts of the tiles' lists, and of the evaluations up to the stop.
fn tiles(
    layers: &[Drawn],
    size: [u32; 2],
    (stop, sample, periphery): (f32, u32, Option<Periphery>),
    counts: Counts,
) -> Counts {
    let visits = std::sync::Mutex::new((Visits::default(), Sampled::default()));
    let mut report = Report::default();
    rasterize(
        size,
        layers,
        Drawn::level,
        |corner, list| {
            let is_coarse = periphery.is_some_and(|periphery| periphery.has(corner));
            let tile = if is_coarse { TileWork::in_blocks(corner, size) } else { TileWork::new(corner, size) };
            let samples = tile.samples();
            let counted = is_sampled(corner, sample)
                .then(|| tile.until_stop(list.iter().filter_map(|k| layers.get(*k as usize)), stop));
            let mut sum = visits.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            sum.1.add(list.len(), samples, counted.is_some());
            sum.0 += counted.unwrap_or_default();
            [(); TILE * TILE]
        },
        &mut report,
    );
    let (visits, sampled) = visits.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let whole = |count: u64| sampled.whole(count);
    Counts {
        tile_pairs: report.tile_pairs,
        longest_list: sampled.longest,
        visited: whole(visits.entries),
        visited_by_rays: whole(visits.entries_by_rays),
        evaluated: whole(visits.evaluated),
        in_step: whole(visits.in_step),
        in_step_by_rays: whole(visits.in_step_by_rays),
        in_step_in_blocks: whole(visits.in_step_in_blocks),
        samples: sampled.samples,
        ..counts
    }
}

/// Tiles, and those of them that were counted.
#[derive(Debug, Clone, Copy, Default)]
struct Sampled {
    longest: u64,
    samples: u64,
    tiles: u64,
    counted: u64,
}

impl Sampled {
    fn add(&mut self, pairs: usize, samples: u64, counted: bool) {
        self.longest = self.longest.max(pairs as u64);
        self.samples += samples;
        self.tiles += 1;
        self.counted += u64::from(counted);
    }

    /// A count of the sampled tiles for all of them.
    fn whole(&self, count: u64) -> u64 {
        let share = self.tiles as f64 / self.counted.max(1) as f64;
        (share * count as f64).round() as u64
    }
}

/// The share of the pixels that are open at the begin of each band, weighted by what the band's splats cover.
fn open_shares(layers: &[Drawn], size: [u32; 2], (stop, sample): (f32, u32), ends: &[u64]) -> Vec<f64> {
    let covered = std::sync::Mutex::new(vec![Covered::default(); ends.len()]);
    rasterize(
        size,
        layers,
        Drawn::level,
        |corner, list| {
            if is_sampled(corner, sample) {
                let band = |k: u32| ends.partition_point(|end| *end <= u64::from(k));
                let items = list.iter().filter_map(|k| Some((band(*k), layers.get(*k as usize)?)));
                let of_tile = TileWork::new(corner, size).by_bands(items, ends.len(), stop);
                let mut sum = covered.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                sum.iter_mut().zip(of_tile).for_each(|(sum, of_tile)| *sum += of_tile);
            }
            [(); TILE * TILE]
        },
        &mut Report::default(),
    );
    let covered = covered.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    covered.iter().map(Covered::open_share).collect()
}
