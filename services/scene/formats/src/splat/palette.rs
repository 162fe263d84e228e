//! iVR-GS's palette checkpoint: `palette_colors_chkpnt.pth` beside a unit's PLY.
//!
//! A zip of a pickle and one file a tensor: `((palette, optimiser state), iteration)` where the palette is a tensor of three
//! numbers. Only that tensor is read; see [`crate::splat::pickle`] for what is not done.

use std::io::{Cursor, Read, Write};

use glam::Vec3;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::splat::pickle::{Id, MAX_BYTES, Pickle, Value};
use crate::splat::problem::Problem;

/// Name of the file in iVR-GS's folders.
pub(crate) const FILE_NAME: &str = "palette_colors_chkpnt.pth";
/// Longest file that is read; real ones take about two thousand bytes.
pub(crate) const MAX_FILE: u64 = 1 << 24;
/// Most entries of the zip.
const MAX_ENTRIES: usize = 4096;
const REMEDY: &str = "give the checkpoint that iVR-GS wrote, or --palette r,g,b";

/// The palette colour, clamped to 0 to 1 as iVR-GS does at use.
pub(crate) fn read(bytes: &[u8]) -> Result<Vec3, Problem> {
    let damaged = |e: zip::result::ZipError| Problem::new("zip", e.to_string(), REMEDY);
    let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    if zip.len() > MAX_ENTRIES {
        return Err(Problem::new("zip", format!("{} entries", zip.len()), REMEDY));
    }
    let mut names = Vec::new();
    for name in zip.file_names() {
        names.push(name.map_err(damaged)?.into_owned());
    }
    let Some(prefix) = names.iter().find_map(|n| n.strip_suffix("data.pkl")).map(str::to_owned) else {
        return Err(Problem::new("zip", "there is no data.pkl", REMEDY));
    };
    let pickle = Pickle::parse(&entry(&mut zip, &format!("{prefix}data.pkl"), MAX_BYTES)?)?;
    let big_endian = names.contains(&format!("{prefix}byteorder"))
        && entry(&mut zip, &format!("{prefix}byteorder"), 16)?.starts_with(b"big");
    let shape = || Problem::new("data.pkl", "it is not ((palette, optimiser), iteration) with three numbers", REMEDY);
    let pair = pickle.item(pickle.root(), 0).ok_or_else(shape)?;
    let palette = pickle.item(pair, 0).ok_or_else(shape)?;
    let tensor = Tensor::of(&pickle, palette).ok_or_else(shape)?;
    let data = entry(&mut zip, &format!("{prefix}data/{}", tensor.key), 1 << 16)?;
    let color = tensor.three(&data, big_endian).ok_or_else(shape)?;
    if !color.is_finite() {
        return Err(Problem::new("palette", format!("the colour is {color}"), REMEDY));
    }
    Ok(color.clamp(Vec3::ZERO, Vec3::ONE))
}

fn entry(zip: &mut ZipArchive<Cursor<&[u8]>>, name: &str, limit: usize) -> Result<Vec<u8>, Problem> {
    let damaged = |e: String| Problem::new(format!("zip entry {name}"), e, REMEDY);
    let file = zip.by_name(name).map_err(|e| damaged(e.to_string()))?;
    let mut bytes = Vec::new();
    file.take(limit as u64 + 1).read_to_end(&mut bytes).map_err(|e| damaged(e.to_string()))?;
    if bytes.len() > limit {
        return Err(damaged(format!("longer than {limit} bytes")));
    }
    Ok(bytes)
}

/// The storage of the palette's three numbers.
struct Tensor {
    key: String,
    size: usize,
    offset: usize,
    stride: usize,
}

impl Tensor {
    /// `_rebuild_tensor_v2(storage, offset, (3,), (stride,), …)`, possibly within `_rebuild_parameter(tensor, …)`.
    fn of(pickle: &Pickle, mut id: Id) -> Option<Self> {
        loop {
            let Value::Call(function, arguments) = *pickle.get(id) else { return None };
            let Value::Global(name) = pickle.get(function) else { return None };
            match name.as_str() {
                // Its argument was made before it, so the index falls and the loop ends.
                "torch._utils _rebuild_parameter" => {
                    let inner = pickle.item(arguments, 0)?;
                    if inner >= id {
                        return None;
                    }
                    id = inner;
                }
                "torch._utils _rebuild_tensor_v2" => return Self::rebuilt(pickle, arguments),
                _ => return None,
            }
        }
    }

