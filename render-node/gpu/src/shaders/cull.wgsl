// Marks Gaussians that may reach the picture: a bit for each, counted by block of 1024.
//
// The order of the list is the order of the scene, so that Gaussians of equal depth keep their order in every picture. No
// workgroup waits for another: block counts are written by one pass and summed by the next.

override CLIPS: bool = false;
override PER_RAY: bool = false;

const BLOCK: u32 = 1024u;
const WORDS: u32 = 32u;

@group(0) @binding(7) var<storage, read> sides: array<Side>;
@group(0) @binding(8) var<storage, read_write> bits: array<u32>;
@group(0) @binding(9) var<storage, read_write> blocks: array<u32>;

fn hidden(global: u32) -> bool {
    for (var k = 0u; k < frame.edits; k++) {
        if edits[k].kind.y == 0u && in_mask(k, global) {
            return true;
        }
    }
    return false;
}

fn clipped(at: vec3<f32>) -> bool {
    var inside = true;
    for (var k = 0u; k < frame.clips; k++) {
        let side = sides[k];
        inside = inside && dot(side.plane.xyz, at) >= side.plane.w;
        if side.kind.z == 1u {
            if inside != (side.kind.y == 1u) {
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
    let dilated = 0.5478 * length(c) * inverseSqrt(abs(view.lens.x * view.lens.y));
    let reached = 1.001 * (half / max(most, 1e-30) + sqrt(2.0 * log(max(1.0 / frame.limits.x, frame.limits.y))) * dilated);
    let edge = vec2<f32>(frame.size) - view.lens.zw;
    let outside = vec4(
        -(view.lens.x * c.x + view.lens.z * c.z) / length(view.lens.xz),
        (view.lens.x * c.x - edge.x * c.z) / length(vec2(view.lens.x, edge.x)),
        -(view.lens.y * c.y + view.lens.w * c.z) / length(view.lens.yw),
        (view.lens.y * c.y - edge.y * c.z) / length(vec2(view.lens.y, edge.y)),
    );
    return !(max(max(outside.x, outside.y), max(outside.z, outside.w)) > reached);
}

fn may_reach(i: u32) -> bool {
    let center = centers[i];
    let shape = shapes[2u * i + 1u];
    let unit = bitcast<u32>(shape.w);
    let opacity = min(center.w * units[unit].palette.w, 1.0);
    if opacity <= 0.0 || units[unit].kind.z == 0u {
        return false;
    }
    if MASKS && hidden(part.first + i) {
        return false;
    }
    if CLIPS && clipped(center.xyz) {
        return false;
    }
    let size = max(max(shape.x, shape.y), shape.z) * units[unit].x.w;
    // Edits may raise the opacity to 1 at most.
    let radius = sqrt(2.0 * log(max(1.0 / frame.limits.x, frame.limits.y)));
    for (var v = 0u; v < frame.view_count; v++) {
        let view = frame.views[v];
        let from_eye = away_from_eye(view, center.xyz);
        let at = vec3(dot(view.right.xyz, from_eye), dot(view.down.xyz, from_eye), dot(view.forward.xyz, from_eye));
        if PER_RAY {
            if may_meet_rays(view, at, radius * size) {
                return true;
            }
            continue;
        }
        if at.z <= frame.limits.w {
            continue;
        }
        let slope = at.xy / at.z;
        // |J·M| is at most this times the greatest standard deviation; the dilation adds at most its root.
        let stretch = view.lens.xy / at.z * sqrt(1.0 + slope * slope);
        let half = radius * (stretch * size + 0.55) + 0.5;
        let pixel = view.lens.xy * slope + view.lens.zw;
        // The comparison keeps NaN: the projection classifies it.
        if !(any(pixel + half < vec2(0.0)) || any(pixel - half > vec2<f32>(frame.size))) {
            return true;
        }
    }
    return false;
}

var<workgroup> words: array<atomic<u32>, WORDS>;

@compute @workgroup_size(256)
fn mark(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane < WORDS {
        atomicStore(&words[lane], 0u);
    }
    workgroupBarrier();
    for (var k = 0u; k < 4u; k++) {
        let at = k * 256u + lane;
        let i = group.x * BLOCK + at;
        if i < part.count && may_reach(i) {
            atomicOr(&words[at >> 5u], 1u << (at & 31u));
        }
    }
    workgroupBarrier();
    let block = part.block + group.x;
    if lane < WORDS {
        bits[block * WORDS + lane] = atomicLoad(&words[lane]);
    }
    if lane == 0u {
        var sum = 0u;
        for (var k = 0u; k < WORDS; k++) {
            sum += countOneBits(atomicLoad(&words[k]));
        }
        blocks[block] = sum;
    }
}
