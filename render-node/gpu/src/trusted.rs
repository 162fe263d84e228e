//! The calls of wgpu that trust their caller. The one file of this package with calls that the compiler cannot check.
#![allow(
    unsafe_code,
    reason = "wgpu trusts the caller for what its own checks cost: the shaders of this package and its own cache of pipelines"
)]

/// Checks that wgpu adds to our shaders. Accesses to buffers and arrays stay within bounds, since their numbers come from files.
/// Every loop of our shaders counts towards a limit that its body leaves alone, and every divisor is at least 1. So loops need
/// no counter of wgpu's own, and divisions no test for zero.
pub(super) const CHECKS: wgpu::ShaderRuntimeChecks = wgpu::ShaderRuntimeChecks {
    bounds_checks: true,
    force_loop_bounding: false,
    ray_query_initialization_tracking: true,
    task_shader_dispatch_tracking: true,
    mesh_shader_primitive_indices_clamp: true,
    int_div_checks: false,
};

/// A module of a shader of this package, with [`CHECKS`] only.
pub(super) fn shader_module(device: &wgpu::Device, label: &str, text: String) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(text.into());
    let descriptor = wgpu::ShaderModuleDescriptor { label: Some(label), source };
    // SAFETY: only texts of this package come here. None has an endless loop or a division of integers by zero, see `CHECKS`.
    unsafe { device.create_shader_module_trusted(descriptor, CHECKS) }
}

/// A cache of compiled pipelines that begins with the bytes of an earlier one, as [`wgpu::PipelineCache::get_data`] gave them.
pub(super) fn pipeline_cache(device: &wgpu::Device, bytes: Option<&[u8]>) -> wgpu::PipelineCache {
    let descriptor = wgpu::PipelineCacheDescriptor { label: Some("pipelines"), data: bytes, fallback: true };
    // SAFETY: the bytes carry the hash with which this program stored them, in a folder of this user alone. wgpu and the driver
    // compare device and version.
    unsafe { device.create_pipeline_cache(&descriptor) }
}
