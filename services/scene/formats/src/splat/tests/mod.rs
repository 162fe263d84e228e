//! Round trips of each format through files on disk.

mod bit_exact;
mod compressed;
mod errors;
mod ivrgs;
mod orientation;
mod ply_variants;
mod scene_file;
mod unlit;

use std::path::PathBuf;

use glam::Vec3;
use proptest::prelude::*;
use sg_scene::model::{ExtraColumn, ExtraValues, Gaussians, Harmonics, Scene, ShadingColumns};

use crate::splat::{Format, WarningCode};
use crate::{LoadOptions, Loaded, SaveOptions, load, save};

/// The field's constant harmonic, spelled out once more.
const C0: f64 = 0.282_094_791_773_878_14;

/// A temporary folder.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn through(&self, name: &str, scene: &Scene, options: &SaveOptions) -> Loaded {
        let saved = save(&self.path(name), scene, options).unwrap();
        load(&saved.files[0].with_file_name(name), &LoadOptions::default()).unwrap()
    }
}

fn as_format(format: Format) -> SaveOptions {
    SaveOptions { format: Some(format), ..SaveOptions::default() }
}

fn codes(loaded: &Loaded) -> Vec<WarningCode> {
    loaded.warnings.iter().map(|w| w.code).collect()
}

/// Any bits at all: NaN of every payload, infinities, denormals.
fn bits(n: usize) -> impl Strategy<Value = Vec<f32>> {
    proptest::collection::vec(any::<u32>().prop_map(f32::from_bits), n)
}

fn vec3s(values: &[f32]) -> Vec<Vec3> {
    values.chunks_exact(3).map(Vec3::from_slice).collect()
}

fn rows<const K: usize>(values: &[f32]) -> Vec<[f32; K]> {
    values.chunks_exact(K).map(|c| c.try_into().unwrap()).collect()
}

prop_compose! {
    fn any_columns()(n in 0_usize..20, degree in 0_u8..4)(
        floats in bits(n * (11 + 10 + 3 * (usize::from(degree) + 1).pow(2) + 3)),
        wide in proptest::collection::vec(any::<u64>(), n),
        n in Just(n),
        degree in Just(degree),
    ) -> Gaussians {
        let mut from = floats.as_slice();
        let mut take = |k: usize| {
            let (head, tail) = from.split_at(k * n);
            from = tail;
            head
        };
        let terms = (usize::from(degree) + 1).pow(2) - 1;
        let ints = |name: &str, values| ExtraColumn { name: name.to_owned(), values };
        Gaussians {
            position: vec3s(take(3)),
            rotation: rows(take(4)),
            log_scale: vec3s(take(3)),
            opacity_logit: take(1).to_vec(),
            shading: Some(ShadingColumns {
                offset_color: vec3s(take(3)),
                normal: vec3s(take(3)),
                ambient: take(1).to_vec(),
                diffuse: take(1).to_vec(),
                specular: take(1).to_vec(),
                shininess: take(1).to_vec(),
            }),
            harmonics: Some(Harmonics { degree, dc: rows(take(3)), rest: rows(take(3 * terms)) }),
            extra: vec![
                ints("i8", ExtraValues::I8(wide.iter().map(|&x| x as i8).collect())),
                ints("u8", ExtraValues::U8(wide.iter().map(|&x| x as u8).collect())),
                ints("i16", ExtraValues::I16(wide.iter().map(|&x| x as i16).collect())),
                ints("u16", ExtraValues::U16(wide.iter().map(|&x| x as u16).collect())),
                ints("i32", ExtraValues::I32(wide.iter().map(|&x| x as i32).collect())),
                ints("u32", ExtraValues::U32(wide.iter().map(|&x| x as u32).collect())),
                ints("f32", ExtraValues::F32(take(1).to_vec())),
                ints("f64", ExtraValues::F64(wide.iter().map(|&x| f64::from_bits(x)).collect())),
            ],
            antialiased: n % 2 == 1,
        }
    }
}
