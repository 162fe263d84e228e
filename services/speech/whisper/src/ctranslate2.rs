//! Files of weights of CTranslate2 (`model.bin`) with a `WhisperSpec`.
//!
//! All numbers are little-endian. A string has a u16 length, and its last byte is zero. The file is, in order:
//!
//! - u32 version, name of the kind of model, u32 revision, u32 number of variables;
//! - for each variable its name, u8 rank, u32 for each dimension, u8 type, u32 bytes, and the values;
//! - u32 number of aliases, and for each its name and the variable's name.

use std::collections::HashMap;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use sg_input::file::{self, RegularFile};
use sg_input::printable;
use sg_layers::{MAX_LAYERS, ModelError, StoredType, TensorReader, to_f32};

use crate::config::{ModelSize, SizeKeys, StackSize};

/// The version whose layout this is.
const VERSION: u32 = 6;
const KIND: &str = "WhisperSpec";
/// Most variables. Large models have 1,300.
const MAX_VARIABLES: u32 = 1 << 14;
/// Most bytes of a name.
const MAX_NAME: usize = 512;
const MAX_RANK: u8 = 4;
/// Number of CTranslate2 for x·Φ(x).
const GELU: i64 = 3;

#[derive(Clone)]
struct Variable {
    shape: Vec<usize>,
    kind: u8,
    from: u64,
    bytes: usize,
}

/// An open file of weights with the places of its variables.
pub(crate) struct CTranslate2Reader {
    path: PathBuf,
    file: RegularFile,
    variables: HashMap<String, Variable>,
}

/// Reads one number after the other.
struct Cursor<'a> {
    path: &'a Path,
    file: &'a RegularFile,
    at: u64,
}

impl Cursor<'_> {
    fn wrong(&self, what: &str) -> ModelError {
        let at = self.at;
        ModelError::file(self.path, format!("not a whole model of CTranslate2: at byte {at}, {what}; get it again"))
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], ModelError> {
        let mut bytes = [0; N];
        self.file.file.read_exact_at(&mut bytes, self.at).map_err(|_| self.wrong("the file ends"))?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn u8(&mut self) -> Result<u8, ModelError> {
        Ok(self.bytes::<1>()?[0])
    }

    fn u32(&mut self) -> Result<u32, ModelError> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn name(&mut self) -> Result<String, ModelError> {
        let length = usize::from(u16::from_le_bytes(self.bytes()?));
        if length > MAX_NAME {
            return Err(self.wrong(&format!("a name would have {length} bytes, more than {MAX_NAME}")));
        }
        let mut bytes = vec![0; length];
        self.file.file.read_exact_at(&mut bytes, self.at).map_err(|_| self.wrong("the file ends within a name"))?;
        let text = String::from_utf8(bytes).map_err(|_| self.wrong("a name is not UTF-8"))?;
        self.at += length as u64;
        Ok(text.trim_end_matches('\0').to_owned())
    }

    fn variable(&mut self) -> Result<(String, Variable), ModelError> {
        let name = self.name()?;
        let rank = self.u8()?;
        if rank > MAX_RANK {
            return Err(self.wrong(&format!("a variable has {rank} dimensions, more than {MAX_RANK}")));
        }
        let shape: Vec<usize> = (0..rank).map(|_| self.u32().map(|size| size as usize)).collect::<Result<_, _>>()?;
        let kind = self.u8()?;
        let bytes = self.u32()? as usize;
        let variable = Variable { shape, kind, from: self.at, bytes };
        let values = variable.shape.iter().try_fold(1_usize, |product, size| product.checked_mul(*size));
        if size_of(kind).is_none_or(|size| values.and_then(|values| values.checked_mul(size)) != Some(bytes)) {
            let (shape, name) = (&variable.shape, printable(&name));
            return Err(self.wrong(&format!("`{name}` has {bytes} bytes for shape {shape:?} of type {kind}")));
        }
        self.at += bytes as u64;
        if self.at > self.file.length {
            return Err(self.wrong("the file ends within a variable"));
        }
        Ok((name, variable))
    }
}

/// Bytes of a value, by CTranslate2's number of its type.
fn size_of(kind: u8) -> Option<usize> {
    match kind {
        1 => Some(1),
        2 | 4 | 5 => Some(2),
        0 | 3 => Some(4),
        _ => None,
    }
}

impl CTranslate2Reader {
    pub(crate) fn open(path: &Path) -> Result<Self, ModelError> {
        let file = file::open(path).map_err(|error| ModelError::file(path, error.to_string()))?;
        let mut cursor = Cursor { path, file: &file, at: 0 };
        let version = cursor.u32()?;
        if version != VERSION {
            let problem =
                format!("its version is {version}, but {VERSION} is read; convert the model with CTranslate2 4");
            return Err(ModelError::file(path, problem));
        }
        let kind = cursor.name()?;
        if kind != KIND {
            let problem = format!("it is a `{}`, not a `{KIND}`; give a Whisper model", printable(&kind));
            return Err(ModelError::file(path, problem));
        }
        cursor.u32()?;
        let count = cursor.u32()?;
        if count > MAX_VARIABLES {
            return Err(cursor.wrong(&format!("there would be {count} variables, more than {MAX_VARIABLES}")));
        }
        let mut variables: HashMap<String, Variable> =
            (0..count).map(|_| cursor.variable()).collect::<Result<_, _>>()?;
        let aliases = cursor.u32()?;
        if aliases > MAX_VARIABLES {
            return Err(cursor.wrong(&format!("there would be {aliases} aliases, more than {MAX_VARIABLES}")));
        }
        for _ in 0..aliases {
            let (alias, name) = (cursor.name()?, cursor.name()?);
            if let Some(variable) = variables.get(&name).cloned() {
                variables.insert(alias, variable);
            }
        }
        if cursor.at != file.length {
            return Err(cursor.wrong(&format!("it should end, but it has {} bytes", file.length)));
        }
        Ok(Self { path: path.to_owned(), file, variables })
    }

