//! Resources of passes. A pass finds each one by the name of its variable in the shader.

use crate::created::count_created;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::recorded::BoundBuffer;
use crate::shader::Binding;

/// Buffers and textures by name.
#[derive(Debug, Clone, Default)]
pub(super) struct Resources<'a>(Vec<(&'static str, wgpu::BindingResource<'a>)>);

impl<'a> Resources<'a> {
    /// Buffers by name.
    pub(super) fn of<const N: usize>(buffers: [(&'static str, &'a wgpu::Buffer); N]) -> Self {
        Self(buffers.map(|(name, buffer)| (name, buffer.as_entire_binding())).into())
    }

    /// One texture.
    pub(super) fn of_texture(name: &'static str, view: &'a wgpu::TextureView) -> Self {
        Self::of_textures([(name, view)])
    }

    /// Textures by name.
    pub(super) fn of_textures<const N: usize>(views: [(&'static str, &'a wgpu::TextureView); N]) -> Self {
        Self(views.map(|(name, view)| (name, wgpu::BindingResource::TextureView(view))).into())
    }

    /// These resources and `others`. A later resource replaces an earlier one of the same name.
    pub(super) fn and<'b>(&self, others: &Resources<'b>) -> Resources<'b>
    where
        'a: 'b,
    {
        Resources(self.0.iter().chain(&others.0).cloned().collect())
    }

    /// These resources and `buffers`. A later resource replaces an earlier one of the same name.
    pub(super) fn with<'b, const N: usize>(&self, buffers: [(&'static str, &'b wgpu::Buffer); N]) -> Resources<'b>
    where
        'a: 'b,
    {
        self.and(&Resources::of(buffers))
    }

    /// A bind group of those resources that a pass uses. [`Gpu::check`] reports [`GpuError::Unbound`] if one of them is missing.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        pass: &'static str,
        layout: &wgpu::BindGroupLayout,
        bindings: &[Binding],
    ) -> wgpu::BindGroup {
        let entry = |binding: &Binding| {
            let found = self.0.iter().rev().find(|(name, _)| *name == &*binding.name);
            if found.is_none() {
                gpu.report(GpuError::Unbound { pass, resource: binding.name.to_string() });
            }
            found.map(|(_, resource)| wgpu::BindGroupEntry { binding: binding.number, resource: resource.clone() })
        };
        count_created(|created| created.bind_groups += 1);
        let entries: Vec<wgpu::BindGroupEntry> = bindings.iter().filter_map(entry).collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(pass), layout, entries: &entries })
    }

    /// The buffers among them that a pass uses.
    pub(super) fn buffers(&self, bindings: &[Binding]) -> Vec<BoundBuffer> {
        let bound = |binding: &Binding| {
            let (_, resource) = self.0.iter().rev().find(|(name, _)| *name == &*binding.name)?;
            let wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, .. }) = resource else { return None };
            Some(BoundBuffer { variable: binding.name.clone(), access: binding.access?, buffer: (*buffer).clone() })
        };
        bindings.iter().filter_map(bound).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::pipeline::Kernel;
    use crate::shader::Shader;

    #[test]
    fn a_missing_resource_is_named() {
        let Some(gpu) = test_device() else { return };
        let text = "
            @group(0) @binding(3) var<storage, read> given: array<u32>;
            @group(0) @binding(1) var<storage, read_write> made: array<u32>;
            @compute @workgroup_size(1) fn copy() { made[0] = given[0]; }
        ";
        let kernel = Kernel::new(&gpu, &Shader::new(&gpu, "test", &[text]), "copy", &[]);
        let buffer = gpu.storage("test", 16);
        let whole = Resources::of([("given", &buffer)]);
        let made = gpu.storage("test", 16);
        kernel.bind(&gpu, &whole.with([("made", &made), ("unused", &made)]));
        assert!(gpu.check().is_ok());
        kernel.bind(&gpu, &whole);
        match gpu.check() {
            Err(GpuError::Unbound { pass, resource }) => assert_eq!((pass, resource.as_str()), ("copy", "made")),
            other => panic!("{other:?}"),
        }
    }
}
