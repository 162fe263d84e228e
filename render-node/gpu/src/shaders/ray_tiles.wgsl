// Blends splats ray by ray. Each tile lists its splats in the order of the ray that meets each best within the
// tile. Each ray sorts its layers again. Follows tiles.wgsl, blend_tiles.wgsl and the text of sort_window.rs.

// Ray coefficients of the splats.
@group(0) @binding(17) var<storage, read> rays: array<RayCoefficients>;
// For each pair: depth in its tile, and place in the unsorted list. Depths are not negative, so that their bits
// have the same order.
@group(0) @binding(18) var<storage, read_write> pair_depths: array<u32>;
@group(0) @binding(19) var<storage, read_write> pair_places: array<u32>;
// The list in the order of depths.
@group(0) @binding(20) var<storage, read_write> ordered_tiles: array<u32>;
@group(0) @binding(21) var<storage, read_write> ordered_splats: array<u32>;

// The point where the ray through a pixel meets a splat.
fn meet(at: vec2<f32>, splat: u32) -> Meeting {
    let d = at - clamp(ellipses[splat].center, vec2(0.0), vec2<f32>(frame.size));
    let ray = rays[splat];
    let over = vec2(levels[splat].depth, tints[splat].over_per_row);
    let view = splat / frame.capacity;
    let direction = (at - frame.views[view].principal) / frame.views[view].focal;
    var meeting = meet_ray(NearRay(ray.along, ray.fall, ray.across, ray.depth_factor, over), d, direction, frame.near);
    meeting.depth = min(meeting.depth, 0.999 * EMPTY_DEPTH);
    return meeting;
}

// The depth of each listed pair, on the ray through its tile that meets the splat best.
@compute @workgroup_size(LANES)
fn measure_rays(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var at = lane; at < PAIR_BLOCK; at += LANES) {
        let i = group.x * PAIR_BLOCK + at;
        if i < totals.window_pairs {
            let splat = pair_splats[i];
            let ellipse = ellipses[splat];
            let tile = pair_tiles[i] % (frame.tiles.x * frame.tiles.y);
            let first = vec2<f32>(vec2(tile % frame.tiles.x, tile / frame.tiles.x) * TILE) + 0.5;
            let best = clamp(ellipse.center, first, first + f32(TILE - 1u));
            pair_depths[i] = bitcast<u32>(max(meet(best, splat).depth, 0.0));
            pair_places[i] = i;
        }
    }
}

@compute @workgroup_size(LANES)
fn order_rays(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    for (var at = lane; at < PAIR_BLOCK; at += LANES) {
        let i = group.x * PAIR_BLOCK + at;
        if i < totals.window_pairs {
            let unsorted = pair_places[i];
            ordered_tiles[i] = pair_tiles[unsorted];
            ordered_splats[i] = pair_splats[unsorted];
        }
    }
}

// Limit of the loop iterations of one ray. A software device silently leaves a loop after 65,535 iterations.
const ROUNDS: u32 = 60000u;

// The layer of a pair on a ray; opacity 0 if it is not drawn.
fn layer_of(k: u32, center: vec2<f32>) -> Layer {
    let splat = pair_splats[k];
    let l = levels[splat];
    let meeting = meet(center, splat);
    if meeting.below <= l.range {
        return Layer(meeting.depth, min(exp2(l.log_opacity - meeting.below) * meeting.share, 1.0), k);
    }
    return Layer(meeting.depth, 0.0, k);
}

// Blends a layer behind all layers so far.
fn blend_layer(ray: ptr<function, Blended>, layer: Layer) {
    if layer.alpha > 0.0 {
        let weight = layer.alpha * (*ray).transmittance;
        (*ray).color += weight * tints[pair_splats[layer.item]].color;
        if surfaces((*ray).transmittance, (*ray).transmittance - weight) {
            (*ray).front = max(layer.depth, frame.near_plane);
        }
        (*ray).transmittance -= weight;
    }
}

// Blends the layers [first, last) of a list in the order of the ray. Each pass over the whole list takes the next
// layers, as many as fit.
fn blend_in_order(ray: ptr<function, Blended>, first: u32, last: u32, center: vec2<f32>) {
    let stop = frame.least_transmittance;
    var rounds = 2u * (last - first);
    var done = Layer(-1.0, 0.0, 0u);
    var more = true;
    while more && (*ray).transmittance >= stop && rounds + 2u * (last - first) < ROUNDS {
        var next = nobody();
        for (var k = first; k < last; k++) {
            let layer = layer_of(k, center);
            if layer.alpha > 0.0 && comes_behind(layer, done) {
                keep_nearest(&next, layer);
            }
        }
        pour(ray, &next);
        done = deepest(&next);
        more = done.depth < EMPTY_DEPTH;
        rounds += last - first + 1u;
    }
    if more && (*ray).transmittance >= stop {
        // The list is too long for another pass: blend the rest in the order of the tile.
        for (var k = first; k < last; k++) {
            let layer = layer_of(k, center);
            if comes_behind(layer, done) {
                blend_layer(ray, layer);
            }
        }
    }
}

fn comes_behind(layer: Layer, other: Layer) -> bool {
    return layer.depth > other.depth || (layer.depth == other.depth && layer.item > other.item);
}

@compute @workgroup_size(TILE, TILE)
fn blend_rays(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let at = vec2(group.x * TILE + local.x, group.y * TILE + local.y);
    if any(at >= frame.size) {
        return;
    }
    let pixel = pixel_of(group.z, at);
    let center = vec2<f32>(at) + 0.5;
    var ray = continued(pixel);
    let before = ray;
    let part = part_of_list(group);
    let stop = frame.least_transmittance;
    var waiting = nobody_before();
    // Transmittance of all layers so far, including the sort window.
    var through = ray.transmittance;
    // Greatest blended depth, and the opacity that came too late for its place before it.
    var gone = -1.0;
    var late = 0.0;
    for (var k = part.x; k < part.y; k++) {
        if ray.transmittance < stop || late > LATE {
            break;
        }
        let layer = layer_of(k, center);
        // Behind the whole window an invisible layer would only displace a nearer one.
        if layer.alpha > 0.0 && (through >= stop || layer.depth < deepest(&waiting).depth) {
            through *= 1.0 - layer.alpha;
            late += select(0.0, layer.alpha, layer.depth < gone);
            // The nearest layer leaves the window; at first the slots are empty.
            let nearest = wait_with(&waiting, layer);
            blend_layer(&ray, nearest);
            gone = max(gone, nearest.depth);
        }
    }
    if late > LATE {
        ray = before;
        blend_in_order(&ray, part.x, part.y, center);
    } else {
        pour(&ray, &waiting);
    }
    store_pixel(group.z, at, pixel, ray.color, ray.transmittance);
    store_front(group.z, at, ray.front);
}
