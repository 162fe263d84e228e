// Follows quads.wgsl: the mean depth of what is blended, in a smaller picture of the same view. COARSE, the pixels of the picture's
// edge that one pixel of this stands for, stands before this text.

@vertex
fn corner_depth(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    var out = corner_in(VIEW, vertex, instance);
    out.color = vec3(levels[VIEW * frame.capacity + order[instance]].w, 0.0, 0.0);
    return out;
}

@fragment
fn blend_depth(in: Corner) -> @location(0) vec4<f32> {
    let across = vec2<f32>(frame.size) / vec2<f32>((frame.size + COARSE - 1u) / COARSE);
    return layer(in.position.xy * across, in);
}
