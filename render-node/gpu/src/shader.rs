//! Shader modules, and the resources that their entry points use.

use std::collections::HashMap;

use wgpu::naga::front::wgsl::parse_str;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

use crate::device::Gpu;
use crate::shader_layout::declarations;

/// Functions of many passes.
const FRAME: &str = include_str!("shaders/frame.wgsl");

/// Functions of Gaussians near the eye.
const NEARNESS: &str = include_str!("shaders/nearness.wgsl");

/// A prefix sum over a workgroup.
const SCAN: &str = include_str!("shaders/workgroup_scan.wgsl");

/// A variable of a shader that stands for a resource.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Binding {
    pub(super) name: String,
    pub(super) number: u32,
}

/// A shader module.
#[derive(Debug)]
pub(super) struct Shader {
    pub(super) module: wgpu::ShaderModule,
    /// The resources of each entry point.
    uses: HashMap<String, Vec<Binding>>,
}

impl Shader {
    /// A module of the shared declarations, then `parts`. As with every error of wgpu, [`Gpu::check`] reports invalid text.
    pub(super) fn new(gpu: &Gpu, label: &str, parts: &[&str]) -> Self {
        let text = [&[&declarations(), FRAME, NEARNESS, SCAN], parts].concat().join("\n");
        let uses = resources_of(&text);
        let source = wgpu::ShaderSource::Wgsl(text.into());
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source });
        Self { module, uses }
    }

    /// The resources that these entry points use, each once.
    pub(super) fn bindings(&self, entries: &[&str]) -> Vec<Binding> {
        let mut all: Vec<Binding> = Vec::new();
        for binding in entries.iter().filter_map(|entry| self.uses.get(*entry)).flatten() {
            if !all.contains(binding) {
                all.push(binding.clone());
            }
        }
        all
    }
}

/// The resources of each entry point: those that wgpu puts into the layout of its pipeline. Empty for invalid text.
fn resources_of(text: &str) -> HashMap<String, Vec<Binding>> {
    let Ok(module) = parse_str(text) else { return HashMap::new() };
    // wgpu validates; only the analysis of uses is needed here.
    let mut validator = Validator::new(ValidationFlags::empty(), Capabilities::all());
    let Ok(analysis) = validator.validate(&module) else { return HashMap::new() };
    let uses = |(k, entry): (usize, &wgpu::naga::EntryPoint)| {
        let used = analysis.get_entry_point(k);
        let variables = module.global_variables.iter().filter(|(handle, _)| !used[*handle].is_empty());
        let bindings = variables.filter_map(|(_, variable)| {
            Some(Binding { name: variable.name.clone()?, number: variable.binding.as_ref()?.binding })
        });
        (entry.name.clone(), bindings.collect())
    };
    module.entry_points.iter().enumerate().map(uses).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_point_has_the_resources_that_it_and_its_functions_use() {
        let text = "
            @group(0) @binding(4) var<storage, read> first: array<u32>;
            @group(0) @binding(2) var<storage, read_write> second: array<u32>;
            @group(0) @binding(7) var<storage, read> third: array<u32>;
            fn indirect() -> u32 { return first[0]; }
            @compute @workgroup_size(1) fn both() { second[0] = indirect(); }
            @compute @workgroup_size(1) fn one() { second[0] = 1u; }
            @compute @workgroup_size(1) fn none() {}
        ";
        let uses = resources_of(text);
        let names = |entry: &str| uses[entry].iter().map(|b| (b.name.as_str(), b.number)).collect::<Vec<_>>();
        assert_eq!(names("both"), [("first", 4), ("second", 2)]);
        assert_eq!(names("one"), [("second", 2)]);
        assert_eq!(names("none"), []);
    }
}
