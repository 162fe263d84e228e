// Follows full_screen.wgsl: writes scene depths to a headset's depth image by a perspective projection between two
// planes.

@group(0) @binding(0) var<uniform> range: DepthRange;
@group(0) @binding(1) var depths: texture_2d<f32>;

@fragment
fn store(in: Covered) -> @builtin(frag_depth) f32 {
    let size = vec2<i32>(textureDimensions(depths));
    // Depths of two surfaces cannot be interpolated: take the nearest pixel.
    let pixel = clamp(vec2<i32>(in.at * vec2<f32>(size)), vec2(0), size - 1);
    let metres = textureLoad(depths, pixel, 0).x * range.scale;
    let seen = select(range.farthest, clamp(metres, range.nearest, range.farthest), metres > 0.0);
    return clamp(range.farthest / (range.farthest - range.nearest) * (1.0 - range.nearest / seen), 0.0, 1.0);
}
