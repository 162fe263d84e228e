//! Every layout of a mesh gives the same tetrahedra.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

mod mesh_files;

use glam::DVec3;
use proptest::prelude::*;
use sg_volume::mesh::{LeftOut, MeshValues};
use sg_volume::{Dataset, Mesh, ReadError, ScalarType, Scalars};

use mesh_files::model::{
    cell_values, density, grid, mesh, model, one_cell, point_values, read, refusal, shapes, volume, volumes,
};
use mesh_files::{Array, Legacy, Model, XmlLayout, gzip, legacy, vtu};

/// Names that select a part of [`model`].
const VARIABLES: [&str; 9] =
    ["density", "momentum", "momentum:1", "momentum:z", "point number", "two:1", "material", "flux", "flux:0"];

#[test]
fn a_mesh_is_read_in_every_layout() {
    let model = model();
    for variable in VARIABLES {
        let expected = mesh("a.vtu", &vtu(std::slice::from_ref(&model), XmlLayout::ASCII, None), Some(variable));
        for layout in XmlLayout::all() {
            let bytes = vtu(std::slice::from_ref(&model), layout, None);
            assert!(mesh("b.vtu", &bytes, Some(variable)) == expected, "{variable} {layout:?}");
        }
        for layout in Legacy::all() {
            assert!(mesh("b.vtk", &legacy(&model, layout), Some(variable)) == expected, "{variable} {layout:?}");
        }
    }
}

#[test]
fn tetrahedra_fill_the_cells_and_carry_their_values() {
    let model = model();
    let bytes = vtu(std::slice::from_ref(&model), XmlLayout::ASCII, None);
    let by_cell = mesh("m.vtu", &bytes, Some("material"));
    assert_eq!((by_cell.scalar_type(), by_cell.left_out()), (ScalarType::U8, LeftOut::default()));
    let (values, volumes) = (cell_values(&by_cell), volumes(&by_cell));
    for (cell, (kind, _, expected)) in shapes().into_iter().enumerate() {
        let own = values.iter().zip(&volumes).filter(|(value, _)| **value == 100.0 + cell as f64);
        let sum: f64 = own.map(|(_, volume)| volume).sum();
        assert!((sum - expected).abs() < 1e-9, "type {kind}: {sum} for {expected}");
    }
    let by_point = mesh("m.vtu", &bytes, Some("density"));
    assert_eq!((by_point.scalar_type(), by_point.variable()), (ScalarType::F32, Some("density")));
    assert_eq!(by_point.cells(), by_cell.cells());
    for (point, value) in by_point.points().iter().zip(point_values(&by_point)) {
        assert!((value - density(*point)).abs() < 1e-5);
    }
    // The middles of the edges of a quadratic tetrahedron are corners of its eight parts.
    let quadratic = values.iter().filter(|value| **value == 107.0).count();
    assert_eq!(quadratic, 8);
}

#[test]
fn a_name_selects_a_quantity_a_component_or_a_length() {
    let model = model();
    let momentum = |p: &DVec3| DVec3::new(p.x, 3.0, 2.0 * p.z);
    for (name, bytes) in
        [("m.vtu", vtu(std::slice::from_ref(&model), XmlLayout::ASCII, None)), ("m.vtk", legacy(&model, Legacy::ASCII))]
    {
        type Part = fn(DVec3) -> f64;
        let parts: [(&str, Part); 4] =
            [("momentum", DVec3::length), ("momentum:1", |v| v.y), ("momentum:z", |v| v.z), ("momentum:x", |v| v.x)];
        for (variable, part) in parts {
            let found = mesh(name, &bytes, Some(variable));
            assert_eq!((found.variable(), found.scalar_type()), (Some("momentum"), ScalarType::F32), "{variable}");
            for (point, value) in found.points().iter().zip(point_values(&found)) {
                assert!((part(momentum(point)) - value).abs() < 1e-4 * value.abs().max(1.0), "{variable}");
            }
        }
        for (variable, parts) in [
            ("pressure", &["pressure", "density", "momentum (3 components)", "give one of"][..]),
            ("momentum:3", &["momentum", "no component `3` among 3", "0 to 2"]),
            ("momentum:w", &["no component `w`"]),
            ("density:1", &["no component `1` among 1"]),
        ] {
            let line = refusal(name, &bytes, Some(variable));
            assert!(parts.iter().all(|part| line.contains(part)), "{line}");
        }
    }
}

