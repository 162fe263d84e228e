//! Lists of the Gaussians that touch each 16 × 16 tile, in depth order, within bounded memory.

use std::ops::Range;

use glam::DVec2;
use rayon::prelude::*;

use crate::project::Ellipse;

/// Edge of a tile in pixels.
pub const TILE: usize = 16;

/// Entries of tile lists held at once (8 bytes each while they are made). A scene whose footprints cover more is drawn in
/// several batches of tiles.
const BUDGET: u64 = 1 << 25;

/// Chunks of the depth order whose row lists are made in parallel.
const CHUNKS: usize = 16;

/// A rectangle of tiles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Batch {
    pub(crate) rows: Range<usize>,
    pub(crate) columns: Range<usize>,
}

/// Tiles of a picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    width: usize,
    height: usize,
}

/// The lists of one row of tiles within a batch.
pub(crate) struct TileRow {
    first_column: usize,
    offsets: Vec<u32>,
    items: Vec<u32>,
}

impl TileRow {
    /// Column of each tile, and the indices of its Gaussians in depth order.
    pub(crate) fn tiles(&self) -> impl ExactSizeIterator<Item = (usize, &[u32])> {
        self.offsets.windows(2).enumerate().map(|(k, ends)| {
            let list = match ends {
                [from, to] => self.items.get(*from as usize..*to as usize).unwrap_or_default(),
                _ => &[],
            };
            (self.first_column + k, list)
        })
    }

    pub(crate) fn pairs(&self) -> u64 {
        self.items.len() as u64
    }
}

impl Grid {
    pub(crate) fn of(width: u32, height: u32) -> Self {
        Self { width: width as usize, height: height as usize }
    }

    pub(crate) fn columns(&self) -> usize {
        self.width.div_ceil(TILE)
    }

    pub(crate) fn rows(&self) -> usize {
        self.height.div_ceil(TILE)
    }

    /// Pixels `[from, to)` along one axis whose centres lie in the closed interval `low..high`.
    fn pixels(low: f64, high: f64, size: usize) -> Range<usize> {
        // Saturating casts: places outside the picture become its edge.
        let from = (low - 0.5).ceil().max(0.0) as usize;
        let to = ((high - 0.5).floor() + 1.0).max(0.0) as usize;
        from.min(size)..to.min(size)
    }

    /// Tile columns whose pixel centres the level at `radius` may touch in tile row `row`.
    fn columns_touched(&self, ellipse: &Ellipse, radius: f64, row: usize) -> Range<usize> {
        let Ellipse { center, slope, along_row, over_rows } = *ellipse;
        let tall = radius * over_rows;
        let top = ((row * TILE) as f64 + 0.5 - center.y).max(-tall);
        let bottom = (((row + 1) * TILE).min(self.height) as f64 - 0.5 - center.y).min(tall);
        if top > bottom {
            return 0..0;
        }
        // The rightmost point of the level, as an offset in y; by symmetry the leftmost is at its negative.
        let wide = along_row.hypot(slope * over_rows);
        let tip = radius * slope * over_rows * over_rows / wide;
        let half = |y: f64| along_row * (radius * radius - (y / over_rows).powi(2)).max(0.0).sqrt();
        let right = tip.clamp(top, bottom);
        let left = (-tip).clamp(top, bottom);
        let pixels = Self::pixels(
            center.x + slope * left - half(left) - MARGIN,
            center.x + slope * right + half(right) + MARGIN,
            self.width,
        );
        if pixels.is_empty() { 0..0 } else { pixels.start / TILE..pixels.end.div_ceil(TILE) }
    }

    /// Tile rows whose pixel centres the level at `radius` may touch.
    fn rows_touched(&self, ellipse: &Ellipse, radius: f64) -> Range<usize> {
        let tall = radius * ellipse.over_rows + MARGIN;
        let pixels = Self::pixels(ellipse.center.y - tall, ellipse.center.y + tall, self.height);
        if pixels.is_empty() { 0..0 } else { pixels.start / TILE..pixels.end.div_ceil(TILE) }
    }

    /// Cuts the picture into batches whose lists fit the budget, counted on bounding boxes.
    pub(crate) fn batches<T: Sync>(&self, splats: &[T], level: impl Fn(&T) -> (Ellipse, f64) + Sync) -> Vec<Batch> {
        let whole = Batch { rows: 0..self.rows(), columns: 0..self.columns() };
        let worst = splats.len() as u64 * (self.rows() * self.columns()) as u64;
        if worst <= BUDGET {
            return vec![whole];
        }
        let table = self.box_counts(splats, level);
        let mut pending = vec![whole];
        let mut done = Vec::new();
        while let Some(batch) = pending.pop() {
            let (rows, columns) = (batch.rows.len(), batch.columns.len());
            if table.sum(&batch) <= BUDGET || rows * columns <= 1 {
                done.push(batch);
            } else if rows > 1 {
                let middle = batch.rows.start + rows / 2;
                pending.push(Batch { rows: middle..batch.rows.end, columns: batch.columns.clone() });
                pending.push(Batch { rows: batch.rows.start..middle, columns: batch.columns });
            } else {
                let middle = batch.columns.start + columns / 2;
                pending.push(Batch { rows: batch.rows.clone(), columns: middle..batch.columns.end });
                pending.push(Batch { rows: batch.rows, columns: batch.columns.start..middle });
            }
        }
        done
    }

