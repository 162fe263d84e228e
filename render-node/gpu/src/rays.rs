//! The passes of the view-consistent mode: tiles listed in the order of the rays through them, layers put in order on each ray.
//!
//! A layer waits for those that may lie before it until there is no room for more that wait. Those that wait are written out one by one
//! rather than looped over, so that they may stay in registers, and because a device made of processor cores counts rounds.

use super::device::Gpu;
use super::kernel::{Kernel, module};
use super::passes::tiles_of;

/// Edge of a tile in pixels. In a tile of 16 the order on one ray differs so much from that of another that 64 layers that wait
/// do not mend it on a trained scene, and lists are longer.
pub(super) const EDGE: u32 = 8;

/// Vectors of a splat's tint: a colour, and what rays meet.
pub(super) const TINT: u64 = 3;

/// How layers of one ray are put in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Waiting {
    /// Layers that wait at a time.
    pub(super) layers: usize,
    /// One over the opacity that may come too late for its place. Where more does, the list is gone through as often as it
    /// takes, the next nearest each time.
    pub(super) parts: u32,
}

/// Compute passes that take the place of three of the affine mode, and two more.
pub(super) struct RayPasses {
    pub(super) touch: Kernel,
    pub(super) list: Kernel,
    pub(super) measure: Kernel,
    pub(super) order: Kernel,
    pub(super) blend: Kernel,
}

impl RayPasses {
    /// For one way of waiting, with the depth of each pixel's front or without.
    pub(super) fn new(gpu: &Gpu, waiting: Waiting, depths: bool) -> Self {
        let text = [&waiting_room(waiting), &tiles_of(EDGE), include_str!("shaders/ray_tiles.wgsl")].concat();
        let shader = module(gpu, "tiles, by ray", &text);
        let kernel = |entry| Kernel::new(gpu, &shader, entry, &[]);
        Self {
            touch: kernel("touch"),
            list: kernel("list_pairs"),
            measure: kernel("measure_rays"),
            order: kernel("order_rays"),
            blend: Kernel::new(gpu, &shader, "blend_rays", &[("DEPTHS", f64::from(u8::from(depths)))]),
        }
    }
}

/// Layers that wait in order of depth, and what is done with them. `wait_with` takes one more up and gives the nearest away,
/// `keep_nearest` takes one up and forgets the deepest; of equal depths the one that came first is the nearer.
fn waiting_room(Waiting { layers, parts }: Waiting) -> String {
    let slots = |text: &dyn Fn(usize) -> String| (0..layers).map(text).collect::<String>();
    let up = |text: &dyn Fn(usize) -> String| (0..layers).rev().map(text).collect::<String>();
    let last = layers.saturating_sub(1);
    [
        "// No layer is deeper.\nconst FARTHEST: f32 = 3e38;\n".to_owned(),
        format!("const LATE: f32 = {:?};\n", 1.0 / f64::from(parts)),
        "struct Ray { color: vec3<f32>, transmittance: f32, front: f32 }\n".to_owned(),
        "struct Layer { depth: f32, alpha: f32, item: u32 }\n".to_owned(),
        format!("struct Waiting {{ {} }}\n", slots(&|k| format!("at{k}: Layer, "))),
        "fn nobody_before() -> Waiting { var none: Waiting; return none; }\n".to_owned(),
        "fn nobody() -> Waiting {\n    let none = Layer(FARTHEST, 0.0, 0u);\n    var all: Waiting;\n".to_owned(),
        slots(&|k| format!("    all.at{k} = none;\n")),
        "    return all;\n}\n".to_owned(),
        "fn wait_with(waiting: ptr<function, Waiting>, given: Layer) -> Layer {\n    var one = given;\n".to_owned(),
        up(&|k| swap(k, ">=")),
        "    return one;\n}\n".to_owned(),
        "fn keep_nearest(waiting: ptr<function, Waiting>, given: Layer) {\n    var one = given;\n".to_owned(),
        slots(&|k| swap(k, "<")),
        "}\n".to_owned(),
        "fn pour(ray: ptr<function, Ray>, waiting: ptr<function, Waiting>) {\n".to_owned(),
        slots(&|k| format!("    blend_layer(ray, (*waiting).at{k});\n")),
        "}\n".to_owned(),
        format!("fn deepest(waiting: ptr<function, Waiting>) -> Layer {{ return (*waiting).at{last}; }}\n"),
    ]
    .concat()
}

/// Puts `one` in the place of who waits at `k` and that in its place, where its depth compares so.
fn swap(k: usize, compares: &str) -> String {
    format!(
        "    let held{k} = (*waiting).at{k};\n    if one.depth {compares} held{k}.depth {{ (*waiting).at{k} = one; one = held{k}; }}\n"
    )
}
