
// Follows quads.wgsl on devices with multiview.

@vertex
fn corner_together(
    @builtin(view_index) view: u32,
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> Corner {
    return corner_in(view, vertex, instance);
}
