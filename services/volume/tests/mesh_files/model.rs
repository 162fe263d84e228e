//! Models of meshes for tests, and the reading of their files.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::path::{Path, PathBuf};

use glam::DVec3;
use sg_volume::mesh::MeshValues;
use sg_volume::{Dataset, Mesh, ReadError, ReadOptions, ScalarType, Volume, read_dataset};

use super::{Array, Legacy, LegacyWriter, Model};

pub(crate) fn put(dir: &Path, name: &str, data: &[u8]) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, data).unwrap();
    path
}

/// Reads bytes as a file of this name.
pub(crate) fn read(name: &str, data: &[u8], variable: Option<&str>) -> Result<Dataset, ReadError> {
    let dir = tempfile::tempdir().unwrap();
    let options = ReadOptions { variable: variable.map(str::to_owned), ..ReadOptions::default() };
    read_dataset(&put(dir.path(), name, data), &options)
}

pub(crate) fn mesh(name: &str, data: &[u8], variable: Option<&str>) -> Mesh {
    match read(name, data, variable) {
        Ok(Dataset::Mesh(mesh)) => mesh,
        other => panic!("{name}: {other:?}"),
    }
}

pub(crate) fn volume(name: &str, data: &[u8], variable: Option<&str>) -> Volume {
    match read(name, data, variable) {
        Ok(Dataset::Volume(volume)) => volume,
        other => panic!("{name}: {other:?}"),
    }
}

/// The one line of the error.
pub(crate) fn refusal(name: &str, data: &[u8], variable: Option<&str>) -> String {
    let error = read(name, data, variable).expect_err(name);
    let line = error.to_string();
    let has_remedy = line.contains("; ") || matches!(error, ReadError::Grid { .. });
    assert!(!line.contains('\n') && line.contains(name) && has_remedy, "{line}");
    line
}

pub(crate) fn point_values(mesh: &Mesh) -> Vec<f64> {
    match mesh.values() {
        MeshValues::Points(values) => (0..values.len()).map(|i| values.get(i).unwrap()).collect(),
        MeshValues::Cells(_) => panic!("values of cells"),
    }
}

pub(crate) fn cell_values(mesh: &Mesh) -> Vec<f64> {
    match mesh.values() {
        MeshValues::Cells(values) => (0..values.len()).map(|i| values.get(i).unwrap()).collect(),
        MeshValues::Points(_) => panic!("values of points"),
    }
}

/// Volumes of the tetrahedra.
pub(crate) fn volumes(mesh: &Mesh) -> Vec<f64> {
    let of = |cell: &[u32; 4]| {
        let at = cell.map(|i| mesh.points()[i as usize]);
        (at[1] - at[0]).cross(at[2] - at[0]).dot(at[3] - at[0]) / 6.0
    };
    mesh.cells().iter().map(of).collect()
}

/// One cell of each type that can be split, its volume, and a triangle. Each lies elsewhere.
pub(crate) fn shapes() -> Vec<(u8, Vec<DVec3>, f64)> {
    let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
    let prism =
        |base: &[DVec3]| -> Vec<DVec3> { base.iter().copied().chain(base.iter().map(|p| *p + DVec3::Z)).collect() };
    let polygon = |n: usize| -> Vec<DVec3> {
        (0..n)
            .map(|k| DVec3::from((glam::DVec2::from_angle(std::f64::consts::TAU * k as f64 / n as f64), 0.0)))
            .collect()
    };
    let area = |n: f64| 0.5 * n * (std::f64::consts::TAU / n).sin();
    // The middles of edges follow the corners; only their number counts for these.
    let more = |corners: &[DVec3], count: usize| -> Vec<DVec3> {
        corners.iter().copied().cycle().take(corners.len() + count).collect()
    };
    let mut voxel = prism(&square);
    voxel.swap(2, 3);
    voxel.swap(6, 7);
    let mut pyramid = square.to_vec();
    pyramid.push(DVec3::new(0.5, 0.5, 1.0));
    let tetrahedron = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let mut quadratic = tetrahedron.clone();
    for (i, j) in [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)] {
        quadratic.push(0.5 * (tetrahedron[i] + tetrahedron[j]));
    }
    vec![
        (10, tetrahedron.clone(), 1.0 / 6.0),
        (11, voxel, 1.0),
        (12, prism(&square), 1.0),
        (13, prism(&square[..3]), 0.5),
        (14, pyramid.clone(), 1.0 / 3.0),
        (15, prism(&polygon(5)), area(5.0)),
        (16, prism(&polygon(6)), area(6.0)),
        (24, quadratic, 1.0 / 6.0),
        (25, more(&prism(&square), 12), 1.0),
        (26, more(&prism(&square[..3]), 9), 0.5),
        (27, more(&pyramid, 8), 1.0 / 3.0),
        (29, more(&prism(&square), 19), 1.0),
        (31, more(&prism(&square[..3]), 6), 0.5),
        (32, more(&prism(&square[..3]), 12), 0.5),
        (33, more(&prism(&square), 16), 1.0),
        (37, more(&pyramid, 14), 1.0 / 3.0),
        (5, square[..3].to_vec(), 0.0),
    ]
}

