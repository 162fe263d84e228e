//! Shader modules, and the resources that their entry points use.

use std::collections::HashMap;
use std::sync::Arc;

use wgpu::naga::front::wgsl::parse_str;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu::naga::{AddressSpace, GlobalVariable, StorageAccess};

use crate::barriers::Access;
use crate::device::Gpu;
use crate::shader_layout::declarations;
use crate::trusted;

/// Functions of many passes.
const FRAME: &str = include_str!("shaders/frame.wgsl");

/// Functions of Gaussians near the eye.
const NEARNESS: &str = include_str!("shaders/nearness.wgsl");

/// A prefix sum over a workgroup.
const SCAN: &str = include_str!("shaders/workgroup_scan.wgsl");

/// A variable of a shader that stands for a resource.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Binding {
    pub(super) name: Arc<str>,
    pub(super) number: u32,
    /// Use of a buffer.
    pub(super) access: Option<Access>,
}

/// Text of `sum_numbers` for the buffer of a variable.
pub(super) fn running_sums(variable: &str) -> String {
    include_str!("shaders/running_sums.wgsl").replace("NUMBERS", variable)
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
        let text = text_of(parts);
        let uses = resources_of(&text);
        let module = trusted::shader_module(&gpu.device, label, text);
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

/// The shared declarations, then `parts`.
fn text_of(parts: &[&str]) -> String {
    [&[&declarations(), FRAME, NEARNESS, SCAN], parts].concat().join("\n")
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
            let (name, binding) = (variable.name.as_deref()?.into(), variable.binding.as_ref()?);
            Some(Binding { name, number: binding.binding, access: access(variable) })
        });
        (entry.name.clone(), bindings.collect())
    };
    module.entry_points.iter().enumerate().map(uses).collect()
}

fn access(variable: &GlobalVariable) -> Option<Access> {
    match variable.space {
        AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Some(Access::Write),
        AddressSpace::Storage { .. } => Some(Access::Read),
        AddressSpace::Uniform => Some(Access::Uniform),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use wgpu::naga::ShaderStage;
    use wgpu::naga::back::pipeline_constants::process_overrides;
    use wgpu::naga::back::spv;

    use super::*;

    /// Instructions of SPIR-V that one entry point becomes.
    fn instructions(text: &str, entry: &str, checks: wgpu::ShaderRuntimeChecks) -> usize {
        let module = parse_str(text).unwrap();
        let info = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).unwrap();
        let stage = ShaderStage::Compute;
        let constants = Default::default();
        let (module, info) = process_overrides(&module, &info, Some((stage, entry)), &constants).unwrap();
        let options = spv::Options {
            force_loop_bounding: checks.force_loop_bounding,
            emit_int_div_checks: checks.int_div_checks,
            ..spv::Options::default()
        };
        let pipeline = spv::PipelineOptions { shader_stage: stage, entry_point: entry.to_owned() };
        let words = spv::write_vec(&module, &info, &options, Some(&pipeline)).unwrap();
        // Behind the header of five words, each instruction begins with its length.
        let (mut at, mut count) = (5, 0);
        while let Some(word) = words.get(at) {
            at += (word >> 16) as usize;
            count += 1;
        }
        count
    }

    #[test]
    fn our_shaders_have_no_checks_of_loops_and_divisions() {
        let tiles = text_of(&[&crate::tile_shader::source(16, crate::textures::PicturePrecision::Full)]);
        let sort = text_of(&[&crate::radix_sort::source("listed")]);
        let entries = ["touch", "list_pairs", "list_large", "blend", "blend_staged"].map(|entry| (&tiles, entry));
        for (text, entry) in entries.into_iter().chain(["count", "scatter"].map(|entry| (&sort, entry))) {
            let [checked, ours] =
                [wgpu::ShaderRuntimeChecks::checked(), trusted::CHECKS].map(|checks| instructions(text, entry, checks));
            assert!(ours < checked, "{entry}: {ours} of {checked}");
        }
    }

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
        let names = |entry: &str| uses[entry].iter().map(|b| (&*b.name, b.number)).collect::<Vec<_>>();
        assert_eq!(names("both"), [("first", 4), ("second", 2)]);
        assert_eq!(names("one"), [("second", 2)]);
        assert_eq!(names("none"), []);
    }
}
