//! Variants of the 3DGS file: column orders, missing columns, encodings and number types.

use glam::Vec3;
use sg_scene::model::{ExtraColumn, ExtraValues};
use sg_scene::synthetic::samples;

use super::{Folder, codes};
use crate::splat::ply::{OutElement, OutProperty, OutValues, write};
use crate::splat::{WarningCode, three_dgs};
use crate::{LoadOptions, load};

#[test]
fn columns_of_a_first_stage_file_are_renamed() {
    let folder = Folder::new();
    for (degree, rest) in [(3_u8, 45_usize), (0, 0)] {
        let g = samples::harmonic(64, degree, 31);
        let normals: Vec<f32> = g.position.iter().flat_map(|p| p.normalize_or_zero().to_array()).collect();
        let h = g.harmonics.as_ref().unwrap();
        // The rows in their true order, under the header that the program writes for them.
        let mut names: Vec<String> = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned).into();
        names.extend((0..rest).map(|i| format!("f_rest_{i}")));
        names.extend(
            ["opacity", "normal_0", "normal_1", "normal_2", "scale_0", "scale_1", "scale_2"].map(str::to_owned),
        );
        names.extend(["rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned));
        let vector = |v: &[Vec3], i: usize| v[i].to_array();
        let mut floats = Vec::new();
        for i in 0..64 {
            floats.extend(vector(&g.position, i));
            floats.extend(&normals[3 * i..3 * i + 3]);
            floats.extend(h.dc[i]);
            for channel in 0..3 {
                floats.extend((0..rest / 3).map(|k| h.rest[i * rest / 3 + k][channel]));
            }
            floats.push(g.opacity_logit[i]);
            floats.extend(vector(&g.log_scale, i));
            floats.extend(g.rotation[i]);
        }
        let width = names.len();
        let property =
            |(at, name): (usize, &String)| OutProperty::new(name.clone(), OutValues::F32(&floats), width, at);
        let mut out = Vec::new();
        write(
            &mut out,
            &[],
            &[OutElement { name: "vertex", rows: 64, properties: names.iter().enumerate().map(property).collect() }],
        )
        .unwrap();
        std::fs::write(folder.path("a.ply"), out).unwrap();
        let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
        assert_eq!(codes(&loaded), [WarningCode::Remapped]);
        let b = &loaded.scene.units[0].gaussians;
        assert_eq!(
            (&g.position, &g.rotation, &g.log_scale, &g.opacity_logit),
            (&b.position, &b.rotation, &b.log_scale, &b.opacity_logit)
        );
        assert_eq!(g.harmonics, b.harmonics);
        let ny: Vec<f32> = normals.iter().skip(1).step_by(3).copied().collect();
        assert_eq!(b.extra[1], ExtraColumn { name: "ny".to_owned(), values: ExtraValues::F32(ny) });
    }
}

#[test]
fn flat_gaussians_get_a_thickness() {
    let folder = Folder::new();
    let g = samples::harmonic(10, 0, 2);
    let properties = three_dgs::properties(&g).into_iter().filter(|p| p.name != "scale_2").collect();
    let mut out = Vec::new();
    write(&mut out, &[], &[OutElement { name: "vertex", rows: 10, properties }]).unwrap();
    std::fs::write(folder.path("a.ply"), out).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(codes(&loaded), [WarningCode::Flattened]);
    let b = &loaded.scene.units[0].gaussians;
    for i in 0..10 {
        assert_eq!(b.log_scale[i].truncate(), g.log_scale[i].truncate());
        let thinner = b.scale(i).x.min(b.scale(i).y);
        assert!((b.scale(i).z / thinner - 1e-3).abs() < 1e-8);
    }
}

/// A little-endian file's text and big-endian twins, made without the writer.
#[test]
fn all_encodings_read_the_same() {
    let folder = Folder::new();
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let header = |format: &str, end: &str| {
        let mut text = format!(
            "ply{end}format {format} 1.0{end}comment é{end}obj_info x{end}element face 2{end}property list uchar int v{end}element vertex 2{end}"
        );
        for name in names {
            text.push_str(&format!("property float {name}{end}"));
        }
        text.push_str(&format!("property double weight{end}property short id{end}end_header{end}"));
        text
    };
    let floats: Vec<f32> = (0..28).map(|i| (i as f32 - 3.5) * 0.37).collect();
    let mut text = header("ascii", "\n");
    text.push_str("3 0 1 2\n\n2 7 8\n");
    let (mut little, mut big) =
        (header("binary_little_endian", "\r\n").into_bytes(), header("binary_big_endian", "\n").into_bytes());
    for face in [[3_i32, 0, 1, 2].as_slice(), &[2, 7, 8]] {
        for out in [&mut little, &mut big] {
            out.push(face[0] as u8);
        }
        for v in &face[1..] {
            little.extend(v.to_le_bytes());
            big.extend(v.to_be_bytes());
        }
    }
    for (k, row) in floats.chunks(14).enumerate() {
        for x in row {
            text.push_str(&format!("{x} "));
            little.extend(x.to_le_bytes());
            big.extend(x.to_be_bytes());
        }
        let (weight, id) = (0.1 * k as f64 - 7.0, -300 * k as i16);
        text.push_str(&format!("  {weight} {id} \r\n"));
        little.extend([&weight.to_le_bytes()[..], &id.to_le_bytes()].concat());
        big.extend([&weight.to_be_bytes()[..], &id.to_be_bytes()].concat());
    }
    let mut read = Vec::new();
    for bytes in [text.into_bytes(), little, big] {
        std::fs::write(folder.path("a.ply"), bytes).unwrap();
        let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
        assert_eq!(codes(&loaded), [WarningCode::Ignored], "the faces");
        read.push(loaded.scene);
    }
    assert_eq!(read[0].units[0].gaussians.position[1].to_array(), floats[14..17]);
    assert_eq!(read[0].units[0].gaussians.extra[0].values, ExtraValues::F64(vec![-7.0, 0.1 - 7.0]));
    assert_eq!(read[0].units[0].gaussians.extra[1].values, ExtraValues::I16(vec![0, -300]));
    assert_eq!(read[0], read[1]);
    assert_eq!(read[0], read[2]);
}

#[test]
fn double_columns_are_narrowed_with_a_warning() {
    let folder = Folder::new();
    let mut text =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty float z\n".to_owned();
    for name in
        ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    {
        text.push_str(&format!("property float {name}\n"));
    }
    text.push_str("end_header\n0.1 1e400 3 nan 0 0 0 0 0 0 0 0 0 inf\n");
    std::fs::write(folder.path("a.ply"), text).unwrap();
    let loaded = load(&folder.path("a.ply"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.scene.units[0].gaussians.position[0].x, 0.1);
    assert_eq!(
        codes(&loaded),
        [WarningCode::Narrowed, WarningCode::NonFinite, WarningCode::NonFinite, WarningCode::NonFinite]
    );
    let messages: Vec<_> = loaded.warnings.iter().skip(1).map(|w| w.message.as_str()).collect();
    assert_eq!(
        messages,
        [
            "centres that are not finite and not drawn: 1",
            "rotations that are not finite and read as none: 1",
            "rows of harmonics that are not finite: 1"
        ]
    );
}
