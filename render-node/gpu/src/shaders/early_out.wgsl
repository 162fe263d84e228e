// Writes the nearest depth at saturated pixels, so that the depth test rejects later splats.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var blended: texture_2d<f32>;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn close(@builtin(position) at: vec4<f32>) {
    // Alpha is 1 - transmittance.
    if textureLoad(blended, vec2<i32>(at.xy), 0).a <= 1.0 - frame.least_transmittance {
        discard;
    }
}
