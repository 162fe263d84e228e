// Blends each tile's list, front to back. Follows tiles.wgsl, which has the variables, and over.wgsl. PictureStore, a picture that can be
// written, stands before both.
//
// What a pixel has collected is kept between two dispatches, and the last one writes the pictures.

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

// Edge of the squares of pixels that one evaluation of a tile serves: the twin of Periphery::has in foveation.rs.
fn block_edge(group: vec3<u32>) -> u32 {
    let first = vec2<f32>(group.xy * TILE);
    let view = frame.views[group.z];
    let slope = (clamp(view.principal, first, first + f32(TILE)) - view.principal) / view.focal;
    return select(1u, FOVEAL_BLOCK, dot(slope, slope) >= frame.foveal_squared_slope);
}

// What a pixel or a block has collected so far.
struct Blended {
    color: vec3<f32>,
    transmittance: f32,
    front: f32,
}

// The pixel or block of a lane.
struct Place {
    at: vec2<u32>,
    edge: u32,
    // Whether the lane has one.
    is_used: bool,
}

// The first lanes take the blocks, so that groups of lanes in step have all or none of them.
fn place_of(group: vec3<u32>, lane: u32) -> Place {
    let edge = block_edge(group);
    let across = TILE / edge;
    let at = group.xy * TILE + edge * vec2(lane % across, lane / across);
    return Place(at, edge, lane < across * across && all(at < frame.size));
}

fn middle_of(place: Place) -> vec2<f32> {
    return vec2<f32>(place.at) + 0.5 * f32(place.edge);
}

// Where a pixel of a view lies in `pixels`.
fn pixel_of(view: u32, at: vec2<u32>) -> u32 {
    return (view * frame.size.y + at.y) * frame.size.x + at.x;
}

// The part of a tile's list that this dispatch blends: its first pair and its end.
fn part_of_list(group: vec3<u32>) -> vec2<u32> {
    let list = tile_lists[(group.z * frame.tiles.y + group.y) * frame.tiles.x + group.x];
    let first = list.first + stretch.first_item;
    return vec2(first, max(min(list.end, first + STRETCH), first));
}

// Stores one colour for all pixels of a block. Between two dispatches its first pixel stands for it.
fn store_block(view: u32, place: Place, blended: Blended) {
    let pixel = pixel_of(view, place.at);
    for (var k = 0u; k < place.edge * place.edge; k++) {
        let to = place.at + vec2(k % place.edge, k / place.edge);
        if all(to < frame.size) {
            store_pixel(view, to, pixel, blended.color, blended.transmittance);
            store_front(view, to, blended.front);
        }
    }
}

// Blends a splat behind all before it, at the middle of a pixel or block.
fn blend_splat(to: ptr<function, Blended>, e: Ellipse, l: Level, tint: Tint, center: vec2<f32>, edge: u32, view: u32) {
    let d = center - e.center;
    var meeting: Meeting;
    if tint.over_per_row > 0.0 {
        let told_at = clamp(e.center, vec2(0.0), vec2<f32>(frame.size));
        let direction = (center - frame.views[view].principal) / frame.views[view].focal;
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
        let before = (*to).transmittance;
        let weight = min(exp2(l.log_opacity - meeting.below) * meeting.share, 1.0) * before;
        (*to).color += weight * tint.color;
        if surfaces(before, before - weight) {
            // A center behind the eye has no depth; the ray has.
            (*to).front = max(select(meeting.depth, l.depth, l.depth > 0.0), frame.near_plane);
        }
        (*to).transmittance = before - weight;
    }
}

// What the dispatches before this one have collected.
fn continued(pixel: u32) -> Blended {
    if stretch.index > 0u {
        return Blended(pixels[pixel].xyz, pixels[pixel].w, 0.0);
    }
    return Blended(vec3(0.0), 1.0, 0.0);
}

// Every pixel or block walks its tile's list on its own, for software devices: barriers of 256 lanes cost them more than reading
// each splat again.
@compute @workgroup_size(TILE, TILE)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = place_of(group, lane);
    if !place.is_used {
        return;
    }
    let center = middle_of(place);
    var blended = continued(pixel_of(group.z, place.at));
    let part = part_of_list(group);
    let stop = frame.least_transmittance;
    for (var k = part.x; k < part.y; k++) {
        if blended.transmittance < stop {
            break;
        }
        let splat = pair_splats[k];
        blend_splat(&blended, ellipses[splat], levels[splat], tints[splat], center, place.edge, group.z);
    }
    store_block(group.z, place, blended);
}

// Splats of a tile's list that its lanes keep in workgroup memory at a time, one each.
const STAGED: u32 = TILE * TILE;

var<workgroup> staged_ellipses: array<Ellipse, STAGED>;
var<workgroup> staged_levels: array<Level, STAGED>;
var<workgroup> staged_tints: array<Tint, STAGED>;
// Lanes that need no further splats.
var<workgroup> finished: atomic<u32>;

// The twin of `blend` for graphics cards. All lanes of a tile copy the next splats of its list to workgroup memory, and each pixel or
// block reads them there.
@compute @workgroup_size(TILE, TILE)
fn blend_staged(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = place_of(group, lane);
    let center = middle_of(place);
    var blended = Blended(vec3(0.0), 1.0, 0.0);
    if place.is_used {
        blended = continued(pixel_of(group.z, place.at));
    }
    let part = part_of_list(group);
    let stop = frame.least_transmittance;
    if lane == 0u {
        atomicStore(&finished, 0u);
    }
    workgroupBarrier();
    var is_open = place.is_used && blended.transmittance >= stop;
    if !is_open {
        atomicAdd(&finished, 1u);
    }
    for (var begin = part.x; begin < part.y; begin += STAGED) {
        workgroupBarrier();
        if atomicLoad(&finished) == STAGED {
            break;
        }
        let count = min(STAGED, part.y - begin);
        if lane < count {
            let splat = pair_splats[begin + lane];
            staged_ellipses[lane] = ellipses[splat];
            staged_levels[lane] = levels[splat];
            staged_tints[lane] = tints[splat];
        }
        workgroupBarrier();
        if is_open {
            for (var k = 0u; k < count; k++) {
                blend_splat(&blended, staged_ellipses[k], staged_levels[k], staged_tints[k], center, place.edge, group.z);
                if blended.transmittance < stop {
                    is_open = false;
                    atomicAdd(&finished, 1u);
                    break;
                }
            }
        }
    }
    if place.is_used {
        store_block(group.z, place, blended);
    }
}
