// Depth of the front of each pixel along the view axis, from quadrilaterals; 0 without a front.

@group(0) @binding(0) var blended: texture_2d<f32>;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

@fragment
fn depth_from_quads(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = textureLoad(blended, vec2<i32>(at.xy), 0);
    return vec4(select(0.0, p.x / max(p.w, SURFACE), p.w >= SURFACE), 0.0, 0.0, 1.0);
}
