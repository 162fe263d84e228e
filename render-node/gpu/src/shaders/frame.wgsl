// Numbers of a frame for every pass. Mirrors `FrameUniform` of shader_layout.rs word for word.

struct View {
    // Rows of the rotation from the scene frame to the camera frame (x right, y down, z forward). Their fourth
    // numbers are the rounding rests of the eye's coordinates.
    right: vec4<f32>,
    down: vec4<f32>,
    forward: vec4<f32>,
    // Position of the eye relative to the origin of the stored centers.
    eye: vec4<f32>,
    // Focal lengths and principal point, pixels.
    lens: vec4<f32>,
}

struct Frame {
    views: array<View, 2>,
    // Eye of the shared shading; w is 1 if shading is shared.
    shading_eye: vec4<f32>,
    // Unit vector towards the light, or zero; unused for a headlight.
    light: vec4<f32>,
    // Highlight: colour, and its share.
    overlay: vec4<f32>,
    // Background colour, and the highlight's factor on the opacity.
    background: vec4<f32>,
    // Least alpha that is drawn, its ratio to a faint opacity, transmittance at which a pixel is finished, near plane.
    limits: vec4<f32>,
    size: vec2<u32>,
    tiles: vec2<u32>,
    view_count: u32,
    // Gaussians that may be visible at once.
    capacity: u32,
    // Pairs of a Gaussian and a tile that are listed at once.
    pair_capacity: u32,
    // Editable units with a mask.
    edits: u32,
    // Words of one mask.
    mask_words: u32,
    clips: u32,
    spare: vec2<u32>,
}

// One stretch of a long job: Gaussians of one set of buffers, or pairs of one window.
struct Part {
    // First Gaussian by scene-wide index, or first pair.
    first: u32,
    count: u32,
    // Index of the part, and of its first block of Gaussians.
    index: u32,
    block: u32,
}

// A base unit.
struct Unit {
    // Columns of the linear part of its transform; w of the first is its greatest stretch.
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    // Columns of the inverse, for the direction that its harmonics are seen from.
    ix: vec4<f32>,
    iy: vec4<f32>,
    iz: vec4<f32>,
    // Palette colour, and the factor on the opacity.
    palette: vec4<f32>,
    // Factors on ka, kd, ks and the exponent.
    multipliers: vec4<f32>,
    // Shading model (0 paper, 1 as iVR-GS trains, 2 as its viewer draws), look (0 palette, 1 lit, 2 harmonics), visible,
    // whether the dilation takes as much opacity as it adds area.
    kind: vec4<u32>,
}

// An editable unit: its colour, and the factor on the opacity; kind: whether the colour counts, whether it is visible.
struct Edit {
    color: vec4<f32>,
    kind: vec4<u32>,
}

// A half-space: its normal and the least product, relative to the centres' origin. kind: number of its clip, whether the
// clip keeps its inside, whether it is the clip's last side.
struct Side {
    plane: vec4<f32>,
    kind: vec4<u32>,
}

// The eye is subtracted in two steps: first what may cancel, which is exact, then the rest.
fn away_from_eye(view: View, at: vec3<f32>) -> vec3<f32> {
    return (at - view.eye.xyz) - vec3(view.right.w, view.down.w, view.forward.w);
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
