//! The compressed PLY of SuperSplat and PlayCanvas: 16 bytes a Gaussian, plus harmonics of a byte each.
//!
//! `element chunk` holds the ranges of 256 Gaussians: position, logarithm of the scale and, since 2024, colour.
//! `element vertex` holds four words. Position and scale have 11-10-11 bits within those ranges. The rotation has the
//! index of its largest component (w, x, y, z) and the three others in 10 bits each. Colour and opacity have 8 bits
//! each. An optional `element sh` holds `f_rest_…` as bytes. Ranges are interpolated in f64, as the programs in the
//! field do.
//!
//! Step sizes, twice the largest error: position and scale range/2047 (x, z) and range/1023 (y) of a chunk. Rotation
//! components √2/1023, colour range/255, opacity 1/255, harmonics 1/32 within ±4.

use std::borrow::Cow;
use std::path::PathBuf;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::splat::columns::{C0, filter_comment, is_harmonic, is_known, is_normal};
use crate::splat::format::{Format, PlyLayout, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ply::{self, OutElement, OutProperty, OutValues, PlyFile, Table};
use crate::splat::ply_format::PlyFormat;
use crate::splat::problem::{Problem, Warning, WarningCode};
use crate::splat::unit_comments::orientation_of_unlit;
use crate::splat::{morton, unlit};
use sg_scene::model::{Gaussians, Harmonics};

/// Gaussians that share their ranges.
const CHUNK: usize = 256;
/// Opacities of exactly 0 and 1 have infinite logits; σ(±20) is 0 and 1 to within 3e-9.
const LOGIT_LIMIT: f64 = 20.0;
/// Logarithms of the scale are held within ±20, as the programs in the field do.
const SCALE_LIMIT: f32 = 20.0;

/// The property names of a chunk, least corner before greatest.
const RANGES: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// The property names of a Gaussian.
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

impl Format {
    /// The compressed PLY of SuperSplat and PlayCanvas.
    pub const COMPRESSED: Self = Self(&PlyFormat {
        extensions: &[".compressed.ply", ".ply"],
        layout: Some(PlyLayout::new(
            &["chunk", "vertex", "sh"],
            |file| file.has("chunk") && file.has("vertex") && !file.has("gaussians"),
            read,
        )),
        writer: Some(SplatWriter {
            is_default_for: |extension, _| extension == ".compressed.ply",
            can_reorder: true,
            ..SplatWriter::new(write)
        }),
        ..PlyFormat::new("compressed", "SuperSplat's compressed PLY, 16 bytes a Gaussian; all units as one, unlit")
    });
}

fn read(file: &PlyFile, _warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    let (chunks, vertices) = (file.required_table("chunk")?, file.required_table("vertex")?);
    read_elements(&chunks, &vertices, file.table("sh")?.as_ref())
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    job.write_file(|out| {
        let mut flat = unlit::flatten(job.scene, warnings);
        if job.options.reorder {
            flat = Cow::Owned(morton::reorder(&flat));
            let message = "the Gaussians are written in Morton order: masks and labels of the old file do not fit";
            warnings.push(Warning::new(WarningCode::Reordered, message));
        }
        let packed = Packed::new(&flat, warnings);
        let comments: Vec<String> = filter_comment(&flat).into_iter().chain(orientation_of_unlit(job.scene)).collect();
        Ok(ply::write(out, &comments, &packed.elements(&flat))?)
    })
}

/// Reads the elements of a file.
fn read_elements(chunks: &Table<'_>, vertices: &Table<'_>, sh: Option<&Table<'_>>) -> Result<Gaussians, Problem> {
    let n = vertices.rows;
    if chunks.rows != n.div_ceil(CHUNK) {
        return Err(Problem::new(
            "element chunk",
            format!("{} chunks for {n} Gaussians", chunks.rows),
            format!("{} are needed, one for each {CHUNK}: write the file again", n.div_ceil(CHUNK)),
        ));
    }
    let range = |names| chunks.floats(names, |c: [f32; 6]| (dvec(&c[..3]), dvec(&c[3..])));
    let positions = range(["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"])?;
    let scales = range(["min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"])?;
    let colors = if chunks.column("min_r").is_some() {
        range(["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"])?
    } else {
        vec![(DVec3::ZERO, DVec3::ONE); chunks.rows]
    };
    let words = vertices.words(WORDS, |w| w)?;
    let within = |ranges: &[(DVec3, DVec3)], i: usize, t: DVec3| {
        let (low, high) = ranges.get(i / CHUNK).copied().unwrap_or_default();
        // Not `lerp`: at t = 0 and 1 this form gives the ends of the range exactly.
        low * (DVec3::ONE - t) + high * t
    };
    let column = |f: &(dyn Fn(usize, [u32; 4]) -> Vec3 + Sync)| -> Vec<Vec3> {
        words.par_iter().with_min_len(4096).enumerate().map(|(i, w)| f(i, *w)).collect()
    };
    let position = column(&|i, w| within(&positions, i, unpack_11_10_11(w[0])).as_vec3());
    let log_scale = column(&|i, w| within(&scales, i, unpack_11_10_11(w[2])).as_vec3());
    let constant_term = |(i, w): (usize, &[u32; 4])| {
        let t = DVec3::new(unorm(w[3] >> 24, 8), unorm(w[3] >> 16, 8), unorm(w[3] >> 8, 8));
        ((within(&colors, i, t) - 0.5) / C0).as_vec3().to_array()
    };
    let dc = words.par_iter().with_min_len(4096).enumerate().map(constant_term).collect();
    let opacity_logit = words.par_iter().with_min_len(4096).map(|w| logit(unorm(w[3], 8))).collect();
    let rotation = words.par_iter().with_min_len(4096).map(|w| unpack_rotation(w[1])).collect();
    let (degree, rest) = match sh {
        Some(sh) => read_harmonics(sh, n)?,
        None => (0, Vec::new()),
    };
    let harmonics = Some(Harmonics { degree, dc, rest });
    let extra = vertices.extra(|name| WORDS.contains(&name) || is_known(name));
    let shading = None;
    Ok(Gaussians { position, rotation, log_scale, opacity_logit, shading, harmonics, extra, antialiased: false })
}

fn read_harmonics(sh: &Table<'_>, n: usize) -> Result<(u8, Vec<[f32; 3]>), Problem> {
    let count = sh.columns.iter().filter(|c| is_harmonic(&c.name)).count();
    let degree = match count {
        9 => 1,
        24 => 2,
        45 => 3,
        _ => {
            let what = format!("{count} properties f_rest_…");
            return Err(Problem::new(
                "element sh",
                what,
                "spherical harmonics of degree 1 to 3 have 9, 24 or 45 of them",
            ));
        }
    };
    if sh.rows != n {
        return Err(Problem::new("element sh", format!("{} rows for {n} Gaussians", sh.rows), "write the file again"));
    }
    let terms = count / 3;
    let mut rest = vec![[0.0_f32; 3]; n * terms];
    for term in 0..terms {
        let names = [0, 1, 2].map(|c| format!("f_rest_{}", c * terms + term));
        let rows = sh.bytes([&names[0], &names[1], &names[2]], |b| b.map(unpack_harmonic))?;
        for (to, row) in rest.iter_mut().skip(term).step_by(terms).zip(rows) {
            *to = row;
        }
    }
    Ok((degree, rest))
}

/// A scene in this format's terms, ready to be written.
pub(crate) struct Packed {
    ranges: Vec<[f32; 18]>,
    words: Vec<[u32; 4]>,
    sh: Vec<u8>,
    terms: usize,
}

impl Packed {
    /// Packs Gaussians that are drawn unlit from their harmonics.
    pub(crate) fn new(g: &Gaussians, warnings: &mut Vec<Warning>) -> Self {
        let n = g.len();
        let white = Harmonics { degree: 0, dc: vec![[0.0; 3]; n], rest: vec![] };
        let harmonics = g.harmonics.as_ref().unwrap_or(&white);
        let chunk = |c: usize| {
            let rows = c * CHUNK..n.min((c + 1) * CHUNK);
            let color =
                |i: usize| harmonics.dc.get(i).map(|dc| (DVec3::from_array(dc.map(f64::from)) * C0 + 0.5).as_vec3());
            let colors: Vec<Vec3> = rows.clone().filter_map(color).collect();
            let position = Range3::of(g.position.get(rows.clone()).unwrap_or_default(), f32::MAX);
            let scale = Range3::of(g.log_scale.get(rows.clone()).unwrap_or_default(), SCALE_LIMIT);
            let color = Range3::of(&colors, f32::MAX);
            let words: Vec<[u32; 4]> = rows
                .zip(colors)
                .map(|(i, c)| {
                    let alpha = if g.has_finite_position(i) { f64::from(g.opacity(i)) } else { 0.0 };
                    let [r, g8, b] = color.normalize(c).to_array();
                    let rgba = (pack(r, 8) << 24) | (pack(g8, 8) << 16) | (pack(b, 8) << 8) | pack(alpha, 8);
                    let q = g.unit_rotation(i);
                    let rotation = pack_rotation([q.w, q.x, q.y, q.z]);
                    let at = |r: &Range3, v: Option<&Vec3>| pack_11_10_11(r.normalize(v.copied().unwrap_or_default()));
                    [at(&position, g.position.get(i)), rotation, at(&scale, g.log_scale.get(i)), rgba]
                })
                .collect();
            let mut ranges = [0.0; 18];
            let corners = [position.low, position.high, scale.low, scale.high, color.low, color.high];
            for (to, corner) in ranges.chunks_exact_mut(3).zip(corners) {
                to.copy_from_slice(&corner.to_array());
            }
            (ranges, words)
        };
        let chunks: Vec<_> = (0..n.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        let terms = harmonics.rest_per_gaussian();
        let mut sh = vec![0; 3 * terms * n];
        if terms > 0 {
            // Channel-major within a Gaussian, as the property names count.
            sh.par_chunks_exact_mut(3 * terms).zip(harmonics.rest.par_chunks_exact(terms)).for_each(|(to, rest)| {
                for (channel, to) in to.chunks_exact_mut(terms).enumerate() {
                    for (to, row) in to.iter_mut().zip(rest) {
                        *to = pack_harmonic(row[channel]);
                    }
                }
            });
        }
        warn_of_losses(g, harmonics, warnings);
        let (ranges, words): (Vec<_>, Vec<Vec<_>>) = chunks.into_iter().unzip();
        Self { ranges, words: words.concat(), sh, terms }
    }

    /// The elements of the file; `g` gives the columns that are kept as they are.
    pub(crate) fn elements<'a>(&'a self, g: &'a Gaussians) -> Vec<OutElement<'a>> {
        let ranges = bytemuck::cast_slice(&self.ranges);
        let words = bytemuck::cast_slice(&self.words);
        let property = |(at, name)| OutProperty::new(name, OutValues::U32(words), 4, at);
        let mut vertices: Vec<_> = WORDS.into_iter().enumerate().map(property).collect();
        vertices.extend(g.extra.iter().filter(|e| is_kept(&e.name)).map(OutProperty::extra));
        let mut elements = vec![
            OutElement {
                name: "chunk",
                rows: self.ranges.len(),
                properties: OutProperty::vector(RANGES, ranges).collect(),
            },
            OutElement { name: "vertex", rows: self.words.len(), properties: vertices },
        ];
        if self.terms > 0 {
            let width = 3 * self.terms;
            let property = |at| OutProperty::new(format!("f_rest_{at}"), OutValues::U8(&self.sh), width, at);
            elements.push(OutElement {
                name: "sh",
                rows: self.words.len(),
                properties: (0..width).map(property).collect(),
            });
        }
        elements
    }
}

/// Normals are not part of the format: three floats would nearly double its size.
fn is_kept(name: &str) -> bool {
    !is_known(name) && !is_normal(name) && !WORDS.contains(&name)
}

fn warn_of_losses(g: &Gaussians, harmonics: &Harmonics, warnings: &mut Vec<Warning>) {
    let lost = (0..g.len()).into_par_iter().filter(|&i| !g.has_finite_position(i)).count();
    if lost > 0 {
        let message = format!("{lost} Gaussians without a finite position are written with opacity 0");
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
    let wide = harmonics.rest.par_iter().flatten().filter(|x| x.is_nan() || x.abs() > 4.0).count();
    if wide > 0 {
        let message = format!("{wide} harmonic coefficients are beyond ±4 and are cut to it");
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
    let steep = g.log_scale.par_iter().filter(|s| s.is_nan() || s.abs().max_element() > SCALE_LIMIT).count();
    if steep > 0 {
        let message =
            format!("{steep} Gaussians have a logarithm of the scale beyond ±{SCALE_LIMIT} and are cut to it");
        warnings.push(Warning::new(WarningCode::Lossy, message));
    }
}

/// The range of the finite values of a chunk on each axis.
struct Range3 {
    low: Vec3,
    high: Vec3,
}

impl Range3 {
    fn of(values: &[Vec3], limit: f32) -> Self {
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        for value in values {
            for ((x, low), high) in value.to_array().into_iter().zip(&mut low).zip(&mut high) {
                if x.is_finite() {
                    *low = low.min(x);
                    *high = high.max(x);
                }
            }
        }
        for (low, high) in low.iter_mut().zip(&mut high) {
            if *low > *high {
                (*low, *high) = (0.0, 0.0);
            }
            *low = low.clamp(-limit, limit);
            *high = high.clamp(-limit, limit);
        }
        Self { low: Vec3::from_array(low), high: Vec3::from_array(high) }
    }

    /// 0 to 1 within the range; 0 if it has no extent or the value is NaN.
    fn normalize(&self, v: Vec3) -> DVec3 {
        let axis = |v: f32, low: f32, high: f32| {
            let (v, low, high) = (f64::from(v), f64::from(low), f64::from(high));
            if v >= high && high > low {
                1.0
            } else if v > low {
                (v - low) / (high - low)
            } else {
                0.0
            }
        };
        DVec3::new(
            axis(v.x, self.low.x, self.high.x),
            axis(v.y, self.low.y, self.high.y),
            axis(v.z, self.low.z, self.high.z),
        )
    }
}

fn dvec(xyz: &[f32]) -> DVec3 {
    match xyz {
        [x, y, z] => DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)),
        _ => DVec3::ZERO,
    }
}

fn unorm(word: u32, bits: u32) -> f64 {
    let most = (1 << bits) - 1;
    f64::from(word & most) / f64::from(most)
}

/// NaN becomes 0.
fn pack(t: f64, bits: u32) -> u32 {
    let most = f64::from((1_u32 << bits) - 1);
    (t * most + 0.5).floor().clamp(0.0, most) as u32
}

fn unpack_11_10_11(word: u32) -> DVec3 {
    DVec3::new(unorm(word >> 21, 11), unorm(word >> 11, 10), unorm(word, 11))
}

fn pack_11_10_11(t: DVec3) -> u32 {
    (pack(t.x, 11) << 21) | (pack(t.y, 10) << 11) | pack(t.z, 11)
}

fn logit(p: f64) -> f32 {
    (p / (1.0 - p)).ln().clamp(-LOGIT_LIMIT, LOGIT_LIMIT) as f32
}

/// `[w, x, y, z]` of unit length.
fn unpack_rotation(word: u32) -> [f32; 4] {
    let largest = (word >> 30) as usize;
    let small = [20, 10, 0].map(|shift| (unorm(word >> shift, 10) - 0.5) * std::f64::consts::SQRT_2);
    let rest = (1.0 - small.iter().map(|x| x * x).sum::<f64>()).max(0.0).sqrt();
    let mut from = small.into_iter();
    [0, 1, 2, 3].map(|k| if k == largest { rest } else { from.next().unwrap_or_default() } as f32)
}

fn pack_rotation(q: [f64; 4]) -> u32 {
    let mut largest = 0;
    let mut length = 0.0;
    let mut sign = 1.0;
    for (k, x) in q.into_iter().enumerate() {
        if x.abs() > length {
            (largest, length, sign) = (k, x.abs(), x.signum());
        }
    }
    let mut word = largest as u32;
    for (k, x) in q.into_iter().enumerate() {
        if k != largest {
            word = (word << 10) | pack(x * sign * std::f64::consts::FRAC_1_SQRT_2 + 0.5, 10);
        }
    }
    word
}

/// Bytes 0 and 255 stand for the ends of ±4, the others for the middle of their step.
fn unpack_harmonic(byte: u8) -> f32 {
    match byte {
        0 => -4.0,
        255 => 4.0,
        _ => (f32::from(byte) + 0.5) / 32.0 - 4.0,
    }
}

fn pack_harmonic(x: f32) -> u8 {
    ((x / 8.0 + 0.5) * 256.0).clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_word_survives_being_unpacked_and_packed(word in any::<u32>(), byte in any::<u8>()) {
            prop_assert_eq!(pack_11_10_11(unpack_11_10_11(word)), word);
            prop_assert_eq!(pack_harmonic(unpack_harmonic(byte)), byte);
        }

        #[test]
        fn a_rotation_is_kept_to_its_step(q in proptest::array::uniform4(-1.0_f64..1.0)) {
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            prop_assume!(length > 1e-3);
            let q = q.map(|x| x / length);
            let got = unpack_rotation(pack_rotation(q)).map(f64::from);
            let cosine = q.iter().zip(got).map(|(a, b)| a * b).sum::<f64>().abs();
            // Three components are off by at most half a step each; the fourth follows from the length.
            prop_assert!(cosine > 1.0 - 4e-6, "{q:?} became {got:?}");
            let norm = got.iter().map(|x| x * x).sum::<f64>();
            prop_assert!((norm - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn zero_and_full_opacity_stay_finite() {
        assert!(logit(0.0) == -20.0 && logit(1.0) == 20.0);
        assert_eq!(pack(f64::from(1.0 / (1.0 + (20.0_f32).exp())), 8), 0);
        assert_eq!(pack(f64::NAN, 8), 0);
    }
}
