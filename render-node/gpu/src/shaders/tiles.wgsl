// Blends splats tile by tile: lists which splats touch which square tile in depth order, then blends each tile's list.
// TILE, the edge of one in pixels, stands before this text.
//
// Lists longer than the buffer holds are made and blended in windows of the depth order, front to back: what a pixel has
// collected so far is kept between them.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> ellipses: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read_write> totals: array<u32>;
// Tiles touched by each of the depth order's splats (all views of one before the next), and sums of 256 of them.
@group(0) @binding(5) var<storage, read_write> touched: array<u32>;
@group(0) @binding(6) var<storage, read_write> sums: array<u32>;
@group(0) @binding(7) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> pair_splats: array<u32>;
// Dispatches: the pairs' sort, the pairs' ends.
@group(0) @binding(9) var<storage, read_write> dispatches: array<u32>;
// First pair and end of each tile's list.
@group(0) @binding(10) var<storage, read_write> lists: array<vec2<u32>>;
// Composited colour and transmittance of each pixel, view after view.
@group(0) @binding(11) var<storage, read_write> pixels: array<vec4<f32>>;

@group(0) @binding(14) var<storage, read_write> longest_list: atomic<u32>;
@group(0) @binding(12) var<storage, read> levels: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> tints: array<vec4<f32>>;
// Depth of each pixel's front, 0 without one; written with DEPTHS.
@group(0) @binding(19) var<storage, read_write> fronts: array<f32>;

override DEPTHS: bool = false;

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
    e.center = a.xy;
    e.slope = a.z;
    if b.z < 0.0 {
        return e;
    }
    let reach = sqrt(b.z);
    e.along = reach / a.w;
    e.tall = reach / b.x;
    e.wide = length(vec2(e.along, e.slope * e.tall));
    e.tip = e.slope * e.tall * e.tall / e.wide;
    let rows = pixel_range(a.y - e.tall - MARGIN, a.y + e.tall + MARGIN, frame.size.y);
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

// Where the splat of an item lies in the list of splats; an item is a place in the depth order and a view.
fn splat_of(item: u32) -> u32 {
    return (item % frame.view_count) * frame.capacity + order[item / frame.view_count];
}

@compute @workgroup_size(256)
fn touch(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32) {
    let items = totals[0] * frame.view_count;
    for (var block = group.x; block * 256u < items; block += groups.x) {
        let item = block * 256u + lane;
        var tiles = 0u;
        if item < items {
            let e = extent(splat_of(item));
            for (var row = e.first_row; row < e.end_row; row++) {
                let span = columns(e, row);
                tiles += span.y - span.x;
            }
            touched[item] = tiles;
        }
        let through = sum_up_to(lane, tiles);
        if lane == 255u {
            sums[block] = through;
        }
        workgroupBarrier();
    }
}

@compute @workgroup_size(256)
fn sum_touched(@builtin(local_invocation_index) lane: u32) {
    let n = (totals[0] * frame.view_count + 255u) / 256u;
    let each = (n + 255u) / 256u;
    let first = lane * each;
    let last = min(first + each, n);
    var sum = 0u;
    for (var k = first; k < last; k++) {
        sum += sums[k];
    }
    var running = sum_up_to(lane, sum) - sum;
    for (var k = first; k < last; k++) {
        let count = sums[k];
        sums[k] = running;
        running += count;
    }
    if lane == 255u {
        totals[3] = scanned[255];
    }
}

// How many pairs the window holds, and the work that makes.
@compute @workgroup_size(1)
fn open_window() {
    if part.index == 0u {
        atomicStore(&longest_list, 0u);
    }
    let all = totals[3];
    let count = min(all - min(all, part.first), frame.pair_capacity);
    totals[2] = count;
    dispatches[0] = (count + 4095u) / 4096u;
    dispatches[1] = 1u;
    dispatches[2] = 1u;
    dispatches[3] = (count + 1023u) / 1024u;
    dispatches[4] = 1u;
    dispatches[5] = 1u;
}

