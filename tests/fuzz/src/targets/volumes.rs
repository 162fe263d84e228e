//! Volumes, meshes and transfer functions.

use std::path::Path;

use sg_volume::{Dataset, ReadOptions, TransferFunction, read_dataset, read_series};

use super::accepted;
use crate::parts::Parts;
use crate::stage::Stage;

/// Volumes of more voxels, and meshes of more points and tetrahedra, are not looked into.
const MAX_ELEMENTS: usize = 4096;

/// The first block is the name: it tells the size and the type.
pub(crate) fn raw(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let name: String =
        parts.block().iter().take(100).map(|b| char::from(*b)).filter(|c| !matches!(c, '/' | '\0')).collect();
    let name = format!("in_{name}");
    let accepted = volume(&stage.write(&name, parts.rest()));
    stage.remove(&name);
    accepted
}

pub(crate) fn nrrd(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.nrrd", input))
}

/// The first block is the header; the rest lies beside it, in files of several names.
pub(crate) fn nhdr(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let header = parts.block();
    stage.write("data.raw", parts.rest());
    volume(&stage.write("in.nhdr", header))
}

/// The first block is the header; the rest follows it, and lies beside it too.
pub(crate) fn metaimage(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let header = parts.block();
    let voxels = parts.rest();
    stage.write("data.raw", voxels);
    volume(&stage.write("in.mha", &[header, voxels].concat()))
}

pub(crate) fn vti(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.vti", input))
}

pub(crate) fn vtu(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.vtu", input))
}

pub(crate) fn legacy_vtk(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.vtk", input))
}

pub(crate) fn nifti(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.nii", input))
}

pub(crate) fn nifti_gzip(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.nii.gz", input))
}

pub(crate) fn dicom(stage: &Stage, input: &[u8]) -> bool {
    volume(&stage.write("in.dcm", input))
}

fn volume(path: &Path) -> bool {
    let data = match read_dataset(path, &ReadOptions::default()) {
        Ok(data) => data,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return false;
        }
    };
    let elements = match &data {
        Dataset::Volume(volume) => {
            let voxels: usize = volume.grid().dims().into_iter().product();
            assert_eq!(voxels, volume.scalars().len());
            voxels
        }
        Dataset::Mesh(mesh) => {
            let points = mesh.points().len() as u32;
            assert!(mesh.cells().iter().flatten().all(|point| *point < points), "every corner is a point");
            mesh.points().len() + mesh.cells().len()
        }
    };
    if elements <= MAX_ELEMENTS {
        let field = data.to_field();
        if let Ok(function) = field.as_ref().automatic_transfer_function(data.variable()) {
            assert_eq!(function.check(), Ok(()), "an automatic transfer function is right");
        }
    }
    true
}

pub(crate) fn transfer_function(stage: &Stage, input: &[u8]) -> bool {
    let path = stage.write("tf.json", input);
    let Some(loaded) = accepted(TransferFunction::load(&path), &path) else { return false };
    let text = loaded.function.to_json().unwrap();
    let again = TransferFunction::load(&stage.write("copy.json", text.as_bytes()));
    assert_eq!(again.unwrap().function, loaded.function, "a transfer function reads back");
    true
}

/// The first byte chooses the kind of series. Two of the files that it may name are there.
pub(crate) fn series(stage: &Stage, input: &[u8]) -> bool {
    let mut parts = Parts(input);
    let name = if parts.byte().is_multiple_of(2) { "in.pvd" } else { "in.vti.series" };
    ["a.vti", "b.vti"].iter().for_each(|name| drop(stage.keep(name, Vec::new)));
    let path = stage.write(name, parts.rest());
    // An error may be about a file that the series names.
    let Some(steps) = accepted(read_series(&path), stage.folder()) else { return false };
    assert!(!steps.is_empty(), "a series has a step");
    let folder = stage.folder().canonicalize().unwrap();
    for step in &steps {
        let file = step.path.canonicalize().unwrap();
        assert!(file.starts_with(&folder), "{} lies outside the folder", file.display());
        assert!(step.time.is_none_or(f64::is_finite), "{:?}", step.time);
    }
    true
}
