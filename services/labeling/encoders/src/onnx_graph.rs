//! Graphs of ONNX with the inputs and the output that a tower has.

use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::session::{Session, SessionInputValue};
use ort::value::{Outlet, TensorElementType, TensorRef};
use sg_input::file;

use crate::error::EncoderError;
use crate::onnx_runtime::{OnnxRuntime, message};

/// Most threads of a graph.
const MAX_THREADS: usize = 256;

/// An input or an output that a graph may have: one tensor, whose first dimension is the batch.
pub(crate) struct Port {
    pub(crate) name: &'static str,
    pub(crate) element: TensorElementType,
    /// Dimensions after the batch. A graph has the same ones, or leaves them free.
    pub(crate) dimensions: Vec<usize>,
}

impl Port {
    pub(crate) fn floats(name: &'static str, dimensions: &[usize]) -> Self {
        Self { name, element: TensorElementType::Float32, dimensions: dimensions.to_vec() }
    }

    fn integers(name: &'static str, dimensions: &[usize]) -> Self {
        Self { name, element: TensorElementType::Int64, dimensions: dimensions.to_vec() }
    }

    /// Whether a graph's tensor is this one, or what is wrong with it.
    fn check(&self, outlet: &Outlet) -> Result<(), String> {
        let (Some(element), Some(shape)) = (outlet.dtype().tensor_type(), outlet.dtype().tensor_shape()) else {
            return Err("it is no tensor".to_owned());
        };
        if element != self.element {
            return Err(format!("it has elements of {element}, not of {0}; take an export with {0}", self.element));
        }
        if shape.is_empty() {
            // A graph need not state shapes. What it gives is checked in any case.
            return Ok(());
        }
        let fits = |(size, expected): (&i64, &usize)| *size < 0 || usize::try_from(*size) == Ok(*expected);
        let batch_is_free = shape.first().is_some_and(|size| *size < 0);
        if shape.len() != 1 + self.dimensions.len() || !shape[1..].iter().zip(&self.dimensions).all(fits) {
            let expected = &self.dimensions;
            return Err(format!(
                "its shape is {shape:?}, not a batch of {expected:?}; take graph and configuration of one model"
            ));
        }
        if !batch_is_free {
            return Err(format!("its shape is {shape:?}; export the graph with a free batch size"));
        }
        Ok(())
    }
}

/// Values of one input: batch and dimensions, row by row.
pub(crate) enum Values {
    Floats(Vec<f32>),
    Integers(Vec<i64>),
}

/// How texts become the inputs of a graph.
#[derive(Clone, Copy)]
pub(crate) struct Filling {
    /// Tokens of each text with those that fill up.
    pub(crate) length: usize,
    pub(crate) token: u32,
    /// Whether the model sees the tokens that fill up.
    pub(crate) is_seen: bool,
}

/// A graph, ready to run.
pub(crate) struct Graph {
    path: PathBuf,
    /// ONNX Runtime runs a session once at a time, or its memory may be corrupted.
    session: Mutex<Session>,
    version: String,
    /// Inputs that the graph has.
    inputs: Vec<&'static str>,
    output: Port,
    has_fixed_length: bool,
}

impl Graph {
    /// Opens a graph of images.
    pub(crate) fn of_images(
        path: &Path,
        runtime: &OnnxRuntime,
        threads: NonZeroUsize,
        side: usize,
        outputs: Vec<Port>,
    ) -> Result<Self, EncoderError> {
        Self::open(path, runtime, threads, &[Port::floats("pixel_values", &[3, side, side])], outputs)
    }

    /// Opens a graph of texts of at most `context` tokens.
    pub(crate) fn of_texts(
        path: &Path,
        runtime: &OnnxRuntime,
        threads: NonZeroUsize,
        context: usize,
        outputs: Vec<Port>,
    ) -> Result<Self, EncoderError> {
        let inputs = ["input_ids", "attention_mask", "token_type_ids"].map(|name| Port::integers(name, &[context]));
        Self::open(path, runtime, threads, &inputs, outputs)
    }

    /// Opens a graph that has the first of `inputs`, none but those, and one of `outputs`. The first that it has is taken.
    fn open(
        path: &Path,
        runtime: &OnnxRuntime,
        threads: NonZeroUsize,
        inputs: &[Port],
        outputs: Vec<Port>,
    ) -> Result<Self, EncoderError> {
        let wrong = |problem: String| EncoderError::file(path, problem);
        check_files(path)?;
        let session = open_session(path, runtime, threads.get().min(MAX_THREADS)).map_err(|problem| {
            wrong(format!("ONNX Runtime {} does not read it: {problem}; get it again, whole", runtime.version()))
        })?;
        let names = |ports: &[Port]| ports.iter().map(|port| format!("`{}`", port.name)).collect::<Vec<_>>().join(", ");
        let mut own = Vec::new();
        for outlet in session.inputs() {
            let Some(port) = inputs.iter().find(|port| port.name == outlet.name()) else {
                let (name, known) = (outlet.name(), names(inputs));
                return Err(wrong(format!("its input `{name}` is unknown; a graph of this kind has {known}")));
            };
            port.check(outlet).map_err(|problem| wrong(format!("input `{}`: {problem}", port.name)))?;
            own.push(port.name);
        }
        let first = inputs.first().map_or("", |port| port.name);
        if !own.contains(&first) {
            return Err(wrong(format!("it has no input `{first}`; take the graph of this tower")));
        }
        let named = |port: &Port| session.outputs().iter().position(|outlet| outlet.name() == port.name);
        let known = names(&outputs);
        let Some((output, at)) = outputs.into_iter().find_map(|port| named(&port).map(|at| (port, at))) else {
            let found: Vec<String> = session.outputs().iter().map(|outlet| format!("`{}`", outlet.name())).collect();
            return Err(wrong(format!(
                "its outputs are {}, but {known} is needed; export the graph anew",
                found.join(", ")
            )));
        };
        output
            .check(&session.outputs()[at])
            .map_err(|problem| wrong(format!("output `{}`: {problem}", output.name)))?;
        let last = |outlet: &Outlet| outlet.dtype().tensor_shape().and_then(|shape| shape.last().copied());
        let has_fixed_length = session.inputs().iter().any(|outlet| last(outlet).is_some_and(|size| size > 0));
        let version = runtime.version().to_owned();
        Ok(Self { path: path.to_owned(), session: Mutex::new(session), version, inputs: own, output, has_fixed_length })
    }

