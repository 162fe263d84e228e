// Lists which splats touch which square tile in depth order, for blend_tiles.wgsl. TILE, the edge of a tile in pixels, stands before this
// text.
//
// Lists longer than the buffer holds are made and blended in windows of the depth order, front to back.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> window: Window;
@group(0) @binding(2) var<uniform> stretch: Stretch;
@group(0) @binding(3) var<storage, read> ellipses: array<Ellipse>;
@group(0) @binding(4) var<storage, read> depth_order: array<u32>;
@group(0) @binding(5) var<storage, read_write> totals: Totals;
// Tiles touched by each of the depth order's splats (all views of one before the next), and sums of LANES of them.
@group(0) @binding(6) var<storage, read_write> touched: array<u32>;
@group(0) @binding(7) var<storage, read_write> touched_sums: array<u32>;
@group(0) @binding(8) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(9) var<storage, read_write> pair_splats: array<u32>;
@group(0) @binding(10) var<storage, read_write> pair_dispatches: PairDispatches;
@group(0) @binding(11) var<storage, read_write> tile_lists: array<TileList>;
// Blended colour and transmittance of each pixel, view after view, between two dispatches.
@group(0) @binding(12) var<storage, read_write> pixels: array<vec4<f32>>;

@group(0) @binding(13) var<storage, read_write> longest_list: atomic<u32>;
@group(0) @binding(14) var<storage, read> levels: array<Level>;
@group(0) @binding(15) var<storage, read> tints: array<Tint>;

// Those that rays evaluate.
@group(0) @binding(22) var<storage, read> near_rays: NearRays;

// The pictures, and the depth of each pixel's front, 0 without one; depths are written with DEPTHS.
@group(0) @binding(23) var first_picture: PictureStore;
@group(0) @binding(24) var second_picture: PictureStore;
@group(0) @binding(25) var first_depths: texture_storage_2d<r32float, write>;
@group(0) @binding(26) var second_depths: texture_storage_2d<r32float, write>;

// Number of tiles outside the visibility mask before each column, for each row of tiles of both eyes.
@group(0) @binding(27) var<storage, read> shown_before: array<u32>;

// Items that touch so many tiles that a workgroup lists them together.
struct LargeItems {
    count: atomic<u32>,
    items: array<u32, LARGE_ITEMS>,
}
@group(0) @binding(28) var<storage, read_write> large_items: LargeItems;

// Pixels by which a level is taken to reach further, so that rounding here costs no pixel that blending would draw.
const MARGIN: f32 = 0.01;

struct Extent {
    center: vec2<f32>,
    slope: f32,
    // Half sizes of the level along a row through its centre, and over the rows.
    along: f32,
    tall: f32,
    // Its greatest half width, and the row offset where it reaches furthest right.
    wide: f32,
    tip: f32,
    first_row: u32,
    end_row: u32,
}

fn pixel_range(low: f32, high: f32, size: u32) -> vec2<u32> {
    let limit = f32(size);
    let first = clamp(ceil(low - 0.5), 0.0, limit);
    let end = clamp(floor(high - 0.5) + 1.0, 0.0, limit);
    return vec2(u32(first), u32(end));
}

fn extent(at: u32) -> Extent {
    let a = ellipses[at];
    let b = levels[at];
    var e: Extent;
    e.center = a.center;
    e.slope = a.slope;
    if b.range < 0.0 {
        return e;
    }
    let reach = sqrt(b.range);
    e.along = reach / a.per_column;
    e.tall = reach / b.per_row;
    e.wide = length(vec2(e.along, e.slope * e.tall));
    e.tip = e.slope * e.tall * e.tall / e.wide;
    let rows = pixel_range(a.center.y - e.tall - MARGIN, a.center.y + e.tall + MARGIN, frame.size.y);
    if rows.x < rows.y {
        e.first_row = rows.x / TILE;
        e.end_row = (rows.y + TILE - 1u) / TILE;
    }
    return e;
}