    /// How many bounding boxes cover each tile, as a summed-area table.
    fn box_counts<T: Sync>(&self, splats: &[T], level: impl Fn(&T) -> (Ellipse, f64) + Sync) -> SummedArea {
        let stride = self.columns() + 1;
        let mut cells = vec![0_i64; stride * (self.rows() + 1)];
        let mut add = |row: usize, column: usize, n: i64| {
            if let Some(cell) = cells.get_mut(row * stride + column) {
                *cell += n;
            }
        };
        for splat in splats {
            let (ellipse, radius) = level(splat);
            let rows = self.rows_touched(&ellipse, radius);
            let half = ellipse.half_size(radius).x + MARGIN;
            let pixels = Self::pixels(ellipse.center.x - half, ellipse.center.x + half, self.width);
            if !rows.is_empty() && !pixels.is_empty() {
                let columns = pixels.start / TILE..pixels.end.div_ceil(TILE);
                add(rows.start, columns.start, 1);
                add(rows.start, columns.end, -1);
                add(rows.end, columns.start, -1);
                add(rows.end, columns.end, 1);
            }
        }
        // Corner differences to counts, counts to sums over all tiles above and to the left: two prefix sums each way.
        SummedArea::of(cells, stride)
    }

    /// Lists of a batch, one entry for each of its tile rows. `splats` is in depth order.
    pub(crate) fn bin<T: Sync>(
        &self,
        batch: &Batch,
        splats: &[T],
        level: impl Fn(&T) -> (Ellipse, f64) + Sync,
    ) -> Vec<TileRow> {
        let size = splats.len().div_ceil(CHUNKS).max(1);
        let spans: Vec<Vec<Vec<Span>>> = splats
            .par_chunks(size)
            .enumerate()
            .map(|(chunk, splats)| {
                let mut rows: Vec<Vec<Span>> = vec![Vec::new(); batch.rows.len()];
                for (k, splat) in splats.iter().enumerate() {
                    let (ellipse, radius) = level(splat);
                    let touched = self.rows_touched(&ellipse, radius);
                    let from = touched.start.max(batch.rows.start);
                    for row in from..touched.end.min(batch.rows.end) {
                        let columns = self.columns_touched(&ellipse, radius, row);
                        let from = columns.start.max(batch.columns.start);
                        let to = columns.end.min(batch.columns.end);
                        if let (true, Some(spans)) = (from < to, rows.get_mut(row - batch.rows.start)) {
                            let offset = |column: usize| (column - batch.columns.start) as u16;
                            spans.push(Span { item: (chunk * size + k) as u32, from: offset(from), to: offset(to) });
                        }
                    }
                }
                rows
            })
            .collect();
        (0..batch.rows.len())
            .into_par_iter()
            .map(|row| {
                let spans: Vec<&[Span]> = spans.iter().filter_map(|chunk| chunk.get(row)).map(Vec::as_slice).collect();
                TileRow::of(batch.columns.clone(), &spans)
            })
            .collect()
    }
}

/// Pixels by which a level is taken to reach further, so that rounding here never costs a pixel that blending would draw.
const MARGIN: f64 = 1e-3;

/// A Gaussian's tiles within one tile row, columns counted from the batch's first.
#[derive(Debug, Clone, Copy)]
struct Span {
    item: u32,
    from: u16,
    to: u16,
}

impl TileRow {
    fn of(columns: Range<usize>, spans: &[&[Span]]) -> Self {
        let mut starts = vec![0_i64; columns.len() + 1];
        let mut change = |column: u16, n: i64| {
            if let Some(start) = starts.get_mut(usize::from(column)) {
                *start += n;
            }
        };
        for span in spans.iter().copied().flatten() {
            change(span.from, 1);
            change(span.to, -1);
        }
        let mut covering = 0;
        let mut end = 0_i64;
        let mut offsets = Vec::with_capacity(columns.len() + 1);
        for change in &starts {
            offsets.push(end as u32);
            covering += change;
            end += covering;
        }
        let mut items = vec![0; end as usize];
        let mut next = offsets.clone();
        for span in spans.iter().copied().flatten() {
            for at in next.get_mut(usize::from(span.from)..usize::from(span.to)).unwrap_or_default() {
                if let Some(item) = items.get_mut(*at as usize) {
                    *item = span.item;
                }
                *at += 1;
            }
        }
        Self { first_column: columns.start, offsets, items }
    }
}

/// Sums over rectangles of tiles.
struct SummedArea {
    stride: usize,
    sums: Vec<i64>,
}

impl SummedArea {
    /// From corner differences, one row and one column more than there are tiles.
    fn of(mut cells: Vec<i64>, stride: usize) -> Self {
        for _ in 0..2 {
            for row in cells.chunks_mut(stride) {
                let mut sum = 0;
                for cell in row {
                    sum += *cell;
                    *cell = sum;
                }
            }
            for k in stride..cells.len() {
                cells[k] += cells[k - stride];
            }
        }
        Self { stride, sums: cells }
    }

