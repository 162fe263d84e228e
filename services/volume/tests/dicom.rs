//! DICOM series, written by a crate that knows nothing of the reader.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::path::{Path, PathBuf};

use dicom_core::value::{DataSetSequence, PixelFragmentSequence};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use glam::DVec3;
use sg_volume::{
    Dataset, LengthUnit, Limits, PatientFrame, ReadError, ReadOptions, ScalarType, Scalars, Volume, WorldFrame,
    is_dicom, is_volume, read_dataset, read_volume, reads_beside,
};

const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const RLE: &str = "1.2.840.10008.1.2.5";
const LOSSLESS: &str = "1.2.840.10008.1.2.4.70";
const DIMS: [usize; 3] = [4, 3, 5];
/// Directions of rows and columns, and their normal.
const ROW: DVec3 = DVec3::new(0.8, 0.6, 0.0);
const COLUMN: DVec3 = DVec3::new(0.0, 0.0, -1.0);
const NORMAL: DVec3 = DVec3::new(-0.6, 0.8, 0.0);
const ORIGIN: DVec3 = DVec3::new(-20.0, 12.5, 70.0);
/// Lengths between columns, rows and slices.
const SPACING: DVec3 = DVec3::new(0.5, 0.75, 2.0);
/// What stands in every tag that tells of a person or a place.
const MARKER: &str = "MARKER^MEIER";

fn values() -> Vec<i16> {
    (0..60).map(|i| (i * 521 % 4000) as i16 - 700).collect()
}

