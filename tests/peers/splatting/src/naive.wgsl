// One quad for each Gaussian, already projected and in order from back to front.

struct Splat {
    // Centre in clip coordinates.
    @location(0) center: vec2<f32>,
    // Both half axes of one standard deviation, in clip coordinates.
    @location(1) axes: vec4<f32>,
    // RGB, and opacity.
    @location(2) color: vec4<f32>,
}

struct Corner {
    @builtin(position) position: vec4<f32>,
    // In standard deviations.
    @location(0) at: vec2<f32>,
    @location(1) @interpolate(flat) color: vec4<f32>,
}

@vertex
fn corner(@builtin(vertex_index) index: u32, splat: Splat) -> Corner {
    let at = 3.0 * (2.0 * vec2<f32>(f32(index & 1u), f32(index >> 1u)) - 1.0);
    let position = splat.center + at.x * splat.axes.xy + at.y * splat.axes.zw;
    return Corner(vec4<f32>(position, 0.0, 1.0), at, splat.color);
}

@fragment
fn blend(corner: Corner) -> @location(0) vec4<f32> {
    let alpha = min(corner.color.a * exp(-0.5 * dot(corner.at, corner.at)), 0.99);
    if alpha < 1.0 / 255.0 {
        discard;
    }
    return vec4<f32>(alpha * corner.color.rgb, alpha);
}