// Tile columns that the level touches in one row of tiles: the twin of Grid::columns_touched in tiles.rs.
fn columns(e: Extent, row: u32) -> vec2<u32> {
    let top = max(f32(row * TILE) + 0.5 - e.center.y, -e.tall);
    let bottom = min(f32(min((row + 1u) * TILE, frame.size.y)) - 0.5 - e.center.y, e.tall);
    if top > bottom {
        return vec2(0u);
    }
    let right = clamp(e.tip, top, bottom);
    let left = clamp(-e.tip, top, bottom);
    let half_right = e.along * sqrt(max(1.0 - (right / e.tall) * (right / e.tall), 0.0));
    let half_left = e.along * sqrt(max(1.0 - (left / e.tall) * (left / e.tall), 0.0));
    let low = e.center.x + e.slope * left - half_left - MARGIN;
    let high = e.center.x + e.slope * right + half_right + MARGIN;
    let range = pixel_range(low, high, frame.size.x);
    if range.x >= range.y {
        return vec2(0u);
    }
    return vec2(range.x / TILE, (range.y + TILE - 1u) / TILE);
}

// Number of tiles of a row before a column that the visibility mask leaves.
fn tiles_before(view: u32, row: u32, column: u32) -> u32 {
    return shown_before[((frame.first_eye + view) * frame.tiles.y + row) * (frame.tiles.x + 1u) + column];
}

// Set beside the number of tiles of an item that is among the large ones.
const IS_LARGE: u32 = 0x80000000u;

// Where the splat of an item lies in the list of splats; an item is a place in the depth order and a view.
fn splat_of(item: u32) -> u32 {
    return (item % frame.view_count) * frame.capacity + depth_order[item / frame.view_count];
}

@compute @workgroup_size(LANES)
fn touch(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32) {
    let items = totals.listed * frame.view_count;
    for (var block = group.x; block * LANES < items; block += groups.x) {
        let item = block * LANES + lane;
        var tiles = 0u;
        if item < items {
            let e = extent(splat_of(item));
            for (var row = e.first_row; row < e.end_row; row++) {
                let span = columns(e, row);
                if frame.hides_tiles == 1u {
                    let view = item % frame.view_count;
                    tiles += tiles_before(view, row, span.y) - tiles_before(view, row, span.x);
                } else {
                    tiles += span.y - span.x;
                }
            }
            touched[item] = tiles;
            if tiles > LARGE_TILES {
                let at = atomicAdd(&large_items.count, 1u);
                if at < LARGE_ITEMS {
                    large_items.items[at] = item;
                    touched[item] = tiles | IS_LARGE;
                }
            }
        }
        let through = sum_up_to(lane, tiles);
        if lane == LANES - 1u {
            touched_sums[block] = through;
        }
        workgroupBarrier();
    }
}

@compute @workgroup_size(LANES)
fn sum_touched(@builtin(local_invocation_index) lane: u32) {
    let pairs = sum_numbers(lane, (totals.listed * frame.view_count + LANES - 1u) / LANES);
    if lane == 0u {
        totals.pairs = pairs;
    }
}

// How many pairs the window holds, and the work that makes.
@compute @workgroup_size(1)
fn open_window() {
    if window.index == 0u {
        atomicStore(&longest_list, 0u);
    }
    let all = totals.pairs;
    let count = min(all - min(all, window.first_pair), frame.pair_capacity);
    totals.window_pairs = count;
    pair_dispatches.sort = DispatchArguments((count + SORT_BLOCK - 1u) / SORT_BLOCK, 1u, 1u);
    pair_dispatches.pairs = DispatchArguments((count + PAIR_BLOCK - 1u) / PAIR_BLOCK, 1u, 1u);
    pair_dispatches.large = DispatchArguments(min(atomicLoad(&large_items.count), LARGE_ITEMS), 1u, 1u);
}

@compute @workgroup_size(LANES)
fn list_pairs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32) {
    let items = totals.listed * frame.view_count;
    let begin = window.first_pair;
    let end = begin + frame.pair_capacity;
    let per_view = frame.tiles.x * frame.tiles.y;
    for (var block = group.x; block * LANES < items; block += groups.x) {
        let item = block * LANES + lane;
        var count = 0u;
        var is_large = false;
        if item < items {
            let tiles = touched[item];
            count = tiles & ~IS_LARGE;
            is_large = tiles != count;
        }
        var place = touched_sums[block] + sum_up_to(lane, count) - count;
        if count > 0u && !is_large && place < end && place + count > begin {
            let splat = splat_of(item);
            let e = extent(splat);
            let view = item % frame.view_count;
            let base = view * per_view;
            for (var row = e.first_row; row < e.end_row; row++) {
                let span = columns(e, row);
                for (var column = span.x; column < span.y; column++) {
                    if frame.hides_tiles == 1u
                        && tiles_before(view, row, column) == tiles_before(view, row, column + 1u) {
                        continue;
                    }
                    if place >= begin && place < end {
                        pair_tiles[place - begin] = base + row * frame.tiles.x + column;
                        pair_splats[place - begin] = splat;
                    }
                    place++;
                }
            }
        }
        workgroupBarrier();
    }
}