fn bytes(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn slice_values(slice: usize) -> Vec<i16> {
    values()[12 * slice..][..12].to_vec()
}

fn text(object: &mut InMemDicomObject, tag: (u16, u16), vr: VR, value: &str) {
    object.put(DataElement::new(Tag(tag.0, tag.1), vr, value));
}

fn number(object: &mut InMemDicomObject, tag: (u16, u16), value: u16) {
    object.put(DataElement::new(Tag(tag.0, tag.1), VR::US, PrimitiveValue::from(value)));
}

fn sequence(object: &mut InMemDicomObject, tag: (u16, u16), items: Vec<InMemDicomObject>) {
    object.put(DataElement::new(Tag(tag.0, tag.1), VR::SQ, DataSetSequence::from(items)));
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join("\\")
}

fn place(slice: f64) -> String {
    joined(&(ORIGIN + slice * SPACING.z * NORMAL).to_array())
}

/// The attributes of a picture, without its place and its voxels.
fn picture(series: &str) -> InMemDicomObject {
    let mut object = InMemDicomObject::new_empty();
    for (tag, vr) in [
        ((0x0008, 0x0080), VR::LO),
        ((0x0008, 0x0090), VR::PN),
        ((0x0008, 0x1030), VR::LO),
        ((0x0008, 0x103E), VR::LO),
        ((0x0010, 0x0010), VR::PN),
        ((0x0010, 0x0020), VR::LO),
        ((0x0010, 0x4000), VR::LT),
        ((0x0018, 0x1030), VR::LO),
        ((0x0020, 0x0010), VR::SH),
    ] {
        text(&mut object, tag, vr, MARKER);
    }
    text(&mut object, (0x0008, 0x0016), VR::UI, "1.2.840.10008.5.1.4.1.1.2");
    text(&mut object, (0x0008, 0x0018), VR::UI, "2.25.777000777");
    text(&mut object, (0x0010, 0x0030), VR::DA, "19190919");
    text(&mut object, (0x0020, 0x000E), VR::UI, series);
    text(&mut object, (0x0028, 0x0004), VR::CS, "MONOCHROME2");
    for (element, value) in [
        (0x0002, 1),
        (0x0010, DIMS[1] as u16),
        (0x0011, DIMS[0] as u16),
        (0x0100, 16),
        (0x0101, 16),
        (0x0102, 15),
        (0x0103, 1),
    ] {
        number(&mut object, (0x0028, element), value);
    }
    object
}

fn oriented(object: &mut InMemDicomObject, slice: f64) {
    text(object, (0x0020, 0x0032), VR::DS, &place(slice));
    text(object, (0x0020, 0x0037), VR::DS, &joined(&[ROW.to_array(), COLUMN.to_array()].concat()));
    text(object, (0x0028, 0x0030), VR::DS, &joined(&[SPACING.y, SPACING.x]));
}

fn slice(series: &str, slice: usize) -> InMemDicomObject {
    let mut object = picture(series);
    oriented(&mut object, slice as f64);
    // Numbers of instances lie: they run against the places.
    text(&mut object, (0x0020, 0x0013), VR::IS, &(100 - slice).to_string());
    pixels(&mut object, bytes(&slice_values(slice)));
    object
}

fn pixels(object: &mut InMemDicomObject, bytes: Vec<u8>) {
    object.put(DataElement::new(Tag(0x7FE0, 0x0010), VR::OW, PrimitiveValue::from(bytes)));
}

fn fragments(object: &mut InMemDicomObject, fragments: Vec<Vec<u8>>) {
    object.put(DataElement::new(Tag(0x7FE0, 0x0010), VR::OB, PixelFragmentSequence::new_fragments(fragments)));
}

fn put(path: &Path, object: InMemDicomObject, syntax: &str) {
    let meta = FileMetaTableBuilder::new().transfer_syntax(syntax);
    object.with_meta(meta).unwrap().write_to_file(path).unwrap();
}

/// A folder of a series whose file names are in another order than its slices. `change` changes the slices.
fn series(folder: &Path, syntax: &str, change: impl Fn(usize, &mut InMemDicomObject)) -> Vec<PathBuf> {
    let names = ["IM0003", "a.dcm", "IM0001", "z", "IM0002.DCM"];
    let made = names.iter().enumerate().map(|(at, name)| {
        let mut object = slice("1.2.3.4", at);
        change(at, &mut object);
        let path = folder.join(name);
        put(&path, object, syntax);
        path
    });
    made.collect()
}

/// The same volume as NRRD, of these values.
fn nrrd(folder: &Path, kind: &str, data: &[u8]) -> Volume {
    let vector = |way: DVec3| format!("({},{},{})", way.x, way.y, way.z);
    let header = format!(
        "NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 5\n\
         space directions: {} {} {}\nspace origin: {}\nencoding: raw\nendian: little\n\n",
        vector(ROW * SPACING.x),
        vector(COLUMN * SPACING.y),
        vector(NORMAL * SPACING.z),
        vector(ORIGIN)
    );
    let path = folder.join("same.nrrd");
    std::fs::write(&path, [header.as_bytes(), data].concat()).unwrap();
    read_volume(&path).unwrap()
}

fn assert_same(one: &Volume, other: &Volume) {
    assert_eq!(one.scalars(), other.scalars());
    assert_eq!(one.frame(), other.frame());
    let (a, b) = (one.grid(), other.grid());
    assert_eq!(a.dims(), b.dims());
    for corner in [DVec3::ZERO, DVec3::new(3.0, 0.0, 0.0), DVec3::new(0.0, 2.0, 0.0), DVec3::new(0.0, 0.0, 4.0)] {
        assert!(a.to_world(corner).distance(b.to_world(corner)) < 1e-6, "{corner}");
    }
}

fn with_series(path: &Path, series: Option<usize>) -> Result<Volume, ReadError> {
    match read_dataset(path, &ReadOptions { series, ..ReadOptions::default() })? {
        Dataset::Volume(volume) => Ok(volume),
        Dataset::Mesh(_) => panic!("a mesh"),
    }
}

fn refused(path: &Path) -> String {
    let said = read_volume(path).unwrap_err().to_string();
    assert_eq!(said.lines().count(), 1, "{said}");
    said
}

#[test]
fn a_folder_and_each_of_its_files_give_the_volume_of_the_nrrd() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let same = nrrd(other.path(), "int16", &bytes(&values()));
    for syntax in [EXPLICIT, "1.2.840.10008.1.2", "1.2.840.10008.1.2.1.99"] {
        let files = series(folder.path(), syntax, |_, _| {});
        for path in files.iter().map(PathBuf::as_path).chain([folder.path()]) {
            assert!(is_volume(path) && is_dicom(path), "{}", path.display());
            let volume = read_volume(path).unwrap();
            assert_same(&volume, &same);
            assert!(volume.notes().is_empty() && volume.variable().is_none());
            let unit = Some(LengthUnit::Millimetre);
            assert_eq!(volume.frame(), WorldFrame { patient: Some(PatientFrame::Lps), unit });
        }
    }
    assert!(reads_beside(&folder.path().join("IM0001")) && !reads_beside(folder.path()));
    std::fs::write(folder.path().join("scene.toml"), "").unwrap();
    assert!(!is_volume(folder.path()) && !is_volume(other.path()));
}

