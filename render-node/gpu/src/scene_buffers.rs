//! Uploads a scene's columns to the device, once.
//!
//! Scenes without shading columns or harmonics pay nothing for them. The buffers store centers with the transforms
//! of the units, computed in f64, relative to the middle of a distant scene.

use std::cell::Cell;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use bytemuck::Pod;
use glam::{DMat3, DVec3, Vec3, Vec4};
use half::f16;
use rayon::prelude::*;
use sg_scene::affine::NormalTransform;
use sg_scene::appearance::{Appearance, UnitAppearance};
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Scene};
use sg_scene::tone::Tone;

use crate::device::Gpu;
use crate::resources::Resources;
use crate::shader_layout::{
    BLOCK, COLOR_HARMONICS, COLOR_LIT, COLOR_PALETTE, Center, Part, SURFACE_NUMBERS, Shape, Unit, shading_model_number,
};

/// Padding behind a column: its last element is read with the word after it.
const PADDING: u64 = 16;

/// Numbers of the shading columns of one Gaussian.
type Surface = [f32; SURFACE_NUMBERS as usize];

/// A scene on the device.
pub(super) struct SceneBuffers {
    pub(super) parts: Vec<PartBuffers>,
    /// A [`Part`] for each of them.
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
    /// For each unit of trained splats: its number, the palette of its file, and its Gaussians.
    trained: Vec<(usize, Vec3, Arc<Mask>)>,
}

/// Units whose colours are harmonics alone, with the palettes of their files.
fn trained(scene: &Scene) -> Vec<(usize, Vec3, Arc<Mask>)> {
    let units = scene.units.iter().enumerate();
    let trained = units.filter(|(_, u)| u.gaussians.shading.is_none() && u.gaussians.harmonics.is_some());
    let masked = trained.map(|(k, unit)| {
        let mut mask = Mask::empty(scene.len());
        mask.select_range(unit.range());
        (k, unit.palette, Arc::new(mask))
    });
    masked.collect()
}

/// A range of Gaussians; each of its columns fits one binding.
pub(super) struct PartBuffers {
    part: Part,
    uniform: wgpu::Buffer,
    /// [`Center`]s.
    centers: wgpu::Buffer,
    /// [`Shape`]s.
    shapes: wgpu::Buffer,
    /// [`Surface`]s, in full or half precision.
    surfaces: wgpu::Buffer,
    /// Coefficients, in full or half precision.
    harmonics: wgpu::Buffer,
}

impl PartBuffers {
    /// Number of blocks of the list.
    pub(super) fn blocks(&self) -> u32 {
        self.part.count.div_ceil(BLOCK)
    }

    /// The buffers by name.
    pub(super) fn resources(&self) -> Resources<'_> {
        Resources::of([
            ("part", &self.uniform),
            ("centers", &self.centers),
            ("shapes", &self.shapes),
            ("surfaces", &self.surfaces),
            ("harmonics", &self.harmonics),
        ])
    }
}

/// Columns of a range of Gaussians that every scene has.
struct Columns {
    centers: Vec<Center>,
    shapes: Vec<Shape>,
    /// Number of Gaussians with a NaN or infinite attribute.
    non_finite: usize,
}

