// Meshes in the room around a scene: hands, pointers, brushes, the floor, and holes for panels that lie behind the picture.
// Each fragment compares its depth with that of the scene, softly, since a scene of Gaussians has no sharp surface.

// Whether the target is sRGB: it encodes linear values on its own.
override CURVED: bool = false;

@group(0) @binding(0) var<uniform> eye: MeshEye;
@group(0) @binding(1) var<storage, read> corners: array<MeshCorner>;
@group(0) @binding(2) var<storage, read> items: array<MeshItem>;
@group(0) @binding(3) var picture: texture_2d<f32>;
@group(0) @binding(4) var depths: texture_2d<f32>;

// Distance between thin lines of the floor, and between strong ones, metres.
const FINE: f32 = 0.25;
const COARSE_LINES: f32 = 1.0;

struct Corner {
    @builtin(position) position: vec4<f32>,
    // In the axes of the eye: x right, y down, z forward, metres.
    @location(0) at: vec3<f32>,
    @location(1) normal: vec3<f32>,
    // On the mesh, before it is placed.
    @location(2) local: vec3<f32>,
    @location(3) @interpolate(flat) item: u32,
}

@vertex
fn place(@builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32) -> Corner {
    let corner = corners[vertex];
    let item = items[index];
    let p = vec4(corner.position, 1.0);
    let at = vec3(dot(item.right, p), dot(item.down, p), dot(item.forward, p));
    // The cofactors keep normals at right angles under any scale.
    let a = item.right.xyz;
    let b = item.down.xyz;
    let c = item.forward.xyz;
    let n = corner.normal;
    let normal = vec3(dot(cross(b, c), n), dot(cross(c, a), n), dot(cross(a, b), n));
    let across = eye.focal.x * at.x + eye.middle.x * at.z;
    let down = eye.focal.y * at.y + eye.middle.y * at.z;
    let depth = eye.farthest / (eye.farthest - eye.nearest) * (at.z - eye.nearest);
    return Corner(vec4(across, -down, depth, at.z), at, normal, corner.position, index);
}

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

fn covered(position: vec4<f32>) -> f32 {
    let pixel = clamp(vec2<i32>(position.xy), vec2(0), vec2<i32>(eye.part) - 1);
    return clamp(textureLoad(picture, pixel, 0).w, 0.0, 1.0);
}

// Metres from the eye along its axis to the scene's front at a pixel of the depths. Haze without a front counts as lying at
// the scene's middle.
fn front(pixel: vec2<i32>) -> f32 {
    let depth = textureLoad(depths, clamp(pixel, vec2(0), vec2<i32>(eye.depth_part) - 1), 0).x;
    return select(eye.haze, depth * eye.scale, depth > 0.0);
}

struct Overlap {
    // Share of the fragment that is in front of the scene.
    before: f32,
    // How near the scene's front is, 1 at the same depth.
    touch: f32,
}

// Four pixels of the depths are compared, and the results interpolated: depths of two surfaces cannot be.
fn meet(position: vec4<f32>, z: f32, softness: f32, thickness: f32) -> Overlap {
    let at = position.xy / vec2<f32>(eye.part) * vec2<f32>(eye.depth_part) - 0.5;
    let low = vec2<i32>(floor(at));
    let share = at - floor(at);
    var result = Overlap(0.0, 0.0);
    for (var k = 0; k < 4; k++) {
        let step = vec2(k & 1, k >> 1u);
        let weights = select(1.0 - share, share, step == vec2(1));
        let gap = front(low + step) - z;
        let weight = weights.x * weights.y;
        result.before += weight * smoothstep(-softness, softness, gap);
        result.touch += weight * exp(-(gap * gap) / (thickness * thickness));
    }
    return result;
}