#[test]
fn values_are_rescaled_slice_by_slice_and_padding_is_empty() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let padding = values()[7];
    let slope = |slice: usize| 0.5 + slice as f64;
    series(folder.path(), EXPLICIT, |slice, object| {
        text(object, (0x0028, 0x1053), VR::DS, &slope(slice).to_string());
        text(object, (0x0028, 0x1052), VR::DS, "-1024");
        text(object, (0x0028, 0x1050), VR::DS, "40\\300");
        text(object, (0x0028, 0x1051), VR::DS, "400\\1500");
        object.put(DataElement::new(Tag(0x0028, 0x0120), VR::SS, PrimitiveValue::from(padding)));
    });
    let rescaled = |(at, value): (usize, i16)| (f64::from(value) * slope(at / 12) - 1024.0) as f32;
    let expected: Vec<f32> = values().into_iter().enumerate().map(rescaled).collect();
    let volume = read_volume(folder.path()).unwrap();
    let Scalars::F32(found) = volume.scalars() else { panic!("{:?}", volume.scalars().scalar_type()) };
    for (at, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert!(found == expected || values()[at] == padding && found.is_nan(), "{at}: {found} {expected}");
    }
    assert_eq!(volume.scalars().range().non_finite, values().iter().filter(|value| **value == padding).count());
    assert_eq!(volume.notes(), ["the series suggests the window -160 to 240"]);
    // Without padding they are those of a NRRD of float.
    series(folder.path(), EXPLICIT, |slice, object| {
        text(object, (0x0028, 0x1053), VR::DS, &slope(slice).to_string());
        text(object, (0x0028, 0x1052), VR::DS, "-1024");
    });
    let data: Vec<u8> = expected.iter().flat_map(|value| value.to_le_bytes()).collect();
    assert_same(&read_volume(folder.path()).unwrap(), &nrrd(other.path(), "float", &data));
}

#[test]
fn stored_bits_of_every_width_keep_their_values() {
    let folder = tempfile::tempdir().unwrap();
    let read = |bits: [u16; 4], data: &dyn Fn(i16) -> Vec<u8>| {
        series(folder.path(), EXPLICIT, |slice, object| {
            for (element, value) in [0x0100, 0x0101, 0x0102, 0x0103].into_iter().zip(bits) {
                number(object, (0x0028, element), value);
            }
            pixels(object, slice_values(slice).into_iter().flat_map(data).collect());
        });
        read_volume(folder.path()).unwrap().scalars().clone()
    };
    let byte = read([8, 8, 7, 0], &|value| vec![value as u8]);
    assert_eq!(byte, Scalars::U8(values().iter().map(|value| *value as u8).collect()));
    let signed = read([8, 8, 7, 1], &|value| vec![value as u8]);
    assert_eq!(signed, Scalars::I8(values().iter().map(|value| *value as i8).collect()));
    // Twelve bits, and others above them.
    let twelve = read([16, 12, 11, 0], &|value| (value as u16 | 0xF000).to_le_bytes().to_vec());
    assert_eq!(twelve, Scalars::U16(values().iter().map(|value| *value as u16 & 0x0FFF).collect()));
    let wide = read([32, 32, 31, 1], &|value| (i32::from(value) * 70_000).to_le_bytes().to_vec());
    assert_eq!(wide, Scalars::I32(values().iter().map(|value| i32::from(*value) * 70_000).collect()));
}

