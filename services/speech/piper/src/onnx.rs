//! The parts of an ONNX file that a voice is made of: its tensors, and its nodes with their inputs and attributes.
//!
//! The messages are those of `onnx.proto` (ONNX's IR). Only the fields that are used here are read; tensors stay where they are in
//! the file's bytes until they are asked for.

use std::cell::Cell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use sg_input::{file, printable};
use sg_layers::{ModelError, StoredType, to_f32};

use crate::protobuf::{Broken, Fields, Value, append_numbers};

/// Longest file. The largest published voices have 115 MB.
const MAX_BYTES: u64 = 512 << 20;
/// Most nodes, and most tensors. A published voice has 2,800 and 450.
const MAX_PARTS: usize = 1 << 15;
const MAX_RANK: usize = 8;
/// Most inputs of a node that are kept; the others are results of nodes with long lists.
const MAX_INPUTS: usize = 4;
/// Most numbers of an attribute.
const MAX_NUMBERS: usize = 16;
/// Most names that stand for another one, in a row.
const MAX_ALIASES: usize = 4;

const FLOAT: u64 = 1;
const FLOAT16: u64 = 10;
const BFLOAT16: u64 = 16;

/// A tensor's place in the file.
#[derive(Clone, Debug, Default)]
pub(crate) struct StoredTensor<'a> {
    pub(crate) shape: Vec<usize>,
    data_type: u64,
    /// `raw_data`, or else packed `float_data`.
    bytes: &'a [u8],
    external: bool,
}

/// A node of the graph.
#[derive(Clone, Debug, Default)]
pub(crate) struct Node<'a> {
    pub(crate) inputs: Vec<&'a str>,
    output: &'a str,
    operation: &'a str,
    numbers: HashMap<&'a str, Vec<i64>>,
}

impl Node<'_> {
    /// The numbers of an attribute; empty where there is none.
    pub(crate) fn numbers(&self, attribute: &str) -> &[i64] {
        self.numbers.get(attribute).map_or(&[], Vec::as_slice)
    }
}

/// The bytes of a file, and its name for messages.
pub(crate) struct OnnxFile {
    path: PathBuf,
    bytes: Vec<u8>,
}

/// The graph of an ONNX file.
pub(crate) struct Graph<'a> {
    pub(crate) path: &'a Path,
    tensors: HashMap<&'a str, StoredTensor<'a>>,
    nodes: HashMap<&'a str, Node<'a>>,
    /// Results that are their operation's input unchanged.
    aliases: HashMap<&'a str, &'a str>,
    /// Values that may still be taken: nodes may share a tensor, and each takes a copy.
    left: Cell<usize>,
}

impl OnnxFile {
    pub(crate) fn read(path: &Path) -> Result<Self, ModelError> {
        let bytes = file::read(path, MAX_BYTES).map_err(|error| ModelError::file(path, error.to_string()))?;
        Ok(Self { path: path.to_owned(), bytes })
    }

    /// Finds the tensors and nodes.
    pub(crate) fn graph(&self) -> Result<Graph<'_>, ModelError> {
        let broken = |Broken| ModelError::file(&self.path, "not a whole ONNX file; get the voice again");
        let mut graph = None;
        for field in Fields::of(&self.bytes) {
            if let (7, Value::Bytes(message)) = field.map_err(broken)? {
                graph = Some(message);
            }
        }
        let Some(message) = graph else { return Err(broken(Broken)) };
        let mut found = Graph {
            path: &self.path,
            tensors: HashMap::new(),
            nodes: HashMap::new(),
            aliases: HashMap::new(),
            // A value takes two bytes of a file at least, so each can be taken twice.
            left: Cell::new(self.bytes.len()),
        };
        for (count, field) in Fields::of(message).enumerate() {
            if count > 4 * MAX_PARTS {
                let problem = format!("its graph has more than {} parts; it is no voice", 4 * MAX_PARTS);
                return Err(ModelError::file(&self.path, problem));
            }
            match field.map_err(broken)? {
                (1, Value::Bytes(node)) => found.add_node(node).map_err(broken)?,
                (5, Value::Bytes(tensor)) => {
                    let (name, tensor) = tensor_of(tensor).map_err(broken)?;
                    found.tensors.insert(name, tensor);
                }
                _ => {}
            }
            if found.tensors.len().max(found.nodes.len()) > MAX_PARTS {
                let problem = format!("its graph has more than {MAX_PARTS} nodes or tensors; it is no voice");
                return Err(ModelError::file(&self.path, problem));
            }
        }
        Ok(found)
    }
}

