//! Every broken file of a mesh gives one clear line.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

mod mesh_files;

use std::time::{Duration, Instant};

use proptest::prelude::*;
use sg_volume::{Limits, ReadError, ReadOptions, ScalarType, Scalars, read_dataset};

use mesh_files::model::{grid, mesh, model, one_cell, put, read, refusal, volume};
use mesh_files::{Array, Legacy, LegacyWriter, Model, Place, XmlLayout, legacy, vtu};

/// The bytes with one part in place of another.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes);
    assert!(text.contains(from), "{from} in {text}");
    text.replacen(from, to, 1).into_bytes()
}

#[test]
fn broken_vtu_files_are_refused_at_their_place() {
    let cell = Model {
        points: vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        cells: vec![(10, vec![0, 1, 2, 3]), (10, vec![3, 1, 2, 0])],
        point_data: vec![Array::new("a", 1, ScalarType::F32, vec![1.0, 2.0, 3.0, 4.0])],
        cell_data: Vec::new(),
    };
    let whole = vtu(std::slice::from_ref(&cell), XmlLayout::ASCII, None);
    for (from, to, parts) in [
        ("0 1 2 3 3", "0 1 2 4 3", &["connectivity", "point 4 of 4"][..]),
        ("0 1 2 3 3", "0 1 -2 3 3", &["connectivity", "entry 2 is -2"]),
        ("0 1 2 3 3", "0 1 2 3", &["expected 8 numbers", "found 7"]),
        ("4 8 ", "4 -8 ", &["offsets", "entry 1 is -8"]),
        ("4 8 ", "9 8 ", &["offsets", "cell 0 has points 0 to 9 of 8"]),
        ("4 8 ", "8 4 ", &["expected 4 numbers"]),
        ("4 8 ", "3 8 ", &["cell 0 has type 10 and 3 points"]),
        ("4 8 ", "4 ", &["expected 2 numbers", "found 1"]),
        ("10 10", "42 10", &["types", "cell 0 has type 42", "Tetrahedralize"]),
        ("10 10", "10 5", &[]),
        ("10 10", "5 5", &["no cell with a volume"]),
        ("NumberOfPoints=\"4\"", "NumberOfPoints=\"-4\"", &["NumberOfPoints", "not a count"]),
        ("NumberOfPoints=\"4\"", "NumberOfPoints=\"5\"", &["expected 15 numbers"]),
        ("NumberOfCells=\"2\"", "", &["NumberOfCells"]),
        ("NumberOfCells=\"2\"", "NumberOfCells=\"3\"", &["expected 3 numbers"]),
        ("NumberOfPoints=\"4\"", "NumberOfPoints=\"0\"", &["no"]),
        ("Name=\"a\" NumberOfComponents=\"1\"", "Name=\"a\" NumberOfComponents=\"0\"", &["found at least 1"]),
        ("Name=\"Points\" NumberOfComponents=\"3\"", "Name=\"Points\"", &["1 components in place of 3"]),
        ("Name=\"types\"", "Name=\"kinds\"", &["no array `types`"]),
        ("UnstructuredGrid\" version", "PolyData\" version", &["PolyData", "UnstructuredGrid"]),
        ("type=\"Float32\"", "type=\"String\"", &["type `String`"]),
    ] {
        let bytes = replaced(&whole, from, to);
        if parts.is_empty() {
            assert_eq!(mesh("m.vtu", &bytes, None).cells().len(), 1);
            continue;
        }
        let variable = if to.contains("Components=\"0\"") { Some("a") } else { None };
        let line = refusal("m.vtu", &bytes, variable);
        assert!(parts.iter().all(|part| line.contains(part)), "{from} -> {to}: {line}");
    }
    // A name with a line end does not break the line of an error.
    let named = replaced(&whole, "Name=\"a\"", "Name=\"a&#10;b\"");
    assert!(refusal("m.vtu", &named, Some("c")).contains("a b"));
}