/// Run lengths of a picture of 16 bits: literal runs of the high bytes, then of the low ones.
fn run_lengths(values: &[i16]) -> Vec<u8> {
    let segment = |byte: usize| {
        let bytes: Vec<u8> = values.iter().map(|value| value.to_be_bytes()[byte]).collect();
        // The last byte three times over, as a run: more than the picture needs.
        [vec![bytes.len() as u8 - 1], bytes.clone(), vec![254, bytes[bytes.len() - 1]]].concat()
    };
    let (high, low) = (segment(0), segment(1));
    let mut head = [2_u32, 64, 64 + high.len() as u32].to_vec();
    head.resize(16, 0);
    let head: Vec<u8> = head.into_iter().flat_map(u32::to_le_bytes).collect();
    [head, high, low].concat()
}

/// A lossless JPEG of 16 bits, each value predicted by the one before it. All 17 classes of differences have five bits.
fn lossless_jpeg(values: &[i16]) -> Vec<u8> {
    let (rows, columns) = (DIMS[1], DIMS[0]);
    let mut bits: Vec<bool> = Vec::new();
    for (at, value) in values.iter().enumerate() {
        let value = *value as u16;
        let before = match (at % columns, at / columns) {
            (0, 0) => 1 << 15,
            (0, row) => values[(row - 1) * columns] as u16,
            _ => values[at - 1] as u16,
        };
        let difference = i32::from(value.wrapping_sub(before).cast_signed());
        let class = 32 - difference.unsigned_abs().leading_zeros();
        bits.extend((0..5).rev().map(|bit| class >> bit & 1 == 1));
        if class < 16 {
            let stored = if difference < 0 { difference - 1 } else { difference };
            bits.extend((0..class).rev().map(|bit| stored >> bit & 1 == 1));
        }
    }
    bits.resize(bits.len().next_multiple_of(8), true);
    let mut scan = Vec::new();
    for byte in bits.chunks(8) {
        let byte = byte.iter().fold(0_u8, |byte, bit| byte << 1 | u8::from(*bit));
        scan.push(byte);
        if byte == 0xFF {
            scan.push(0);
        }
    }
    let frame = [0xFF, 0xC3, 0, 11, 16, 0, rows as u8, 0, columns as u8, 1, 1, 0x11, 0];
    let lengths: Vec<u8> = (1..=16).map(|length| if length == 5 { 17 } else { 0 }).collect();
    let table = [&[0xFF, 0xC4, 0, 36, 0][..], &lengths, &(0..17).collect::<Vec<u8>>()].concat();
    let start = [0xFF, 0xDA, 0, 8, 1, 1, 0, 1, 0, 0];
    [&[0xFF, 0xD8][..], &frame, &table, &start, &scan, &[0xFF, 0xD9]].concat()
}

#[test]
fn run_lengths_and_lossless_jpeg_give_the_same_volume() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let even = |mut bytes: Vec<u8>| {
        bytes.resize(bytes.len().next_multiple_of(2), 0);
        bytes
    };
    let same = nrrd(other.path(), "int16", &bytes(&values()));
    for (syntax, packed) in [(RLE, run_lengths as fn(&[i16]) -> Vec<u8>), (LOSSLESS, lossless_jpeg)] {
        let files = series(folder.path(), syntax, |slice, object| {
            fragments(object, vec![even(packed(&slice_values(slice)))]);
        });
        assert_same(&read_volume(folder.path()).unwrap(), &same);
        // A picture that breaks off.
        let mut object = slice("1.2.3.4", 1);
        fragments(&mut object, vec![even(packed(&slice_values(1))[..70].to_vec())]);
        put(&files[1], object, syntax);
        let said = refused(folder.path());
        assert!(said.contains("a.dcm: content:"), "{said}");
    }
    series(folder.path(), "1.2.840.10008.1.2.4.90", |_, object| fragments(object, vec![vec![0; 8]]));
    assert!(refused(folder.path()).contains("JPEG 2000, which is not read; unpack it with"));
}

