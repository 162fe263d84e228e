//! Uploads a scene's columns to the device, once.
//!
//! Scenes without shading columns or harmonics pay nothing for them. The buffers store centers with the transforms
//! of the units, computed in f64, relative to the middle of a distant scene.

use glam::{DMat3, DVec3, Vec3, Vec4};
use half::f16;
use rayon::prelude::*;
use sg_scene::model::{BaseUnit, Scene};

use crate::device::Gpu;
use crate::shader_layout::{ColorSource, Part, Unit, shading_model_number};
use sg_raster::shading::NormalTransform;

/// Gaussians of one block of the list.
pub(super) const BLOCK: usize = 1024;

/// Padding behind a column: its last element is read with the word after it.
const PADDING: u64 = 16;

/// Words of the shading columns of one Gaussian, in full and in half precision.
const SURFACE: [usize; 2] = [10, 5];

/// A scene on the device.
pub(super) struct SceneBuffers {
    pub(super) parts: Vec<PartBuffers>,
    pub(super) part_table: wgpu::Buffer,
    pub(super) units: Vec<Unit>,
    /// Origin of the stored centers in the scene frame.
    pub(super) origin: DVec3,
    pub(super) len: usize,
    pub(super) blocks: u32,
    pub(super) lit: bool,
    pub(super) highlights: bool,
    /// −1 without harmonics.
    pub(super) degree: i32,
    pub(super) half: bool,
    /// Number of Gaussians with a NaN or infinite attribute, stored with opacity 0.
    pub(super) non_finite: usize,
    /// Bytes on the device.
    pub(super) bytes: u64,
}

/// A range of Gaussians; each of its columns fits one binding.
pub(super) struct PartBuffers {
    pub(super) part: Part,
    pub(super) uniform: wgpu::Buffer,
    pub(super) centers: wgpu::Buffer,
    pub(super) shapes: wgpu::Buffer,
    pub(super) surfaces: wgpu::Buffer,
    pub(super) harmonics: wgpu::Buffer,
}

/// The stored attributes of one Gaussian.
struct Row {
    center: Vec4,
    shape: [Vec4; 2],
    surface: [f32; 10],
    finite: bool,
}

impl SceneBuffers {
    /// Uploads; `half` stores shading columns and harmonics in half precision.
    pub(super) fn upload(gpu: &Gpu, scene: &Scene, half: bool) -> Self {
        let origin = origin(scene);
        let lit = scene.units.iter().any(|u| u.gaussians.shading.is_some());
        let degree = scene
            .units
            .iter()
            .filter(|u| u.gaussians.shading.is_none())
            .filter_map(|u| u.gaussians.harmonics.as_ref().map(|h| i32::from(h.degree)))
            .max()
            .unwrap_or(-1);
        let surface_words = if lit { SURFACE[usize::from(half)] } else { 0 };
        let coefficients = if degree < 0 { 0 } else { 3 * ((degree + 1) * (degree + 1)) as usize };
        let harmonic_bytes = coefficients * if half { 2 } else { 4 };
        // The widest column limits the range of a binding. Ranges hold whole blocks.
        let widest = 32.max(4 * surface_words).max(harmonic_bytes) as u64;
        let most = ((gpu.largest_binding() - PADDING) / widest) as usize / BLOCK * BLOCK;
        let mut buffers = Self {
            parts: Vec::new(),
            part_table: gpu.storage("parts", 0),
            units: scene.units.iter().map(unit).collect(),
            origin,
            len: scene.len(),
            blocks: 0,
            lit,
            highlights: scene
                .units
                .iter()
                .any(|u| u.gaussians.shading.as_ref().is_some_and(|s| s.specular.iter().any(|ks| *ks != 0.0))),
            degree,
            half,
            non_finite: 0,
            bytes: 0,
        };
        for first in (0..scene.len()).step_by(most.max(BLOCK)) {
            let end = (first + most.max(BLOCK)).min(scene.len());
            buffers.upload_part(gpu, scene, first..end, [surface_words, coefficients]);
        }
        let table: Vec<Part> = buffers.parts.iter().map(|p| p.part).collect();
        buffers.part_table = gpu.storage("parts", size_of_val(table.as_slice()) as u64);
        gpu.queue.write_buffer(&buffers.part_table, 0, bytemuck::cast_slice(&table));
        buffers
    }