    fn rebuilt(pickle: &Pickle, arguments: Id) -> Option<Self> {
        let Value::Persistent(storage) = *pickle.get(pickle.item(arguments, 0)?) else { return None };
        let Value::Global(kind) = pickle.get(pickle.item(storage, 1)?) else { return None };
        let size = match kind.as_str() {
            "torch FloatStorage" => 4,
            "torch DoubleStorage" => 8,
            _ => return None,
        };
        let Value::Text(key) = pickle.get(pickle.item(storage, 2)?) else { return None };
        if key.is_empty() || !key.bytes().all(|b| b.is_ascii_digit()) {
            return None;
        }
        let number = |id: Id| match *pickle.get(id) {
            Value::Int(n) => usize::try_from(n).ok(),
            _ => None,
        };
        let shape = pickle.item(arguments, 2)?;
        if number(pickle.item(shape, 0)?)? != 3 || pickle.item(shape, 1).is_some() {
            return None;
        }
        let stride = number(pickle.item(pickle.item(arguments, 3)?, 0)?)?;
        Some(Self { key: key.clone(), size, offset: number(pickle.item(arguments, 1)?)?, stride })
    }

    fn three(&self, data: &[u8], big_endian: bool) -> Option<Vec3> {
        let at = |k: usize| {
            let from = self.stride.checked_mul(k)?.checked_add(self.offset)?.checked_mul(self.size)?;
            let bytes = data.get(from..from.checked_add(self.size)?)?;
            let mut word = [0; 8];
            word.get_mut(..self.size)?.copy_from_slice(bytes);
            if big_endian {
                word.get_mut(..self.size)?.reverse();
            }
            Some(match self.size {
                4 => f32::from_le_bytes(*word.first_chunk()?),
                _ => f64::from_le_bytes(word) as f32,
            })
        };
        Some(Vec3::new(at(0)?, at(1)?, at(2)?))
    }
}