#[test]
fn a_file_of_many_frames_is_a_volume() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let item = |tags: &[((u16, u16), &str)]| {
        let mut object = InMemDicomObject::new_empty();
        for (tag, value) in tags {
            text(&mut object, *tag, VR::DS, value);
        }
        object
    };
    let mut object = picture("1.2.3.4");
    text(&mut object, (0x0028, 0x0008), VR::IS, "5");
    let mut shared = InMemDicomObject::new_empty();
    let orientation = joined(&[ROW.to_array(), COLUMN.to_array()].concat());
    sequence(&mut shared, (0x0020, 0x9116), vec![item(&[((0x0020, 0x0037), orientation.as_str())])]);
    let spacing = joined(&[SPACING.y, SPACING.x]);
    sequence(&mut shared, (0x0028, 0x9110), vec![item(&[((0x0028, 0x0030), spacing.as_str())])]);
    sequence(&mut object, (0x5200, 0x9229), vec![shared]);
    let order = [3, 0, 4, 1, 2];
    let frames = order.map(|slice| {
        let mut frame = InMemDicomObject::new_empty();
        sequence(&mut frame, (0x0020, 0x9113), vec![item(&[((0x0020, 0x0032), place(f64::from(slice)).as_str())])]);
        let rescaling = [((0x0028, 0x1052), "-3"), ((0x0028, 0x1053), "2")];
        sequence(&mut frame, (0x0028, 0x9145), vec![item(&rescaling)]);
        frame
    });
    sequence(&mut object, (0x5200, 0x9230), frames.to_vec());
    pixels(&mut object, order.iter().flat_map(|slice| bytes(&slice_values(*slice as usize))).collect());
    let path = folder.path().join("enhanced");
    put(&path, object, EXPLICIT);
    let data: Vec<u8> = values().iter().flat_map(|value| (2.0 * f32::from(*value) - 3.0).to_le_bytes()).collect();
    let same = nrrd(other.path(), "float", &data);
    for path in [folder.path(), &path] {
        assert_same(&read_volume(path).unwrap(), &same);
    }
}

#[test]
fn of_several_series_the_largest_is_read_and_the_others_are_told() {
    let folder = tempfile::tempdir().unwrap();
    series(folder.path(), EXPLICIT, |_, _| {});
    for at in 0..2 {
        put(&folder.path().join(format!("other{at}")), slice("1.2.3.9", at), EXPLICIT);
    }
    let mut report = picture("1.2.3.10");
    number(&mut report, (0x0028, 0x0100), 16);
    put(&folder.path().join("report"), report, EXPLICIT);
    for name in ["notes.txt", "DICOMDIR"] {
        std::fs::write(folder.path().join(name), MARKER).unwrap();
    }
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let largest = read_volume(folder.path()).unwrap();
    assert_eq!(largest.grid().dims(), DIMS);
    assert_eq!(
        largest.notes(),
        [
            "series 1 of 2 was read, 5 slices of 4 x 3; others are 2 (2 slices of 4 x 3); --series N reads another",
            "1 file was left out: no DICOM",
            "1 file was left out: no voxels"
        ]
    );
    for (path, series) in [(folder.path().to_owned(), Some(2)), (folder.path().join("other1"), None)] {
        assert_eq!(with_series(&path, series).unwrap().grid().dims(), [4, 3, 2]);
    }
    let said = with_series(folder.path(), Some(3)).unwrap_err().to_string();
    assert!(said.contains("--series: no series 3") && said.contains("from 1 to 2"), "{said}");
    let said = with_series(&folder.path().join("none.nrrd"), Some(1)).unwrap_err().to_string();
    assert!(said.contains("a NRRD file holds one series"), "{said}");
}