impl<'a> Graph<'a> {
    fn add_node(&mut self, message: &'a [u8]) -> Result<(), Broken> {
        let (mut node, mut name, mut constant) = (Node::default(), "", None);
        for field in Fields::of(message) {
            match field? {
                (1, value) if node.inputs.len() < MAX_INPUTS => node.inputs.push(text(value)?),
                (2, value) if node.output.is_empty() => node.output = text(value)?,
                (3, value) => name = text(value)?,
                (4, value) => node.operation = text(value)?,
                (5, Value::Bytes(attribute)) if node.numbers.len() < MAX_NUMBERS => {
                    constant = node.add_attribute(attribute)?.or(constant);
                }
                _ => {}
            }
        }
        match (node.operation, constant, node.inputs.first()) {
            ("Constant", Some(tensor), _) => {
                self.tensors.insert(node.output, tensor);
            }
            ("Identity", _, Some(input)) => {
                self.aliases.insert(node.output, input);
            }
            _ if !name.is_empty() => {
                self.nodes.insert(name, node);
            }
            _ => {}
        }
        Ok(())
    }

    /// A node by its name.
    pub(crate) fn node(&self, name: &str) -> Option<&Node<'a>> {
        self.nodes.get(name)
    }

    /// A tensor by its name, or by one that stands for it.
    pub(crate) fn tensor(&self, name: &str) -> Option<&StoredTensor<'a>> {
        let mut name = name;
        for _ in 0..MAX_ALIASES {
            if let Some(tensor) = self.tensors.get(name) {
                return Some(tensor);
            }
            name = self.aliases.get(name)?;
        }
        None
    }

    /// The finite values of a tensor, row by row. `place` is what it is for.
    pub(crate) fn values(&self, place: &str, tensor: &StoredTensor) -> Result<Vec<f32>, ModelError> {
        let wrong = |problem: String| ModelError::config(self.path, &printable(place), problem);
        let (stored, size) = match tensor.data_type {
            FLOAT => (StoredType::F32, 4),
            FLOAT16 => (StoredType::F16, 2),
            BFLOAT16 => (StoredType::Bf16, 2),
            _ if tensor.external => (StoredType::F32, 4),
            other => {
                return Err(wrong(format!(
                    "its values have ONNX's type {other}; take a voice of floating-point weights"
                )));
            }
        };
        if tensor.external {
            return Err(wrong("its values lie in another file; take a voice whose one file has all weights".into()));
        }
        let count = tensor.shape.iter().try_fold(size, |product: usize, size| product.checked_mul(*size));
        if count != Some(tensor.bytes.len()) {
            let (bytes, shape) = (tensor.bytes.len(), &tensor.shape);
            return Err(wrong(format!("it has {bytes} bytes of values for shape {shape:?}; get the voice again")));
        }
        let Some(left) = self.left.get().checked_sub(tensor.bytes.len() / size) else {
            return Err(wrong("too many nodes share the file's weights; get the voice again".into()));
        };
        self.left.set(left);
        let values = to_f32(tensor.bytes, stored);
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(wrong(format!("weight {at} is {}, which is no number; get the voice again", values[at]))),
            None => Ok(values),
        }
    }
}

