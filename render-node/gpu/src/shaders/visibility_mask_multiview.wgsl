// Follows visibility_mask.wgsl on devices with multiview.

@vertex
fn hide_together(@builtin(view_index) view: u32, @builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return corner_in(view, vertex);
}