#[test]
fn slices_that_make_no_grid_are_refused_by_the_names_of_their_files() {
    let read = |change: &dyn Fn(usize, &mut InMemDicomObject)| {
        let folder = tempfile::tempdir().unwrap();
        series(folder.path(), EXPLICIT, change);
        refused(folder.path())
    };
    let moved = |to: [f64; 5]| read(&|slice, object| text(object, (0x0020, 0x0032), VR::DS, &place(to[slice])));
    assert!(moved([0.0, 1.0, 2.0, 4.0, 5.0]).contains("slices: 1 missing between IM0001 and z; add the missing files"));
    assert!(moved([0.0, 1.0, 2.0, 3.0, 4.2]).contains("2.400 mm between z and IM0002.DCM, and 2.000 mm between most"));
    assert!(moved([0.0, 1.0, 2.0, 2.0, 3.0]).contains("are at the same place"));
    let of = |tag: (u16, u16), vr: VR, value: &'static str| {
        read(&|slice, object| {
            if slice == 2 {
                text(object, tag, vr, value);
            }
        })
    };
    for (tag, vr, value, part) in [
        ((0x0020, 0x0037), VR::DS, "1\\0\\0\\0\\1\\0", "ImageOrientationPatient: a plane in another direction"),
        ((0x0020, 0x0037), VR::DS, "", "no directions of rows and columns"),
        ((0x0020, 0x0032), VR::DS, "", "ImagePositionPatient: no place"),
        ((0x0020, 0x0032), VR::DS, "1\\2", "no number"),
        ((0x0020, 0x0032), VR::DS, "1\\2\\nan", "no number"),
        ((0x0028, 0x0030), VR::DS, "0.5\\0.5", "PixelSpacing: another spacing than that of"),
        ((0x0028, 0x0030), VR::DS, "0\\1", "a length that is not above 0"),
        ((0x0028, 0x0004), VR::CS, "RGB", "a colour picture"),
        ((0x0028, 0x0008), VR::IS, "70000", "number of frames"),
        ((0x0028, 0x0008), VR::IS, "2", "are at the same place"),
    ] {
        let said = of(tag, vr, value);
        assert!(said.contains(part) && said.contains("IM0001"), "{value}: {said}");
    }
    for (element, value, part) in
        [(0x0010, 2, "Rows and Columns"), (0x0100, 12, "8, 16 or 32 bits"), (0x0101, 17, "stored bits")]
    {
        let said = read(&|slice, object| {
            if slice == 2 {
                number(object, (0x0028, element), value);
            }
        });
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn a_tilted_gantry_leans_the_grid_and_a_note_tells_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |slice: f64| ORIGIN + slice * (SPACING.z * NORMAL + 0.4 * COLUMN);
    series(folder.path(), EXPLICIT, |slice, object| {
        text(object, (0x0020, 0x0032), VR::DS, &joined(&at(slice as f64).to_array()));
        text(object, (0x0028, 0x0004), VR::CS, "MONOCHROME1");
    });
    let volume = read_volume(folder.path()).unwrap();
    assert!(volume.grid().to_world(DVec3::new(0.0, 0.0, 4.0)).distance(at(4.0)) < 1e-6);
    let [tilt, inverted] = volume.notes() else { panic!("{:?}", volume.notes()) };
    assert!(tilt.contains("lean by 11.3 degrees") && inverted.contains("MONOCHROME1"), "{tilt} {inverted}");
}

