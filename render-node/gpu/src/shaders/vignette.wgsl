// Darkens the edge of an eye's picture, evenly around the straight-ahead direction.

struct Vignette {
    // The pixel of the straight-ahead direction.
    middle: vec2<f32>,
    // Pixels for each unit of the tangent of the angle from there.
    focal: vec2<f32>,
    // Tangents of the angles at which it begins and is whole; how dark that is.
    begins: f32,
    whole: f32,
    strength: f32,
    spare: f32,
}

@group(0) @binding(0) var<uniform> vignette: Vignette;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

@fragment
fn darken(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let tangent = length((at.xy - vignette.middle) / vignette.focal);
    return vec4(0.0, 0.0, 0.0, vignette.strength * smoothstep(vignette.begins, vignette.whole, tangent));
}
