//! A small voice of random weights, written as Piper's exporter writes one, for tests without a real one.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::noise::Noise;

/// Components of a phoneme, and between the layers of the flow and of the durations.
const WIDTH: usize = 8;
/// Components of the prior.
pub(crate) const PRIOR: usize = 6;
const INNER: usize = 10;
const SPEAKER: usize = 3;
/// Symbols with ids: marks, space and letters.
pub(crate) const SYMBOLS: usize = 40;

/// What is made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    /// Whether each step of a residual block has two convolutions.
    pub(crate) two: bool,
    pub(crate) speakers: usize,
}

/// A voice that can be changed before it is written.
#[derive(Clone)]
pub(crate) struct MadeVoice {
    pub(crate) tensors: BTreeMap<String, (Vec<usize>, Vec<f32>)>,
    pub(crate) nodes: BTreeMap<String, MadeNode>,
    pub(crate) config: Value,
}

#[derive(Clone)]
pub(crate) struct MadeNode {
    operation: &'static str,
    pub(crate) inputs: Vec<String>,
    pub(crate) attributes: BTreeMap<&'static str, Vec<i64>>,
}

/// A voice on disk.
pub(crate) struct Written {
    pub(crate) folder: TempDir,
}

impl Written {
    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join("made.onnx")
    }
}

struct Maker {
    noise: Noise,
    voice: MadeVoice,
}

impl Maker {
    fn tensor(&mut self, name: &str, shape: &[usize], scale: f32) {
        let values = self.noise.numbers(shape.iter().product(), scale);
        self.voice.tensors.insert(name.to_owned(), (shape.to_vec(), values));
    }

