//! MetaImage files, written line by line as ITK writes them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DMat3, DVec3};
use sg_volume::{
    LengthUnit, Limits, PatientFrame, ReadError, ScalarType, Scalars, Volume, WorldFrame, read_volume,
    read_volume_within, reads_beside,
};

fn values() -> Vec<i16> {
    (0..60).map(|i| (i * 521 % 4000) as i16 - 700).collect()
}

fn bytes(big_endian: bool) -> Vec<u8> {
    values().iter().flat_map(|v| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
}

fn zlib(data: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

/// A header as ITK writes it for a CT, with the lines of the layout and the name of the data file.
fn itk(layout: &str, file: &str) -> String {
    format!(
        "ObjectType = Image\nNDims = 3\n{layout}TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\n\
         CenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\nElementSpacing = 2 1.5 0.5\nDimSize = 3 4 5\n\
         ElementType = MET_SHORT\nElementDataFile = {file}\n"
    )
}

fn read(dir: &Path, name: &str, parts: &[&[u8]]) -> Result<Volume, ReadError> {
    let path = dir.join(name);
    std::fs::write(&path, parts.concat()).unwrap();
    read_volume(&path)
}

#[test]
fn every_layout_gives_the_same_volume() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let text = values().iter().fold(String::new(), |mut text, value| {
        let _ = write!(text, "{value} ");
        text
    });
    std::fs::write(d.join("plain.raw"), bytes(false)).unwrap();
    std::fs::write(d.join("junk.raw"), [&b"junk"[..], &bytes(true)].concat()).unwrap();
    std::fs::write(d.join("packed.zraw"), zlib(&bytes(false))).unwrap();
    let plain = "BinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n";
    let packed = "BinaryData = True\nCompressedData = True\nCompressedDataSize = 99\n";
    let cases: [(&str, &str, &str, Vec<u8>); 9] = [
        ("a.mha", plain, "LOCAL", bytes(false)),
        ("b.mha", "BinaryDataByteOrderMSB = True\n", "LOCAL", bytes(true)),
        ("c.mha", packed, "LOCAL", zlib(&bytes(false))),
        ("d.mha", packed, "LOCAL", gzip(&bytes(false))),
        ("e.mha", "BinaryData = False\n", "LOCAL", text.into_bytes()),
        ("f.mhd", plain, "plain.raw", vec![]),
        ("g.mhd", "ElementByteOrderMSB = True\nHeaderSize = 4\n", "junk.raw", vec![]),
        ("h.mhd", "ElementByteOrderMSB = True\nHeaderSize = -1\n", "junk.raw", vec![]),
        ("i.mhd", packed, "packed.zraw", vec![]),
    ];
    for (name, layout, file, data) in cases {
        let volume = read(d, name, &[itk(layout, file).as_bytes(), &data]).unwrap();
        assert_eq!(volume.scalars(), &Scalars::I16(values()), "{name}");
        let grid = volume.grid();
        assert_eq!((grid.dims(), grid.spacing()), ([3, 4, 5], DVec3::new(2.0, 1.5, 0.5)), "{name}");
        // A row of the file's matrix is the direction of an axis.
        assert_eq!(grid.direction(), DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z), "{name}");
        assert_eq!(grid.origin(), DVec3::new(10.0, 20.0, 30.0), "{name}");
        assert!(reads_beside(Path::new(name)), "{name}");
    }
    // By content, under a name without an ending, and with the line ends of another system.
    let header = itk(plain, "LOCAL").replace('\n', "\r\n");
    assert_eq!(read(d, "unnamed", &[header.as_bytes(), &bytes(false)]).unwrap().grid().dims(), [3, 4, 5]);
}

#[test]
fn the_header_tells_the_patient_and_the_length_unit() {
    let dir = tempfile::tempdir().unwrap();
    let (lps, mm) = (Some(PatientFrame::Lps), Some(LengthUnit::Millimetre));
    let matrix = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\n";
    for (from, to, patient, unit) in [
        ("", "", lps, mm),
        ("AnatomicalOrientation = RAI\n", "AnatomicalOrientation = ???\n", None, None),
        ("AnatomicalOrientation = RAI\n", "DistanceUnits = um\n", None, Some(LengthUnit::Micrometre)),
        ("CenterOfRotation = 0 0 0\n", "DistanceUnits = um\n", lps, Some(LengthUnit::Micrometre)),
        // Without directions the axes of the file lie anywhere in the patient.
        (matrix, "", None, None),
    ] {
        let header = itk("", "LOCAL").replacen(from, to, 1);
        let volume = read(dir.path(), "v.mha", &[header.as_bytes(), &bytes(false)]).unwrap();
        assert_eq!(volume.frame(), WorldFrame { patient, unit }, "{header}");
    }
}