#[test]
fn broken_legacy_files_are_refused_at_their_place() {
    let whole = one_cell(Legacy::ASCII, |writer| {
        writer.data("POINT_DATA", &[Array::new("a", 1, ScalarType::F32, vec![1.0, 2.0, 3.0, 4.0])]);
    });
    let offsets = one_cell(Legacy { offsets: true, ..Legacy::ASCII }, |writer| {
        writer.data("CELL_DATA", &[Array::new("a", 1, ScalarType::F32, vec![1.0])]);
    });
    for (bytes, from, to, parts) in [
        (&whole, "4 0 1 2 3", "4 0 1 2 4", &["connectivity", "point 4 of 4"][..]),
        (&whole, "4 0 1 2 3", "4 0 1 -2 3", &["CELLS", "entry 3 is -2"]),
        (&whole, "4 0 1 2 3", "-4 0 1 2 3", &["CELLS", "entry 0 is -4"]),
        (&whole, "4 0 1 2 3", "5 0 1 2 3", &["cell 0 has 5 points, but 4 numbers are left"]),
        (&whole, "4 0 1 2 3", "3 0 1 2 3", &["1 numbers are left after 1 cells"]),
        (&whole, "CELLS 1 5", "CELLS 2 5", &["end before cell 1 of 2"]),
        (&whole, "CELLS 1 5", "CELLS 0 0", &["line 17", "`4` is no keyword"]),
        (&whole, "CELLS 1 5", "CELLS 1 -5", &["line 16", "CELLS: `-5` is not a whole number"]),
        (&whole, "CELL_TYPES 1\n10", "CELL_TYPES 1\n42", &["type 42"]),
        (&whole, "CELL_TYPES 1\n10", "CELL_TYPES 2\n10 10", &["2 types for 1 cells"]),
        (&whole, "CELL_TYPES 1\n10", "", &["CELL_TYPES", "there are none"]),
        (&whole, "POINTS 4 double", "POINTS 3 double", &["`0` is no keyword"]),
        (&whole, "POINTS 4 double", "POINTS 4 quadruple", &["`quadruple` is not a type"]),
        (&whole, "POINT_DATA 4\n", "POINT_DATA 3\n", &["`4` is no keyword"]),
        (&whole, "POINT_DATA 4\n", "POINT_DATA 5\n", &["SCALARS `a`", "expected 5 x 1 numbers, found 4"]),
        (&whole, "POINT_DATA 4\n", "CELL_DATA 4\n", &["4 values for 1 cells"]),
        (&whole, "POINT_DATA 4\n", "", &["`SCALARS` is no keyword that can stand here"]),
        (&whole, "SCALARS a float", "SCALARS a float four", &["`four` is not a whole number"]),
        (&whole, "UNSTRUCTURED_GRID", "POLYDATA", &["POLYDATA", "ParaView"]),
        (&whole, "UNSTRUCTURED_GRID", "FIELD", &["`FIELD` is no grid"]),
        (&whole, "DATASET UNSTRUCTURED_GRID", "", &["DATASET", "there is none"]),
        (&whole, "UNSTRUCTURED_GRID", "STRUCTURED_GRID", &["DIMENSIONS", "there are none"]),
        (&whole, "Version 3.0", "Version 7.2", &["line 1", "version `7.2`"]),
        (&whole, "# vtk DataFile", "# VDK datafile", &["line 1"]),
        (&whole, "\nASCII", "\nOCTAL", &["line 3", "neither ASCII nor BINARY"]),
        (&offsets, "0 4 ", "0 -4 ", &["OFFSETS", "entry 1 is -4"]),
        (&offsets, "0 4 ", "1 4 ", &["OFFSETS", "from 1 to 4 in place of 0 to 4"]),
        (&offsets, "0 4 ", "0 5 ", &["OFFSETS", "from 0 to 5"]),
        (&offsets, "CELLS 2 4", "CELLS 3 4", &["no CONNECTIVITY"]),
        (&offsets, "CONNECTIVITY", "CONNECTED", &["no CONNECTIVITY"]),
    ] {
        let line = refusal("m.vtk", &replaced(bytes, from, to), None);
        assert!(parts.iter().all(|part| line.contains(part)), "{from} -> {to}: {line}");
    }
    let steps = replaced(&offsets, "CELLS 2 4", "CELLS 4 4");
    let steps = replaced(&replaced(&steps, "0 4 ", "0 3 2 4 "), "CELL_TYPES 1\n10", "CELL_TYPES 3\n5 5 5");
    let line = refusal(
        "m.vtk",
        &replaced(
            &steps,
            "CELL_DATA 1\nSCALARS a float\nLOOKUP_TABLE default\n1",
            "CELL_DATA 3\nSCALARS a float\nLOOKUP_TABLE d\n1 1 1",
        ),
        None,
    );
    assert!(line.contains("cell 1 has points 3 to 2 of 4"), "{line}");
}

