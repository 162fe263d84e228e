// Blends splats tile by tile: lists which splats touch which square tile in depth order, then blends each tile's list.
// TILE, the edge of one in pixels, and PictureStore, a picture that can be written, stand before this text.
//
// Lists longer than the buffer holds are made and blended in windows of the depth order, front to back: what a pixel has
// collected so far is kept between them. The last dispatch writes the pictures. Follows over.wgsl.

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

override DEPTHS: bool = false;
// Whether a later dispatch continues with the pixels.
override CONTINUED: bool = false;

fn store_pixel(view: u32, at: vec2<u32>, pixel: u32, color: vec3<f32>, transmittance: f32) {
    if CONTINUED {
        pixels[pixel] = vec4(color, transmittance);
    } else if view == 0u {
        textureStore(first_picture, at, over(color, transmittance));
    } else {
        textureStore(second_picture, at, over(color, transmittance));
    }
}

fn store_front(view: u32, at: vec2<u32>, front: f32) {
    if DEPTHS && (front > 0.0 || stretch.index == 0u) {
        if view == 0u {
            textureStore(first_depths, at, vec4(front));
        } else {
            textureStore(second_depths, at, vec4(front));
        }
    }
}

// Whether a layer brings the opacity of all so far to that of a surface.
fn surfaces(before: f32, after: f32) -> bool {
    return DEPTHS && 1.0 - before < SURFACE && 1.0 - after >= SURFACE;
}

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
    let n = (totals.listed * frame.view_count + LANES - 1u) / LANES;
    let each = (n + LANES - 1u) / LANES;
    let first = lane * each;
    let last = min(first + each, n);
    var sum = 0u;
    for (var k = first; k < last; k++) {
        sum += touched_sums[k];
    }
    var running = sum_up_to(lane, sum) - sum;
    for (var k = first; k < last; k++) {
        let count = touched_sums[k];
        touched_sums[k] = running;
        running += count;
    }
    if lane == LANES - 1u {
        totals.pairs = scanned[LANES - 1u];
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
        if item < items {
            count = touched[item];
        }
        var place = touched_sums[block] + sum_up_to(lane, count) - count;
        if count > 0u && place < end && place + count > begin {
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

// Edge of the squares of pixels that one evaluation of a tile serves: the twin of Periphery::has in foveation.rs.
fn block_edge(group: vec3<u32>) -> u32 {
    let first = vec2<f32>(group.xy * TILE);
    let view = frame.views[group.z];
    let slope = (clamp(view.principal, first, first + f32(TILE)) - view.principal) / view.focal;
    return select(1u, FOVEAL_BLOCK, dot(slope, slope) >= frame.foveal_squared_slope);
}

// Stores one colour for all pixels of a block. Between two dispatches its first pixel stands for it.
fn store_block(view: u32, at: vec2<u32>, edge: u32, color: vec3<f32>, transmittance: f32, front: f32) {
    let pixel = (view * frame.size.y + at.y) * frame.size.x + at.x;
    for (var k = 0u; k < edge * edge; k++) {
        let to = at + vec2(k % edge, k / edge);
        if all(to < frame.size) {
            store_pixel(view, to, pixel, color, transmittance);
            store_front(view, to, front);
        }
    }
}

// Every pixel or block walks its tile's list on its own. The lanes of a tile read the same splat at the same time: a
// graphics card serves it from the nearest cache. A software device needs no barriers of 256 lanes.
@compute @workgroup_size(TILE, TILE)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let tile = (group.z * frame.tiles.y + group.y) * frame.tiles.x + group.x;
    let edge = block_edge(group);
    // The first lanes take the blocks, so that groups of lanes in step have all or none of them.
    let across = TILE / edge;
    if lane >= across * across {
        return;
    }
    let at = group.xy * TILE + edge * vec2(lane % across, lane / across);
    if any(at >= frame.size) {
        return;
    }
    let pixel = (group.z * frame.size.y + at.y) * frame.size.x + at.x;
    let center = vec2<f32>(at) + 0.5 * f32(edge);
    var color = vec3(0.0);
    var transmittance = 1.0;
    var front = 0.0;
    if stretch.index > 0u {
        color = pixels[pixel].xyz;
        transmittance = pixels[pixel].w;
    }
    let list = tile_lists[tile];
    let first = list.first + stretch.first_item;
    let last = min(list.end, first + STRETCH);
    let stop = frame.least_transmittance;
    for (var k = first; k < last; k++) {
        if transmittance < stop {
            break;
        }
        let splat = pair_splats[k];
        let e = ellipses[splat];
        let l = levels[splat];
        let d = center - e.center;
        let tint = tints[splat];
        var meeting: Meeting;
        if tint.over_per_row > 0.0 {
            let told_at = clamp(e.center, vec2(0.0), vec2<f32>(frame.size));
            let direction = (center - frame.views[group.z].principal) / frame.views[group.z].focal;
            meeting = meet_ray(near_rays.entries[u32(tint.over_per_row) - 1u], center - told_at, direction, frame.near);
        } else {
            let v = d.y * l.per_row;
            if edge == 1u {
                let u = (d.x - e.slope * d.y) * e.per_column;
                meeting = Meeting(u * u + v * v, l.depth, 1.0);
            } else {
                // The mean of a block's pixels widens an ellipse: see in_blocks() in foveation.rs.
                let tall = 1.0 / (1.0 + FOVEAL_VARIANCE * l.per_row * l.per_row);
                let slope = e.slope * tall;
                let u = (d.x - slope * d.y) * e.per_column;
                let wide = 1.0 / (1.0 + FOVEAL_VARIANCE * e.per_column * e.per_column * (1.0 + e.slope * slope));
                meeting = Meeting(u * u * wide + v * v * tall, l.depth, sqrt(wide * tall));
            }
        }
        if meeting.below <= l.range {
            let weight = min(exp2(l.log_opacity - meeting.below) * meeting.share, 1.0) * transmittance;
            color += weight * tint.color;
            if surfaces(transmittance, transmittance - weight) {
                // A center behind the eye has no depth; the ray has.
                front = max(select(meeting.depth, l.depth, l.depth > 0.0), frame.near_plane);
            }
            transmittance -= weight;
        }
    }
    store_block(group.z, at, edge, color, transmittance, front);
}
