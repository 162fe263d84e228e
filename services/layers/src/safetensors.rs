//! Files of weights in the safetensors format.
//!
//! A file is read tensor by tensor. So memory never holds more of it than one tensor beside those that the model keeps, and a
//! shape is compared with the configuration before its memory is taken.

use std::collections::HashMap;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use sg_input::file::{self, RegularFile};

use crate::error::ModelError;
use crate::tensor::{StoredType, TensorReader, to_f32};

/// Most bytes of a file's header. Real ones have up to 200 kB.
const MAX_HEADER_BYTES: u64 = 8 << 20;

/// An open file of weights with its header.
pub(crate) struct SafetensorsReader {
    path: PathBuf,
    file: RegularFile,
    tensors: HashMap<String, TensorInfo>,
    /// Where the tensors' bytes begin.
    data: u64,
}

impl SafetensorsReader {
    pub(crate) fn open(path: &Path) -> Result<Self, ModelError> {
        let wrong = |problem: String| ModelError::file(path, problem);
        let file = file::open(path).map_err(|error| wrong(error.to_string()))?;
        let mut start = [0; 8];
        file.file.read_exact_at(&mut start, 0).map_err(|_| wrong(damaged("it has less than 8 bytes")))?;
        let header = u64::from_le_bytes(start);
        if header > MAX_HEADER_BYTES {
            return Err(wrong(damaged(&format!("its header would have {header} bytes, more than {MAX_HEADER_BYTES}"))));
        }
        let data = 8 + header;
        let mut text = vec![0; usize::try_from(header).unwrap_or_default()];
        let read = file.file.read_exact_at(&mut text, 8);
        read.map_err(|_| wrong(damaged(&format!("it ends within its header of {header} bytes"))))?;
        let metadata: Metadata =
            serde_json::from_slice(&text).map_err(|error| wrong(damaged(&format!("in its header, {error}"))))?;
        let expected = data.saturating_add(metadata.data_len() as u64);
        if file.length != expected {
            let found = file.length;
            return Err(wrong(damaged(&format!("it has {found} bytes, but its header speaks of {expected}"))));
        }
        let tensors = metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
        Ok(Self { path: path.to_owned(), file, tensors, data })
    }
}

impl TensorReader for SafetensorsReader {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let Some(info) = self.tensors.get(name) else {
            return Err(ModelError::NoTensor {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
            });
        };
        if info.shape != shape {
            return Err(ModelError::Shape {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
                found: info.shape.clone(),
            });
        }
        let wrong = |problem: String| ModelError::file(&self.path, format!("tensor `{name}`: {problem}"));
        let stored = match info.dtype {
            Dtype::F32 => StoredType::F32,
            Dtype::F16 => StoredType::F16,
            Dtype::BF16 => StoredType::Bf16,
            other => return Err(wrong(format!("its values are {other:?}; convert the weights to F32, F16 or BF16"))),
        };
        let (from, to) = info.data_offsets;
        // The header's offsets fit its shapes and the file's length.
        let mut bytes = vec![0; to - from];
        let read = self.file.file.read_exact_at(&mut bytes, self.data + from as u64);
        read.map_err(|error| wrong(error.to_string()))?;
        Ok(to_f32(&bytes, stored))
    }

    fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }
}

fn damaged(what: &str) -> String {
    format!("not a whole safetensors file: {what}; get it again")
}
