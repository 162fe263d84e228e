// Follows full_screen.wgsl: copies a picture onto a surface or a headset's image, its numbers unchanged.

// Whether the target is sRGB: it encodes linear values on its own.
override CURVED: bool = false;

@group(0) @binding(0) var picture: texture_2d<f32>;

fn pixel(at: vec2<i32>, size: vec2<i32>) -> vec3<f32> {
    return textureLoad(picture, clamp(at, vec2(0), size - 1), 0).xyz;
}

@fragment
fn present(in: Covered) -> @location(0) vec4<f32> {
    let size = vec2<i32>(textureDimensions(picture));
    var at = in.at * vec2<f32>(size) - 0.5;
    // A picture of the target's size is copied, for any rounding of the coordinate.
    let whole = round(at);
    at = select(at, whole, abs(at - whole) < vec2(1.0 / 256.0));
    let low = vec2<i32>(floor(at));
    let part = at - floor(at);
    // Some devices do not filter f32.
    let above = mix(pixel(low, size), pixel(low + vec2(1, 0), size), part.x);
    let below = mix(pixel(low + vec2(0, 1), size), pixel(low + vec2(1, 1), size), part.x);
    var color = clamp(mix(above, below, part.y), vec3(0.0), vec3(1.0));
    if CURVED {
        let power = pow((color + 0.055) / 1.055, vec3(2.4));
        color = select(power, color / 12.92, color <= vec3(0.04045));
    }
    return vec4(color, 1.0);
}