#[test]
fn old_and_long_forms_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    // The least header, in the other spelling of its keys and separators.
    let least = "NDims: 3\nDimSize: 2 2 2\nElementType: MET_UCHAR\nElementSize: 1 2 3\nElementDataFile: LOCAL\n";
    let volume = read(d, "least.mha", &[least.as_bytes(), &[1, 2, 3, 4, 5, 6, 7, 8]]).unwrap();
    assert_eq!(volume.grid().to_world(DVec3::ONE), DVec3::new(1.0, 2.0, 3.0));
    assert_eq!((volume.frame(), volume.variable()), (WorldFrame::default(), None));
    // A fourth axis of one sample.
    let four = "NDims = 4\nDimSize = 2 2 2 1\nElementSpacing = 1 2 3 1\nOffset = 5 6 7 0\nName = pressure\n\
                TransformMatrix = 1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let volume = read(d, "four.mha", &[four.as_bytes(), &[1, 2, 3, 4, 5, 6, 7, 8]]).unwrap();
    assert_eq!(volume.grid().to_world(DVec3::ONE), DVec3::new(6.0, 8.0, 4.0));
    assert_eq!(volume.variable(), Some("pressure"));
    for (name, scalar) in [
        ("MET_CHAR", ScalarType::I8),
        ("MET_USHORT", ScalarType::U16),
        ("MET_INT", ScalarType::I32),
        // MetaIO's long has 4 bytes on every machine.
        ("MET_LONG", ScalarType::I32),
        ("MET_ULONG", ScalarType::U32),
        ("MET_LONG_LONG", ScalarType::I64),
        ("MET_ULONG_LONG", ScalarType::U64),
        ("MET_FLOAT", ScalarType::F32),
        ("MET_DOUBLE", ScalarType::F64),
    ] {
        let header = format!("NDims = 3\nDimSize = 1 2 1\nElementType = {name}\nElementDataFile = LOCAL\n");
        let volume = read(d, "t.mha", &[header.as_bytes(), &vec![0; 2 * scalar.bytes()]]).unwrap();
        assert_eq!(volume.scalars().scalar_type(), scalar, "{name}");
    }
}

#[test]
fn every_broken_file_gets_one_clear_line() {
    let dir = tempfile::tempdir().unwrap();
    let le = bytes(false);
    let with = |from: &str, to: &str| itk("", "LOCAL").replacen(from, to, 1);
    let packed = itk("CompressedData = True\n", "LOCAL");
    let z = zlib(&le);
    let cases: [(&str, String, &[u8], &[&str]); 17] = [
        ("cut.mha", itk("", "LOCAL"), &le[..119], &["expected 120 bytes", "found 119", "DimSize"]),
        ("long.mha", itk("", "LOCAL"), &[&le[..], b"!"].concat(), &["expected 120 bytes", "found 121"]),
        ("few.mha", packed.clone(), &zlib(&le[..100]), &["expected 120 bytes", "found 100"]),
        ("many.mha", packed.clone(), &zlib(&[&le[..], b"!"].concat()), &["expected 120 bytes", "more than 120"]),
        ("broken.mha", packed.clone(), &z[..z.len() - 2], &["break off before their check sum"]),
        ("mesh.mha", with("Image", "Mesh"), &le, &["line 1", "ObjectType = Mesh", "type Image"]),
        ("none.mha", with("DimSize = 3 4 5\n", ""), &le, &["no field `DimSize`"]),
        ("flat.mha", with("NDims = 3", "NDims = 2"), &le, &["DimSize = 3 4 5"]),
        ("type.mha", with("MET_SHORT", "MET_SHORT_ARRAY"), &le, &["MET_SHORT_ARRAY", "MET_CHAR to MET_DOUBLE"]),
        (
            "rgb.mha",
            itk("ElementNumberOfChannels = 3\n", "LOCAL"),
            &le,
            &["ElementNumberOfChannels", "one value a voxel"],
        ),
        ("list.mhd", itk("", "LIST"), b"a.raw\n", &["line 10", "join the slices"]),
        ("pattern.mhd", itk("", "a%03d.raw 1 5 1"), b"", &["join the slices"]),
        ("gone.mhd", itk("", "gone.raw"), b"", &["gone.raw"]),
        ("spacing.mha", with("2 1.5 0.5", "2 1.5"), &le, &["ElementSpacing = 2 1.5", "give 3 numbers"]),
        ("zero.mha", with("2 1.5 0.5", "2 0 0.5"), &le, &["spacing"]),
        ("word.mha", itk("BinaryData = False\n", "LOCAL"), b"1 2 x", &["value 3", "`x`", "int16"]),
        ("line.mha", "NDims = 3\nnonsense\n".to_owned(), b"", &["line 2", "nonsense", "Key = Value"]),
    ];
    for (name, header, data, parts) in cases {
        let error = read(dir.path(), name, &[header.as_bytes(), data]).unwrap_err().to_string();
        let missing: Vec<_> =
            parts.iter().copied().chain(name.split('.').next()).filter(|p| !error.contains(p)).collect();
        assert!(missing.is_empty() && !error.contains('\n'), "{name}: {missing:?} missing in: {error}");
    }
    let path = dir.path().join("small.mha");
    std::fs::write(&path, [itk("", "LOCAL").as_bytes(), &le].concat()).unwrap();
    let error = read_volume_within(&path, Limits { voxel_bytes: 119, ..Limits::default() }).unwrap_err();
    assert!(matches!(error, ReadError::TooLarge { bytes: 120, limit: 119, .. }), "{error}");
}
