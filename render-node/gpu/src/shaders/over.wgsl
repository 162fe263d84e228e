// A pixel's blended color over the background.

fn over(color: vec3<f32>, transmittance: f32) -> vec4<f32> {
    return vec4(color + transmittance * frame.background, 1.0 - transmittance);
}
