// Follows hidden.wgsl where the device can draw to both eyes at once.

@vertex
fn hide_together(@builtin(view_index) view: u32, @builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return corner_in(view, vertex);
}