impl SceneBuffers {
    /// Uploads; `half` stores shading columns and harmonics in half precision.
    pub(super) fn upload(gpu: &Gpu, scene: &Scene, half: bool) -> Self {
        let origin = origin(scene);
        let lit = scene.has_shading();
        let degree = scene
            .units
            .iter()
            .filter(|u| u.gaussians.shading.is_none())
            .filter_map(|u| u.gaussians.harmonics.as_ref().map(|h| i32::from(h.degree)))
            .max()
            .unwrap_or(-1);
        let coefficients = if degree < 0 { 0 } else { 3 * ((degree + 1) * (degree + 1)) as usize };
        let number = if half { size_of::<f16>() } else { size_of::<f32>() };
        let surface = if lit { SURFACE_NUMBERS as usize } else { 0 };
        // The widest column limits the range of a binding. Ranges hold whole blocks.
        let widest = size_of::<Shape>().max(number * surface.max(coefficients)) as u64;
        let block = BLOCK as usize;
        let most = ((gpu.largest_binding() - PADDING) / widest) as usize / block * block;
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
            trained: trained(scene),
        };
        for first in (0..scene.len()).step_by(most.max(block)) {
            let end = (first + most.max(block)).min(scene.len());
            buffers.upload_part(gpu, scene, first..end, coefficients);
        }
        let table: Vec<Part> = buffers.parts.iter().map(|p| p.part).collect();
        buffers.part_table = gpu.table("parts", &table);
        buffers
    }

    /// The appearance with the palettes of trained splats as colours of their Gaussians, below those of all edits
    /// ([`BaseUnit::tint`]). `None` where each palette is the file's own.
    pub(super) fn tinted(&self, appearance: &Appearance) -> Option<Appearance> {
        let tint = |(unit, own, mask): &(usize, Vec3, Arc<Mask>)| {
            let palette = appearance.base.get(*unit)?.palette;
            let (mask, color) = (Arc::clone(mask), Some(palette));
            (palette != *own).then_some(UnitAppearance {
                mask,
                color,
                opacity: 1.0,
                visible: true,
                tone: Tone::NEUTRAL,
            })
        };
        let tints: Vec<UnitAppearance> = self.trained.iter().filter_map(tint).collect();
        (!tints.is_empty()).then(|| {
            let units = tints.into_iter().chain(appearance.units.iter().cloned()).collect();
            Appearance { units, ..appearance.clone() }
        })
    }

    /// Whether shaders and buffers for `other` fit this scene.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let kind = |s: &Self| (s.len, s.parts.len(), s.units.len(), s.blocks, s.lit, s.highlights, s.degree, s.half);
        kind(self) == kind(other)
    }

    fn upload_part(&mut self, gpu: &Gpu, scene: &Scene, range: Range<usize>, coefficients: usize) {
        let part = Part {
            first: range.start as u32,
            count: range.len() as u32,
            index: self.parts.len() as u32,
            first_block: self.blocks,
        };
        let bytes = Cell::new(0);
        let upload = |label: &str, column: &[u8]| {
            bytes.set(bytes.get() + column.len() as u64);
            let buffer = gpu.storage(label, column.len() as u64 + PADDING);
            gpu.queue.write_buffer(&buffer, 0, column);
            buffer
        };
        let (columns, surfaces) = match (self.lit, self.half) {
            (false, _) => {
                let (columns, _) = Columns::of(scene, range.clone(), self.origin, |_| ());
                (columns, upload("surfaces", &[]))
            }
            (true, false) => {
                let (columns, surfaces) = Columns::of(scene, range.clone(), self.origin, |surface| surface);
                (columns, upload("surfaces", bytemuck::cast_slice(&surfaces)))
            }
            (true, true) => {
                let half = |surface: Surface| surface.map(f16::from_f32);
                let (columns, surfaces) = Columns::of(scene, range.clone(), self.origin, half);
                (columns, upload("surfaces", bytemuck::cast_slice(&surfaces)))
            }
        };
        let harmonics = match (coefficients, self.half) {
            (0, _) => upload("harmonics", &[]),
            (_, false) => {
                let column: Vec<f32> = harmonics(scene, range, coefficients, |x| x);
                upload("harmonics", bytemuck::cast_slice(&column))
            }
            (_, true) => {
                let column: Vec<f16> = harmonics(scene, range, coefficients, f16::from_f32);
                upload("harmonics", bytemuck::cast_slice(&column))
            }
        };
        self.parts.push(PartBuffers {
            uniform: gpu.uniform("part", &part),
            centers: upload("centers", bytemuck::cast_slice(&columns.centers)),
            shapes: upload("shapes", bytemuck::cast_slice(&columns.shapes)),
            surfaces,
            harmonics,
            part,
        });
        self.blocks += part.count.div_ceil(BLOCK);
        self.non_finite += columns.non_finite;
        self.bytes += bytes.get();
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
    Unit {
        shading_model: shading_model_number(unit.shading),
        color_source: if unit.gaussians.shading.is_some() {
            COLOR_LIT
        } else if unit.gaussians.harmonics.is_some() {
            COLOR_HARMONICS
        } else {
            COLOR_PALETTE
        },
        visible: 1,
        compensated: u32::from(unit.gaussians.antialiased),
        ..Unit::of_transform(unit.transform)
    }
}

