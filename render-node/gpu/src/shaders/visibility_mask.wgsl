// Puts what nobody can see nearer than everything that is drawn after it.

override VIEW: u32 = 0u;

// Corners as shares of the picture's width and height, and the view they belong to.
@group(0) @binding(0) var<storage, read> corners: array<vec4<f32>>;

fn corner_in(view: u32, vertex: u32) -> vec4<f32> {
    let corner = corners[vertex];
    let at = vec4(corner.xy * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
    // One of the other view is a triangle of no extent.
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