#[test]
fn without_a_name_the_active_scalars_come_first_and_then_any_scalar() {
    let all = model();
    let only = |points: &[usize], cells: &[usize]| Model {
        point_data: points.iter().map(|&i| all.point_data[i].clone()).collect(),
        cell_data: cells.iter().map(|&i| all.cell_data[i].clone()).collect(),
        ..all.clone()
    };
    for (model, active, xml, legacy_first) in [
        // A legacy file has its first SCALARS as the active ones: here the density, in the fourth place.
        (only(&[0, 1, 2, 3], &[0]), Some("density"), "density", "density"),
        (only(&[0, 1, 2, 3], &[0]), None, "point number", "density"),
        (only(&[0, 2], &[0, 1]), None, "material", "material"),
        (only(&[0], &[1]), None, "momentum", "flux"),
    ] {
        let bytes = vtu(std::slice::from_ref(&model), XmlLayout::ASCII, active);
        assert_eq!(mesh("m.vtu", &bytes, None).variable(), Some(xml));
        // Its cells come first in the file.
        assert_eq!(mesh("m.vtk", &legacy(&model, Legacy::ASCII), None).variable(), Some(legacy_first));
    }
    let none = only(&[], &[]);
    for (name, bytes) in
        [("m.vtu", vtu(std::slice::from_ref(&none), XmlLayout::ASCII, None)), ("m.vtk", legacy(&none, Legacy::ASCII))]
    {
        assert!(refusal(name, &bytes, None).contains("no quantity"));
    }
}

#[test]
fn pieces_become_one_mesh() {
    let model = model();
    for layout in XmlLayout::all() {
        let pieces = [Model::default(), model.clone(), Model::default(), model.clone()];
        for variable in ["density", "material"] {
            let one = mesh("one.vtu", &vtu(std::slice::from_ref(&model), layout, None), Some(variable));
            let two = mesh("two.vtu", &vtu(&pieces, layout, None), Some(variable));
            let points = one.points().len();
            assert_eq!(two.points(), [one.points(), one.points()].concat());
            let moved = one.cells().iter().map(|cell| cell.map(|i| i + points as u32)).collect::<Vec<_>>();
            assert_eq!(two.cells(), [one.cells(), &moved].concat());
            let values = |mesh: &Mesh| if variable == "density" { point_values(mesh) } else { cell_values(mesh) };
            assert_eq!(values(&two), [values(&one), values(&one)].concat());
        }
    }
    let mut other = model.clone();
    other.point_data[3].scalar = ScalarType::F64;
    let mixed = [model.clone(), other];
    assert!(refusal("m.vtu", &vtu(&mixed, XmlLayout::ASCII, None), Some("density")).contains("differs between pieces"));
    let mut without = model.clone();
    without.point_data.clear();
    let line = refusal("m.vtu", &vtu(&[model, without], XmlLayout::ASCII, None), Some("density"));
    assert!(line.contains("piece 1") && line.contains("no array `density`"), "{line}");
}

#[test]
fn files_packed_as_a_whole_are_read_and_content_shows_the_format() {
    let model = model();
    let (xml, old) = (vtu(std::slice::from_ref(&model), XmlLayout::ASCII, None), legacy(&model, Legacy::ASCII));
    let expected = mesh("m.vtu", &xml, Some("density"));
    for (ending, bytes) in [("vtu", &xml), ("vtk", &old)] {
        let packed = [("gz", gzip(bytes)), ("zst", zstd::encode_all(bytes.as_slice(), 3).unwrap())];
        for (packing, packed) in packed {
            assert!(mesh(&format!("M.{ending}.{packing}").to_uppercase(), &packed, Some("density")) == expected);
            let cut = &packed[..packed.len() / 2];
            assert!(matches!(read(&format!("m.{ending}.{packing}"), cut, None), Err(ReadError::Io { .. })));
        }
        assert!(mesh("unnamed", bytes, Some("density")) == expected);
    }
}