    /// The model's size, by the shapes of its variables.
    pub(crate) fn size(&self) -> Result<ModelSize, ModelError> {
        for (name, expected) in [
            ("encoder/activation", GELU),
            ("decoder/activation", GELU),
            ("encoder/pre_norm", 1),
            ("decoder/pre_norm", 1),
            ("decoder/alibi", 0),
            ("decoder/scale_embeddings", 0),
        ] {
            let found = self.number(name)?;
            if found.is_some_and(|found| found != expected) {
                let problem = format!("it is {}, but a Whisper model has {expected}", found.unwrap_or_default());
                return Err(ModelError::config(&self.path, name, problem));
            }
        }
        let [width, bands, _] = self.shape("encoder/conv1/weight")?;
        let [frames, _] = self.shape("encoder/position_encodings/encodings")?;
        let [vocabulary, _] = self.shape("decoder/embeddings/weight")?;
        let [context, _] = self.shape("decoder/position_encodings/encodings")?;
        let stack = |part: &str| -> Result<StackSize, ModelError> {
            let has = |at: &usize| self.has(&format!("{part}/layer_{at}/self_attention/linear_0/weight"));
            let [inner, _] = self.shape(&format!("{part}/layer_0/ffn/linear_0/weight"))?;
            let heads = self.number(&format!("{part}/num_heads"))?.unwrap_or_default();
            let heads = usize::try_from(heads).unwrap_or_default();
            Ok(StackSize { layers: (0..=MAX_LAYERS).take_while(has).count(), heads, inner })
        };
        let (encoder, decoder) = (stack("encoder")?, stack("decoder")?);
        ModelSize { bands, frames, width, encoder, decoder, vocabulary, context }.checked(&self.path, &KEYS)
    }

    /// A whole number, or `None` where there is none of this name.
    fn number(&self, name: &str) -> Result<Option<i64>, ModelError> {
        let Some(variable) = self.variables.get(name) else { return Ok(None) };
        let wrong = |problem: String| ModelError::config(&self.path, name, problem);
        let mut bytes = [0; 4];
        let bytes = bytes.get_mut(..variable.bytes).ok_or_else(|| wrong("it is no single number".into()))?;
        self.file.file.read_exact_at(bytes, variable.from).map_err(|error| wrong(error.to_string()))?;
        match (variable.kind, &*bytes) {
            (1, [a]) => Ok(Some(i64::from(i8::from_le_bytes([*a])))),
            (2, [a, b]) => Ok(Some(i64::from(i16::from_le_bytes([*a, *b])))),
            (3, [a, b, c, d]) => Ok(Some(i64::from(i32::from_le_bytes([*a, *b, *c, *d])))),
            _ => Err(wrong("it is no whole number; get the model again".into())),
        }
    }

    fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N], ModelError> {
        let shape = self.variables.get(name).map(|variable| variable.shape.clone()).unwrap_or_default();
        shape.try_into().map_err(|found| {
            let problem = format!("it has shape {found:?}, but {N} dimensions are needed; give a Whisper model");
            ModelError::config(&self.path, name, problem)
        })
    }
}

const KEYS: SizeKeys = SizeKeys {
    bands: "encoder/conv1/weight",
    frames: "encoder/position_encodings/encodings",
    width: "encoder/conv1/weight",
    encoder: ["encoder/layer_0", "encoder/num_heads", "encoder/layer_0/ffn/linear_0/weight"],
    decoder: ["decoder/layer_0", "decoder/num_heads", "decoder/layer_0/ffn/linear_0/weight"],
    vocabulary: "decoder/embeddings/weight",
    context: "decoder/position_encodings/encodings",
};

impl TensorReader for CTranslate2Reader {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let Some(variable) = self.variables.get(name) else {
            return Err(ModelError::NoTensor {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
            });
        };
        if variable.shape != shape {
            return Err(ModelError::Shape {
                path: self.path.clone(),
                tensor: name.to_owned(),
                expected: shape.to_vec(),
                found: variable.shape.clone(),
            });
        }
        let wrong = |problem: String| ModelError::file(&self.path, format!("variable `{name}`: {problem}"));
        let stored = match variable.kind {
            0 => StoredType::F32,
            4 => StoredType::F16,
            5 => StoredType::Bf16,
            _ => return Err(wrong("its values are integers; convert the model with `--quantization float16`".into())),
        };
        // The places fit the file's length.
        let mut bytes = vec![0; variable.bytes];
        self.file.file.read_exact_at(&mut bytes, variable.from).map_err(|error| wrong(error.to_string()))?;
        Ok(to_f32(&bytes, stored))
    }

    fn has(&self, name: &str) -> bool {
        self.variables.contains_key(name)
    }
}
