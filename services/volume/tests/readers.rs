//! Every encoding of a volume gives the same values, and every broken file gives one clear line.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use sg_volume::{
    LabelEntry, LengthUnit, Limits, PatientFrame, ReadError, Scalars, Volume, WorldFrame, lacks_spacing, raw_file_name,
    read_volume, read_volume_within, write_raw,
};

fn values() -> Vec<i16> {
    (0..60).map(|i| (i * 521 % 4000) as i16 - 700).collect()
}

fn bytes(big_endian: bool) -> Vec<u8> {
    values().iter().flat_map(|v| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), Compression::default());
    e.write_all(data).unwrap();
    e.finish().unwrap()
}

fn zlib(data: &[u8]) -> Vec<u8> {
    let mut e = ZlibEncoder::new(Vec::new(), Compression::default());
    e.write_all(data).unwrap();
    e.finish().unwrap()
}

fn put(dir: &Path, name: &str, data: &[u8]) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, data).unwrap();
    path
}

fn joined(parts: &[&[u8]]) -> Vec<u8> {
    parts.concat()
}

#[test]
fn raw_files_are_read_in_every_packing_and_byte_order() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    for (name, data) in [
        ("v_3x4x5_int16.raw", bytes(false)),
        ("v_3x4x5_int16_le.raw", bytes(false)),
        ("v_3x4x5_int16_be.raw", bytes(true)),
        ("v_3x4x5_int16.raw.gz", gzip(&bytes(false))),
        ("v_3x4x5_int16_be.raw.zst", zstd::encode_all(bytes(true).as_slice(), 3).unwrap()),
    ] {
        let v = read_volume(&put(d, name, &data)).unwrap();
        assert_eq!(v.grid().dims(), [3, 4, 5], "{name}");
        assert_eq!(v.scalars(), &Scalars::I16(values()), "{name}");
        assert_eq!((v.grid().spacing(), v.grid().origin()), (DVec3::ONE, DVec3::ZERO));
        assert_eq!((v.frame(), lacks_spacing(Path::new(name))), (WorldFrame::default(), true));
    }
}

const NRRD: &str = "NRRD0005\n# made\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 3 4 5\n\
    space directions: (0,2,0) (-1.5,0,0) (0,0,0.5)\nspace origin: (10,20,30)\nkinds: domain domain domain\nkey:=a: b\n";

#[test]
fn nrrd_is_read_in_every_encoding_attached_and_detached() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let ascii = values().iter().fold(String::new(), |mut s, v| {
        let _ = writeln!(s, "{v}");
        s
    });
    put(d, "data.bin", &joined(&[b"junk", &bytes(true)]));
    put(d, "lines.bin", &joined(&[b"one\ntwo\n", b"xy", &bytes(false)]));
    put(d, "data.gz", &gzip(&bytes(false)));
    let cases: [(&str, &str, Vec<u8>); 8] = [
        ("a.nrrd", "encoding: raw\nendian: little\n\n", bytes(false)),
        ("b.nrrd", "encoding: raw\nendian: big\n\n", bytes(true)),
        ("c.nrrd", "encoding: gzip\nendian: little\n\n", gzip(&bytes(false))),
        ("d.nrrd", "encoding: ascii\n\n", ascii.into_bytes()),
        ("e.nhdr", "encoding: raw\nendian: big\nbyte skip: -1\ndata file: data.bin\n", vec![]),
        ("f.nhdr", "encoding: raw\nendian: little\nline skip: 2\nbyte skip: 2\ndata file: lines.bin\n", vec![]),
        ("g.nhdr", "encoding: gz\nendian: little\ndatafile: data.gz\n", vec![]),
        ("h.nrrd", "encoding: raw\r\nendian: little\r\n\r\n", bytes(false)),
    ];
    let direction = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
    for (name, end, data) in cases {
        let v = read_volume(&put(d, name, &joined(&[NRRD.as_bytes(), end.as_bytes(), &data]))).unwrap();
        assert_eq!(v.scalars(), &Scalars::I16(values()), "{name}");
        assert_eq!(v.grid().spacing(), DVec3::new(2.0, 1.5, 0.5), "{name}");
        assert_eq!(v.grid().origin(), DVec3::new(10.0, 20.0, 30.0), "{name}");
        assert_eq!(v.grid().direction(), direction, "{name}");
    }
    // One value along a fourth axis, and spacings instead of directions, one of them backwards.
    let four = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 1 2 2 2\nspacings: nan 1 -2 3\nencoding: raw\n\n";
    let v = read_volume(&put(d, "four.nrrd", &joined(&[four.as_bytes(), &[1, 2, 3, 4, 5, 6, 7, 8]]))).unwrap();
    assert_eq!(v.grid().dims(), [2, 2, 2]);
    assert_eq!(v.grid().to_world(DVec3::ONE), DVec3::new(1.0, -2.0, 3.0));
}