impl<'a> Node<'a> {
    /// Takes in an attribute; returns its tensor where it is one.
    fn add_attribute(&mut self, message: &'a [u8]) -> Result<Option<StoredTensor<'a>>, Broken> {
        let (mut name, mut numbers, mut tensor) = ("", Vec::new(), None);
        for field in Fields::of(message) {
            match field? {
                (1, value) => name = text(value)?,
                (3 | 8, value) => append_numbers(&mut numbers, value, MAX_NUMBERS)?,
                (5, Value::Bytes(message)) => tensor = Some(tensor_of(message)?.1),
                _ => {}
            }
        }
        if !numbers.is_empty() {
            self.numbers.insert(name, numbers);
        }
        Ok(tensor)
    }
}

fn text(value: Value<'_>) -> Result<&str, Broken> {
    match value {
        Value::Bytes(bytes) => str::from_utf8(bytes).map_err(|_| Broken),
        _ => Err(Broken),
    }
}

fn tensor_of(message: &[u8]) -> Result<(&str, StoredTensor<'_>), Broken> {
    let (mut name, mut tensor, mut shape) = ("", StoredTensor::default(), Vec::new());
    for field in Fields::of(message) {
        match field? {
            (1, value) => append_numbers(&mut shape, value, MAX_RANK)?,
            (2, Value::Varint(number)) => tensor.data_type = number,
            (4 | 9, Value::Bytes(bytes)) => tensor.bytes = bytes,
            (8, value) => name = text(value)?,
            (13, _) => tensor.external = true,
            (14, Value::Varint(place)) => tensor.external |= place != 0,
            _ => {}
        }
    }
    tensor.shape = shape.into_iter().map(|size| usize::try_from(size).map_err(|_| Broken)).collect::<Result<_, _>>()?;
    Ok((name, tensor))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made_voice::{bytes_field, varint};

    fn graph_of(parts: &[Vec<u8>]) -> OnnxFile {
        OnnxFile { path: "x.onnx".into(), bytes: bytes_field(7, &parts.concat()) }
    }

    fn tensor(name: &str, data_type: u8, values_at: u8, values: &[u8]) -> Vec<u8> {
        let head = [vec![1 << 3], varint(2), vec![2 << 3, data_type], bytes_field(8, name.as_bytes())].concat();
        [head, bytes_field(values_at, values)].concat()
    }

    #[test]
    fn weights_are_found_under_other_names_and_in_other_types() {
        let floats: Vec<u8> = [1.5_f32, -2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let constant = [
            bytes_field(2, b"constant"),
            bytes_field(4, b"Constant"),
            bytes_field(5, &[bytes_field(1, b"value"), bytes_field(5, &tensor("", 1, 4, &floats))].concat()),
        ];
        let alias = |from: &str, to: &str| {
            let texts = [bytes_field(1, from.as_bytes()), bytes_field(2, to.as_bytes()), bytes_field(4, b"Identity")];
            bytes_field(1, &texts.concat())
        };
        let file = graph_of(&[
            bytes_field(1, &constant.concat()),
            alias("constant", "second"),
            alias("second", "third"),
            // A circle of names ends.
            alias("a", "b"),
            alias("b", "a"),
            bytes_field(5, &tensor("half", 10, 9, &[0x00, 0x3e, 0x00, 0xc0])),
            bytes_field(5, &tensor("whole", 7, 9, &[0; 16])),
        ]);
        let graph = file.graph().unwrap();
        for name in ["constant", "third", "half"] {
            assert_eq!(graph.values(name, graph.tensor(name).unwrap()).unwrap(), [1.5, -2.0], "{name}");
        }
        assert!(graph.tensor("a").is_none() && graph.tensor("none").is_none());
        let error = graph.values("whole", graph.tensor("whole").unwrap()).unwrap_err().to_string();
        assert_eq!(error, "x.onnx: `whole`: its values have ONNX's type 7; take a voice of floating-point weights");
    }

    #[test]
    fn weights_in_other_files_are_refused() {
        let file =
            graph_of(&[bytes_field(5, &[tensor("far", 1, 9, &[]), bytes_field(13, b"x"), vec![14 << 3, 1]].concat())]);
        let graph = file.graph().unwrap();
        let error = graph.values("far", graph.tensor("far").unwrap()).unwrap_err().to_string();
        assert!(error.contains("its values lie in another file"), "{error}");
    }

    #[test]
    fn nodes_that_share_a_tensor_take_no_more_than_the_file_has() {
        let file = graph_of(&[bytes_field(5, &tensor("half", 10, 9, &[0x00, 0x3e, 0x00, 0xc0]))]);
        let graph = file.graph().unwrap();
        let shared = graph.tensor("half").unwrap();
        let taken =
            std::iter::repeat_with(|| graph.values("here", shared)).take_while(Result::is_ok).take(1000).count();
        assert!(2 * taken <= file.bytes.len() && taken >= 2, "{taken}");
        let error = graph.values("here", shared).unwrap_err().to_string();
        assert_eq!(error, "x.onnx: `here`: too many nodes share the file's weights; get the voice again");
    }
}
