// Functions of many passes. The declarations of shader_layout.rs stand before this text.

// The eye is subtracted in two steps: first what may cancel, which is exact, then the rest.
fn away_from_eye(view: View, at: vec3<f32>) -> vec3<f32> {
    return (at - view.eye) - view.eye_rest;
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