/// A header as 3D Slicer writes it, of this `space` and with other lines.
fn slicer(space: &str, lines: &str) -> String {
    format!(
        "NRRD0004\n# Complete NRRD file format specification at:\n# http://teem.sourceforge.net/nrrd/format.html\ntype: short\n\
         dimension: 3\nspace: {space}\nsizes: 3 4 5\n{lines}kinds: domain domain domain\nendian: little\nencoding: raw\n\
         space origin: (-115.5,30.25,-700)\n\n"
    )
}

#[test]
fn nrrd_tells_the_sides_of_a_patient_and_the_length_unit() {
    let dir = tempfile::tempdir().unwrap();
    let read =
        |header: &str| read_volume(&put(dir.path(), "v.nrrd", &joined(&[header.as_bytes(), &bytes(false)]))).unwrap();
    const AXES: &str = "space directions: (0.75,0,0) (0,0.75,0) (0,0,2.5)\n";
    let with_unit = |unit: &str| format!("{AXES}space units: \"{unit}\" \"{unit}\" \"{unit}\"\n");
    let (lps, ras, mm) = (Some(PatientFrame::Lps), Some(PatientFrame::Ras), Some(LengthUnit::Millimetre));
    let cases = [
        ("left-posterior-superior", AXES.to_owned(), lps, mm),
        ("LPS", with_unit("um"), lps, Some(LengthUnit::Micrometre)),
        ("right-anterior-superior", with_unit("mm"), ras, mm),
        ("Left-Anterior-Superior", AXES.to_owned(), ras, mm),
        ("scanner-xyz", with_unit("m"), None, Some(LengthUnit::Metre)),
        ("3D-right-handed", AXES.to_owned(), None, None),
        // Without directions the axes of the file lie anywhere in the patient.
        ("LPS", "spacings: 0.75 0.75 2.5\nunits: \"mm\" \"mm\" \"mm\"\n".to_owned(), None, mm),
        ("LPS", with_unit("furlong"), lps, None),
    ];
    for (space, lines, patient, unit) in cases {
        assert_eq!(read(&slicer(space, &lines)).frame(), WorldFrame { patient, unit }, "{space} {lines}");
    }
}

#[test]
fn nrrd_tells_names_and_colours_of_segments() {
    let dir = tempfile::tempdir().unwrap();
    let lines = "Segment0_Name:=cyst: left\nSegment0_Color:=1 0.5 0\nSegment0_LabelValue:=4\nSegment1_Name:=kidney\n\
                 space directions: (1,0,0) (0,1,0) (0,0,1)\nSegment1_Extent:=0 2 0 3 0 4\n";
    let header = slicer("left-posterior-superior", lines);
    let v = read_volume(&put(dir.path(), "v.seg.nrrd", &joined(&[header.as_bytes(), &bytes(false)]))).unwrap();
    let told = |label| v.labels().get(label).cloned();
    assert_eq!(told(4), Some(LabelEntry { name: Some("cyst: left".to_owned()), color: Some([1.0, 0.5, 0.0]) }));
    assert_eq!(told(2), Some(LabelEntry { name: Some("kidney".to_owned()), color: None }));
    assert_eq!(v.labels().labels().count(), 2);
}

