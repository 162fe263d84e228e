// Blends splats as quadrilaterals, near to far: what is drawn first keeps its share (target alpha is 1 - transmittance).

override VIEW: u32 = 0u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> ellipses: array<Ellipse>;
@group(0) @binding(2) var<storage, read> depth_order: array<u32>;
@group(0) @binding(3) var<storage, read> levels: array<Level>;
@group(0) @binding(4) var<storage, read> tints: array<Tint>;

// Those that rays evaluate.
@group(0) @binding(5) var<storage, read> near_rays: NearRays;

// Pixels beyond which a quadrilateral is cut to the picture.
const FAR: f32 = 8192.0;

struct Corner {
    @builtin(position) position: vec4<f32>,
    // Centre, slope, per column.
    @location(0) @interpolate(flat) ellipse: vec4<f32>,
    // Per row, log2 of the opacity, range.
    @location(1) @interpolate(flat) level: vec3<f32>,
    @location(2) @interpolate(flat) color: vec3<f32>,
    // View, and the place of what rays evaluate from 1 on.
    @location(3) @interpolate(flat) near: vec2<u32>,
}

fn corner_in(view: u32, vertex: u32, instance: u32) -> Corner {
    let at = view * frame.capacity + depth_order[(vertex >> 2u) + instance];
    let a = ellipses[at];
    let b = levels[at];
    var out: Corner;
    out.ellipse = vec4(a.center, a.slope, a.per_column);
    out.level = vec3(b.per_row, b.log_opacity, b.range);
    out.color = tints[at].color;
    out.near = vec2(view, u32(tints[at].over_per_row));
    // The level is a disc in (u, v), and the square around it a parallelogram of pixels. (An octagon has a sixth less to
    // fill, and was twice as slow for splats of some hundred pixels.)
    let reach = sqrt(max(b.range, 0.0));
    let sign = vec2(f32(vertex & 1u) * 2.0 - 1.0, f32((vertex >> 1u) & 1u) * 2.0 - 1.0);
    let dy = sign.y * (reach / b.per_row);
    let dx = sign.x * (reach / a.per_column) + a.slope * dy;
    // One that reaches far out of the picture is drawn as the picture's part of its bounding box: rasterizers lose what they
    // cannot clip exactly.
    let half = vec2(length(vec2(reach / a.per_column, a.slope * (reach / b.per_row))), reach / b.per_row);
    let size = vec2<f32>(frame.size);
    var at_corner = a.center + vec2(dx, dy);
    if max(half.x, half.y) > FAR {
        at_corner = clamp(a.center + sign * half, vec2(-1.0), size + 1.0);
    }
    let ndc = at_corner / size * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    out.position = select(vec4(ndc, 0.5, 1.0), vec4(-2.0, -2.0, 0.5, 1.0), b.range < 0.0);
    return out;
}

@vertex
fn corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    return corner_in(VIEW, vertex, instance);
}

// What a splat adds at a place of the picture, pixels.
fn layer(at: vec2<f32>, in: Corner) -> vec4<f32> {
    if in.near.y > 0u {
        let view = in.near.x;
        let told_at = clamp(in.ellipse.xy, vec2(0.0), vec2<f32>(frame.size));
        let direction = (at - frame.views[view].principal) / frame.views[view].focal;
        let meeting = meet_ray(near_rays.entries[in.near.y - 1u], at - told_at, direction, frame.near);
        let met = select(0.0, min(exp2(in.level.y - meeting.below) * meeting.share, 1.0), meeting.below <= in.level.z);
        return vec4(in.color * met, met);
    }
    let d = at - in.ellipse.xy;
    let u = (d.x - in.ellipse.z * d.y) * in.ellipse.w;
    let v = d.y * in.level.x;
    let below = u * u + v * v;
    // Blending nothing costs less than discarding does.
    let alpha = select(0.0, min(exp2(in.level.y - below), 1.0), below <= in.level.z);
    return vec4(in.color * alpha, alpha);
}

@fragment
fn blend(in: Corner) -> @location(0) vec4<f32> {
    return layer(in.position.xy, in);
}
