//! The `.splat` file of antimatter15's web viewer: records of 32 bytes, without a header.
//!
//! | bytes | content |
//! | --- | --- |
//! | 0..12 | centre, three little-endian `f32` |
//! | 12..24 | standard deviations along the axes, linear, three little-endian `f32` |
//! | 24..28 | colour and opacity, RGBA, 0 to 255; colour = ½ + C₀·dc |
//! | 28..32 | rotation, w x y z, each (byte − 128)/128 |
//!
//! The file stores neither view-dependent harmonics nor extra columns. The scene holds logarithms of the scales. Opacities
//! of exactly 0 and 1 become logits of ±16, so that they stay finite.

use std::io::Write;
use std::path::PathBuf;

use glam::Vec3;
use rayon::prelude::*;
use sg_scene::model::{Gaussians, Harmonics};

use crate::splat::activation::logit;
use crate::splat::columns::C0;
use crate::splat::format::{Format, Source, SplatFormat, SplatWriter, WriteJob, WriteProblem};
use crate::splat::problem::{Problem, Warning, WarningCode};
use crate::splat::unlit;

/// Bytes of one Gaussian.
const RECORD: usize = 32;

/// The format `splat`.
#[derive(Debug)]
pub(crate) struct DotSplat;

impl Format {
    /// antimatter15's records of 32 bytes.
    pub const SPLAT: Self = Self(&DotSplat);
}

impl SplatFormat for DotSplat {
    fn name(&self) -> &'static str {
        "splat"
    }

    fn description(&self) -> &'static str {
        "antimatter15's 32 bytes a Gaussian; 8-bit colours, opacities and rotations"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[".splat"]
    }

    fn sniff(&self, source: &Source) -> bool {
        source.has_extension(self.extensions())
    }

    fn decode(&self, bytes: &[u8], _warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
        read(bytes)
    }

    fn writer(&self) -> Option<SplatWriter> {
        Some(SplatWriter { is_default_for: |extension, _| extension == ".splat", ..SplatWriter::new(write) })
    }
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    let records = encode(&unlit::flatten(job.scene, warnings), warnings);
    job.write_file(|out| Ok(out.write_all(records.as_flattened())?))
}

/// Reads the records. Memory grows with the length of `bytes` alone: the format announces no count.
fn read(bytes: &[u8]) -> Result<Gaussians, Problem> {
    let (records, rest) = bytes.as_chunks::<RECORD>();
    if !rest.is_empty() {
        return Err(Problem::new(
            format!("record {}", records.len()),
            format!("{} bytes follow the last whole record; a record has {RECORD}", rest.len()),
            "the file is cut off or is no .splat: write it again",
        ));
    }
    let column = |at: usize| {
        move |record: &[u8; RECORD]| {
            let float = |k: usize| f32::from_le_bytes(std::array::from_fn(|b| record[at + 4 * k + b]));
            Vec3::new(float(0), float(1), float(2))
        }
    };
    let position = column(0);
    let scale = column(12);
    let log_scale = |r: &[u8; RECORD]| Vec3::from_array(scale(r).to_array().map(|s| f64::from(s).ln() as f32));
    let constant_term = |r: &[u8; RECORD]| [r[24], r[25], r[26]].map(|c| ((f64::from(c) / 255.0 - 0.5) / C0) as f32);
    let rotation = |r: &[u8; RECORD]| [r[28], r[29], r[30], r[31]].map(|b| (f32::from(b) - 128.0) / 128.0);
    Ok(Gaussians {
        position: records.par_iter().map(position).collect(),
        rotation: records.par_iter().map(rotation).collect(),
        log_scale: records.par_iter().map(log_scale).collect(),
        opacity_logit: records.par_iter().map(|r| logit(f64::from(r[27]) / 255.0)).collect(),
        shading: None,
        harmonics: Some(Harmonics { degree: 0, dc: records.par_iter().map(constant_term).collect(), rest: vec![] }),
        extra: vec![],
        antialiased: false,
    })
}

