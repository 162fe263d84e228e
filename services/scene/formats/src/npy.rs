//! NumPy `.npy` files of masks, labels, indices, probabilities and pictures: little endian, C order.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use npyz::{DType, NpyHeader, Order, TypeChar, WriterBuilder};

use crate::staged_file::StagedFile;
use sg_input::file;
use sg_scene::mask::Mask;

/// Longest header that is read; those of plain arrays take 118 bytes.
const MAX_HEADER: usize = 1024;

/// An array file that cannot be used or written.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file could not be read.
    #[error("{path}: {source}; give the path of a NumPy .npy file")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file could not be written.
    #[error("{path}: {source}; nothing was changed")]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The content does not have the required form.
    #[error("{path}: {place}: {what}; {remedy}")]
    Content {
        /// The file.
        path: PathBuf,
        /// Header, or the element's index.
        place: String,
        /// The cause.
        what: String,
        /// The remedy.
        remedy: String,
    },
}

mod sealed {
    pub trait Sealed: npyz::AutoSerialize + npyz::Deserialize + Copy {}
    impl Sealed for u8 {}
    impl Sealed for i32 {}
    impl Sealed for i64 {}
    impl Sealed for u32 {}
    impl Sealed for u64 {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// An element type of an array file.
pub trait Element: sealed::Sealed {}
impl<T: sealed::Sealed> Element for T {}

/// Writes an array of any shape, the last axis fastest.
///
/// # Errors
/// [`NpyError::Write`] where the system refuses; [`NpyError::Content`] where the shape does not multiply to the number of values.
pub fn write_array<T: Element>(path: &Path, shape: &[usize], values: &[T]) -> Result<(), NpyError> {
    let wide: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    if shape.iter().try_fold(1_usize, |a, &b| a.checked_mul(b)) != Some(values.len()) {
        return Err(content(
            path,
            "shape",
            format!("{shape:?} holds not {} values", values.len()),
            "give a shape that fits",
        ));
    }
    let write = || -> io::Result<()> {
        let mut file = StagedFile::create(path)?;
        let mut array = npyz::WriteOptions::new().default_dtype().shape(&wide).writer(&mut file).begin_nd()?;
        array.extend(values.iter().copied())?;
        array.finish()?;
        file.commit().map(|_| ())
    };
    write().map_err(|source| NpyError::Write { path: path.to_path_buf(), source })
}

/// Writes a mask as `uint8 (n,)` of 0 and 1.
///
/// # Errors
/// [`NpyError::Write`].
pub fn write_mask(path: &Path, mask: &Mask) -> Result<(), NpyError> {
    let bytes: Vec<u8> = (0..mask.len()).map(|i| u8::from(mask.get(i))).collect();
    write_array(path, &[bytes.len()], &bytes)
}

/// Reads a mask of `len` Gaussians: `uint8` of 0 and 1, or `bool`, shape `(len,)`.
///
/// # Errors
/// [`NpyError`] if it cannot be read, has another type or length, or holds another value.
pub fn read_mask(path: &Path, len: usize) -> Result<Mask, NpyError> {
    let (header, mut data) = open(path)?;
    check_vector(path, &header)?;
    if !matches!(scalar(&header), Some((TypeChar::Uint | TypeChar::Bool, 1))) {
        return Err(wrong_type(path, &header, "uint8 or bool"));
    }
    let bytes: Vec<u8> = raw(path, &mut data, header.len())?;
    if bytes.len() != len {
        let what = format!("{} values for a scene of {len} Gaussians", bytes.len());
        return Err(content(path, "shape", what, "give the mask that was made for this scene"));
    }
    if let Some(i) = bytes.iter().position(|&b| b > 1) {
        let what = format!("the value is {}", bytes.get(i).copied().unwrap_or_default());
        return Err(content(path, &format!("element {i}"), what, "a mask holds only 0 and 1"));
    }
    Ok(Mask::from_fn(len, |i| bytes.get(i) == Some(&1)))
}

/// Writes labels as `int32 (n,)`.
///
/// # Errors
/// [`NpyError::Write`].
pub fn write_labels(path: &Path, labels: &[i32]) -> Result<(), NpyError> {
    write_array(path, &[labels.len()], labels)
}

/// Reads labels, `(n,)`, of any integer type whose values fit `int32`.
///
/// # Errors
/// [`NpyError`] if it cannot be read, is no vector of integers, or holds a value that does not fit.
pub fn read_labels(path: &Path) -> Result<Vec<i32>, NpyError> {
    read_integers(path)?
        .into_iter()
        .enumerate()
        .map(|(i, v)| {
            i32::try_from(v)
                .map_err(|_| content(path, &format!("element {i}"), format!("the label is {v}"), "labels are int32"))
        })
        .collect()
}

/// Reads indices, `(n,)`, of any integer type: each from 0 to below `below`.
///
/// # Errors
/// [`NpyError`] if it cannot be read, is no vector of integers, or holds an index out of range.
pub fn read_indices(path: &Path, below: usize) -> Result<Vec<usize>, NpyError> {
    read_integers(path)?
        .into_iter()
        .enumerate()
        .map(|(i, v)| {
            usize::try_from(v).ok().filter(|&v| v < below).ok_or_else(|| {
                let what = format!("the index is {v}");
                content(path, &format!("element {i}"), what, format!("indices run from 0 to below {below}"))
            })
        })
        .collect()
}

/// Reads a `float32` or `float64` array of any shape, C order, as `f64`: the shape and the values.
///
/// # Errors
/// [`NpyError`] if it cannot be read or has another type.
pub fn read_floats(path: &Path) -> Result<(Vec<usize>, Vec<f64>), NpyError> {
    let (header, data) = open(path)?;
    if header.order() == Order::Fortran && header.shape().len() > 1 {
        return Err(content(path, "header", "the array is in Fortran order", "save it with numpy.ascontiguousarray"));
    }
    let shape = header.shape().iter().map(|&n| usize::try_from(n).unwrap_or(usize::MAX)).collect();
    let values = match scalar(&header) {
        Some((TypeChar::Float, 4)) => values::<f32>(path, header, data)?.into_iter().map(f64::from).collect(),
        Some((TypeChar::Float, 8)) => values::<f64>(path, header, data)?,
        _ => return Err(wrong_type(path, &header, "float32 or float64")),
    };
    Ok((shape, values))
}

fn read_integers(path: &Path) -> Result<Vec<i64>, NpyError> {
    let (header, data) = open(path)?;
    check_vector(path, &header)?;
    let wide = match scalar(&header) {
        Some((TypeChar::Int, 1)) => values::<i8>(path, header, data)?.into_iter().map(i64::from).collect(),
        Some((TypeChar::Int, 2)) => values::<i16>(path, header, data)?.into_iter().map(i64::from).collect(),
        Some((TypeChar::Int, 4)) => values::<i32>(path, header, data)?.into_iter().map(i64::from).collect(),
        Some((TypeChar::Int, 8)) => values::<i64>(path, header, data)?,
        Some((TypeChar::Uint, 1)) => values::<u8>(path, header, data)?.into_iter().map(i64::from).collect(),
        Some((TypeChar::Uint, 2)) => values::<u16>(path, header, data)?.into_iter().map(i64::from).collect(),
        Some((TypeChar::Uint, 4)) => values::<u32>(path, header, data)?.into_iter().map(i64::from).collect(),
        // A value past the end of i64 is past the end of every scene, too.
        Some((TypeChar::Uint, 8)) => {
            values::<u64>(path, header, data)?.into_iter().map(|v| i64::try_from(v).unwrap_or(i64::MAX)).collect()
        }
        _ => return Err(wrong_type(path, &header, "an integer type")),
    };
    Ok(wide)
}

type Data = BufReader<File>;

/// Opens a file and reads its header; the data that the header promises are there.
fn open(path: &Path) -> Result<(NpyHeader, Data), NpyError> {
    let read = |source| NpyError::Read { path: path.to_path_buf(), source };
    let file::RegularFile { file, length: size, .. } = file::open(path).map_err(read)?;
    let mut file = BufReader::new(file);
    let mut start = Vec::with_capacity(MAX_HEADER);
    (&mut file).take(MAX_HEADER as u64).read_to_end(&mut start).map_err(read)?;
    let bad = |what: String| content(path, "header", what, "give a NumPy .npy file as numpy.save writes it");
    let length = match start.get(..12) {
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, _, _]) => 10 + usize::from(u16::from_le_bytes([*a, *b])),
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d]) => {
            u32::from_le_bytes([*a, *b, *c, *d]).saturating_add(12) as usize
        }
        _ => return Err(bad("this is no .npy file".to_owned())),
    };
    let Some(text) = start.get(..length) else {
        return Err(bad(format!("the header takes {length} bytes, the file or the limit of {MAX_HEADER} ends before")));
    };
    // The header is a Python expression: a bound on its brackets bounds the depth of the parser's recursion.
    if text.iter().filter(|b| matches!(b, b'(' | b'[' | b'{')).count() > 16 {
        return Err(bad("the type is not a plain number".to_owned()));
    }
    let header = NpyHeader::from_reader(text).map_err(|e| bad(e.to_string().replace('\n', " ")))?;
    let item = header.dtype().num_bytes().unwrap_or(usize::MAX) as u64;
    let need = header.shape().iter().try_fold(item, |a, &b| a.checked_mul(b));
    let have = size.saturating_sub(length as u64);
    if need.is_none_or(|need| need > have) {
        let what = format!(
            "shape {:?} of {} needs more than the {have} bytes that follow",
            header.shape(),
            header.dtype().descr()
        );
        return Err(content(path, "data", what, "the file is cut off: write it again"));
    }
    file.seek(SeekFrom::Start(length as u64)).map_err(read)?;
    Ok((header, file))
}

