//! NIfTI files, written byte by byte in the order of the standard's header.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::io::Write as _;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use sg_volume::{
    LengthUnit, Limits, PatientFrame, ReadError, ScalarType, Scalars, Volume, WorldFrame, read_volume,
    read_volume_within,
};

/// Appends numbers in one byte order.
struct Bytes {
    bytes: Vec<u8>,
    big: bool,
}

macro_rules! number {
    ($($name:ident $ty:ty),*) => { $(fn $name(&mut self, x: $ty) {
        self.bytes.extend(if self.big { x.to_be_bytes() } else { x.to_le_bytes() });
    })* };
}

impl Bytes {
    number!(int16 i16, int32 i32, int64 i64, float32 f32, float64 f64);

    fn text(&mut self, text: &[u8], length: usize) {
        let end = self.bytes.len() + length;
        self.bytes.extend(text);
        self.bytes.resize(end, 0);
    }
}

#[derive(Clone)]
struct File {
    wide: bool,
    big: bool,
    /// `dim[0]` and the sizes; the rest is 1.
    dim: Vec<i64>,
    datatype: i16,
    bitpix: i16,
    pixdim: [f64; 4],
    vox_offset: Option<f64>,
    slope: f64,
    intercept: f64,
    codes: [i16; 2],
    quatern: [f64; 3],
    qoffset: [f64; 3],
    srow: [f64; 12],
    magic: Option<&'static [u8]>,
    extension: Vec<u8>,
    voxels: Vec<u8>,
}

const DIMS: [usize; 3] = [3, 4, 5];

fn values() -> Vec<i16> {
    (0..60).map(|i| (i * 521 % 4000) as i16 - 700).collect()
}

