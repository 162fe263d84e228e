// Darkens the edge of an eye's picture, evenly around the straight-ahead direction.

@group(0) @binding(0) var<uniform> vignette: VignetteShape;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

@fragment
fn darken(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let tangent = length((at.xy - vignette.middle) / vignette.focal);
    return vec4(0.0, 0.0, 0.0, vignette.strength * smoothstep(vignette.begins, vignette.whole, tangent));
}
