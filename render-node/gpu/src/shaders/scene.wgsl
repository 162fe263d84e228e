// One part of the scene with its edits, as the passes that go through its Gaussians see it.

override MASKS: bool = false;
override CLIPS: bool = false;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> centers: array<Center>;
@group(0) @binding(3) var<storage, read> shapes: array<Shape>;
@group(0) @binding(4) var<storage, read> units: array<Unit>;
@group(0) @binding(5) var<storage, read> edits: array<Edit>;
@group(0) @binding(6) var<storage, read> masks: array<u32>;
@group(0) @binding(19) var<storage, read> clip_sides: array<ClipSide>;

// Whether the Gaussian of this scene-wide index is in the mask of edit k.
fn in_mask(k: u32, global: u32) -> bool {
    let word = masks[k * frame.mask_words + (global >> 5u)];
    return ((word >> (global & 31u)) & 1u) == 1u;
}