#[test]
fn a_place_in_a_patient_is_the_same_in_every_space() {
    let dir = tempfile::tempdir().unwrap();
    // The same voxels of the same patient; x and y of RAS are those of LPS turned round, LAS is left-handed.
    let spaces = [
        ("LPS", "(0.75,0,0) (0,0.6,0) (0,0,2.5)", "(-10,20,30)", DVec3::new(1.0, 1.0, 1.0)),
        ("RAS", "(-0.75,0,0) (0,-0.6,0) (0,0,2.5)", "(10,-20,30)", DVec3::new(-1.0, -1.0, 1.0)),
        ("LAS", "(0.75,0,0) (0,-0.6,0) (0,0,2.5)", "(-10,-20,30)", DVec3::new(-1.0, -1.0, 1.0)),
    ];
    for (space, directions, origin, to_lps) in spaces {
        let header = format!(
            "NRRD0004\ntype: short\ndimension: 3\nspace: {space}\nsizes: 3 4 5\nspace directions: {directions}\n\
             endian: little\nencoding: raw\nspace origin: {origin}\n\n"
        );
        let v = read_volume(&put(dir.path(), "p.nrrd", &joined(&[header.as_bytes(), &bytes(false)]))).unwrap();
        let place = to_lps * v.grid().to_world(DVec3::new(2.0, 3.0, 4.0));
        assert!((place - DVec3::new(-8.5, 21.8, 40.0)).length() < 1e-12, "{space}: {place}");
        let frame = if space == "LPS" { PatientFrame::Lps } else { PatientFrame::Ras };
        assert_eq!(v.frame().patient, Some(frame), "{space}");
    }
}

fn vti(attributes: &str, array: &str, appended: &[u8]) -> Vec<u8> {
    let head = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" {attributes}>\n\
         <ImageData WholeExtent=\"2 4 0 3 1 5\" Origin=\"1 2 3\" Spacing=\"0.5 1 2\" Direction=\"0 -1 0 1 0 0 0 0 1\">\n\
         <Piece Extent=\"2 4 0 3 1 5\"><PointData Scalars=\"b\">\n\
         <DataArray type=\"Float32\" Name=\"v\" NumberOfComponents=\"3\" format=\"ascii\">1 2 3</DataArray>\n\
         <DataArray type=\"Int16\" Name=\"b\" {array}</DataArray>\n</PointData></Piece></ImageData>\n"
    );
    joined(&[head.as_bytes(), appended, b"</VTKFile>\n"])
}

fn appended(encoding: &str, data: &[u8]) -> Vec<u8> {
    joined(&[format!("<AppendedData encoding=\"{encoding}\">\n  _").as_bytes(), data, b"\n</AppendedData>\n"])
}

/// Header numbers of 32 or 64 bits.
fn numbers(wide: bool, big: bool, values: &[u64]) -> Vec<u8> {
    let one = |&v: &u64| match (wide, big) {
        (true, true) => v.to_be_bytes().to_vec(),
        (true, false) => v.to_le_bytes().to_vec(),
        (false, true) => (v as u32).to_be_bytes().to_vec(),
        (false, false) => (v as u32).to_le_bytes().to_vec(),
    };
    values.iter().flat_map(one).collect()
}

/// The bytes in zlib blocks of 50: header and blocks.
fn blocks(wide: bool, data: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let packed: Vec<Vec<u8>> = data.chunks(50).map(zlib).collect();
    let mut header = vec![packed.len() as u64, 50, (data.len() % 50) as u64];
    header.extend(packed.iter().map(|b| b.len() as u64));
    (numbers(wide, false, &header), packed.concat())
}