/// A checkpoint that `torch.load` reads as `((palette, {}), iteration)`.
pub(crate) fn write(palette: Vec3, iteration: u32) -> Result<Vec<u8>, Problem> {
    let mut pickle =
        b"\x80\x02((ctorch._utils\n_rebuild_tensor_v2\n((X\x07\x00\x00\x00storagectorch\nFloatStorage\n".to_vec();
    pickle.extend(
        b"X\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x03tQK\x00K\x03\x85K\x01\x85\x89ccollections\nOrderedDict\n)RtR}tJ",
    );
    pickle.extend(iteration.cast_signed().to_le_bytes());
    pickle.extend(b"t.");
    let floats: Vec<u8> = palette.to_array().into_iter().flat_map(f32::to_le_bytes).collect();
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut write = || -> std::io::Result<()> {
        let entries: [(&str, &[u8]); 4] =
            [("data.pkl", &pickle), ("byteorder", b"little"), ("data/0", &floats), ("version", b"3\n")];
        for (name, bytes) in entries {
            zip.start_file(format!("archive/{name}"), options)?;
            zip.write_all(bytes)?;
        }
        Ok(())
    };
    let failed = |e: String| Problem::new("palette", e, "this is a fault of the program: report it");
    write().map_err(|e| failed(e.to_string()))?;
    Ok(zip.finish().map_err(|e| failed(e.to_string()))?.into_inner())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The opcodes of `data.pkl` after `torch.save(((nn.Parameter(palette), adam.state_dict()), 40000))`.
    pub(crate) fn parameter_pickle() -> Vec<u8> {
        let mut p = b"\x80\x02((".to_vec();
        p.extend(b"ctorch._utils\n_rebuild_parameter\nq\x00");
        p.extend(b"(ctorch._utils\n_rebuild_tensor_v2\nq\x01");
        p.extend(b"((X\x07\x00\x00\x00storageq\x02ctorch\nFloatStorage\nq\x03X\x01\x00\x00\x000q\x04X\x06\x00\x00\x00cuda:0q\x05K\x03tq\x06Q");
        p.extend(b"K\x00K\x03\x85q\x07K\x01\x85q\x08\x89ccollections\nOrderedDict\nq\x09)Rq\x0atq\x0bRq\x0c");
        p.extend(b"\x88h\x09)Rq\x0dtq\x0eRq\x0f");
        // The optimiser's state: {"state": {0: {"step": 12.0}}, "param_groups": [{"lr": 0.01, "params": [0]}]}.
        p.extend(b"}q\x10(X\x05\x00\x00\x00stateq\x11}q\x12K\x00}q\x13X\x04\x00\x00\x00stepq\x14G\x40\x28\x00\x00\x00\x00\x00\x00ss");
        p.extend(
            b"X\x0c\x00\x00\x00param_groupsq\x15]q\x16}q\x17(X\x02\x00\x00\x00lrq\x18G\x3f\x84\x7a\xe1\x47\xae\x14\x7b",
        );
        p.extend(b"X\x06\x00\x00\x00paramsq\x19]q\x1aK\x00auau");
        p.extend(b"tq\x1bM\x40\x9ctq\x1c.");
        p
    }

    /// A checkpoint as PyTorch zips it.
    pub(crate) fn zipped(prefix: &str, pickle: &[u8], storage: &[u8], deflate: bool) -> Vec<u8> {
        let method = if deflate { CompressionMethod::Deflated } else { CompressionMethod::Stored };
        let options = SimpleFileOptions::default().compression_method(method);
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in [("data.pkl", pickle), ("data/0", storage), ("version", b"3\n")] {
            zip.start_file(format!("{prefix}/{name}"), options).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    fn storage(color: [f32; 3]) -> Vec<u8> {
        color.into_iter().flat_map(f32::to_le_bytes).collect()
    }

    #[test]
    fn a_checkpoint_of_a_trained_parameter_is_read() {
        let bytes = zipped("palette_colors_chkpnt", &parameter_pickle(), &storage([0.25, 1.5, -0.5]), false);
        assert_eq!(read(&bytes).unwrap(), Vec3::new(0.25, 1.0, 0.0), "clamped to 0 to 1");
    }

    #[test]
    fn a_written_palette_is_read() {
        let color = Vec3::new(0.1, 0.7, 1.0 / 3.0);
        assert_eq!(read(&write(color, 40_000).unwrap()).unwrap(), color);
    }

    #[test]
    fn hostile_checkpoints_are_refused() {
        let call = b"\x80\x02cposix\nsystem\nX\x02\x00\x00\x00ls\x85R.".to_vec();
        let nested = [b"\x80\x02".to_vec(), b")".to_vec(), b"\x85".repeat(500_000), b".".to_vec()].concat();
        let memo = b"\x80\x02Nr\xff\xff\xff\x7f.".to_vec();
        let endless_parameter = b"\x80\x02((ctorch._utils\n_rebuild_parameter\n)RNtK\x01t.".to_vec();
        for pickle in [call, nested, memo, endless_parameter, b"\x80\x02K".to_vec(), b"\x80\x02\xff.".to_vec(), vec![]]
        {
            let error = read(&zipped("archive", &pickle, &storage([0.0; 3]), false)).unwrap_err().to_string();
            assert!(error.contains("data.pkl") && !error.contains('\n'), "{error}");
        }
        let bomb = zipped("archive", &vec![b'N'; MAX_BYTES + 1], &storage([0.0; 3]), true);
        assert!(read(&bomb).unwrap_err().to_string().contains("longer than"));
        let short = zipped("archive", &parameter_pickle(), &[0; 8], false);
        assert!(read(&short).is_err());
        assert!(read(b"not a zip at all").is_err());
        assert!(read(&zipped("archive", &parameter_pickle(), &storage([f32::NAN, 0.0, 0.0]), false)).is_err());
    }

    proptest! {
        #[test]
        fn damaged_checkpoints_never_panic(at in 0_usize..400, byte in any::<u8>(), cut in 0_usize..400) {
            let mut pickle = parameter_pickle();
            if let Some(b) = pickle.get_mut(at) {
                *b = byte;
            }
            pickle.truncate(pickle.len() - cut.min(pickle.len()) / 4);
            let _ = Pickle::parse(&pickle).map(|p| Tensor::of(&p, p.item(p.root(), 0).unwrap_or_default()).is_some());
        }
    }
}