impl File {
    /// A 3 x 4 x 5 int16 file of unit spacing.
    fn new(wide: bool, big: bool) -> Self {
        let bytes = |v: &i16| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        Self {
            wide,
            big,
            dim: vec![3, 3, 4, 5],
            datatype: 4,
            bitpix: 16,
            pixdim: [1.0; 4],
            vox_offset: None,
            slope: 0.0,
            intercept: 0.0,
            codes: [0; 2],
            quatern: [0.0; 3],
            qoffset: [0.0; 3],
            srow: [0.0; 12],
            magic: None,
            extension: Vec::new(),
            voxels: values().iter().flat_map(bytes).collect(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut b = Bytes { bytes: Vec::new(), big: self.big };
        let end = if self.wide { 544 } else { 352 } + self.extension.len();
        let offset = self.vox_offset.unwrap_or(end as f64);
        let dim = |k: usize| self.dim.get(k).copied().unwrap_or(1);
        let pixdim = |k: usize| self.pixdim.get(k).copied().unwrap_or(0.0);
        if self.wide {
            b.int32(540);
            b.text(self.magic.unwrap_or(b"n+2\0\r\n\x1a\n"), 8);
            b.int16(self.datatype);
            b.int16(self.bitpix);
            (0..8).for_each(|k| b.int64(dim(k)));
            (0..3).for_each(|_| b.float64(0.0)); // intent_p
            (0..8).for_each(|k| b.float64(pixdim(k)));
            b.int64(offset as i64);
            b.float64(self.slope);
            b.float64(self.intercept);
            (0..4).for_each(|_| b.float64(7.0)); // cal_max, cal_min, slice_duration, toffset
            (0..2).for_each(|_| b.int64(7)); // slice_start, slice_end
            b.text(b"description", 80);
            b.text(b"", 24);
            self.codes.iter().for_each(|&c| b.int32(i32::from(c)));
            self.quatern.iter().chain(&self.qoffset).chain(&self.srow).for_each(|&x| b.float64(x));
            (0..3).for_each(|_| b.int32(2)); // slice_code, xyzt_units, intent_code
            b.text(b"density", 16);
            b.text(b"", 16); // dim_info, unused
            assert_eq!(b.bytes.len(), 540);
        } else {
            b.int32(348);
            b.text(b"", 28); // data_type, db_name
            b.int32(0);
            b.int16(0);
            b.text(b"r", 2);
            (0..8).for_each(|k| b.int16(dim(k) as i16));
            (0..3).for_each(|_| b.float32(0.0)); // intent_p
            b.int16(2); // intent_code
            b.int16(self.datatype);
            b.int16(self.bitpix);
            b.int16(7); // slice_start
            (0..8).for_each(|k| b.float32(pixdim(k) as f32));
            b.float32(offset as f32);
            b.float32(self.slope as f32);
            b.float32(self.intercept as f32);
            b.int16(7); // slice_end
            b.text(&[0, 2], 2); // slice_code, xyzt_units
            (0..4).for_each(|_| b.float32(7.0)); // cal_max, cal_min, slice_duration, toffset
            (0..2).for_each(|_| b.int32(7)); // glmax, glmin
            b.text(b"description", 80);
            b.text(b"", 24);
            self.codes.iter().for_each(|&c| b.int16(c));
            self.quatern.iter().chain(&self.qoffset).chain(&self.srow).for_each(|&x| b.float32(x as f32));
            b.text(b"density", 16);
            b.text(self.magic.unwrap_or(b"n+1\0"), 4);
            assert_eq!(b.bytes.len(), 348);
        }
        b.text(&[u8::from(!self.extension.is_empty())], 4);
        [b.bytes, self.extension.clone(), self.voxels.clone()].concat()
    }
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut e = GzEncoder::new(Vec::new(), Compression::default());
    e.write_all(data).unwrap();
    e.finish().unwrap()
}

fn put(dir: &Path, name: &str, data: &[u8]) -> PathBuf {
    let path = dir.join(name);
    std::fs::write(&path, data).unwrap();
    path
}

fn read(file: &File) -> Volume {
    let dir = tempfile::tempdir().unwrap();
    read_volume(&put(dir.path(), "v.nii", &file.bytes())).unwrap()
}

/// The files of both versions in both byte orders.
fn variants() -> [File; 4] {
    [(false, false), (false, true), (true, false), (true, true)].map(|(wide, big)| File::new(wide, big))
}

#[test]
fn a_map_to_the_patient_makes_the_frame_ras_and_the_unit_is_the_header_s() {
    let (ras, mm) = (Some(PatientFrame::Ras), Some(LengthUnit::Millimetre));
    for mut file in variants() {
        assert_eq!(read(&file).frame(), WorldFrame { patient: None, unit: mm });
        file.codes[0] = 1;
        assert_eq!(read(&file).frame(), WorldFrame { patient: ras, unit: mm }, "a qform");
        (file.codes, file.srow) = ([0, 1], [2.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
        assert_eq!(read(&file).frame(), WorldFrame { patient: ras, unit: mm }, "an sform");
    }
}

#[test]
fn both_versions_and_byte_orders_are_read_plain_and_gzipped() {
    let dir = tempfile::tempdir().unwrap();
    for (i, mut file) in variants().into_iter().enumerate() {
        for extension in [0, 16, 6000] {
            file.extension = vec![0xa5; extension];
            let data = file.bytes();
            let zipped = gzip(&data);
            let cases: [(&str, &[u8]); 4] =
                [("v.nii", &data), ("v.nii.gz", &zipped), ("V.NII.GZ", &zipped), ("zipped.nii", &zipped)];
            for (name, data) in cases {
                let v = read_volume(&put(dir.path(), name, data)).unwrap_or_else(|e| panic!("{i} {name}: {e}"));
                assert_eq!(v.grid().dims(), DIMS, "{i} {name}");
                assert_eq!(v.scalars(), &Scalars::I16(values()), "{i} {name}");
                assert_eq!(v.variable(), Some("density"), "{i} {name}");
                assert_eq!((v.grid().spacing(), v.grid().origin()), (DVec3::ONE, DVec3::ZERO), "{i} {name}");
            }
        }
    }
}

#[test]
fn every_scalar_type_is_read() {
    let types = [
        (2, ScalarType::U8),
        (256, ScalarType::I8),
        (4, ScalarType::I16),
        (512, ScalarType::U16),
        (8, ScalarType::I32),
        (768, ScalarType::U32),
        (1024, ScalarType::I64),
        (1280, ScalarType::U64),
        (16, ScalarType::F32),
        (64, ScalarType::F64),
    ];
    for (datatype, scalar) in types {
        for mut file in variants() {
            (file.datatype, file.bitpix, file.dim) = (datatype, 8 * scalar.bytes() as i16, vec![2, 2, 1]);
            // The values 1 and 100 in the type.
            let (ones, hundreds): ([u8; 8], [u8; 8]) = match scalar {
                ScalarType::F32 => {
                    (u64::from(1_f32.to_bits()).to_be_bytes(), u64::from(100_f32.to_bits()).to_be_bytes())
                }
                ScalarType::F64 => (1_f64.to_be_bytes(), 100_f64.to_be_bytes()),
                _ => (1_u64.to_be_bytes(), 100_u64.to_be_bytes()),
            };
            let stored = |value: [u8; 8]| {
                let mut bytes = value[8 - scalar.bytes()..].to_vec();
                if !file.big {
                    bytes.reverse();
                }
                bytes
            };
            file.voxels = [stored(ones), stored(hundreds)].concat();
            let v = read(&file);
            assert_eq!((v.scalars().scalar_type(), v.grid().dims()), (scalar, [2, 1, 1]));
            assert_eq!((v.scalars().get(0), v.scalars().get(1)), (Some(1.0), Some(100.0)), "{scalar:?}");
            file.bitpix = 0;
            assert_eq!(read(&file), v, "bitpix 0 is not checked");
        }
    }
}

#[test]
fn the_sform_goes_before_the_qform_and_the_qform_before_pixdim() {
    for mut file in variants() {
        file.pixdim = [-1.0, 2.0, -1.5, 0.5];
        let half = f64::from(std::f32::consts::FRAC_1_SQRT_2);
        // A quarter turn about z; qfac −1 mirrors the third axis.
        (file.quatern, file.qoffset) = ([0.0, 0.0, half], [10.0, 20.0, 30.0]);
        file.srow = [-3.0, 0.0, 0.0, 90.0, 0.0, 0.0, 2.0, -126.0, 0.0, 1.0, 0.0, -72.0];
        let v = read(&file);
        assert_eq!(v.grid().spacing(), DVec3::new(2.0, 1.5, 0.5));
        assert_eq!((v.grid().origin(), v.grid().direction()), (DVec3::ZERO, DMat3::IDENTITY));

        file.codes = [1, 0];
        let v = read(&file);
        assert_eq!(v.grid().origin(), DVec3::new(10.0, 20.0, 30.0));
        let corner = v.grid().to_world(DVec3::new(1.0, 2.0, 3.0));
        assert!((corner - DVec3::new(10.0 - 3.0, 20.0 + 2.0, 30.0 - 1.5)).length() < 1e-6, "{corner}");

        file.codes = [1, 2];
        let v = read(&file);
        assert_eq!(v.grid().spacing(), DVec3::new(3.0, 1.0, 2.0));
        assert_eq!(v.grid().direction(), DMat3::from_cols(DVec3::NEG_X, DVec3::Z, DVec3::Y));
        assert_eq!(v.grid().to_world(DVec3::ONE), DVec3::new(87.0, -124.0, -71.0));
    }
    // One slice without a thickness.
    let mut slice = File::new(false, false);
    (slice.dim, slice.pixdim) = (vec![3, 3, 20, 1], [1.0, 0.5, 0.5, 0.0]);
    assert_eq!(read(&slice).grid().spacing(), DVec3::new(0.5, 0.5, 1.0));
    slice.dim = vec![5, 3, 20, 1, 1, 0];
    assert_eq!(read(&slice).grid().dims(), [3, 20, 1]);
}

#[test]
fn values_are_scaled_as_the_header_says() {
    for mut file in variants() {
        for (slope, intercept) in [(0.0, 9.0), (f64::NAN, 9.0), (f64::INFINITY, 9.0), (f64::NAN, f64::NAN), (1.0, 0.0)]
        {
            (file.slope, file.intercept) = (slope, intercept);
            assert_eq!(read(&file).scalars(), &Scalars::I16(values()), "{slope} {intercept}");
        }
        (file.slope, file.intercept) = (0.5, -1024.0);
        let scaled = |x: i16| (f64::from(x) * 0.5 - 1024.0) as f32;
        assert_eq!(read(&file).scalars(), &Scalars::F32(values().into_iter().map(scaled).collect()));
        // Half as many int32 values; they need float64.
        (file.datatype, file.bitpix, file.dim) = (8, 32, vec![3, 3, 2, 5]);
        let stored = read(&File { slope: 0.0, ..file.clone() });
        let v = read(&file);
        assert_eq!(v.scalars().scalar_type(), ScalarType::F64);
        assert_eq!(v.scalars().get(7), stored.scalars().get(7).map(|x| x * 0.5 - 1024.0));
    }
}

#[test]
fn a_broken_file_gets_one_clear_line() {
    type Change = fn(&mut File);
    let cases: [(Change, &[&str]); 28] = [
        (|f| f.voxels.truncate(119), &["expected 120 bytes", "found 119", "3 x 4 x 5 int16"]),
        (|f| f.voxels.push(0), &["expected 120 bytes", "found 121"]),
        (|f| f.voxels.clear(), &["expected 120 bytes", "found 0"]),
        (|f| f.dim = vec![3, 3, 4, 6], &["expected 144 bytes", "found 120", "`dim`"]),
        (|f| f.dim = vec![0, 3, 4, 5], &["dim[0] is 0"]),
        (|f| f.dim = vec![8, 3, 4, 5], &["dim[0] is 8"]),
        (|f| f.dim = vec![-3, 3, 4, 5], &["dim[0] is -3"]),
        (|f| f.dim = vec![3, 3, -4, 5], &["dim[2] is -4"]),
        (|f| f.dim = vec![3, 3, 4, 0], &["dim[3] is 0"]),
        (|f| f.dim = vec![3, 32767, 32767, 32767], &["dimensions [32767, 32767, 32767]"]),
        (|f| f.dim = vec![3, 32767, 32767, 3], &["6442057734 bytes", "found 120"]),
        (|f| f.dim = vec![4, 3, 2, 5, 2], &["4 axes", "[3, 2, 5, 2]", "extract one 3-D volume", "fslroi"]),
        (|f| f.dim = vec![5, 3, 4, 5, 1, 3], &["5 axes", "extract one 3-D volume"]),
        (|f| f.datatype = 32, &["datatype 32", "complex", "magnitude"]),
        (|f| f.datatype = 128, &["datatype 128", "colour", "one channel"]),
        (|f| f.datatype = 1536, &["float128", "float64"]),
        (|f| f.datatype = 1, &["datatype 1", "convert the values"]),
        (|f| f.bitpix = 12, &["bitpix is 12 for int16"]),
        (|f| f.magic = Some(b"ni1\0"), &["magic", ".hdr and .img"]),
        (|f| f.magic = Some(b"n+9\0"), &["no magic", ".nii"]),
        (|f| f.vox_offset = Some(100.0), &["vox_offset is 100", "352"]),
        (|f| f.vox_offset = Some(1e9), &["vox_offset is 1000000000"]),
        (|f| f.vox_offset = Some(-352.0), &["vox_offset is -352"]),
        (|f| f.vox_offset = Some(400.0), &["expected 120 bytes", "found 72"]),
        (|f| (f.slope, f.intercept) = (2.0, f64::NAN), &["scl_inter is NaN"]),
        (|f| f.pixdim = [1.0, f64::NAN, 1.0, 1.0], &["spacing"]),
        (|f| (f.codes, f.quatern) = ([1, 0], [3.0, 0.0, 0.0]), &["quatern_b", "qform_code"]),
        (|f| f.codes = [0, 1], &["spacing"]),
    ];
    let dir = tempfile::tempdir().unwrap();
    for big in [false, true] {
        for (change, parts) in &cases {
            let mut file = File::new(false, big);
            change(&mut file);
            let error = read_volume(&put(dir.path(), "v.nii", &file.bytes())).unwrap_err().to_string();
            let missing: Vec<_> = parts.iter().filter(|p| !error.contains(**p)).collect();
            assert!(missing.is_empty() && !error.contains('\n') && error.contains("v.nii"), "{missing:?}: {error}");
        }
    }
    let good = File::new(false, false).bytes();
    let zipped = gzip(&good);
    let cases: [(&str, &[u8], &[&str]); 11] = [
        ("empty.nii", b"", &["sizeof_hdr"]),
        ("text.nii", &[b'x'; 400], &["sizeof_hdr is not 348 or 540"]),
        ("cut.nii", &good[..200], &["200 of 348 bytes"]),
        ("cut.nii.gz", &zipped[..zipped.len() - 30], &["expected 120 bytes", "found"]),
        ("start.nii.gz", &zipped[..12], &["sizeof_hdr"]),
        ("broken.nii.gz", b"\x1f\x8b nothing of gzip", &["broken.nii.gz"]),
        ("pair.hdr", &good, &["pair", ".nii"]),
        ("pair.img", &good, &["pair", ".nii"]),
        ("pair.img.gz", &zipped, &["pair", ".nii"]),
        ("many.nii.gz", &gzip(&[good.clone(), vec![0; 9]].concat()), &["found more than 120"]),
        (
            "wide.nii",
            &File { dim: vec![3, i64::MAX, i64::MAX, i64::MAX], ..File::new(true, false) }.bytes(),
            &["dimensions"],
        ),
    ];
    for (name, data, parts) in cases {
        let error = read_volume(&put(dir.path(), name, data)).unwrap_err().to_string();
        let missing: Vec<_> = parts.iter().filter(|p| !error.contains(**p)).collect();
        assert!(missing.is_empty() && !error.contains('\n') && error.contains(name), "{missing:?}: {error}");
    }
}

#[test]
fn limits_hold_for_stored_and_for_scaled_values() {
    let dir = tempfile::tempdir().unwrap();
    let mut file = File::new(true, false);
    let path = put(dir.path(), "v.nii", &file.bytes());
    let within = |voxel_bytes| read_volume_within(&path, Limits { voxel_bytes, ..Limits::default() });
    assert!(matches!(within(119), Err(ReadError::TooLarge { bytes: 120, limit: 119, .. })));
    assert!(within(120).is_ok());
    (file.slope, file.intercept) = (2.0, 1.0);
    put(dir.path(), "v.nii", &file.bytes());
    assert!(matches!(within(239), Err(ReadError::TooLarge { bytes: 240, limit: 239, .. })));
    assert!(within(240).is_ok());
}

#[test]
fn the_first_bytes_tell_the_format_where_the_name_does_not() {
    let dir = tempfile::tempdir().unwrap();
    for file in variants() {
        let v = read_volume(&put(dir.path(), "volume.dat", &file.bytes())).unwrap();
        assert_eq!(v.scalars(), &Scalars::I16(values()));
    }
    let nrrd = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: raw\n\n\x05\x06";
    assert_eq!(read_volume(&put(dir.path(), "volume", nrrd)).unwrap().scalars(), &Scalars::U8(vec![5, 6]));
    let vti = b"<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 1 0 0 0 0\" Spacing=\"1 1 1\"><Piece><PointData>\
        <DataArray type=\"UInt8\" Name=\"c\" format=\"ascii\">5 6</DataArray></PointData></Piece></ImageData></VTKFile>";
    assert_eq!(read_volume(&put(dir.path(), "volume.xml", vti)).unwrap().scalars(), &Scalars::U8(vec![5, 6]));
    let error = read_volume(&put(dir.path(), "volume.bin", b"DICM")).unwrap_err().to_string();
    assert!(error.contains("no known volume extension") && error.contains(".nii.gz"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    /// A damaged file gives a volume or an error, never a panic.
    #[test]
    fn damaged_files_are_answered(
        which in 0..4_usize,
        zipped in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        shorten in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut file = variants()[which].clone();
        (file.codes, file.slope) = ([1, (which % 2) as i16], 2.0);
        let mut data = file.bytes();
        for (at, value) in changes {
            let i = at.index(data.len());
            data[i] = value;
        }
        if let Some(at) = shorten {
            data.truncate(at.index(data.len()));
        }
        let dir = tempfile::tempdir().unwrap();
        let data = if zipped { gzip(&data) } else { data };
        match read_volume_within(&put(dir.path(), "d.nii", &data), Limits { voxel_bytes: 1 << 20, ..Limits::default() }) {
            Ok(volume) => prop_assert_eq!(volume.scalars().len(), volume.grid().len()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