#[test]
fn vti_is_read_in_every_format() {
    let dir = tempfile::tempdir().unwrap();
    let le = bytes(false);
    let text = values().iter().map(i16::to_string).collect::<Vec<_>>().join(" ");
    let plain32 = joined(&[&numbers(false, false, &[120]), &le]);
    let plain64_big = joined(&[&numbers(true, true, &[120]), &bytes(true)]);
    let (head32, body32) = blocks(false, &le);
    let (head64, body64) = blocks(true, &le);
    let inline = |data: String| format!("format=\"binary\">\n   {data}\n  ");
    let by_offset = |n: usize| format!("format=\"appended\" offset=\"{n}\">");
    const LE: &str = "byte_order=\"LittleEndian\"";
    let z32 = format!("{LE} compressor=\"vtkZLibDataCompressor\"");
    let z64 = format!("{LE} header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"");
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("ascii", vti(LE, &format!("format=\"ascii\">{text}"), b"")),
        ("inline, header and data encoded as one", vti(LE, &inline(STANDARD.encode(&plain32)), b"")),
        (
            "inline, header and data encoded apart",
            vti(LE, &inline(STANDARD.encode(&plain32[..4]) + &STANDARD.encode(&le)), b""),
        ),
        (
            "inline, big endian, 64-bit header",
            vti("byte_order=\"BigEndian\" header_type=\"UInt64\"", &inline(STANDARD.encode(&plain64_big)), b""),
        ),
        ("inline zlib", vti(&z32, &inline(STANDARD.encode(&head32) + &STANDARD.encode(&body32)), b"")),
        ("appended raw", vti(LE, &by_offset(3), &appended("raw", &joined(&[b"xyz", &plain32])))),
        ("appended raw zlib", vti(&z64, &by_offset(0), &appended("raw", &joined(&[&head64, &body64])))),
        (
            "appended base64 zlib",
            vti(
                &z64,
                &by_offset(4),
                &appended(
                    "base64",
                    ("AAAA".to_owned() + &STANDARD.encode(&head64) + &STANDARD.encode(&body64)).as_bytes(),
                ),
            ),
        ),
    ];
    for (name, data) in cases {
        let v = read_volume(&put(dir.path(), "v.vti", &data)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(v.scalars(), &Scalars::I16(values()), "{name}");
        assert_eq!(v.variable(), Some("b"), "{name}");
        assert_eq!(v.grid().dims(), [3, 4, 5], "{name}");
        // Row-major direction [[0,-1,0],[1,0,0],[0,0,1]]: x runs along +y, y along −x. The extent starts at (2, 0, 1).
        assert_eq!(v.grid().to_world(DVec3::ZERO), DVec3::new(1.0, 3.0, 5.0), "{name}");
        assert_eq!(v.grid().to_world(DVec3::new(2.0, 1.0, 0.0)), DVec3::new(0.0, 4.0, 5.0), "{name}");
    }
    let cells = "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 2 0 2 0 2\" Spacing=\"1 1 1\"><Piece><CellData>\
        <DataArray type=\"UInt8\" Name=\"c\" format=\"ascii\">1 2 3 4 5 6 7 8</DataArray></CellData></Piece></ImageData></VTKFile>";
    let v = read_volume(&put(dir.path(), "cells.vti", cells.as_bytes())).unwrap();
    assert_eq!((v.grid().dims(), v.grid().origin()), ([2, 2, 2], DVec3::splat(0.5)));
}

#[test]
fn every_broken_file_gets_one_clear_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let le = bytes(false);
    let nrrd = |end: &str, data: &[u8]| joined(&[NRRD.as_bytes(), end.as_bytes(), data]);
    let raw_le = "encoding: raw\nendian: little\n\n";
    const LE: &str = "byte_order=\"LittleEndian\"";
    let plain = joined(&[&numbers(false, false, &[120]), &le]);
    let (head, body) = blocks(false, &le);
    let z = format!("{LE} compressor=\"vtkZLibDataCompressor\"");
    let by_offset = "format=\"appended\" offset=\"0\">";
    let zst = zstd::encode_all(le.as_slice(), 3).unwrap();
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("cut_3x4x5_int16.raw", le[..119].to_vec(), &["expected 120 bytes", "found 119", "3 x 4 x 5 int16"]),
        ("long_3x4x5_int16.raw", joined(&[&le, b"!"]), &["expected 120 bytes", "found 121"]),
        ("cut_3x4x5_int16.raw.zst", zst[..zst.len() - 5].to_vec(), &["expected 120 bytes", "found"]),
        ("cut_3x4x5_int16.raw.gz", gzip(&le)[..40].to_vec(), &["expected 120 bytes", "found"]),
        ("long_3x4x4_int16.raw.zst", zst.clone(), &["expected 96 bytes", "found more than 96"]),
        ("few_300x400x5_int16.raw.zst", zst.clone(), &["expected 1200000 bytes", "found 120"]),
        ("bad_3x4x5_int16.raw.gz", b"this is no gzip stream at all".to_vec(), &["bad_3x4x5"]),
        ("huge_4000x4000x200_float64.raw.zst", zst, &["25600000000 bytes", "limit"]),
        ("far_90000x4000x1_uint8.raw.gz", gzip(&le), &["expected 360000000 bytes", "at most"]),
        ("none.raw", le.clone(), &["file name", "_XxYxZ_type", "bonsai_256x256x256_uint8.raw"]),
        ("none_3x4x0_uint8.raw", vec![], &["dimensions [3, 4, 0]"]),
        ("odd_3x4x5_int12.raw", le.clone(), &["_XxYxZ_type"]),
        ("volume.dcm", le.clone(), &["byte 128: no DICM", "DICOM part 10"]),
        ("volume.dat", le.clone(), &["no known volume extension", ".nrrd"]),
        ("volume.bin", b"\x89HDF\r\n\x1a\n".to_vec(), &["content: HDF5 cannot be read", "Fiji"]),
        ("magic.nrrd", b"MRRD0004\n".to_vec(), &["line 1", "magic"]),
        ("cut.nrrd", nrrd(raw_le, &le[..100]), &["expected 120 bytes", "found 100", "sizes"]),
        ("long.nrrd", nrrd(raw_le, &joined(&[&le, b"!!"])), &["expected 120", "found 122"]),
        ("endian.nrrd", nrrd("encoding: raw\n\n", &le), &["no field `endian`"]),
        ("hex.nrrd", nrrd("encoding: hex\nendian: little\n\n", &le), &["line 11", "encoding: hex", "gzip"]),
        ("list.nhdr", nrrd("encoding: raw\nendian: little\ndata file: LIST\na\nb\n", b""), &["slices"]),
        ("gone.nhdr", nrrd("encoding: raw\nendian: little\ndata file: gone.bin\n", b""), &["gone.bin"]),
        ("word.nrrd", nrrd("encoding: ascii\n\n", b"1 2 x"), &["value 3", "`x`", "int16"]),
        ("few.nrrd", nrrd("encoding: ascii\n\n", b"1 2 3"), &["expected 60 numbers", "found 3"]),
        ("many.nrrd", nrrd("encoding: ascii\n\n", "7 ".repeat(61).as_bytes()), &["expected 60", "at least 61"]),
        (
            "type.nrrd",
            b"NRRD0004\ntype: block\ndimension: 3\nsizes: 1 1 1\nencoding: raw\n\n".to_vec(),
            &["line 2", "block"],
        ),
        ("rgb.nrrd", b"NRRD0004\ntype: uint8\ndimension: 4\nsizes: 3 2 2 2\nencoding: raw\n\n".to_vec(), &["4 axes"]),
        ("field.nrrd", b"NRRD0004\nnonsense\n\n".to_vec(), &["line 2", "nonsense"]),
        (
            "nan.nrrd",
            b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1 1 1\nspacings: 1 0 1\nencoding: raw\n\n!".to_vec(),
            &["spacing"],
        ),
        ("text.vti", b"hello".to_vec(), &["VTK XML"]),
        ("poly.vti", b"<VTKFile type=\"PolyData\"></VTKFile>".to_vec(), &["PolyData", "ImageData"]),
        ("cut.vti", vti(LE, by_offset, &appended("raw", &plain[..90])), &["expected 120 bytes", "found"]),
        ("xml.vti", vti(LE, "format=\"ascii\">1 2 3</Data", b""), &["byte"]),
        ("few.vti", vti(LE, "format=\"ascii\">1 2 3", b""), &["expected 60 numbers", "found 3"]),
        ("base64.vti", vti(LE, "format=\"binary\">!!!!", b""), &["base64"]),
        ("noappend.vti", vti(LE, by_offset, b""), &["no AppendedData"]),
        ("offset.vti", vti(LE, "format=\"appended\" offset=\"9999\">", &appended("raw", &plain)), &["offset 9999"]),
        ("lz4.vti", vti("compressor=\"vtkLZ4DataCompressor\"", by_offset, &appended("raw", &plain)), &["LZ4", "zlib"]),
        ("block.vti", vti(&z, by_offset, &appended("raw", &joined(&[&head, &body[..20]]))), &["block"]),
        (
            "blocks.vti",
            vti(&z, by_offset, &appended("raw", &numbers(false, false, &[u64::from(u32::MAX), 50, 0]))),
            &["blocks"],
        ),
    ];
    let mut wrong = Vec::new();
    for (name, data, parts) in cases {
        let error = match read_volume(&put(d, name, &data)) {
            Ok(_) => "it was read".to_owned(),
            Err(error) => error.to_string(),
        };
        let missing: Vec<&str> =
            parts.iter().copied().chain(name.split('.').next()).filter(|p| !error.contains(p)).collect();
        if !missing.is_empty() || error.contains('\n') {
            wrong.push(format!("{name}: {missing:?} missing in: {error}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(matches!(read_volume(&d.join("absent_1x1x1_uint8.raw")), Err(ReadError::Io { .. })));
    assert!(matches!(read_volume(&d.join(".")), Err(ReadError::Format { .. } | ReadError::Io { .. })));
    std::fs::create_dir(d.join("folder_1x1x1_uint8.raw")).unwrap();
    assert!(matches!(read_volume(&d.join("folder_1x1x1_uint8.raw")), Err(ReadError::Io { .. })));
    let path = put(d, "v_3x4x5_int16.raw", &le);
    let small = Limits { voxel_bytes: 119, ..Limits::default() };
    assert!(matches!(read_volume_within(&path, small), Err(ReadError::TooLarge { bytes: 120, limit: 119, .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_written_file_reads_back(dims in prop::array::uniform3(1..6_usize), seed in any::<u64>(), kind in 0..4) {
        let n: usize = dims.iter().product();
        let noise = |i: usize| seed.wrapping_mul(2 * i as u64 + 1).rotate_left(17);
        let scalars: Scalars = match kind {
            0 => (0..n).map(|i| noise(i) as u8).collect::<Vec<_>>().into(),
            1 => (0..n).map(|i| noise(i) as i32).collect::<Vec<_>>().into(),
            2 => (0..n).map(|i| noise(i) as f32 * 1e-9).collect::<Vec<_>>().into(),
            _ => (0..n).map(|i| noise(i) as f64 * -1e-3).collect::<Vec<_>>().into(),
        };
        let volume = Volume::new(sg_volume::Grid::unit(dims).unwrap(), scalars, None).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let mut data = Vec::new();
        write_raw(volume.scalars(), &mut data).unwrap();
        let path = put(dir.path(), &raw_file_name("made", &volume), &data);
        prop_assert_eq!(read_volume(&path).unwrap(), volume);
    }

    /// A damaged file gives a volume or an error, never a panic.
    #[test]
    fn damaged_files_are_answered(
        which in 0..4_usize,
        cuts in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        shorten in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let le = bytes(false);
        let (head, body) = blocks(true, &le);
        let z = "byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";
        let (name, mut data) = match which {
            0 => ("d.nrrd", joined(&[NRRD.as_bytes(), b"encoding: raw\nendian: little\n\n", &le])),
            1 => ("d.nrrd", joined(&[NRRD.as_bytes(), b"encoding: gzip\nendian: little\n\n", &gzip(&le)])),
            2 => ("d.vti", vti(z, "format=\"appended\" offset=\"0\">", &appended("raw", &joined(&[&head, &body])))),
            _ => ("d_3x4x5_int16.raw.zst", zstd::encode_all(le.as_slice(), 3).unwrap()),
        };
        for (at, value) in cuts {
            let i = at.index(data.len());
            data[i] = value;
        }
        if let Some(at) = shorten {
            data.truncate(at.index(data.len()));
        }
        let dir = tempfile::tempdir().unwrap();
        match read_volume_within(&put(dir.path(), name, &data), Limits { voxel_bytes: 1 << 20, ..Limits::default() }) {
            Ok(volume) => prop_assert_eq!(volume.scalars().len(), volume.grid().len()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}

#[test]
fn a_header_names_data_in_its_own_folder_only_where_that_is_asked() {
    let dir = tempfile::tempdir().unwrap();
    let inner = dir.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    let data: Vec<u8> = (0..24).collect();
    for folder in [dir.path(), &inner] {
        std::fs::write(folder.join("data.bin"), &data).unwrap();
    }
    std::os::unix::fs::symlink("../data.bin", inner.join("link.bin")).unwrap();
    let own = Limits { own_folder: true, ..Limits::default() };
    for (name, is_own) in [("data.bin", true), ("../data.bin", false), ("link.bin", false)] {
        let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 3 4\nencoding: raw\ndata file: {name}\n");
        let path = inner.join("v.nhdr");
        std::fs::write(&path, header).unwrap();
        assert!(read_volume(&path).is_ok(), "{name}");
        match read_volume_within(&path, own) {
            Ok(_) => assert!(is_own, "{name} was read"),
            Err(error) => assert!(!is_own && error.to_string().contains(name), "{name}: {error}"),
        }
    }
}