    fn node(&mut self, name: &str, operation: &'static str, inputs: Vec<String>, attributes: &[(&'static str, i64)]) {
        let attributes = attributes
            .iter()
            .map(|(name, number)| (*name, if *name == "pads" { vec![*number; 2] } else { vec![*number] }));
        self.voice.nodes.insert(name.to_owned(), MadeNode { operation, inputs, attributes: attributes.collect() });
    }

    /// A layer whose weight has lost its name, as that of a weight norm does.
    fn layer(
        &mut self,
        module: &str,
        operation: &'static str,
        shape: [usize; 3],
        outputs: usize,
        attributes: &[(&'static str, i64)],
    ) {
        let (weight, bias) =
            (format!("onnx::{}", self.voice.tensors.len()), format!("{}.bias", &module[1..].replace('/', ".")));
        let scale = 0.7 / ((shape[1].min(shape[0]) * shape[2]) as f32).sqrt();
        self.tensor(&weight, &shape, scale);
        self.tensor(&bias, &[outputs], 0.1);
        self.node(&format!("{module}/{operation}"), operation, vec!["signal".into(), weight, bias], attributes);
    }

    fn convolution(&mut self, module: &str, inputs: usize, outputs: usize, kernel: usize, dilation: usize) {
        let padding = (dilation * (kernel - 1) / 2) as i64;
        let attributes = [("dilations", dilation as i64), ("pads", padding), ("strides", 1)];
        self.layer(module, "Conv", [outputs, inputs, kernel], outputs, &attributes);
    }

    fn norm(&mut self, module: &str, width: usize) {
        let name = module[1..].replace('/', ".");
        self.tensor(&format!("{name}.gamma"), &[width], 0.5);
        self.tensor(&format!("{name}.beta"), &[width], 0.2);
    }

    fn separable_stack(&mut self, module: &str, width: usize) {
        for at in 0..2 {
            self.convolution(&format!("{module}/convs_sep.{at}"), 1, width, 3, 3_usize.pow(at));
            self.convolution(&format!("{module}/convs_1x1.{at}"), width, width, 1, 1);
            self.norm(&format!("{module}/norms_1.{at}"), width);
            self.norm(&format!("{module}/norms_2.{at}"), width);
        }
    }

    fn table(&mut self, node: &str, tensor: &str, rows: usize, width: usize) {
        self.tensor(tensor, &[rows, width], 0.5);
        self.node(node, "Gather", vec![tensor.into(), "index".into()], &[]);
    }

    fn encoder(&mut self) {
        self.table("/enc_p/emb/Gather", "sid", SYMBOLS, WIDTH);
        for at in 0..2 {
            let attention = format!("/enc_p/encoder/attn_layers.{at}");
            for part in ["conv_q", "conv_k", "conv_v", "conv_o"] {
                self.convolution(&format!("{attention}/{part}"), WIDTH, WIDTH, 1, 1);
            }
            for part in ["emb_rel_k", "emb_rel_v"] {
                self.tensor(&format!("{}.{part}", attention[1..].replace('/', ".")), &[1, 5, 4], 0.5);
            }
            let feed_forward = format!("/enc_p/encoder/ffn_layers.{at}");
            self.convolution(&format!("{feed_forward}/conv_1"), WIDTH, 12, 3, 1);
            self.convolution(&format!("{feed_forward}/conv_2"), 12, WIDTH, 3, 1);
            self.norm(&format!("/enc_p/encoder/norm_layers_1.{at}"), WIDTH);
            self.norm(&format!("/enc_p/encoder/norm_layers_2.{at}"), WIDTH);
        }
        self.convolution("/enc_p/proj", WIDTH, 2 * PRIOR, 1, 1);
    }

    fn durations(&mut self) {
        self.convolution("/dp/pre", WIDTH, INNER, 1, 1);
        self.separable_stack("/dp/convs", INNER);
        self.convolution("/dp/proj", INNER, INNER, 1, 1);
        for at in [3, 5] {
            let flow = format!("/dp/flows.{at}");
            self.convolution(&format!("{flow}/pre"), 1, INNER, 1, 1);
            self.separable_stack(&format!("{flow}/convs"), INNER);
            self.convolution(&format!("{flow}/proj"), INNER, 3 * 4 - 1, 1, 1);
        }
        // Durations of about e.
        self.voice.tensors.insert("dp.flows.0.m".into(), (vec![2, 1], vec![-1.0, 0.3]));
        self.voice.tensors.insert("folded".into(), (vec![2, 1], vec![0.9, 1.1]));
        self.node("/dp/flows.0/Mul", "Mul", vec!["signal".into(), "folded".into()], &[]);
    }

    fn flow(&mut self) {
        for at in [0, 2] {
            let flow = format!("/flow/flows.{at}");
            self.convolution(&format!("{flow}/pre"), PRIOR / 2, WIDTH, 1, 1);
            for (layer, outputs) in [2 * WIDTH, WIDTH].into_iter().enumerate() {
                self.convolution(&format!("{flow}/enc/in_layers.{layer}"), WIDTH, 2 * WIDTH, 3, 1 + layer);
                self.convolution(&format!("{flow}/enc/res_skip_layers.{layer}"), WIDTH, outputs, 1, 1);
            }
            self.convolution(&format!("{flow}/post"), WIDTH, PRIOR / 2, 1, 1);
        }
    }

    fn decoder(&mut self, two: bool) {
        self.convolution("/dec/conv_pre", PRIOR, 8, 7, 1);
        let mut width = 8;
        for (stage, stride) in [4, 2].into_iter().enumerate() {
            let attributes = [("pads", stride as i64 / 2), ("strides", stride as i64)];
            self.layer(
                &format!("/dec/ups.{stage}"),
                "ConvTranspose",
                [width, width / 2, 2 * stride],
                width / 2,
                &attributes,
            );
            width /= 2;
            for (block, kernel) in [3, 5].into_iter().enumerate() {
                let block = format!("/dec/resblocks.{}", 2 * stage + block);
                for step in 0..2 {
                    let (first, second) = (if two { "convs1" } else { "convs" }, "convs2");
                    self.convolution(&format!("{block}/{first}.{step}"), width, width, kernel, 1 + 2 * step);
                    if two {
                        self.convolution(&format!("{block}/{second}.{step}"), width, width, kernel, 1);
                    }
                }
            }
        }
        self.convolution("/dec/conv_post", width, 1, 7, 1);
    }

    fn speakers(&mut self, speakers: usize) {
        self.table("/emb_g/Gather", "emb_g.weight", speakers, SPEAKER);
        self.convolution("/dp/cond", SPEAKER, INNER, 1, 1);
        self.convolution("/dec/cond", SPEAKER, 8, 1, 1);
        for at in [0, 2] {
            self.convolution(&format!("/flow/flows.{at}/enc/cond_layer"), SPEAKER, 4 * WIDTH, 1, 1);
        }
    }
}

impl MadeVoice {
    pub(crate) fn new(kind: Kind) -> Self {
        let letters = ('a'..='z').chain(['\u{327}', '.', ',', '?', ' ']).enumerate();
        let mut ids: BTreeMap<String, Vec<usize>> = letters.map(|(at, c)| (c.to_string(), vec![at + 3])).collect();
        ids.extend([("_".to_owned(), vec![0]), ("^".to_owned(), vec![1]), ("$".to_owned(), vec![2])]);
        let config = json!({
            "audio": { "sample_rate": 8000 },
            "espeak": { "voice": "en-us" },
            "inference": { "noise_scale": 0.6, "length_scale": 1, "noise_w": 0.8 },
            "phoneme_type": "text",
            "phoneme_id_map": ids,
            "speaker_id_map": { "anna": 0, "ben": 1 },
        });
        let voice = Self { tensors: BTreeMap::new(), nodes: BTreeMap::new(), config };
        let mut maker = Maker { noise: Noise::new(3), voice };
        maker.encoder();
        maker.durations();
        maker.flow();
        maker.decoder(kind.two);
        if kind.speakers > 1 {
            maker.speakers(kind.speakers);
        }
        maker.voice
    }

    /// The tensor that a node takes its weights from.
    pub(crate) fn weight(&mut self, node: &str) -> &mut (Vec<usize>, Vec<f32>) {
        let name = self.nodes[node].inputs[1].clone();
        self.tensors.get_mut(&name).unwrap()
    }

    /// The bytes of an ONNX file.
    pub(crate) fn onnx(&self) -> Vec<u8> {
        let nodes = self.nodes.iter().flat_map(|(name, node)| {
            let inputs = node.inputs.iter().flat_map(|input| bytes_field(1, input.as_bytes()));
            let attributes = node.attributes.iter().flat_map(|(name, numbers)| {
                let numbers = numbers.iter().flat_map(|number| [vec![8 << 3], varint(number.cast_unsigned())].concat());
                bytes_field(5, &bytes_field(1, name.as_bytes()).into_iter().chain(numbers).collect::<Vec<_>>())
            });
            let own = [(2, "result"), (3, name), (4, node.operation)];
            let own = own.into_iter().flat_map(|(field, text)| bytes_field(field, text.as_bytes()));
            bytes_field(1, &inputs.chain(own).chain(attributes).collect::<Vec<_>>())
        });
        let tensors = self.tensors.iter().flat_map(|(name, (shape, values))| {
            let shape = shape.iter().flat_map(|size| [vec![1 << 3], varint(*size as u64)].concat());
            let rest = [vec![2 << 3, 1], bytes_field(8, name.as_bytes())].concat();
            let values: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            bytes_field(5, &shape.chain(rest).chain(bytes_field(9, &values)).collect::<Vec<_>>())
        });
        let graph: Vec<u8> = nodes.chain(tensors).collect();
        [vec![1 << 3, 8], bytes_field(7, &graph), vec![(8 << 3) | 2, 2, 16, 15]].concat()
    }

    pub(crate) fn write(&self) -> Written {
        let written = Written { folder: tempfile::tempdir().unwrap() };
        std::fs::write(written.path(), self.onnx()).unwrap();
        std::fs::write(written.folder.path().join("made.onnx.json"), self.config.to_string()).unwrap();
        written
    }
}

pub(crate) fn varint(mut number: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number > 0x7f {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

pub(crate) fn bytes_field(field: u8, bytes: &[u8]) -> Vec<u8> {
    [vec![(field << 3) | 2], varint(bytes.len() as u64), bytes.to_vec()].concat()
}