fn scalar(header: &NpyHeader) -> Option<(TypeChar, u64)> {
    match header.dtype() {
        DType::Plain(t) => Some((t.type_char(), t.size_field())),
        _ => None,
    }
}

fn check_vector(path: &Path, header: &NpyHeader) -> Result<(), NpyError> {
    if header.shape().len() == 1 {
        return Ok(());
    }
    Err(content(path, "header", format!("the shape is {:?}", header.shape()), "give an array of one axis, (n,)"))
}

fn values<T: npyz::Deserialize>(path: &Path, header: NpyHeader, data: Data) -> Result<Vec<T>, NpyError> {
    npyz::NpyFile::with_header(header, data)
        .into_vec()
        .map_err(|source| NpyError::Read { path: path.to_path_buf(), source })
}

fn raw(path: &Path, data: &mut Data, len: u64) -> Result<Vec<u8>, NpyError> {
    let mut bytes = Vec::new();
    data.take(len).read_to_end(&mut bytes).map_err(|source| NpyError::Read { path: path.to_path_buf(), source })?;
    Ok(bytes)
}

fn wrong_type(path: &Path, header: &NpyHeader, want: &str) -> NpyError {
    content(path, "header", format!("the type is {}", header.dtype().descr()), format!("it must be {want}"))
}