#[test]
fn structured_points_are_a_volume() {
    for layout in Legacy::all() {
        for geometry in [
            ["DATASET STRUCTURED_POINTS", "DIMENSIONS 3 2 2", "ORIGIN 1 2 3", "SPACING 0.5 2 4"],
            ["dataset structured_points", "aspect_ratio 0.5 2 4", "dimensions 3 2 2", "origin 1 2 3"],
        ] {
            let bytes = grid(layout, &geometry, &[]);
            let points = volume("v.vtk", &bytes, None);
            assert_eq!((points.grid().dims(), points.variable()), ([3, 2, 2], Some("heat")));
            assert_eq!(points.grid().origin(), DVec3::new(1.0, 2.0, 3.0));
            assert_eq!(points.grid().spacing(), DVec3::new(0.5, 2.0, 4.0));
            assert_eq!(points.scalars(), &Scalars::F32((0..12).map(|i| (i * i) as f32).collect()));
            let cells = volume("v.vtk", &bytes, Some("phase"));
            assert_eq!((cells.grid().dims(), cells.scalars()), ([2, 1, 1], &Scalars::U16(vec![0, 1])));
            assert_eq!(cells.grid().origin(), DVec3::new(1.25, 3.0, 5.0));
        }
    }
}

#[test]
fn other_grids_are_meshes_of_hexahedra() {
    let (x, y, z) = ([0.0, 1.0, 3.0], [0.0, 2.0], [-1.0, 0.5]);
    let points: Vec<f64> = (0..12).flat_map(|i| [x[i % 3], y[i / 3 % 2], z[i / 6]]).collect();
    for layout in Legacy::all() {
        let axes = [
            ("X_COORDINATES 3 float", x.to_vec()),
            ("Y_COORDINATES 2 float", y.to_vec()),
            ("Z_COORDINATES 2 float", z.to_vec()),
        ];
        let rectilinear = grid(layout, &["DATASET RECTILINEAR_GRID", "DIMENSIONS 3 2 2"], &axes);
        let structured = [("POINTS 12 float", points.clone())];
        let structured = grid(layout, &["DATASET STRUCTURED_GRID", "DIMENSIONS 3 2 2"], &structured);
        for variable in ["heat", "phase"] {
            let found = mesh("r.vtk", &rectilinear, Some(variable));
            assert!(found == mesh("s.vtk", &structured, Some(variable)));
            let sum: f64 = volumes(&found).iter().sum();
            assert!((sum - 3.0 * 2.0 * 1.5).abs() < 1e-9);
            if variable == "phase" {
                // The second cell is twice as long.
                let second: f64 =
                    volumes(&found).iter().zip(cell_values(&found)).filter(|(_, v)| *v == 1.0).map(|(v, _)| v).sum();
                assert!((second - 6.0).abs() < 1e-9);
            } else {
                assert_eq!(found.points().len(), 12);
                assert_eq!(point_values(&found)[11], 121.0);
            }
        }
    }
}