    /// Whether all texts need as many tokens as the context has.
    pub(crate) fn has_fixed_length(&self) -> bool {
        self.has_fixed_length
    }

    /// The name of the output that [`Graph::run`] gives.
    pub(crate) fn output(&self) -> &'static str {
        self.output.name
    }

    /// The output for token ids, with as many values for each text as `dimensions` has.
    pub(crate) fn run_texts(
        &self,
        texts: &[Vec<u32>],
        filling: Filling,
        dimensions: &[usize],
    ) -> Result<Vec<f32>, EncoderError> {
        let Filling { length, token, is_seen } = filling;
        let rows = |value: &dyn Fn(Option<u32>) -> i64| {
            let row = |ids: &Vec<u32>| (0..length).map(|at| value(ids.get(at).copied())).collect::<Vec<_>>();
            Values::Integers(texts.iter().flat_map(row).collect())
        };
        let values = |name: &str| match name {
            "input_ids" => rows(&|id| i64::from(id.unwrap_or(token))),
            "attention_mask" => rows(&|id| i64::from(is_seen || id.is_some())),
            // Every text has one segment, the first.
            _ => rows(&|_| 0),
        };
        let inputs = self.inputs.iter().map(|name| (*name, vec![texts.len(), length], values(name)));
        self.run(&inputs.collect::<Vec<_>>(), texts.len(), dimensions)
    }

    /// The output for images, with `dimension` values for each.
    pub(crate) fn run_images(
        &self,
        pixels: Vec<f32>,
        shape: [usize; 4],
        dimension: usize,
    ) -> Result<Vec<f32>, EncoderError> {
        let input = ("pixel_values", shape.to_vec(), Values::Floats(pixels));
        self.run(&[input], shape[0], &[dimension])
    }

    fn run(
        &self,
        inputs: &[(&'static str, Vec<usize>, Values)],
        batch: usize,
        dimensions: &[usize],
    ) -> Result<Vec<f32>, EncoderError> {
        let name = self.output.name;
        let failed = |problem: String| {
            EncoderError::file(&self.path, format!("ONNX Runtime {} failed: {problem}", self.version))
        };
        let of_library = |error: ort::Error| failed(message(&error));
        let tensors: Result<Vec<(&str, SessionInputValue<'_>)>, ort::Error> = inputs
            .iter()
            .map(|(name, shape, values)| {
                let shape = shape.as_slice();
                Ok(match values {
                    Values::Floats(values) => (*name, TensorRef::from_array_view((shape, values.as_slice()))?.into()),
                    Values::Integers(values) => (*name, TensorRef::from_array_view((shape, values.as_slice()))?.into()),
                })
            })
            .collect();
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let outputs = session.run(tensors.map_err(of_library)?).map_err(of_library)?;
        let output = outputs.get(name).ok_or_else(|| failed(format!("it gave no output `{name}`")))?;
        let (shape, values) = output.try_extract_tensor::<f32>().map_err(of_library)?;
        let expected = std::iter::once(batch).chain(dimensions.iter().copied());
        if !shape.iter().map(|size| usize::try_from(*size).ok()).eq(expected.map(Some)) {
            let problem = format!("output `{name}` has shape {shape:?}, not {batch} × {dimensions:?}");
            return Err(failed(format!("{problem}; take graph and configuration of one model")));
        }
        Ok(values.to_vec())
    }
}

/// Checks that the graph and the files beside it, which may be its weights, are regular: the library would wait for a pipe.
fn check_files(path: &Path) -> Result<(), EncoderError> {
    file::open(path).map_err(|error| EncoderError::file(path, error.to_string()))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in fs::read_dir(folder).map_err(|error| EncoderError::file(folder, error.to_string()))? {
        let beside = entry.map_err(|error| EncoderError::file(folder, error.to_string()))?.path();
        file::check_file_or_folder(&beside).map_err(|error| EncoderError::file(&beside, error.to_string()))?;
    }
    Ok(())
}

fn open_session(path: &Path, runtime: &OnnxRuntime, threads: usize) -> Result<Session, String> {
    let builder = Session::builder(runtime.environment()).map_err(|error| message(&error))?;
    let builder = builder.with_intra_threads(threads).map_err(|error| message(&error))?;
    // Threads that spin between passes take time from others.
    let mut builder = builder.with_intra_op_spinning(false).map_err(|error| message(&error))?;
    builder.commit_from_file(path).map_err(|error| message(&error))
}