@compute @workgroup_size(256)
fn list_pairs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32) {
    let items = totals[0] * frame.view_count;
    let begin = part.first;
    let end = begin + frame.pair_capacity;
    let per_view = frame.tiles.x * frame.tiles.y;
    for (var block = group.x; block * 256u < items; block += groups.x) {
        let item = block * 256u + lane;
        var count = 0u;
        if item < items {
            count = touched[item];
        }
        var place = sums[block] + sum_up_to(lane, count) - count;
        if count > 0u && place < end && place + count > begin {
            let splat = splat_of(item);
            let e = extent(splat);
            let base = (item % frame.view_count) * per_view;
            for (var row = e.first_row; row < e.end_row; row++) {
                let span = columns(e, row);
                for (var column = span.x; column < span.y; column++) {
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

@compute @workgroup_size(256)
fn clear_lists(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.tiles.x * frame.tiles.y * frame.view_count {
        lists[id.x] = vec2(0u);
    }
}

// The sorted pairs are bound in the place of the unsorted ones.
@compute @workgroup_size(256)
fn find_ends(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var k = 0u; k < 4u; k++) {
        let i = group.x * 1024u + k * 256u + lane;
        if i < totals[2] {
            let tile = pair_tiles[i];
            if i == 0u || pair_tiles[i - 1u] != tile {
                lists[tile].x = i;
            }
            if i + 1u == totals[2] || pair_tiles[i + 1u] != tile {
                lists[tile].y = i + 1u;
            }
        }
    }
}

var<workgroup> most: atomic<u32>;

// The longest list of any tile in any window so far.
@compute @workgroup_size(256)
fn longest(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&most, 0u);
    }
    workgroupBarrier();
    if id.x < frame.tiles.x * frame.tiles.y * frame.view_count {
        let list = lists[id.x];
        atomicMax(&most, list.y - list.x);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicMax(&longest_list, atomicLoad(&most));
    }
}

// Splats of one tile that one dispatch blends. A software device silently leaves a loop after 65,535 iterations.
const STRETCH: u32 = 32768u;

// Every pixel walks its tile's list on its own. The lanes of a tile read the same splat at the same time: a
// graphics card serves it from the nearest cache. A software device needs no barriers of 256 lanes.
@compute @workgroup_size(TILE, TILE)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let tile = (group.z * frame.tiles.y + group.y) * frame.tiles.x + group.x;
    let at = vec2(group.x * TILE + local.x, group.y * TILE + local.y);
    if any(at >= frame.size) {
        return;
    }
    let pixel = (group.z * frame.size.y + at.y) * frame.size.x + at.x;
    let center = vec2<f32>(at) + 0.5;
    var color = vec3(0.0);
    var transmittance = 1.0;
    var front = 0.0;
    if part.index > 0u {
        color = pixels[pixel].xyz;
        transmittance = pixels[pixel].w;
    }
    let list = lists[tile];
    let first = list.x + part.block;
    let last = min(list.y, first + STRETCH);
    let stop = frame.limits.z;
    for (var k = first; k < last; k++) {
        if transmittance < stop {
            break;
        }
        let splat = pair_splats[k];
        let e = ellipses[splat];
        let l = levels[splat];
        let d = center - e.xy;
        let u = (d.x - e.z * d.y) * e.w;
        let v = d.y * l.x;
        let below = u * u + v * v;
        if below <= l.z {
            let weight = min(exp2(l.y - below), 1.0) * transmittance;
            color += weight * tints[splat].xyz;
            if surfaces(transmittance, transmittance - weight) {
                front = l.w;
            }
            transmittance -= weight;
        }
    }
    pixels[pixel] = vec4(color, transmittance);
    if DEPTHS && (front > 0.0 || part.index == 0u) {
        fronts[pixel] = front;
    }
}