#[test]
fn every_kind_of_attribute_is_read_or_skipped() {
    let numbers = |n: usize| (0..4 * n).map(|i| i as f64).collect::<Vec<_>>();
    for layout in Legacy::all() {
        let colours = if layout.binary { ScalarType::U8 } else { ScalarType::F32 };
        let bytes = one_cell(layout, |writer| {
            writer.line("POINT_DATA 4");
            for (line, components, scalar) in [
                ("SCALARS bare double", 1, ScalarType::F64),
                ("SCALARS wide short 4\nLOOKUP_TABLE own", 4, ScalarType::I16),
                ("LOOKUP_TABLE own 4", 4, colours),
                ("COLOR_SCALARS colour 2", 2, colours),
                ("NORMALS normal float", 3, ScalarType::F32),
                ("VECTORS vector float", 3, ScalarType::F32),
                ("TENSORS tensor float", 9, ScalarType::F32),
                ("TENSORS6 half float", 6, ScalarType::F32),
                ("TEXTURE_COORDINATES texture 2 float", 2, ScalarType::F32),
                ("GLOBAL_IDS global vtkIdType", 1, ScalarType::I32),
                ("PEDIGREE_IDS pedigree vtktypeint64", 1, ScalarType::I64),
                (
                    "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n\
                     FIELD f 3\nNULL_ARRAY\none%20%25 1 4 long",
                    1,
                    ScalarType::I64,
                ),
            ] {
                writer.line(line);
                writer.numbers(&numbers(components), scalar);
            }
            writer.line("METADATA\nCOMPONENT_NAMES\nx\n");
            // The texts "ab" and "" of a FIELD.
            writer.line("two 2 4 unsigned_long");
            writer.numbers(&numbers(2), ScalarType::U64);
            writer.line("FIELD g 2\ntexts 1 2 string");
            writer.bytes.extend(if layout.binary { &b"\xc2ab\xc0\n"[..] } else { b"a%20b\n\n" });
            writer.line("last 1 4 unsigned_char");
            writer.numbers(&numbers(1), ScalarType::U8);
            writer.line("SCALARS bits bit\nLOOKUP_TABLE default");
            if layout.binary {
                writer.bytes.extend(b"\xa0\n");
            } else {
                writer.line("1 0 1 0");
            }
        });
        assert_eq!(mesh("m.vtk", &bytes, None).variable(), Some("bare"));
        for (name, step) in [
            ("bare", 1),
            ("wide:0", 4),
            ("colour:0", 2),
            ("normal:x", 3),
            ("vector:0", 3),
            ("tensor:0", 9),
            ("half:0", 6),
            ("texture:0", 2),
            ("global", 1),
            ("pedigree", 1),
            ("one %", 1),
            ("two:0", 2),
            ("last", 1),
        ] {
            let expected: Vec<f64> = (0..4).map(|i| f64::from(step * i)).collect();
            assert_eq!(point_values(&mesh("m.vtk", &bytes, Some(name))), expected, "{name} {layout:?}");
        }
        assert_eq!(point_values(&mesh("m.vtk", &bytes, Some("bits"))), [1.0, 0.0, 1.0, 0.0]);
        assert!(refusal("m.vtk", &bytes, Some("texts")).contains("none is called `texts`"));
    }
}

#[test]
fn words_for_values_that_are_not_finite_are_numbers() {
    let text = |numbers: &str| {
        one_cell(Legacy::ASCII, |writer| {
            writer.line(&format!("POINT_DATA 4\nSCALARS a float 1\nLOOKUP_TABLE d\n{numbers}"));
        })
    };
    let found = point_values(&mesh("m.vtk", &text("nan -inf\tInf -1e-3"), None));
    assert!(found[0].is_nan());
    assert_eq!(found[1..], [f64::NEG_INFINITY, f64::INFINITY, f64::from(-1e-3_f32)]);
    let line = refusal("m.vtk", &text("1 2\n3 four"), None);
    assert!(line.contains("line 24 of SCALARS `a`: `four` is not a value of type float32"), "{line}");
}

#[test]
fn cells_with_enormous_positions_are_left_out() {
    let mut model = Model { points: vec![0.0; 24], ..Model::default() };
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    for (i, x) in corners.into_iter().enumerate() {
        model.points[i] = x;
        model.points[12 + i] = x * 1e300;
    }
    model.cells = vec![(10, vec![0, 1, 2, 3]), (10, vec![4, 5, 6, 7])];
    model.cell_data = vec![Array::new("a", 1, ScalarType::F32, vec![1.0, 2.0])];
    let found = mesh("m.vtu", &vtu(std::slice::from_ref(&model), XmlLayout::ASCII, None), None);
    assert_eq!((found.cells().len(), found.left_out()), (1, LeftOut { flat: 0, non_finite: 1 }));
}

/// The points of each tetrahedron in increasing order: a reader may turn one.
fn sorted(mesh: &Mesh) -> Vec<[u32; 4]> {
    let mut cells = mesh.cells().to_vec();
    cells.iter_mut().for_each(|cell| cell.sort_unstable());
    cells
}

