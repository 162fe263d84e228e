// Projects and shades each listed Gaussian: the f32 twin of project.rs and shading.rs.
//
// A splat is three vectors in three buffers, which raises the limit of a binding threefold. Ellipse: center x, y,
// slope, per column. Level: per row, log2 of the opacity, log2 of the opacity over the cut (below 0: not drawn),
// depth. Tint: color, and 0. See splat_f32.rs for the form. With PER_RAY the tint is three vectors of ray
// coefficients: see ray_project.wgsl.

override LIT: bool = false;
override DEGREE: i32 = -1;
override HIGHLIGHTS: bool = true;
override TERM: u32 = 0u;
override DIRECTIONAL: bool = false;
override OVERLAY: bool = false;
override COLORS: bool = false;
// Half precision of the shading columns and the harmonics.
override HALF: bool = false;
override PER_RAY: bool = false;

@group(0) @binding(7) var<storage, read> surfaces: array<u32>;
@group(0) @binding(8) var<storage, read> harmonics: array<u32>;
@group(0) @binding(9) var<storage, read> colors: array<u32>;
@group(0) @binding(10) var<storage, read> stretches: array<vec2<u32>>;
@group(0) @binding(11) var<storage, read> listed: array<u32>;
@group(0) @binding(12) var<storage, read_write> ellipses: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> levels: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> tints: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> keys: array<u32>;
@group(0) @binding(16) var<storage, read_write> order: array<u32>;

// sqrt(log2(e) / 2)
const SCALE: f32 = 0.84932180028801904;

struct Surface {
    offset: vec3<f32>,
    normal: vec3<f32>,
    // ka, kd, ks, exponent.
    factors: vec4<f32>,
}

fn surface(i: u32) -> Surface {
    if HALF {
        let at = 5u * i;
        let a = unpack2x16float(surfaces[at]);
        let b = unpack2x16float(surfaces[at + 1u]);
        let c = unpack2x16float(surfaces[at + 2u]);
        let d = unpack2x16float(surfaces[at + 3u]);
        let e = unpack2x16float(surfaces[at + 4u]);
        return Surface(vec3(a, b.x), vec3(b.y, c), vec4(d, e));
    }
    let at = 10u * i;
    var x: array<f32, 10>;
    for (var k = 0u; k < 10u; k++) {
        x[k] = bitcast<f32>(surfaces[at + k]);
    }
    return Surface(vec3(x[0], x[1], x[2]), vec3(x[3], x[4], x[5]), vec4(x[6], x[7], x[8], x[9]));
}

// Coefficient k of Gaussian i, of n coefficients a Gaussian.
fn coefficient(i: u32, k: u32, n: u32) -> vec3<f32> {
    let at = 3u * (i * n + k);
    if HALF {
        let word = at >> 1u;
        let first = unpack2x16float(harmonics[word]);
        let second = unpack2x16float(harmonics[word + 1u]);
        if (at & 1u) == 0u {
            return vec3(first, second.x);
        }
        return vec3(first.y, second);
    }
    return vec3(bitcast<f32>(harmonics[at]), bitcast<f32>(harmonics[at + 1u]), bitcast<f32>(harmonics[at + 2u]));
}

fn seen(i: u32, d: vec3<f32>) -> vec3<f32> {
    let n = u32((DEGREE + 1) * (DEGREE + 1));
    var sum = vec3(0.5) + 0.28209479177387814 * coefficient(i, 0u, n);
    if DEGREE > 0 {
        sum += 0.48860251190291992 * (d.z * coefficient(i, 2u, n) - d.y * coefficient(i, 1u, n) - d.x * coefficient(i, 3u, n));
    }
    if DEGREE > 1 {
        let s = d * d;
        sum += 1.0925484305920792 * d.x * d.y * coefficient(i, 4u, n);
        sum += -1.0925484305920792 * d.y * d.z * coefficient(i, 5u, n);
        sum += 0.31539156525252005 * (2.0 * s.z - s.x - s.y) * coefficient(i, 6u, n);
        sum += -1.0925484305920792 * d.x * d.z * coefficient(i, 7u, n);
        sum += 0.54627421529603959 * (s.x - s.y) * coefficient(i, 8u, n);
    }
    if DEGREE > 2 {
        let s = d * d;
        sum += -0.59004358992664352 * d.y * (3.0 * s.x - s.y) * coefficient(i, 9u, n);
        sum += 2.8906114426405538 * d.x * d.y * d.z * coefficient(i, 10u, n);
        sum += -0.45704579946446572 * d.y * (4.0 * s.z - s.x - s.y) * coefficient(i, 11u, n);
        sum += 0.3731763325901154 * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y) * coefficient(i, 12u, n);
        sum += -0.45704579946446572 * d.x * (4.0 * s.z - s.x - s.y) * coefficient(i, 13u, n);
        sum += 1.4453057213202769 * d.z * (s.x - s.y) * coefficient(i, 14u, n);
        sum += -0.59004358992664352 * d.x * (s.x - 3.0 * s.y) * coefficient(i, 15u, n);
    }
    return sum;
}

