// A triangle that covers the target.

struct Covered {
    @builtin(position) position: vec4<f32>,
    // 0 to 1 across and down the target.
    @location(0) at: vec2<f32>,
}

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> Covered {
    let corner = vec2(f32(vertex & 1u) * 2.0, f32(vertex >> 1u) * 2.0);
    return Covered(vec4(corner.x * 2.0 - 1.0, 1.0 - corner.y * 2.0, 0.5, 1.0), corner);
}

