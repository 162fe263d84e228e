// Puts what was blended over the background.

override VIEW: u32 = 0u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> pixels: array<vec4<f32>>;
@group(0) @binding(2) var blended: texture_2d<f32>;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

fn over(color: vec3<f32>, transmittance: f32) -> vec4<f32> {
    return vec4(color + transmittance * frame.background, 1.0 - transmittance);
}

@fragment
fn from_tiles(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(at.xy);
    let p = pixels[(VIEW * frame.size.y + pixel.y) * frame.size.x + pixel.x];
    return over(p.xyz, p.w);
}

@fragment
fn from_quads(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = textureLoad(blended, vec2<i32>(at.xy), 0);
    return over(p.xyz, max(1.0 - p.w, 0.0));
}