fn encoded(color: vec3<f32>) -> vec3<f32> {
    let c = clamp(color, vec3(0.0), vec3(1.0));
    if !CURVED {
        return c;
    }
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

// Width and height of a pixel on the item's plane. Only the interpolated place is known beside the edge of a triangle: some
// devices read zeros from buffers there.
fn size_of_pixel(in: Corner) -> vec2<f32> {
    return fwidth(in.local.xy) * items[in.item].size;
}

// Coverage of lines with this period at places of a plane, with the size of a pixel there.
fn lines(at: vec2<f32>, pixel: vec2<f32>, period: f32) -> f32 {
    let across = abs(fract(at / period - 0.5) - 0.5) * period / max(pixel, vec2(1e-6));
    let line = 1.0 - min(min(across.x, across.y), 1.0);
    // Lines closer than a few pixels would flicker.
    return line * (1.0 - smoothstep(0.15, 0.5, max(pixel.x, pixel.y) / period));
}

@fragment
fn shade(in: Corner) -> @location(0) vec4<f32> {
    let item = items[in.item];
    let plane = in.local.xy * item.size;
    let pixel = size_of_pixel(in);
    let met = meet(in.position, in.at.z, item.softness, max(0.04 * item.size.x, 0.002));
    let visible = max(1.0 - covered(in.position) * (1.0 - met.before), item.ghost);
    let toward = normalize(-in.at);
    let normal = normalize(in.normal) * select(-1.0, 1.0, dot(in.normal, toward) >= 0.0);
    let facing = dot(normal, toward);
    var color = item.color.xyz;
    var alpha = item.color.w;
    if item.look == MESH_SOLID {
        color *= 0.45 + 0.35 * max(dot(normal, eye.up), 0.0) + 0.3 * facing;
    } else if item.look == MESH_BEAM {
        // The edge of a round beam fades.
        alpha *= smoothstep(0.0, 0.6, facing);
    } else if item.look == MESH_BALL {
        // A shell: faint in its middle, strong at its rim and where it meets the scene.
        let rim = pow(1.0 - facing, 2.5);
        alpha *= clamp(0.08 + 0.8 * rim + 0.75 * met.touch * covered(in.position), 0.0, 1.0);
        color = mix(color, vec3(1.0), 0.35 * met.touch);
    } else {
        let away = 2.0 * length(plane) / max(item.size.x, 1e-6);
        let near = 1.0 - smoothstep(0.03, 0.12, away);
        let grid = near * max(0.45 * lines(plane, pixel, FINE), lines(plane, pixel, COARSE_LINES));
        alpha *= (0.16 + 0.84 * grid) * (1.0 - smoothstep(0.4, 1.0, away));
    }
    // What touches the eye fades.
    alpha *= visible * smoothstep(eye.nearest, 2.0 * eye.nearest, in.at.z);
    return vec4(encoded(color) * alpha, alpha);
}

// Coverage of the item's rounded rectangle.
fn rectangle(item: MeshItem, plane: vec2<f32>, pixel: vec2<f32>) -> f32 {
    let beyond = abs(plane) - 0.5 * item.size + item.corner;
    let distance = length(max(beyond, vec2(0.0))) + min(max(beyond.x, beyond.y), 0.0) - item.corner;
    return 1.0 - smoothstep(-0.5, 0.5, distance / max(max(pixel.x, pixel.y), 1e-6));
}

// Takes the picture away where a layer behind it shall show.
@fragment
fn open(in: Corner) -> @location(0) vec4<f32> {
    let item = items[in.item];
    let plane = in.local.xy * item.size;
    let inside = rectangle(item, plane, size_of_pixel(in));
    let met = meet(in.position, in.at.z, item.softness, 1.0);
    let visible = max(1.0 - covered(in.position) * (1.0 - met.before), item.ghost);
    if inside <= 0.0 {
        discard;
    }
    return vec4(0.0, 0.0, 0.0, inside * visible);
}

// The depth of what hides the scene, for a headset's depth image.
@fragment
fn keep_depth(in: Corner) {
    let item = items[in.item];
    let plane = in.local.xy * item.size;
    let inside = rectangle(item, plane, size_of_pixel(in));
    let is_out = item.look == MESH_HOLE && inside < 0.5;
    if is_out || meet(in.position, in.at.z, item.softness, 1.0).before < 0.5 {
        discard;
    }
}

// The picture's own coverage as the target's, for a headset that shows the surroundings.
@fragment
fn reveal(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(0.0, 0.0, 0.0, covered(position));
}
