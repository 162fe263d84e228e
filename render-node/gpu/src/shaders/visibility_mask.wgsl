// Writes the nearest depth at pixels of the visibility mask.

override VIEW: u32 = 0u;

@group(0) @binding(0) var<storage, read> mask_corners: array<MaskCorner>;

fn corner_in(view: u32, vertex: u32) -> vec4<f32> {
    let corner = mask_corners[vertex];
    let at = vec4(corner.at * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
    // A triangle of the other view has no area.
    return select(vec4(-2.0, -2.0, 0.0, 1.0), at, corner.view == view);
}

@vertex
fn hide(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return corner_in(VIEW, vertex);
}

@fragment
fn leave() -> @location(0) vec4<f32> {
    return vec4(0.0);
}