/// A mesh of tetrahedra with one quantity, in any type.
fn random_model() -> impl Strategy<Value = Model> {
    (4..20_usize, 1..20_usize, 0..10_usize, any::<u64>(), any::<bool>()).prop_map(
        |(points, cells, scalar, seed, of_cells)| {
            let noise =
                |i: usize| (seed ^ 0x9e37_79b9).wrapping_mul(2 * i as u64 + 1).rotate_left(17 + (i % 13) as u32);
            let scalar = ScalarType::ALL[scalar];
            let value = |i: usize| {
                (noise(i) % 100) as f64 + if matches!(scalar, ScalarType::F32 | ScalarType::F64) { 0.25 } else { 0.0 }
            };
            let entries = if of_cells { cells } else { points };
            let array = Array::new("any", 1, scalar, (0..entries).map(value).collect());
            let (point_data, cell_data) = if of_cells { (vec![], vec![array]) } else { (vec![array], vec![]) };
            Model {
                points: (0..3 * points).map(|i| (noise(i + 1000) % 4096) as f64 / 64.0 - 32.0).collect(),
                cells: (0..cells)
                    .map(|i| {
                        let mut corners: Vec<u32> = (0..points as u32).collect();
                        corners.sort_by_key(|&point| noise(5000 + 100 * i + point as usize));
                        (10, corners[..4].to_vec())
                    })
                    .collect(),
                point_data,
                cell_data,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn a_mesh_reads_back_from_every_layout(model in random_model(), xml in 0..25_usize, old in 0..8_usize) {
        let points: Vec<DVec3> = model.points.chunks(3).map(DVec3::from_slice).collect();
        let cells = model.cells.iter().map(|(_, points)| <[u32; 4]>::try_from(points.as_slice()).unwrap()).collect();
        let array = model.point_data.iter().chain(&model.cell_data).next().unwrap();
        let typed = |values: &[f64]| -> Scalars {
            match array.scalar {
                ScalarType::U8 => values.iter().map(|&x| x as u8).collect::<Vec<_>>().into(),
                ScalarType::I8 => values.iter().map(|&x| x as i8).collect::<Vec<_>>().into(),
                ScalarType::U16 => values.iter().map(|&x| x as u16).collect::<Vec<_>>().into(),
                ScalarType::I16 => values.iter().map(|&x| x as i16).collect::<Vec<_>>().into(),
                ScalarType::U32 => values.iter().map(|&x| x as u32).collect::<Vec<_>>().into(),
                ScalarType::I32 => values.iter().map(|&x| x as i32).collect::<Vec<_>>().into(),
                ScalarType::U64 => values.iter().map(|&x| x as u64).collect::<Vec<_>>().into(),
                ScalarType::I64 => values.iter().map(|&x| x as i64).collect::<Vec<_>>().into(),
                ScalarType::F32 => values.iter().map(|&x| x as f32).collect::<Vec<_>>().into(),
                ScalarType::F64 => values.to_vec().into(),
            }
        };
        let values = typed(&array.values);
        let values = if model.cell_data.is_empty() { MeshValues::Points(values) } else { MeshValues::Cells(values) };
        let expected = Mesh::new(points, cells, values, Some("any".to_owned())).ok();
        let xml = XmlLayout::all()[xml];
        let old = Legacy::all()[old];
        for (name, bytes) in [("m.vtu", vtu(std::slice::from_ref(&model), xml, None)), ("m.vtk", legacy(&model, old))] {
            match (read(name, &bytes, None), &expected) {
                (Ok(Dataset::Mesh(found)), Some(expected)) => {
                    prop_assert_eq!(found.points(), expected.points());
                    prop_assert_eq!(found.values(), expected.values());
                    prop_assert_eq!(sorted(&found), sorted(expected));
                    prop_assert!(volumes(&found).iter().all(|volume| *volume > 0.0));
                    prop_assert_eq!((found.left_out(), found.variable()), (expected.left_out(), Some("any")));
                }
                (Err(ReadError::Format { .. }), None) => {}
                (found, expected) => prop_assert!(false, "{name}: {found:?} for {expected:?}"),
            }
        }
    }
}