/// The records of unlit Gaussians, in their order.
fn encode(g: &Gaussians, warnings: &mut Vec<Warning>) -> Vec<[u8; RECORD]> {
    let byte = |x: f64| (x * 255.0).round().clamp(0.0, 255.0) as u8;
    let color = |i: usize| {
        let dc = g.harmonics.as_ref().and_then(|h| h.dc.get(i)).copied().unwrap_or_default();
        dc.map(|c| f64::from(c) * C0 + 0.5)
    };
    let record = |i: usize| {
        let position = g.position.get(i).copied().unwrap_or_default().to_array();
        let scale = g.log_scale.get(i).copied().unwrap_or_default().to_array().map(|s| f64::from(s).exp() as f32);
        let [red, green, blue] = color(i).map(byte);
        let q = g.unit_rotation(i);
        let rotation = [q.w, q.x, q.y, q.z].map(|x| (x * 128.0 + 128.0).round().clamp(0.0, 255.0) as u8);
        let mut out = [0; RECORD];
        for (to, x) in out.chunks_exact_mut(4).zip(position.into_iter().chain(scale)) {
            to.copy_from_slice(&x.to_le_bytes());
        }
        out[24..28].copy_from_slice(&[red, green, blue, byte(f64::from(g.opacity(i)))]);
        out[28..32].copy_from_slice(&rotation);
        out
    };
    let mut lost = vec!["colours, opacities and rotations are rounded to 8 bits a number".to_owned()];
    if g.harmonics.as_ref().is_some_and(|h| h.degree > 0) {
        lost.push("view-dependent harmonics are not kept".to_owned());
    }
    let cut = (0..g.len()).into_par_iter().filter(|&i| color(i).iter().any(|c| !(0.0..=1.0).contains(c))).count();
    if cut > 0 {
        lost.push(format!("{cut} colours outside 0 to 1 are cut to it"));
    }
    if !g.extra.is_empty() {
        let names: Vec<_> = g.extra.iter().map(|e| e.name.as_str()).collect();
        lost.push(format!("columns that are not kept: {}", names.join(", ")));
    }
    if g.antialiased {
        lost.push("the compensated pixel filter is not noted".to_owned());
    }
    warnings.extend(lost.into_iter().map(|message| Warning::new(WarningCode::Lossy, message)));
    (0..g.len()).into_par_iter().map(record).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LoadOptions, SaveOptions, load, save};
    use proptest::prelude::*;
    use sg_scene::model::Scene;
    use sg_scene::synthetic::samples;

    proptest! {
        #[test]
        fn any_records_are_read_and_written_to_within_rounding(bytes in proptest::collection::vec(any::<u8>(), 0..640)) {
            let whole = bytes.len() / RECORD * RECORD;
            let g = read(&bytes[..whole]).unwrap();
            prop_assert_eq!(g.len(), whole / RECORD);
            prop_assert!(g.check_lengths().is_ok());
            prop_assert_eq!(read(&bytes).is_ok(), whole == bytes.len());
            for (record, again) in bytes.as_chunks::<RECORD>().0.iter().zip(encode(&g, &mut Vec::new())) {
                prop_assert_eq!(&record[24..28], &again[24..28], "colour and opacity");
                if record[..12].chunks(4).all(|b| !f32::from_le_bytes(b.try_into().unwrap()).is_nan()) {
                    prop_assert_eq!(&record[..12], &again[..12], "centre");
                }
            }
        }

        #[test]
        fn a_written_rotation_is_the_same_to_a_step(q in proptest::array::uniform4(-1.0_f32..1.0), s in -8.0_f32..3.0) {
            let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            prop_assume!(length > 0.1);
            let mut g = samples::harmonic(1, 0, 1);
            g.rotation[0] = q;
            g.log_scale[0] = Vec3::splat(s);
            let back = read(encode(&g, &mut Vec::new()).as_flattened()).unwrap();
            for (a, b) in back.rotation[0].iter().zip(q) {
                prop_assert!((a - b / length).abs() <= 1.0 / 128.0, "{} for {}", a, b / length);
            }
            prop_assert!((back.log_scale[0].x - s).abs() < 1e-5);
        }
    }

    #[test]
    fn a_scene_goes_through_a_file_and_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.splat");
        let scene = Scene::compose(vec![samples::unit("a", samples::harmonic(50, 1, 3))], None);
        let saved = save(&path, &scene, &SaveOptions::default()).unwrap();
        assert_eq!((saved.format, saved.files.as_slice()), (Format::SPLAT, [path.clone()].as_slice()));
        assert!(saved.warnings.iter().all(|w| w.code == WarningCode::Lossy));
        assert_eq!(std::fs::metadata(&path).unwrap().len(), 50 * RECORD as u64);
        let loaded = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!((loaded.format, loaded.scene.units[0].name.as_str()), (Format::SPLAT, "a"));
        let (was, is) = (&scene.units[0].gaussians, &loaded.scene.units[0].gaussians);
        assert_eq!(was.position, is.position);
        for i in 0..50 {
            assert!((was.opacity(i) - is.opacity(i)).abs() < 0.5 / 255.0 + 1e-6, "opacity {i}");
        }
        // Bytes that were written once stay the same.
        let again = folder.path().join("b.splat");
        save(&again, &loaded.scene, &SaveOptions::default()).unwrap();
        let colours = |p| std::fs::read(p).unwrap().chunks(RECORD).map(|r| r[24..28].to_vec()).collect::<Vec<_>>();
        assert_eq!(colours(&path), colours(&again));
    }

    #[test]
    fn damaged_files_and_other_files_of_that_name_are_handled() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.SPLAT");
        let open = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            load(&path, &LoadOptions::default())
        };
        let empty = open(&[]).unwrap();
        assert!(empty.scene.is_empty() && empty.warnings.iter().any(|w| w.code == WarningCode::Empty));
        for length in [1, 31, 33, 100] {
            let error = open(&vec![1; length]).unwrap_err().to_string();
            assert!(error.contains("a.SPLAT") && error.contains(&format!("record {}", length / RECORD)), "{error}");
        }
        let zeros = open(&[0; 64]).unwrap();
        assert_eq!(zeros.scene.len(), 2);
        assert!(zeros.warnings.iter().any(|w| w.code == WarningCode::NonFinite), "scales of zero have no logarithm");
        // A PLY stays a PLY under any name.
        assert!(open(b"ply\nformat ascii 1.0\n").unwrap_err().to_string().contains("header"));
        // Without the ending, nothing shows that the bytes are records.
        std::fs::write(folder.path().join("a.bin"), [0; 64]).unwrap();
        let error = load(&folder.path().join("a.bin"), &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(".bin files cannot be read") && error.contains(".splat"), "{error}");
    }
}