    fn sum(&self, batch: &Batch) -> u64 {
        // Sum over all tiles above and left of (row, column), exclusive.
        let at = |row: usize, column: usize| match (row.checked_sub(1), column.checked_sub(1)) {
            (Some(r), Some(c)) => self.sums.get(r * self.stride + c).copied().unwrap_or(0),
            _ => 0,
        };
        let Batch { rows, columns } = batch;
        let sum = at(rows.end, columns.end) - at(rows.start, columns.end) - at(rows.end, columns.start)
            + at(rows.start, columns.start);
        sum.max(0) as u64
    }
}

/// Size of a picture in pixels as a vector.
pub(crate) fn picture_size(width: u32, height: u32) -> DVec2 {
    DVec2::new(f64::from(width), f64::from(height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ellipses() -> impl Strategy<Value = (Ellipse, f64)> {
        (-60.0..200.0_f64, -60.0..160.0_f64, -3.0..3.0_f64, 0.55..40.0_f64, 0.55..40.0_f64, 0.5..9.0_f64).prop_map(
            |(x, y, slope, along_row, over_rows, radius)| {
                (Ellipse { center: DVec2::new(x, y), slope, along_row, over_rows }, radius)
            },
        )
    }

    proptest! {
        #[test]
        fn no_touched_pixel_is_missed_and_few_tiles_are_added(list in proptest::collection::vec(ellipses(), 0..20)) {
            let grid = Grid::of(131, 90);
            let whole = Batch { rows: 0..grid.rows(), columns: 0..grid.columns() };
            let rows = grid.bin(&whole, &list, |s| *s);
            for (row, tiles) in rows.iter().enumerate() {
                for (column, got) in tiles.tiles() {
                    prop_assert!(got.is_sorted());
                    for (k, (e, radius)) in list.iter().enumerate() {
                        let inside = |grow: f64| {
                            (row * TILE..((row + 1) * TILE).min(90)).any(|j| {
                                (column * TILE..((column + 1) * TILE).min(131)).any(|i| {
                                    let y = j as f64 + 0.5 - e.center.y;
                                    let x = i as f64 + 0.5 - e.center.x - e.slope * y;
                                    let reach = radius * e.over_rows + grow;
                                    let rest = (1.0 - (y / reach).powi(2)).max(0.0).sqrt();
                                    y.abs() <= reach && x.abs() <= rest * (radius * e.along_row) + grow
                                })
                            })
                        };
                        let listed = got.contains(&(k as u32));
                        prop_assert!(listed || !inside(0.0), "tile {column},{row} misses {k}");
                        // A tile may be listed only if the level passes within a pixel of one of its centres.
                        prop_assert!(!listed || inside(1.5 * (1.0 + e.slope.abs())), "tile {column},{row} lists {k}");
                    }
                }
            }
        }

        #[test]
        fn batches_split_the_same_lists(list in proptest::collection::vec(ellipses(), 1..20)) {
            let grid = Grid::of(131, 90);
            let whole = Batch { rows: 0..grid.rows(), columns: 0..grid.columns() };
            let lists = |batch: &Batch| -> Vec<(usize, usize, Vec<u32>)> {
                grid.bin(batch, &list, |s| *s)
                    .iter()
                    .zip(batch.rows.clone())
                    .flat_map(|(r, row)| r.tiles().map(move |(column, l)| (row, column, l.to_vec())).collect::<Vec<_>>())
                    .collect()
            };
            let mut parts: Vec<_> = [(0..2, 0..9), (2..6, 0..4), (2..6, 4..9)]
                .into_iter()
                .flat_map(|(rows, columns)| lists(&Batch { rows, columns }))
                .collect();
            parts.sort();
            prop_assert_eq!(parts, lists(&whole));
            let table = grid.box_counts(&list, |s| *s);
            let pairs: u64 = grid.bin(&whole, &list, |s| *s).iter().map(TileRow::pairs).sum();
            prop_assert!(table.sum(&whole) >= pairs);
            let split = table.sum(&Batch { rows: 0..3, ..whole.clone() }) + table.sum(&Batch { rows: 3..6, ..whole.clone() });
            prop_assert_eq!(split, table.sum(&whole));
        }
    }

    #[test]
    fn screen_filling_gaussians_are_drawn_in_batches_that_fit() {
        let grid = Grid::of(512, 512);
        let big = Ellipse { center: DVec2::splat(256.0), slope: 0.0, along_row: 1e6, over_rows: 1e6 };
        let list = vec![(big, 3.0); 100_000];
        let batches = grid.batches(&list, |s| *s);
        assert!(batches.len() >= 4, "{}", batches.len());
        let tiles: usize = batches.iter().map(|b| b.rows.len() * b.columns.len()).sum();
        assert_eq!(tiles, grid.rows() * grid.columns());
        assert!(batches.iter().all(|b| (b.rows.len() * b.columns.len() * list.len()) as u64 <= BUDGET));
    }
}
