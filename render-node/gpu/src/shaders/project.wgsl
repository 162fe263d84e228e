// Projects and shades each listed Gaussian: the f32 twin of project.rs and shading.rs.
//
// A splat is an ellipse, a level and a tint in three buffers, which raises the limit of a binding threefold. See
// splat_f32.rs for the form. With PER_RAY it has ray coefficients as well: see ray_project.wgsl.

override LIT: bool = false;
override DEGREE: i32 = -1;
override HIGHLIGHTS: bool = true;
override TERM: u32 = TERM_FULL;
override DIRECTIONAL: bool = false;
override OVERLAY: bool = false;
override COLORS: bool = false;
override OCCLUDED: bool = false;
// Half precision of the shading columns and the harmonics.
override HALF: bool = false;
override PER_RAY: bool = false;

// SURFACE_NUMBERS numbers of each Gaussian, f32 or f16: see surface().
@group(0) @binding(7) var<storage, read> surfaces: array<u32>;
// Three numbers of each coefficient, f32 or f16: see coefficient().
@group(0) @binding(8) var<storage, read> harmonics: array<u32>;
// Shown colors, or with OCCLUDED a factor on ka of each Gaussian. A vec3 would take 16 bytes.
@group(0) @binding(9) var<storage, read> colors: array<array<f32, 3>>;
@group(0) @binding(10) var<storage, read> part_ranges: array<PartRange>;
@group(0) @binding(11) var<storage, read> listed: array<u32>;
@group(0) @binding(12) var<storage, read_write> ellipses: array<Ellipse>;
@group(0) @binding(13) var<storage, read_write> levels: array<Level>;
@group(0) @binding(14) var<storage, read_write> tints: array<Tint>;
@group(0) @binding(15) var<storage, read_write> rays: array<RayCoefficients>;
@group(0) @binding(16) var<storage, read_write> depth_keys: array<u32>;
// NearRays that grow.
struct NearRayList {
    count: atomic<u32>,
    entries: array<NearRay>,
}