#[test]
fn broken_grids_are_refused() {
    let rectilinear = |dims: &str, x: &str| {
        format!(
            "# vtk DataFile Version 3.0\n\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS {dims}\nX_COORDINATES {x}\n\
             Y_COORDINATES 2 float 0 1\nZ_COORDINATES 2 float\n0 1\nPOINT_DATA 8\nSCALARS a float\n1 2 3 4 5 6 7 8\n"
        )
    };
    assert_eq!(mesh("m.vtk", rectilinear("2 2 2", "2 float 0 1").as_bytes(), None).points().len(), 8);
    for (dims, x, part) in [
        ("3 2 2", "2 float 0 1", "differ from 2 x 2 x 2"),
        ("3 2 2", "3 float 0 1 2", "8 values for 12 points"),
        ("2 2 2", "2 string\na\nb", "texts in place of numbers"),
    ] {
        assert!(refusal("m.vtk", rectilinear(dims, x).as_bytes(), None).contains(part), "{part}");
    }
    let flat = "# vtk DataFile Version 2.0\n\nASCII\nDATASET STRUCTURED_GRID\nDIMENSIONS 2 1 1\nPOINTS 2 float\n\
        0 0 0 1 0 0\nPOINT_DATA 2\nSCALARS a float 1\nLOOKUP_TABLE default\n1 2\n";
    assert!(refusal("m.vtk", flat.as_bytes(), None).contains("no cell with a volume"));
    let points = |dims: &str| {
        format!(
            "# vtk DataFile Version 1.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS {dims}\n\
             POINT_DATA 2\nSCALARS a float\n1 2\n"
        )
    };
    assert_eq!(volume("m.vtk", points("2 1 1").as_bytes(), None).scalars(), &Scalars::F32(vec![1.0, 2.0]));
    for dims in ["3 1 1", "2000000000 2000000000 2000000000", "0 1 1"] {
        refusal("m.vtk", points(dims).as_bytes(), None);
    }
}