fn direction(v: vec3<f32>) -> vec3<f32> {
    let m = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if m == 0.0 {
        return vec3(0.0);
    }
    return normalize(v / m);
}

fn raised(base: f32, exponent: f32) -> f32 {
    if base <= 0.0 {
        return select(0.0, 1.0, exponent == 0.0);
    }
    return pow(base, exponent);
}

fn lit(i: u32, unit: Unit, replaced: bool, given: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let s = surface(i);
    let two_sided = unit.kind.x != 0u;
    var diffuse = unit.palette.xyz + s.offset;
    if two_sided {
        diffuse = clamp(unit.palette.xyz, vec3(0.0), vec3(1.0)) + s.offset;
    }
    if replaced {
        diffuse = given;
    }
    let f = s.factors * unit.multipliers;
    var to_light = to_eye;
    if DIRECTIONAL {
        to_light = frame.light.xyz;
    }
    let cosine = dot(s.normal, to_light);
    let side = select(max(cosine, 0.0), abs(cosine), two_sided);
    if TERM == 1u {
        return clamp(0.5 * (s.normal + 1.0), vec3(0.0), vec3(1.0));
    }
    var highlight = 0.0;
    if HIGHLIGHTS && (TERM == 0u || TERM == 4u) && f.z != 0.0 && !(two_sided && cosine == 0.0) {
        let across = dot(s.normal, direction(to_light + to_eye));
        let strength = select(f.z, f.z * f.y, unit.kind.x == 2u);
        highlight = strength * raised(select(max(across, 0.0), abs(across), two_sided), f.w);
    }
    var color = vec3(0.0);
    switch TERM {
        case 0u: { color = (f.x + f.y * side) * diffuse + highlight; }
        case 2u: { color = f.x * diffuse; }
        case 3u: { color = f.y * side * diffuse; }
        default: { color = vec3(highlight); }
    }
    return clamp(color, vec3(0.0), vec3(1.0));
}

fn color_of(i: u32, global: u32, unit: Unit, replaced: bool, given: vec3<f32>, at: vec3<f32>, eye: vec3<f32>) -> vec3<f32> {
    if COLORS {
        let word = 3u * global;
        return vec3(bitcast<f32>(colors[word]), bitcast<f32>(colors[word + 1u]), bitcast<f32>(colors[word + 2u]));
    }
    if LIT && unit.kind.y == 1u {
        return lit(i, unit, replaced, given, direction(eye - at));
    }
    if replaced {
        return max(given, vec3(0.0));
    }
    if DEGREE >= 0 && unit.kind.y == 2u {
        let away = at - eye;
        let d = direction(unit.ix.xyz * away.x + unit.iy.xyz * away.y + unit.iz.xyz * away.z);
        return max(seen(i, d), vec3(0.0));
    }
    return max(unit.palette.xyz, vec3(0.0));
}

