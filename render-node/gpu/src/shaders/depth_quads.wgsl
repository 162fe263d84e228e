// Follows quads.wgsl: the weighted mean depth of all layers, at a lower resolution.

@vertex
fn corner_depth(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    var out = corner_in(VIEW, vertex, instance);
    out.color = vec3(levels[VIEW * frame.capacity + depth_order[instance]].depth, 0.0, 0.0);
    return out;
}

@fragment
fn blend_depth(in: Corner) -> @location(0) vec4<f32> {
    let across = vec2<f32>(frame.size) / vec2<f32>((frame.size + COARSE - 1u) / COARSE);
    return layer(in.position.xy * across, in);
}
