// Follows full_screen.wgsl: copies a picture onto a surface or a headset's image, its numbers unchanged or with the last step of
// finish.rs.

// Whether the target is sRGB: it encodes linear values on its own.
override CURVED: bool = false;

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> last_step: LastStep;

fn pixel(at: vec2<i32>, size: vec2<i32>) -> vec4<f32> {
    return textureLoad(picture, clamp(at, vec2(0), size - 1), 0);
}

// Twin of threshold() in finish.rs.
fn threshold(at: vec2<u32>, channel: u32) -> f32 {
    let place = at.x * 0xc13fa9a9u + at.y * 0x91e10da6u + channel * 0x55555555u;
    return 1.0 / 64.0 + 31.0 / 32.0 * ((f32(place >> 8u) + 0.5) / 16777216.0);
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
    let seen = mix(above, below, part.y);
    var color = seen.xyz;
    if last_step.gradient == 1u {
        color += (1.0 - seen.w) * (mix(last_step.top, last_step.bottom, in.at.y) - last_step.plain);
    }
    color = clamp(color, vec3(0.0), vec3(1.0));
    if last_step.dither == 1u {
        // The target rounds.
        let here = vec2<u32>(in.position.xy);
        let u = vec3(threshold(here, 0u), threshold(here, 1u), threshold(here, 2u));
        color = clamp(color + (u - 0.5) / 255.0, vec3(0.0), vec3(1.0));
    }
    if CURVED {
        let power = pow((color + 0.055) / 1.055, vec3(2.4));
        color = select(power, color / 12.92, color <= vec3(0.04045));
    }
    return vec4(color, 1.0);
}