fn content(path: &Path, place: &str, what: impl Into<String>, remedy: impl Into<String>) -> NpyError {
    NpyError::Content { path: path.to_path_buf(), place: place.to_owned(), what: what.into(), remedy: remedy.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        (folder, path)
    }

    /// The bytes of `numpy.save` of `numpy.array([1, 0, 1], dtype)`, spelled out.
    fn by_hand(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
        while (text.len() + 11) % 64 != 0 {
            text.push(' ');
        }
        text.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn masks_and_labels_round_trip(bits in proptest::collection::vec(any::<bool>(), 0..200), labels in proptest::collection::vec(any::<i32>(), 0..200)) {
            let (_folder, path) = file();
            let mask = Mask::from_fn(bits.len(), |i| bits[i]);
            write_mask(&path, &mask).unwrap();
            prop_assert_eq!(read_mask(&path, bits.len()).unwrap(), mask);
            write_labels(&path, &labels).unwrap();
            prop_assert_eq!(read_labels(&path).unwrap(), labels);
        }
    }

    #[test]
    fn the_bytes_are_those_of_numpy() {
        let (_folder, path) = file();
        write_mask(&path, &Mask::from_fn(3, |i| i != 1)).unwrap();
        let read = std::fs::read(&path).unwrap();
        assert_eq!(&read[..8], b"\x93NUMPY\x01\x00");
        assert_eq!(&read[read.len() - 3..], &[1, 0, 1]);
        assert_eq!((read.len() - 3) % 16, 0, "NumPy aligns the data");
        let text = String::from_utf8_lossy(&read[10..read.len() - 3]).into_owned();
        assert!(text.contains("'descr': '|u1'") && text.contains("'shape': (3,"), "{text}");
    }

    #[test]
    fn files_of_numpy_are_read_in_any_integer_type() {
        let (_folder, path) = file();
        std::fs::write(&path, by_hand("|b1", "(3,)", &[1, 0, 1])).unwrap();
        assert_eq!(read_mask(&path, 3).unwrap(), Mask::from_fn(3, |i| i != 1));
        std::fs::write(
            &path,
            by_hand("<i8", "(2,)", &[255, 255, 255, 255, 255, 255, 255, 255, 7, 0, 0, 0, 0, 0, 0, 0]),
        )
        .unwrap();
        assert_eq!(read_labels(&path).unwrap(), [-1, 7]);
        std::fs::write(&path, by_hand(">u2", "(2,)", &[1, 0, 0, 3])).unwrap();
        assert_eq!(read_indices(&path, 300).unwrap(), [256, 3]);
        assert!(read_indices(&path, 256).unwrap_err().to_string().contains("element 0"));
    }

    #[test]
    fn floats_keep_their_shape() {
        let (_folder, path) = file();
        write_array(&path, &[2, 1, 2], &[0.5_f32, f32::NAN, -1.0, 3.0]).unwrap();
        let (shape, values) = read_floats(&path).unwrap();
        assert_eq!(shape, [2, 1, 2]);
        assert!(values[1].is_nan() && values[0] == 0.5 && values[3] == 3.0);
        assert!(write_array(&path, &[2, 2], &[1.0_f64]).is_err());
    }

    #[test]
    fn bad_files_are_refused_with_a_line() {
        let (_folder, path) = file();
        let deep = format!("{}1{}", "(".repeat(400), ")".repeat(400));
        let table: Vec<(Vec<u8>, &str)> = vec![
            (b"PK\x03\x04 not an array".to_vec(), "no .npy file"),
            (by_hand("|u1", "(4,)", &[1, 0, 1]), "cut off"),
            (by_hand("|u1", "(18446744073709551615, 18446744073709551615)", &[1]), "cut off"),
            (by_hand("|u1", "(3,)", &[1, 0, 2]), "element 2"),
            (by_hand("|u1", "(1, 3)", &[1, 0, 1]), "one axis"),
            (by_hand("<f4", "(3,)", &[0; 12]), "uint8 or bool"),
            (by_hand("|u1", "(2,)", &[1, 0]), "2 values for a scene of 3"),
            (by_hand("|u1", &deep, &[1, 0, 1]), "plain number"),
            (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(), "limit"),
        ];
        for (bytes, want) in table {
            std::fs::write(&path, bytes).unwrap();
            let error = read_mask(&path, 3).unwrap_err().to_string();
            assert!(
                error.contains(want) && error.contains("a.npy") && !error.contains('\n'),
                "{error} should say {want}"
            );
        }
    }
}