// Gaussians of the affine mode that rays evaluate, in any order.
@group(0) @binding(18) var<storage, read_write> near_rays: NearRayList;
// Places in the list, before the sort by depth.
@group(0) @binding(17) var<storage, read_write> depth_places: array<u32>;

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
        let at = SURFACE_NUMBERS / 2u * i;
        let a = unpack2x16float(surfaces[at]);
        let b = unpack2x16float(surfaces[at + 1u]);
        let c = unpack2x16float(surfaces[at + 2u]);
        let d = unpack2x16float(surfaces[at + 3u]);
        let e = unpack2x16float(surfaces[at + 4u]);
        return Surface(vec3(a, b.x), vec3(b.y, c), vec4(d, e));
    }
    let at = SURFACE_NUMBERS * i;
    var x: array<f32, SURFACE_NUMBERS>;
    for (var k = 0u; k < SURFACE_NUMBERS; k++) {
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

// Tone::MOST in tone.rs.
const MOST_TONE = 4.0;

const BRIGHTNESS = vec3<f32>(0.2126, 0.7152, 0.0722);

// Twin of recolored() in recolor.rs.
fn recolored(given: vec3<f32>, own: vec3<f32>, palette: vec3<f32>) -> vec3<f32> {
    let mean = dot(palette, BRIGHTNESS);
    if mean > 1.0 / 256.0 {
        return given * clamp(dot(own, BRIGHTNESS) / mean, 0.5, 1.5);
    }
    return given;
}

// What editable units make of the own color of a Gaussian.
struct Paint {
    // The color that replaces it.
    given: vec3<f32>,
    replaced: bool,
    // Factors on saturation and brightness, and temperature.
    tone: vec3<f32>,
}

const NEUTRAL_TONE = vec3<f32>(1.0, 1.0, 0.0);

// Twin of Tone::of() in tone.rs.
fn toned(color: vec3<f32>, tone: vec3<f32>) -> vec3<f32> {
    if all(tone == NEUTRAL_TONE) {
        return color;
    }
    let warm = vec3(1.0 + 0.5 * tone.z, 1.0, 1.0 - 0.5 * tone.z);
    let grey = vec3(dot(color, BRIGHTNESS));
    return warm * (tone.y / dot(warm, BRIGHTNESS)) * (grey + tone.x * (color - grey));
}

fn lit(i: u32, global: u32, unit: Unit, paint: Paint, to_eye: vec3<f32>) -> vec3<f32> {
    let s = surface(i);
    let two_sided = unit.shading_model != SHADING_PAPER;
    var diffuse = unit.palette + s.offset;
    if two_sided {
        diffuse = clamp(unit.palette, vec3(0.0), vec3(1.0)) + s.offset;
    }
    if paint.replaced {
        diffuse = recolored(paint.given, diffuse, select(unit.palette, clamp(unit.palette, vec3(0.0), vec3(1.0)), two_sided));
    }
    if MASKS {
        diffuse = toned(diffuse, paint.tone);
    }
    var f = s.factors * unit.multipliers;
    if OCCLUDED {
        f.x *= colors[global / 3u][global % 3u];
    }
    var to_light = to_eye;
    if DIRECTIONAL {
        to_light = frame.light;
    }
    let cosine = dot(s.normal, to_light);
    let side = select(max(cosine, 0.0), abs(cosine), two_sided);
    if TERM == TERM_NORMAL {
        return clamp(0.5 * (s.normal + 1.0), vec3(0.0), vec3(1.0));
    }
    var highlight = 0.0;
    if HIGHLIGHTS && (TERM == TERM_FULL || TERM == TERM_SPECULAR) && f.z != 0.0 && !(two_sided && cosine == 0.0) {
        let across = dot(s.normal, direction(to_light + to_eye));
        let strength = select(f.z, f.z * f.y, unit.shading_model == SHADING_IVRGS_VIEWER);
        highlight = strength * raised(select(max(across, 0.0), abs(across), two_sided), f.w);
    }
    var color = vec3(0.0);
    switch TERM {
        case TERM_FULL: { color = (f.x + f.y * side) * diffuse + highlight; }
        case TERM_AMBIENT: { color = f.x * diffuse; }
        case TERM_DIFFUSE: { color = f.y * side * diffuse; }
        default: { color = vec3(highlight); }
    }
    return clamp(color, vec3(0.0), vec3(1.0));
}

fn color_of(i: u32, global: u32, unit: Unit, paint: Paint, at: vec3<f32>, eye: vec3<f32>) -> vec3<f32> {
    if COLORS {
        let color = colors[global];
        return vec3(color[0], color[1], color[2]);
    }
    if LIT && unit.color_source == COLOR_LIT {
        return lit(i, global, unit, paint, direction(eye - at));
    }
    if DEGREE >= 0 && unit.color_source == COLOR_HARMONICS {
        let away = at - eye;
        let d = direction(unit.inverse[0] * away.x + unit.inverse[1] * away.y + unit.inverse[2] * away.z);
        let own = max(seen(i, d), vec3(0.0));
        if paint.replaced {
            // Twin of recolored_unlit() in recolor.rs.
            return unlit(paint.given * clamp(0.5 + dot(own, BRIGHTNESS), 0.5, 1.5), paint.tone);
        }
        return unlit(own, paint.tone);
    }
    if paint.replaced {
        return unlit(paint.given, paint.tone);
    }
    return unlit(unit.palette, paint.tone);
}

// The color of a Gaussian without shading columns.
fn unlit(color: vec3<f32>, tone: vec3<f32>) -> vec3<f32> {
    let own = max(color, vec3(0.0));
    if MASKS {
        return max(toned(own, tone), vec3(0.0));
    }
    return own;
}

fn turned(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

// The greatest key of the depth order: 16 bits of a coarse one.
fn order_ends() -> u32 {
    return select(0xffffffffu, 0xffffu, frame.order_shift > 0u);
}

fn in_scene(unit: Unit, v: vec3<f32>) -> vec3<f32> {
    return unit.linear[0] * v.x + unit.linear[1] * v.y + unit.linear[2] * v.z;
}

// The ellipse that the affine projection makes of a Gaussian (Zwicker et al. 2002), for axes of which the longest is `longest`.
fn seen_affinely(view: View, at: vec3<f32>, rows: array<vec3<f32>, 3>, longest: f32, opacity: f32, kept: f32, share: f32) -> Seen {
    let slope = at.xy / at.z;
    let pixels = view.focal / at.z;
    // In units of `size` pixels, so that all below is of order one.
    var m0 = pixels.x * (rows[0] - slope.x * rows[2]);
    var m1 = pixels.y * (rows[1] - slope.y * rows[2]);
    let most = max(max(largest(m0), largest(m1)), 1e-30);
    let size = clamp(longest * most, 1.0, 1e15);
    let shrunk = min(longest * most, 1.0) / most;
    m0 *= shrunk;
    m1 *= shrunk;
    // As Dilation in project.rs.
    let s = dilation_slope(view, slope, vec2<f32>(frame.size), share);
    let grown = 1.0 + dot(s, s);
    let dilation = frame.dilation * grown / (size * size);
    let c = dot(m1, m1) + dilation * (1.0 + s.y * s.y);
    let root = sqrt(c);
    let across = cross(m0, m1) / root;
    let turned = s.x * m1 - s.y * m0;
    let undilated = dot(m0, m0) + dot(m1, m1) + dot(turned, turned);
    let spread = undilated + dilation * grown;
    let variance = dot(across, across) + dilation * spread / c;
    let ellipse_slope = (dot(m0, m1) + dilation * s.x * s.y) / c;
    let per_column = SCALE / (size * sqrt(variance));
    let per_row = SCALE / (size * root);
    let pixel = view.focal * slope + view.principal;
    var seen: Seen;
    seen.opacity = opacity;
    if kept < 1.0 {
        let area = dot(across, across) * c;
        let less = kept * dilation;
        seen.opacity *= sqrt((area + less * (undilated + less * grown)) / (area + dilation * spread));
    }
    seen.range = log2(max(seen.opacity / frame.least_alpha, frame.alpha_ratio));
    seen.ellipse = Ellipse(pixel, ellipse_slope, per_column);
    seen.per_row = per_row;
    seen.depth = at.z;
    seen.usable = at.z > frame.near_plane && is_finite(variance) && is_finite(c);
    return seen;
}

@compute @workgroup_size(PROJECT_LANES)
fn project(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let range = part_ranges[part.index];
    for (var k = id.x; k < range.count; k += PROJECT_LANES * groups.x) {
        project_one(range.first + k);
    }
}

fn project_one(j: u32) {
    let global = listed[j];
    let i = global - part.first;
    let center = centers[i];
    let shape = shapes[i];
    let unit = units[shape.unit];
    let kept = select(frame.kept_dilation, 0.0, unit.compensated == 1u);

    var opacity = center.opacity * unit.opacity;
    var paint = Paint(vec3(0.0), false, NEUTRAL_TONE);
    var highlighted = false;
    if MASKS {
        for (var k = 0u; k < frame.edit_count; k++) {
            if in_mask(k, global) {
                opacity *= edits[k].opacity;
                if edits[k].colored == 1u {
                    paint.replaced = true;
                    paint.given = edits[k].color;
                }
                // Twin of Tone::and() in tone.rs.
                paint.tone = clamp(
                    vec3(paint.tone.xy * edits[k].tone.xy, paint.tone.z + edits[k].tone.z),
                    vec3(0.0, 0.0, -1.0),
                    vec3(MOST_TONE, MOST_TONE, 1.0),
                );
            }
        }
    }
    opacity = clamp(opacity, 0.0, 1.0);
    if OVERLAY {
        highlighted = in_mask(frame.edit_count, global);
        if highlighted {
            opacity = clamp(opacity * frame.highlight_opacity, 0.0, 1.0);
        }
    }

    // Axes of the Gaussian in the scene's frame, the longest of unit length: whatever they are, no square leaves f32.
    let longest = max(max(max(shape.scale.x, shape.scale.y), shape.scale.z), 1e-30);
    let ax = in_scene(unit, (shape.scale.x / longest) * turned(shape.rotation, vec3(1.0, 0.0, 0.0)));
    let ay = in_scene(unit, (shape.scale.y / longest) * turned(shape.rotation, vec3(0.0, 1.0, 0.0)));
    let az = in_scene(unit, (shape.scale.z / longest) * turned(shape.rotation, vec3(0.0, 0.0, 1.0)));
    let axes = mat3x3(ax, ay, az);
    var cut = Cut(center.position, axes, 1.0);
    if CLIPS {
        cut = cut_by_clips(center.position, axes, longest);
    }
    opacity = select(0.0, opacity, cut.mass > 0.0);

    var shared_color = vec3(0.0);
    let shares = frame.shared_shading == 1u;
    if shares {
        shared_color = color_of(i, global, unit, paint, center.position, frame.shading_eye);
    }
    // Parallel eyes see every centre at one depth, so that one order serves both and neither pops against the other.
    var depth = 0.0;
    // The centre as the point between the eyes sees it.
    var middle = vec3(0.0);
    var drawn = false;
    for (var v = 0u; v < frame.view_count; v++) {
        let view = frame.views[v];
        let from_eye = away_from_eye(view, cut.position);
        let at = vec3(dot(view.right, from_eye), dot(view.down, from_eye), dot(view.forward, from_eye));
        var towards_eye = opacity;
        if CLIPS {
            towards_eye = cut_opacity(opacity, axes, cut, direction(away_from_eye(view, center.position)));
        }
        let rows = array(
            view.right * cut.axes,
            view.down * cut.axes,
            view.forward * cut.axes,
        );
        var seen: Seen;
        // Twin of perspective() in nearness.rs.
        let away = length_of(at);
        let size = size_of(rows, longest);
        let fades = may_fade(away, size, frame.near);
        if PER_RAY || fades || !(size < AFFINE_SIZE * at.z) {
            let part = select(clamp(size / (AFFINE_SIZE * at.z) - 1.0, 0.0, 1.0), 1.0, PER_RAY || fades || !(at.z > STEEP * away));
            seen = seen_by_rays(view, at, rows, longest, towards_eye, kept, part);
        } else {
            seen = seen_affinely(view, at, rows, longest, towards_eye, kept, ray_share(away, frame.near));
        }
        var color = shared_color;
        if !shares {
            color = color_of(i, global, unit, paint, center.position, view.eye);
        }
        if highlighted {
            color = max(mix(color, frame.highlight_color, frame.highlight_mix), vec3(0.0));
        }
        let pixel = seen.ellipse.center;
        let reach = sqrt(seen.range);
        let tall = reach / seen.per_row;
        let half = vec2(length(vec2(reach / seen.ellipse.per_column, seen.ellipse.slope * tall)), tall);
        let usable = seen.usable && seen.opacity > 0.0 && is_finite(pixel.x) && is_finite(pixel.y)
            && is_finite(seen.ellipse.slope) && is_finite(color.x) && is_finite(color.y) && is_finite(color.z);
        let inside = all(pixel + half >= vec2(0.0)) && all(pixel - half <= vec2<f32>(frame.size));
        middle += at / f32(frame.view_count);
        if v == 0u {
            depth = select(at.z, away, PER_RAY);
        }
        var place = 0.0;
        if !PER_RAY && seen.by_rays && usable && inside {
            let near = atomicAdd(&near_rays.count, 1u);
            let held = near < arrayLength(&near_rays.entries);
            if held {
                let over = vec2(seen.depth, seen.over_per_row);
                near_rays.entries[near] = NearRay(seen.ray.along, seen.ray.fall, seen.ray.across, seen.ray.depth_factor, over);
            }
            // Integers below 2^24 are exact.
            place = f32(near + 1u);
            seen.usable = held;
        }
        if usable && inside && seen.usable {
            drawn = true;
        } else {
            seen.range = -1.0;
        }
        let to = v * frame.capacity + j;
        ellipses[to] = seen.ellipse;
        let level_depth = select(max(at.z, 0.0), seen.depth, PER_RAY);
        levels[to] = Level(seen.per_row, log2(max(seen.opacity, 1e-30)), seen.range, level_depth);
        tints[to] = Tint(color, select(place, seen.over_per_row, PER_RAY));
        if PER_RAY {
            rays[to] = seen.ray;
        }
    }
    if !PER_RAY && frame.near > 0.0 {
        depth = order_of(depth, length_of(middle), frame.near);
    }
    // What lies before or behind the range of a coarse order counts as its nearest or farthest.
    let bits = order_bits(depth);
    let key = min((bits - min(bits, frame.order_begins)) >> frame.order_shift, order_ends());
    depth_keys[j] = select(0xffffffffu, key, drawn);
    depth_places[j] = j;
}
