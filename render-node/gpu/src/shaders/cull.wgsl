// Marks Gaussians that may reach the picture: a bit for each, counted by block.
//
// The order of the list is the order of the scene, so that Gaussians of equal depth keep their order in every picture. No
// workgroup waits for another: block counts are written by one pass and summed by the next.

override PER_RAY: bool = false;

@group(0) @binding(8) var<storage, read_write> marked: array<u32>;
@group(0) @binding(9) var<storage, read_write> block_counts: array<u32>;

fn hidden(global: u32) -> bool {
    for (var k = 0u; k < frame.edit_count; k++) {
        if edits[k].visible == 0u && in_mask(k, global) {
            return true;
        }
    }
    return false;
}

// Whether the clips leave nothing of a ball. The outside of a region is kept where one of its sides is near.
fn clipped(at: vec3<f32>, radius: f32) -> bool {
    var inside = true;
    for (var k = 0u; k < frame.clip_side_count; k++) {
        let side = clip_sides[k];
        let keeps_inside = side.keep_inside == 1u;
        inside = inside && dot(side.normal, at) >= side.offset + select(radius, -radius, keeps_inside);
        if side.last == 1u {
            if inside != keeps_inside {
                return true;
            }
            inside = true;
        }
    }
    return false;
}

// Whether a ball around the level, with the dilation, lies on the inner side of one of the planes through the eye and the
// picture's edges, or across it. Asked so that what is not a number stays.
fn may_meet_rays(view: View, at: vec3<f32>, half: f32) -> bool {
    let most = max(max(abs(at.x), abs(at.y)), abs(at.z));
    let c = at / max(most, 1e-30);
    let dilated = 0.5478 * length(c) * inverseSqrt(abs(view.focal.x * view.focal.y));
    let reached = 1.001 * (half / max(most, 1e-30) + sqrt(2.0 * log(max(1.0 / frame.least_alpha, frame.alpha_ratio))) * dilated);
    let edge = vec2<f32>(frame.size) - view.principal;
    let outside = vec4(
        -(view.focal.x * c.x + view.principal.x * c.z) / length(vec2(view.focal.x, view.principal.x)),
        (view.focal.x * c.x - edge.x * c.z) / length(vec2(view.focal.x, edge.x)),
        -(view.focal.y * c.y + view.principal.y * c.z) / length(vec2(view.focal.y, view.principal.y)),
        (view.focal.y * c.y - edge.y * c.z) / length(vec2(view.focal.y, edge.y)),
    );
    return !(max(max(outside.x, outside.y), max(outside.z, outside.w)) > reached);
}

fn may_reach(i: u32) -> bool {
    let center = centers[i];
    let shape = shapes[i];
    let unit = shape.unit;
    let opacity = min(center.opacity * units[unit].opacity, 1.0);
    if opacity <= 0.0 || units[unit].visible == 0u {
        return false;
    }
    if MASKS && hidden(part.first + i) {
        return false;
    }
    let size = max(max(shape.scale.x, shape.scale.y), shape.scale.z) * units[unit].stretch;
    if CLIPS && clipped(center.position, CUT_REACH * size) {
        return false;
    }
    // Edits may raise the opacity to 1 at most.
    let radius = sqrt(2.0 * log(max(1.0 / frame.least_alpha, frame.alpha_ratio)));
    for (var v = 0u; v < frame.view_count; v++) {
        let view = frame.views[v];
        let from_eye = away_from_eye(view, center.position);
        let at = vec3(dot(view.right, from_eye), dot(view.down, from_eye), dot(view.forward, from_eye));
        if PER_RAY {
            if may_meet_rays(view, at, radius * size) {
                return true;
            }
            continue;
        }
        // At least its size, the root of the covariance's trace.
        let most = 1.7320509 * size;
        if may_fade(length(at), most, frame.near) || !(most < AFFINE_SIZE * at.z) {
            if may_meet_rays(view, at, radius * size) {
                return true;
            }
            // What rays do not meet may still be an ellipse.
            if most >= AFFINE_SIZE * at.z {
                continue;
            }
        }
        if at.z <= frame.near_plane {
            continue;
        }
        let slope = at.xy / at.z;
        // |J·M| is at most this times the greatest standard deviation; the dilation adds at most its root, larger beside the axis.
        let stretch = view.focal / at.z * sqrt(1.0 + slope * slope);
        let s = dilation_slope(view, slope, vec2<f32>(frame.size), ray_share(length(at), frame.near));
        let half = radius * (stretch * size + 0.55 * (1.0 + dot(s, s))) + 0.5;
        let pixel = view.focal * slope + view.principal;
        // The comparison keeps NaN: the projection classifies it.
        if !(any(pixel + half < vec2(0.0)) || any(pixel - half > vec2<f32>(frame.size))) {
            return true;
        }
    }
    return false;
}

var<workgroup> words: array<atomic<u32>, MARK_WORDS>;

@compute @workgroup_size(LANES)
fn mark(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane < MARK_WORDS {
        atomicStore(&words[lane], 0u);
    }
    workgroupBarrier();
    for (var at = lane; at < BLOCK; at += LANES) {
        let i = group.x * BLOCK + at;
        if i < part.count && may_reach(i) {
            atomicOr(&words[at >> 5u], 1u << (at & 31u));
        }
    }
    workgroupBarrier();
    let block = part.first_block + group.x;
    if lane < MARK_WORDS {
        marked[block * MARK_WORDS + lane] = atomicLoad(&words[lane]);
    }
    if lane == 0u {
        var sum = 0u;
        for (var k = 0u; k < MARK_WORDS; k++) {
            sum += countOneBits(atomicLoad(&words[k]));
        }
        block_counts[block] = sum;
    }
}
