//! Runs a tile rasterizer over a picture: batches, lists, tiles in parallel, the finished image.

use std::time::Instant;

use rayon::prelude::*;

use crate::image::Image;
use crate::project::Ellipse;
use crate::report::Report;
use crate::tiles::{Grid, TILE, TileRow};

/// One tile, row major.
pub(crate) type TileOf<P> = [P; TILE * TILE];

/// Composited RGB and A = 1 − transmittance of one tile.
pub(crate) type TilePixels = TileOf<[f32; 4]>;

/// Draws `splats`, in depth order, as [`rasterize`] does.
pub(crate) fn draw<T: Sync>(
    size: [u32; 2],
    splats: &[T],
    level: impl Fn(&T) -> (Ellipse, f64) + Sync,
    tile: impl Fn([usize; 2], &[u32]) -> TilePixels + Sync,
    report: &mut Report,
) -> Image {
    let [width, height] = size;
    Image { width, height, rgba: rasterize(size, splats, level, tile, report).into_flattened() }
}

/// Computes each pixel from the Gaussians that may touch it; pixels in row order.
///
/// `level` gives the ellipse and the radius of a Gaussian in standard deviations. `tile` blends the listed
/// Gaussians over the tile whose first pixel is `[x, y]`. A tile depends only on its own list. The picture is
/// therefore the same for any number of threads.
pub(crate) fn rasterize<T: Sync, P: Copy + Default + Send + Sync>(
    [width, height]: [u32; 2],
    splats: &[T],
    level: impl Fn(&T) -> (Ellipse, f64) + Sync,
    tile: impl Fn([usize; 2], &[u32]) -> TileOf<P> + Sync,
    report: &mut Report,
) -> Vec<P> {
    let grid = Grid::of(width, height);
    let mut pixels = vec![P::default(); width as usize * height as usize];
    let began = Instant::now();
    let batches = grid.batches(splats, &level);
    report.seconds.bin += began.elapsed().as_secs_f64();
    for batch in batches {
        let began = Instant::now();
        let rows = grid.bin(&batch, splats, &level);
        report.seconds.bin += began.elapsed().as_secs_f64();
        report.tile_pairs += rows.iter().map(TileRow::pairs).sum::<u64>();
        let began = Instant::now();
        pixels
            .par_chunks_mut(TILE * width as usize)
            .enumerate()
            .skip(batch.rows.start)
            .zip(&rows)
            .for_each(|((row, pixels), tiles)| draw_row(row, pixels, width as usize, tiles, &tile));
        report.seconds.raster += began.elapsed().as_secs_f64();
    }
    pixels
}

/// Fills the pixels of one row of tiles.
pub(crate) fn draw_row<P: Copy + Send>(
    row: usize,
    pixels: &mut [P],
    width: usize,
    tiles: &TileRow,
    tile: &(impl Fn([usize; 2], &[u32]) -> TileOf<P> + Sync),
) {
    let tiles: Vec<(usize, &[u32])> = tiles.tiles().collect();
    let done: Vec<(usize, TileOf<P>)> =
        tiles.into_par_iter().map(|(column, list)| (column * TILE, tile([column * TILE, row * TILE], list))).collect();
    for (x, finished) in done {
        for (line, from) in pixels.chunks_mut(width).zip(finished.chunks(TILE)) {
            let to = line.get_mut(x..).unwrap_or_default();
            for (to, from) in to.iter_mut().zip(from) {
                *to = *from;
            }
        }
    }
}