// For each row of tiles of a large item: its first cell, its first column, and the place of its first pair.
var<workgroup> row_cells: array<u32, LANES>;
var<workgroup> row_columns: array<u32, LANES>;
var<workgroup> row_places: array<u32, LANES>;

// The pairs of the large items, with a workgroup for each: one lane alone would take as long as all others together. A lane finds the
// span of one row of tiles. Then all lanes share the cells of all rows.
@compute @workgroup_size(LANES)
fn list_large(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let item = large_items.items[group.x];
    let begin = window.first_pair;
    let end = begin + frame.pair_capacity;
    let view = item % frame.view_count;
    let base = view * frame.tiles.x * frame.tiles.y;
    let splat = splat_of(item);
    let e = extent(splat);
    let block = item / LANES;
    var count = 0u;
    if block * LANES + lane < item {
        count = touched[block * LANES + lane] & ~IS_LARGE;
    }
    sum_up_to(lane, count);
    var place = touched_sums[block] + scanned[LANES - 1u];
    workgroupBarrier();
    for (var first_row = e.first_row; first_row < e.end_row; first_row += LANES) {
        let own = first_row + lane;
        var span = vec2(0u);
        if own < e.end_row {
            span = columns(e, own);
        }
        let cells = span.y - span.x;
        var shown = cells;
        if frame.hides_tiles == 1u && cells > 0u {
            shown = tiles_before(view, own, span.y) - tiles_before(view, own, span.x);
        }
        row_cells[lane] = sum_up_to(lane, cells) - cells;
        let all_cells = scanned[LANES - 1u];
        workgroupBarrier();
        row_places[lane] = place + sum_up_to(lane, shown) - shown;
        place += scanned[LANES - 1u];
        row_columns[lane] = span.x;
        workgroupBarrier();
        for (var cell = lane; cell < all_cells; cell += LANES) {
            // The last row that begins at this cell or before it.
            var at = 0u;
            for (var step = LANES / 2u; step > 0u; step /= 2u) {
                if row_cells[at + step] <= cell {
                    at += step;
                }
            }
            let row = first_row + at;
            let column = row_columns[at] + cell - row_cells[at];
            var to = row_places[at] + cell - row_cells[at];
            var is_shown = true;
            if frame.hides_tiles == 1u {
                let before = tiles_before(view, row, column);
                is_shown = before < tiles_before(view, row, column + 1u);
                to = row_places[at] + before - tiles_before(view, row, row_columns[at]);
            }
            if is_shown && to >= begin && to < end {
                pair_tiles[to - begin] = base + row * frame.tiles.x + column;
                pair_splats[to - begin] = splat;
            }
        }
        workgroupBarrier();
    }
}

@compute @workgroup_size(LANES)
fn clear_lists(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.tiles.x * frame.tiles.y * frame.view_count {
        tile_lists[id.x] = TileList(0u, 0u);
    }
}

// The sorted pairs are bound in the place of the unsorted ones.
@compute @workgroup_size(LANES)
fn find_ends(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var at = lane; at < PAIR_BLOCK; at += LANES) {
        let i = group.x * PAIR_BLOCK + at;
        if i < totals.window_pairs {
            let tile = pair_tiles[i];
            if i == 0u || pair_tiles[i - 1u] != tile {
                tile_lists[tile].first = i;
            }
            if i + 1u == totals.window_pairs || pair_tiles[i + 1u] != tile {
                tile_lists[tile].end = i + 1u;
            }
        }
    }
}

var<workgroup> most: atomic<u32>;

// The longest list of any tile in any window so far.
@compute @workgroup_size(LANES)
fn longest(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&most, 0u);
    }
    workgroupBarrier();
    if id.x < frame.tiles.x * frame.tiles.y * frame.view_count {
        let list = tile_lists[id.x];
        atomicMax(&most, list.end - list.first);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicMax(&longest_list, atomicLoad(&most));
    }
}