/// A linear quantity.
pub(crate) fn density(at: DVec3) -> f64 {
    at.dot(DVec3::new(1.0, 0.25, 4.0)) - 2.0
}

/// All shapes with quantities of points and cells.
pub(crate) fn model() -> Model {
    let mut model = Model::default();
    for (row, (kind, corners, _)) in shapes().into_iter().enumerate() {
        let first = model.points.len() as u32 / 3;
        model.cells.push((kind, (first..first + corners.len() as u32).collect()));
        let moved = corners.iter().map(|p| *p + DVec3::new(4.0 * row as f64, 0.0, 0.0));
        model.points.extend(moved.flat_map(|p| p.to_array()));
    }
    let at: Vec<DVec3> = model.points.chunks(3).map(DVec3::from_slice).collect();
    let momentum = |p: &DVec3| [f64::from(p.x as f32), 3.0, f64::from(p.z as f32) * 2.0];
    let densities = at.iter().map(|p| f64::from(density(*p) as f32)).collect();
    model.point_data = vec![
        Array::new("momentum", 3, ScalarType::F32, at.iter().flat_map(momentum).collect()),
        Array::new("point number", 1, ScalarType::I64, (0..at.len()).map(|i| i as f64).collect()),
        Array::new("two", 2, ScalarType::I16, (0..2 * at.len()).map(|i| i as f64 - 9.0).collect()),
        Array::new("density", 1, ScalarType::F32, densities),
    ];
    let cells = model.cells.len();
    model.cell_data = vec![
        Array::new("material", 1, ScalarType::U8, (0..cells).map(|i| 100.0 + i as f64).collect()),
        Array::new("flux", 3, ScalarType::F64, (0..3 * cells).map(|i| i as f64 / 8.0).collect()),
    ];
    model
}

/// A legacy grid of 3 x 2 x 2 points with values of points and cells.
pub(crate) fn grid(layout: Legacy, geometry: &[&str], parts: &[(&str, Vec<f64>)]) -> Vec<u8> {
    let mut writer = LegacyWriter::new(layout);
    geometry.iter().for_each(|line| writer.line(line));
    for (line, numbers) in parts {
        writer.line(line);
        writer.numbers(numbers, ScalarType::F32);
    }
    let numbers = |n: usize| (0..n).map(|i| (i * i) as f64).collect::<Vec<f64>>();
    writer.data("POINT_DATA", &[Array::new("heat", 1, ScalarType::F32, numbers(12))]);
    writer.data("CELL_DATA", &[Array::new("phase", 1, ScalarType::U16, numbers(2))]);
    writer.bytes
}

/// A legacy file of one tetrahedron, with these lines at its end.
pub(crate) fn one_cell(layout: Legacy, end: impl Fn(&mut LegacyWriter)) -> Vec<u8> {
    let mut writer = LegacyWriter::new(layout);
    writer.line("DATASET UNSTRUCTURED_GRID");
    writer.line("FIELD FieldData 2");
    writer.line("TIME 1 1 double");
    writer.numbers(&[0.5], ScalarType::F64);
    writer.line("CYCLE 1 1 int");
    writer.numbers(&[7.0], ScalarType::I32);
    writer.points(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    writer.cells(&Model { cells: vec![(10, vec![0, 1, 2, 3])], ..Model::default() });
    end(&mut writer);
    writer.bytes
}