fn turned(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

fn in_scene(unit: Unit, v: vec3<f32>) -> vec3<f32> {
    return unit.x.xyz * v.x + unit.y.xyz * v.y + unit.z.xyz * v.z;
}

// The ellipse that the affine projection makes of a Gaussian (Zwicker et al. 2002), for axes of which the longest is `longest`.
fn seen_affinely(view: View, at: vec3<f32>, rows: array<vec3<f32>, 3>, longest: f32, opacity: f32, compensated: bool) -> Seen {
    let slope = at.xy / at.z;
    let pixels = view.lens.xy / at.z;
    // In units of `size` pixels, so that all below is of order one.
    var m0 = pixels.x * (rows[0] - slope.x * rows[2]);
    var m1 = pixels.y * (rows[1] - slope.y * rows[2]);
    let most = max(max(largest(m0), largest(m1)), 1e-30);
    let size = clamp(longest * most, 1.0, 1e15);
    let shrunk = min(longest * most, 1.0) / most;
    m0 *= shrunk;
    m1 *= shrunk;
    let dilation = DILATION / (size * size);
    let c = dot(m1, m1) + dilation;
    let root = sqrt(c);
    let across = cross(m0, m1) / root;
    let variance = dot(across, across) + dilation * (dot(m0, m0) + dot(m1, m1) + dilation) / c;
    let ellipse_slope = dot(m0, m1) / c;
    let per_column = SCALE / (size * sqrt(variance));
    let per_row = SCALE / (size * root);
    let pixel = view.lens.xy * slope + view.lens.zw;
    var seen: Seen;
    seen.opacity = opacity;
    if compensated {
        seen.opacity *= compensation(m0, m1, dilation);
    }
    seen.range = log2(max(seen.opacity / frame.limits.x, frame.limits.y));
    seen.ellipse = vec4(pixel, ellipse_slope, per_column);
    seen.per_row = per_row;
    seen.last = at.z;
    seen.usable = at.z > frame.limits.w && is_finite(variance) && is_finite(c);
    return seen;
}

@compute @workgroup_size(64)
fn project(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let stretch = stretches[part.index];
    for (var k = id.x; k < stretch.y; k += 64u * groups.x) {
        project_one(stretch.x + k);
    }
}

fn project_one(j: u32) {
    let global = listed[j];
    let i = global - part.first;
    let center = centers[i];
    let rotation = shapes[2u * i];
    let shape = shapes[2u * i + 1u];
    let unit = units[bitcast<u32>(shape.w)];

    var opacity = center.w * unit.palette.w;
    var replaced = false;
    var given = vec3(0.0);
    var highlighted = false;
    if MASKS {
        for (var k = 0u; k < frame.edits; k++) {
            if in_mask(k, global) {
                opacity *= edits[k].color.w;
                if edits[k].kind.x == 1u {
                    replaced = true;
                    given = edits[k].color.xyz;
                }
            }
        }
    }
    opacity = clamp(opacity, 0.0, 1.0);
    if OVERLAY {
        highlighted = in_mask(frame.edits, global);
        if highlighted {
            opacity = clamp(opacity * frame.background.w, 0.0, 1.0);
        }
    }

    // Axes of the Gaussian in the scene's frame, the longest of unit length: whatever they are, no square leaves f32.
    let longest = max(max(max(shape.x, shape.y), shape.z), 1e-30);
    let ax = in_scene(unit, (shape.x / longest) * turned(rotation, vec3(1.0, 0.0, 0.0)));
    let ay = in_scene(unit, (shape.y / longest) * turned(rotation, vec3(0.0, 1.0, 0.0)));
    let az = in_scene(unit, (shape.z / longest) * turned(rotation, vec3(0.0, 0.0, 1.0)));

    var shared_color = vec3(0.0);
    let shares = frame.shading_eye.w == 1.0;
    if shares {
        shared_color = color_of(i, global, unit, replaced, given, center.xyz, frame.shading_eye.xyz);
    }
    // Parallel eyes see every centre at one depth, so that one order serves both and neither pops against the other.
    var depth = 0.0;
    var drawn = false;
    for (var v = 0u; v < frame.view_count; v++) {
        let view = frame.views[v];
        let from_eye = away_from_eye(view, center.xyz);
        let at = vec3(dot(view.right.xyz, from_eye), dot(view.down.xyz, from_eye), dot(view.forward.xyz, from_eye));
        let rows = array(
            vec3(dot(view.right.xyz, ax), dot(view.right.xyz, ay), dot(view.right.xyz, az)),
            vec3(dot(view.down.xyz, ax), dot(view.down.xyz, ay), dot(view.down.xyz, az)),
            vec3(dot(view.forward.xyz, ax), dot(view.forward.xyz, ay), dot(view.forward.xyz, az)),
        );
        var seen: Seen;
        if PER_RAY {
            seen = seen_by_rays(view, at, rows, longest, opacity, unit.kind.w == 1u);
        } else {
            seen = seen_affinely(view, at, rows, longest, opacity, unit.kind.w == 1u);
        }
        var color = shared_color;
        if !shares {
            color = color_of(i, global, unit, replaced, given, center.xyz, view.eye.xyz);
        }
        if highlighted {
            color = max(mix(color, frame.overlay.xyz, frame.overlay.w), vec3(0.0));
        }
        let pixel = seen.ellipse.xy;
        let reach = sqrt(seen.range);
        let tall = reach / seen.per_row;
        let half = vec2(length(vec2(reach / seen.ellipse.w, seen.ellipse.z * tall)), tall);
        let usable = seen.usable && seen.opacity > 0.0 && is_finite(pixel.x) && is_finite(pixel.y)
            && is_finite(seen.ellipse.z) && is_finite(color.x) && is_finite(color.y) && is_finite(color.z);
        let inside = all(pixel + half >= vec2(0.0)) && all(pixel - half <= vec2<f32>(frame.size));
        if PER_RAY {
            if v == 0u {
                depth = length_of(at);
            }
        } else if depth <= frame.limits.w {
            depth = at.z;
        }
        if usable && inside {
            drawn = true;
        } else {
            seen.range = -1.0;
        }
        let to = v * frame.capacity + j;
        ellipses[to] = seen.ellipse;
        levels[to] = vec4(seen.per_row, log2(max(seen.opacity, 1e-30)), seen.range, seen.last);
        if PER_RAY {
            tints[3u * to] = vec4(color, seen.over_per_row);
            tints[3u * to + 1u] = seen.toward;
            tints[3u * to + 2u] = seen.across;
        } else {
            tints[to] = vec4(color, 0.0);
        }
    }
    keys[j] = select(0xffffffffu, bitcast<u32>(depth), drawn);
    order[j] = j;
}