#[test]
fn a_small_file_with_large_counts_fails_at_once() {
    let start = Instant::now();
    const MANY: [&str; 3] = ["100000000000", "18446744073709551615", "6148914691236517206"];
    for many in MANY {
        for encoding in ["ASCII", "BINARY"] {
            let head = format!("# vtk DataFile Version 4.2\n\n{encoding}\nDATASET UNSTRUCTURED_GRID\n");
            for end in [
                format!("POINTS {many} double\n"),
                format!("CELLS {many} {many}\n"),
                format!("CELLS {many} {many}\nOFFSETS vtktypeint64\n"),
                format!("CELL_TYPES {many}\n"),
                format!("FIELD f {many}\na 1 1 int\n"),
                format!("FIELD f 1\na {many} {many} int\n"),
                format!("FIELD f 1\na {many} 1 string\n"),
                format!("POINT_DATA {many}\nVECTORS v float\n"),
                format!("POINT_DATA {many}\nSCALARS v bit\n"),
                format!("POINT_DATA 2\nSCALARS v float {many}\n"),
                format!("POINT_DATA 2\nLOOKUP_TABLE v {many}\n"),
                format!("DIMENSIONS {many} {many} {many}\nX_COORDINATES {many} double\n"),
            ] {
                refusal("m.vtk", format!("{head}{end}1 2 3 4").as_bytes(), None);
            }
        }
        for layout in XmlLayout::all() {
            let bytes = vtu(&[model()], layout, None);
            let text = String::from_utf8_lossy(&bytes);
            for key in ["NumberOfPoints", "NumberOfCells"] {
                if layout.place == Place::Raw {
                    continue;
                }
                let at = text.find(key).unwrap();
                let end = at + text[at..].find(['>', ' ']).unwrap();
                let huge = format!("{}{key}=\"{many}\"{}", &text[..at], &text[end..]);
                refusal("m.vtu", huge.as_bytes(), None);
            }
        }
    }
    // Many pieces that name the same bytes do not fill the memory.
    let layout = XmlLayout { place: Place::Raw, ..XmlLayout::ASCII };
    let points = 200_000;
    let large = Model {
        points: vec![1.0; 3 * points],
        cells: vec![(10, vec![0, 1, 2, 3])],
        point_data: vec![Array::new("a", 1, ScalarType::U8, vec![1.0; points])],
        cell_data: Vec::new(),
    };
    let bytes = vtu(&[large], layout, None);
    let find = |part: &[u8]| bytes.windows(part.len()).position(|w| w == part).unwrap();
    let (begin, end) = (find(b"<Piece"), find(b"</UnstructuredGrid>"));
    let bombs = [&bytes[..begin], &bytes[begin..end].repeat(2000), &bytes[end..]].concat();
    assert!(matches!(read("m.vtu", &bombs, None), Err(ReadError::Expanded { .. })));
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

#[test]
fn a_grid_of_more_tetrahedra_than_the_limit_is_refused() {
    let n = 40;
    let axis: Vec<f64> = (0..n).map(f64::from).collect();
    let mut writer = LegacyWriter::new(Legacy { binary: true, ..Legacy::ASCII });
    writer.line("DATASET RECTILINEAR_GRID");
    for name in ["X", "Y", "Z"] {
        writer.line(&format!("{name}_COORDINATES {n} float"));
        writer.numbers(&axis, ScalarType::F32);
    }
    let values = vec![1.0; 64_000];
    writer.data("POINT_DATA", &[Array::new("a", 1, ScalarType::U8, values)]);
    let dir = tempfile::tempdir().unwrap();
    let path = put(dir.path(), "m.vtk", &writer.bytes);
    let with = |voxel_bytes| {
        let limits = Limits { voxel_bytes, ..Limits::default() };
        read_dataset(&path, &ReadOptions { limits, ..ReadOptions::default() })
    };
    assert!(matches!(with(1 << 20), Err(ReadError::TooLarge { .. })));
    assert!(with(1 << 24).is_ok());
}

/// Files of every family, small enough for many tries.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let small = || {
        let mut model = model();
        model.cells.truncate(3);
        model.points.truncate(3 * 20);
        model.point_data.iter_mut().for_each(|array| array.values.truncate(20 * array.components));
        model.cell_data.iter_mut().for_each(|array| array.values.truncate(3 * array.components));
        model
    };
    let xml = XmlLayout::all().into_iter().map(|layout| ("m.vtu", vtu(&[small(), small()], layout, None)));
    let old = Legacy::all().into_iter().map(|layout| ("m.vtk", legacy(&small(), layout)));
    let axis = |name: &str| (name.to_owned(), vec![0.0, 1.0]);
    let axes = [axis("Y_COORDINATES 2 float"), axis("Z_COORDINATES 2 float")];
    let grids = Legacy::all().into_iter().flat_map(move |layout| {
        let parts = [
            ("X_COORDINATES 3 float", vec![0.0, 1.0, 2.0]),
            (axes[0].0.as_str(), axes[0].1.clone()),
            (axes[1].0.as_str(), axes[1].1.clone()),
        ];
        let points = ("POINTS 12 float", (0..36).map(f64::from).collect());
        [
            ("m.vtk", grid(layout, &["DATASET STRUCTURED_POINTS", "DIMENSIONS 3 2 2"], &[])),
            ("m.vtk", grid(layout, &["DATASET RECTILINEAR_GRID", "DIMENSIONS 3 2 2"], &parts)),
            ("m.vtk", grid(layout, &["DATASET STRUCTURED_GRID", "DIMENSIONS 3 2 2"], &[points])),
        ]
    });
    xml.chain(old).chain(grids).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// A damaged file gives a data set or one line, never a panic.
    #[test]
    fn damaged_files_are_answered(
        which in any::<prop::sample::Index>(),
        cuts in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4_u8), 0..4),
        shorten in prop::option::weighted(0.3, any::<prop::sample::Index>()),
        variable in prop::option::of(prop::sample::select(vec!["momentum", "density", "flux:1", "heat", "phase"])),
    ) {
        thread_local!(static SAMPLES: Vec<(&'static str, Vec<u8>)> = samples());
        let (name, mut data) = SAMPLES.with(|samples| which.get(samples).clone());
        for (at, value, how) in cuts {
            let i = at.index(data.len());
            match how {
                // Bytes, digits, and missing and additional bytes.
                0 => data[i] = value,
                1 => data[i] = b'0' + value % 10,
                2 => drop(data.remove(i)),
                _ => data.insert(i, b'0' + value % 10),
            }
        }
        if let Some(at) = shorten {
            data.truncate(at.index(data.len()));
        }
        let dir = tempfile::tempdir().unwrap();
        let limits = Limits { voxel_bytes: 1 << 20, ..Limits::default() };
        let options = ReadOptions { limits, variable: variable.map(str::to_owned), ..ReadOptions::default() };
        match read_dataset(&put(dir.path(), name, &data), &options) {
            Ok(found) => drop(found.to_field()),
            Err(error) => {
                let line = error.to_string();
                prop_assert!(!line.is_empty() && !line.contains('\n'), "{line}");
            }
        }
    }
}
