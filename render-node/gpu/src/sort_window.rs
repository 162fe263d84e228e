//! The sort window (k-buffer) of the ray-consistent mode, generated as shader text.
//!
//! A layer stays in the window until the window is full. The text unrolls all slots, so that they may stay in
//! registers.

/// The order of layers on one ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct SortWindow {
    /// Number of layers in the window.
    pub(super) layers: usize,
    /// Reciprocal of the opacity that may be blended out of order. Above it, the shader repeats passes over the list and
    /// takes the next nearest layers each time.
    pub(super) late_parts: u32,
}

impl SortWindow {
    /// Shader text of the window. `wait_with` inserts a layer and returns the nearest one. `keep_nearest` inserts a
    /// layer and drops the deepest one. Of equal depths the earlier layer is the nearer one.
    pub(super) fn source(self) -> String {
        let Self { layers, late_parts } = self;
        let slots = |text: &dyn Fn(usize) -> String| (0..layers).map(text).collect::<String>();
        let up = |text: &dyn Fn(usize) -> String| (0..layers).rev().map(text).collect::<String>();
        let last = layers.saturating_sub(1);
        [
            "// No layer is deeper.\nconst EMPTY_DEPTH: f32 = 3e38;\n".to_owned(),
            format!("const LATE: f32 = {:?};\n", 1.0 / f64::from(late_parts)),
            "struct Layer { depth: f32, alpha: f32, item: u32 }\n".to_owned(),
            format!("struct Waiting {{ {} }}\n", slots(&|k| format!("at{k}: Layer, "))),
            "fn nobody_before() -> Waiting { var none: Waiting; return none; }\n".to_owned(),
            "fn nobody() -> Waiting {\n    let none = Layer(EMPTY_DEPTH, 0.0, 0u);\n    var all: Waiting;\n".to_owned(),
            slots(&|k| format!("    all.at{k} = none;\n")),
            "    return all;\n}\n".to_owned(),
            "fn wait_with(waiting: ptr<function, Waiting>, given: Layer) -> Layer {\n    var one = given;\n".to_owned(),
            up(&|k| swap(k, ">=")),
            "    return one;\n}\n".to_owned(),
            "fn keep_nearest(waiting: ptr<function, Waiting>, given: Layer) {\n    var one = given;\n".to_owned(),
            slots(&|k| swap(k, "<")),
            "}\n".to_owned(),
            "fn pour(ray: ptr<function, Blended>, waiting: ptr<function, Waiting>) {\n".to_owned(),
            slots(&|k| format!("    blend_layer(ray, (*waiting).at{k});\n")),
            "}\n".to_owned(),
            format!("fn deepest(waiting: ptr<function, Waiting>) -> Layer {{ return (*waiting).at{last}; }}\n"),
        ]
        .concat()
    }
}

/// Swaps `one` with slot `k` if the comparison of their depths holds.
fn swap(k: usize, comparison: &str) -> String {
    format!(
        "    let held{k} = (*waiting).at{k};\n    if one.depth {comparison} held{k}.depth {{ (*waiting).at{k} = one; one = held{k}; }}\n"
    )
}