    fn upload_part(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        range: std::ops::Range<usize>,
        [surface_words, coefficients]: [usize; 2],
    ) {
        let rows: Vec<Row> = range
            .clone()
            .into_par_iter()
            .map(|i| {
                let index = unit_index(scene, i);
                match scene.units.get(index as usize) {
                    Some(unit) => Row::of(unit, i - unit.first, self.origin, index),
                    None => Row::invisible(index),
                }
            })
            .collect();
        self.non_finite += rows.iter().filter(|r| !r.finite).count();
        let part = Part {
            first: range.start as u32,
            count: range.len() as u32,
            index: self.parts.len() as u32,
            block: self.blocks,
        };
        let upload = |label: &str, words: &[u8]| {
            let buffer = gpu.storage(label, words.len() as u64 + PADDING);
            gpu.queue.write_buffer(&buffer, 0, words);
            buffer
        };
        let centers: Vec<Vec4> = rows.iter().map(|r| r.center).collect();
        let shapes: Vec<Vec4> = rows.iter().flat_map(|r| r.shape).collect();
        let surfaces: Vec<u8> = match surface_words {
            0 => Vec::new(),
            5 => rows.iter().flat_map(|r| r.surface).flat_map(|x| f16::from_f32(x).to_le_bytes()).collect(),
            _ => rows.iter().flat_map(|r| r.surface).flat_map(f32::to_le_bytes).collect(),
        };
        let harmonics: Vec<u8> = if coefficients == 0 {
            Vec::new()
        } else {
            let values = range.clone().flat_map(|i| harmonics_of(scene, i, coefficients));
            if self.half {
                let mut bytes: Vec<u8> = values.flat_map(|x| f16::from_f32(x).to_le_bytes()).collect();
                bytes.resize(bytes.len().next_multiple_of(4), 0);
                bytes
            } else {
                values.flat_map(f32::to_le_bytes).collect()
            }
        };
        let uniform = gpu.buffer("part", size_of::<Part>() as u64, wgpu::BufferUsages::UNIFORM);
        gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&part));
        self.bytes += (48 * rows.len() + surfaces.len() + harmonics.len()) as u64;
        self.blocks += (rows.len() as u32).div_ceil(BLOCK as u32);
        self.parts.push(PartBuffers {
            part,
            uniform,
            centers: upload("centres", bytemuck::cast_slice(&centers)),
            shapes: upload("shapes", bytemuck::cast_slice(&shapes)),
            surfaces: upload("surfaces", &surfaces),
            harmonics: upload("harmonics", &harmonics),
        });
    }
}

/// The origin of the stored centers. It is zero if f32 can hold the centers of the file. It is the middle of the
/// finite centers, rounded to f32, if they lie so far from zero that f32 would lose digits.
fn origin(scene: &Scene) -> DVec3 {
    let (low, high) = (0..scene.len())
        .into_par_iter()
        .filter_map(|i| scene.position(i).filter(|p| p.is_finite()))
        .fold(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
        .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let middle = 0.5 * (low + high);
    let far = middle.is_finite() && middle.abs().max_element() > 16.0 * (high - low).max_element();
    if far { middle.as_vec3().as_dvec3() } else { DVec3::ZERO }
}

fn unit_index(scene: &Scene, i: usize) -> u32 {
    scene.units.partition_point(|u| u.range().end <= i) as u32
}

fn unit(unit: &BaseUnit) -> Unit {
    let source = if unit.gaussians.shading.is_some() {
        ColorSource::Lit
    } else if unit.gaussians.harmonics.is_some() {
        ColorSource::Harmonics
    } else {
        ColorSource::Palette
    };
    let model = shading_model_number(unit.shading);
    let antialiased = u32::from(unit.gaussians.antialiased);
    Unit { kind: [model, source as u32, 1, antialiased], ..Unit::of_transform(unit.transform) }
}

impl Row {
    /// Gaussian `i` of a unit.
    fn of(unit: &BaseUnit, i: usize, origin: DVec3, index: u32) -> Row {
        let g = &unit.gaussians;
        let position = g.position.get(i).copied().unwrap_or(Vec3::NAN);
        let scale = g.log_scale.get(i).copied().unwrap_or(Vec3::NAN).as_dvec3().exp().as_vec3();
        let stored = g.rotation.get(i).copied().unwrap_or([f32::NAN; 4]);
        let logit = g.opacity_logit.get(i).copied().unwrap_or(f32::NAN);
        let center = (unit.transform.transform_point3(position.as_dvec3()) - origin).as_vec3();
        let opacity = (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32;
        let surface = g.shading.as_ref().map_or(Some([0.0; 10]), |s| {
            let normal = NormalTransform::of(DMat3::from_mat4(unit.transform)).apply(s.normal.get(i)?.as_dvec3());
            let (offset, n) = (*s.offset_color.get(i)?, normal.as_vec3());
            Some([
                offset.x,
                offset.y,
                offset.z,
                n.x,
                n.y,
                n.z,
                *s.ambient.get(i)?,
                *s.diffuse.get(i)?,
                *s.specular.get(i)?,
                *s.shininess.get(i)?,
            ])
        });
        let finite = position.is_finite()
            && center.is_finite()
            && scale.is_finite()
            && stored.iter().all(|q| q.is_finite())
            && opacity.is_finite()
            && surface.is_some_and(|s| s.iter().all(|x| x.is_finite()));
        if !finite {
            return Row::invisible(index);
        }
        let q = g.unit_rotation(i);
        let rotation = Vec4::new(q.x as f32, q.y as f32, q.z as f32, q.w as f32);
        Row {
            center: center.extend(opacity),
            shape: [rotation, scale.extend(f32::from_bits(index))],
            surface: surface.unwrap_or([0.0; 10]),
            finite,
        }
    }

    /// A Gaussian that no pass draws.
    fn invisible(index: u32) -> Self {
        let shape = [Vec4::W, Vec3::ZERO.extend(f32::from_bits(index))];
        Self { center: Vec4::ZERO, shape, surface: [0.0; 10], finite: false }
    }
}

/// Harmonics of one Gaussian, padded with zeros to the scene's degree.
fn harmonics_of(scene: &Scene, i: usize, coefficients: usize) -> Vec<f32> {
    let mut values = Vec::with_capacity(coefficients);
    if let Some((unit, local)) = scene.locate(i)
        && let Some(h) = &unit.gaussians.harmonics
    {
        values.extend(h.dc.get(local).copied().unwrap_or_default());
        let k = h.rest_per_gaussian();
        let rest = h.rest.get(local * k..(local + 1) * k).unwrap_or_default();
        values.extend(rest.iter().take(coefficients / 3 - 1).flatten());
    }
    values.resize(coefficients, 0.0);
    values
}