impl Columns {
    /// The columns of a range of Gaussians, and their surfaces as `surface` stores them. One pass over the scene's columns
    /// fills all of them.
    fn of<S: Send>(
        scene: &Scene,
        range: Range<usize>,
        origin: DVec3,
        surface: impl Fn(Surface) -> S + Sync,
    ) -> (Self, Vec<S>) {
        let non_finite = AtomicUsize::new(0);
        let gaussian = |i| {
            let index = unit_index(scene, i);
            let unit = scene.units.get(index as usize);
            let (center, shape, numbers) =
                unit.and_then(|unit| stored(unit, i - unit.first, origin, index)).unwrap_or_else(|| {
                    non_finite.fetch_add(1, Ordering::Relaxed);
                    invisible(index)
                });
            ((center, shape), surface(numbers))
        };
        let ((centers, shapes), surfaces) = range.into_par_iter().map(gaussian).unzip();
        (Self { centers, shapes, non_finite: non_finite.into_inner() }, surfaces)
    }
}

/// Largest standard deviation of a stored Gaussian. Beyond 2¹²⁶ Vulkan leaves open how far a quotient is off, and graphics cards give
/// zero. No picture tells larger ones from this.
const LARGEST_SCALE: f32 = 1e36;

/// Gaussian `i` of a unit; `None` if an attribute is NaN or infinite.
fn stored(unit: &BaseUnit, i: usize, origin: DVec3, index: u32) -> Option<(Center, Shape, Surface)> {
    let g = &unit.gaussians;
    let position = g.position.get(i)?;
    let scale = g.log_scale.get(i)?.as_dvec3().exp().as_vec3();
    let scale = if scale.is_finite() { scale.min(Vec3::splat(LARGEST_SCALE)) } else { scale };
    let rotation = g.rotation.get(i)?;
    let logit = g.opacity_logit.get(i)?;
    let center = (unit.transform.transform_point3(position.as_dvec3()) - origin).as_vec3();
    let opacity = (1.0 / (1.0 + (-f64::from(*logit)).exp())) as f32;
    let surface = match &g.shading {
        None => Surface::default(),
        Some(s) => {
            let normal = NormalTransform::of(DMat3::from_mat4(unit.transform)).apply(s.normal.get(i)?.as_dvec3());
            let ([r, g, b], [x, y, z]) = (s.offset_color.get(i)?.to_array(), normal.as_vec3().to_array());
            let factors = [s.ambient.get(i)?, s.diffuse.get(i)?, s.specular.get(i)?, s.shininess.get(i)?];
            let [ka, kd, ks, shininess] = factors.map(|x| *x);
            [r, g, b, x, y, z, ka, kd, ks, shininess]
        }
    };
    let finite = position.is_finite()
        && center.is_finite()
        && scale.is_finite()
        && rotation.iter().all(|q| q.is_finite())
        && opacity.is_finite()
        && surface.iter().all(|x| x.is_finite());
    let rotation = g.unit_rotation(i).as_quat().into();
    finite.then_some((Center { position: center, opacity }, Shape { rotation, scale, unit: index }, surface))
}

/// A Gaussian that no pass draws.
fn invisible(index: u32) -> (Center, Shape, Surface) {
    let shape = Shape { rotation: Vec4::W, scale: Vec3::ZERO, unit: index };
    (Center::default(), shape, Surface::default())
}

/// Harmonics of a range of Gaussians as `number` stores them, padded with zeros to the scene's degree and to whole words.
fn harmonics<T: Pod + Send + Sync>(
    scene: &Scene,
    range: Range<usize>,
    coefficients: usize,
    number: impl Fn(f32) -> T + Sync,
) -> Vec<T> {
    let numbers = coefficients * range.len();
    let padded = (numbers * size_of::<T>()).next_multiple_of(size_of::<u32>()) / size_of::<T>();
    let mut column = vec![T::zeroed(); padded];
    column.par_chunks_exact_mut(coefficients).zip(range).for_each(|(to, i)| {
        let Some((unit, local)) = scene.locate(i) else { return };
        let Some(h) = &unit.gaussians.harmonics else { return };
        let dc = h.dc.get(local).copied().unwrap_or_default();
        let k = h.rest_per_gaussian();
        let rest = h.rest.get(local * k..(local + 1) * k).unwrap_or_default();
        let values = std::iter::once(&dc).chain(rest).flatten();
        to.iter_mut().zip(values).for_each(|(to, x)| *to = number(*x));
    });
    column
}