#[test]
fn damaged_files_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let files = series(folder.path(), EXPLICIT, |_, _| {});
    let right = std::fs::read(&files[2]).unwrap();
    for length in 133..right.len() {
        std::fs::write(&files[2], &right[..length]).unwrap();
        let said = match read_volume(folder.path()) {
            Ok(volume) => {
                // The file ends between two elements, before its voxels.
                panic!("{length} bytes are taken: {:?}", volume.notes())
            }
            Err(error) => error.to_string(),
        };
        assert!(said.lines().count() == 1 && !said.contains(MARKER), "{length}: {said}");
    }
    // Bits of every place: never a crash, and never more memory than the file is worth.
    for at in 132..right.len() {
        let mut bytes = right.clone();
        bytes[at] ^= 0xFF;
        std::fs::write(&files[2], &bytes).unwrap();
        if let Err(error) = read_volume(folder.path()) {
            let said = error.to_string();
            assert!(said.lines().count() == 1 && !said.contains(MARKER), "{at}: {said}");
        }
    }
    // Sequences in sequences of any depth take no depth of calls.
    let deep = [&right[..right.len() - 36], &[0x08, 0, 0x15, 0x11, b'S', b'Q', 0, 0, 0xFF, 0xFF, 0xFF, 0xFF]].concat();
    let nested =
        [0xFE, 0xFF, 0, 0xE0, 0xFF, 0xFF, 0xFF, 0xFF, 8, 0, 0x15, 0x11, b'S', b'Q', 0, 0, 0xFF, 0xFF, 0xFF, 0xFF];
    std::fs::write(&files[2], [deep, nested.repeat(100_000)].concat()).unwrap();
    assert!(refused(folder.path()).contains("IM0001: content: sequences in sequences"));
}

#[test]
fn nothing_of_a_person_leaves_the_reader() {
    let folder = tempfile::tempdir().unwrap();
    let files = series(folder.path(), EXPLICIT, |_, _| {});
    put(&folder.path().join("other"), slice("1.2.777.9", 0), EXPLICIT);
    let personal = [MARKER, "MEIER", "1.2.3.4", "1.2.777.9", "2.25.777000777", "19190919"];
    let clean = |text: &str| personal.iter().all(|word| !text.contains(word));
    let volume = read_volume(folder.path()).unwrap();
    assert!(clean(&format!("{:?}", volume.notes())) && clean(&format!("{volume:?}")));
    // Marks in the numbers that the reader takes stay there, too.
    for (tag, vr) in [
        ((0x0020, 0x0032), VR::DS),
        ((0x0020, 0x0037), VR::DS),
        ((0x0028, 0x0030), VR::DS),
        ((0x0028, 0x1052), VR::DS),
        ((0x0028, 0x1053), VR::DS),
        ((0x0028, 0x0008), VR::IS),
        ((0x0028, 0x0004), VR::CS),
    ] {
        let mut object = slice("1.2.3.4", 2);
        text(&mut object, tag, vr, MARKER);
        put(&files[2], object, EXPLICIT);
        let error = read_volume(folder.path()).unwrap_err();
        assert!(clean(&error.to_string()) && clean(&format!("{error:?}")), "{error}");
    }
}

#[test]
fn limits_and_folders_without_slices() {
    let (folder, empty) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let files = series(folder.path(), EXPLICIT, |_, _| {});
    let read = |limits| read_dataset(folder.path(), &ReadOptions { limits, ..ReadOptions::default() });
    let said = read(Limits { voxel_bytes: 119, ..Limits::default() }).unwrap_err().to_string();
    assert!(said.contains("120 bytes of voxels exceed the limit of 119"), "{said}");
    // A link out of the folder is left out where only the folder may be read: a slice is missing then.
    let outside = empty.path().join("slice");
    std::fs::rename(&files[1], &outside).unwrap();
    std::os::unix::fs::symlink(&outside, &files[1]).unwrap();
    assert_eq!(read(Limits::default()).unwrap().scalar_type(), ScalarType::I16);
    let said = read(Limits { own_folder: true, ..Limits::default() }).unwrap_err().to_string();
    assert!(said.contains("missing between"), "{said}");
    std::fs::remove_file(&outside).unwrap();
    assert!(refused(empty.path()).contains("folder"));
    std::fs::write(empty.path().join("slice.dcm"), "no DICOM").unwrap();
    assert!(refused(&empty.path().join("slice.dcm")).contains("no DICM"));
}
