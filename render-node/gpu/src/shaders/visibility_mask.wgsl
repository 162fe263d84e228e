// Writes the nearest depth at pixels of the visibility mask.

override VIEW: u32 = 0u;

// Corners as shares of the picture's width and height, and their view.
@group(0) @binding(0) var<storage, read> corners: array<vec4<f32>>;

fn corner_in(view: u32, vertex: u32) -> vec4<f32> {
    let corner = corners[vertex];
    let at = vec4(corner.xy * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
    // A triangle of the other view has no area.
    return select(vec4(-2.0, -2.0, 0.0, 1.0), at, u32(corner.z) == view);
}

@vertex
fn hide(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return corner_in(VIEW, vertex);
}

@fragment
fn leave() -> @location(0) vec4<f32> {
    return vec4(0.0);
}
