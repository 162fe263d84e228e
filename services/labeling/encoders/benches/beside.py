#!/usr/bin/env python3
"""The bench `encoders.rs` for PyTorch and ONNX Runtime: the same sizes with random weights, two threads, the shortest of 20 rounds.

    pip install torch transformers onnx onnxscript onnxruntime
    python beside.py

A text has as many tokens as those of `encoders.rs` have at most, so that both compute as much.
"""

import pathlib
import tempfile
import time

import numpy as np
import onnxruntime
import torch
from transformers import BertConfig, BertModel, CLIPConfig, CLIPModel

BATCHES = [1, 5, 8]
ROUNDS = 20
THREADS = 2


def least(run):
    walls, cores = [], []
    for _ in range(ROUNDS):
        wall, core = time.perf_counter(), time.process_time()
        run()
        walls.append(time.perf_counter() - wall)
        cores.append(time.process_time() - core)
    return min(walls), min(cores)


def row(name, program, run):
    run(8)
    costs = [(count, least(lambda: run(count))) for count in BATCHES]
    walls = " | ".join(f"{1e3 * wall / count:.1f} ms" for count, (wall, _) in costs)
    count, (_, cores) = costs[-1]
    print(f"| {name} | {program} | {walls} | {1e3 * cores / count:.0f} ms |", flush=True)


class Tower(torch.nn.Module):
    def __init__(self, function):
        super().__init__()
        self.function = function
        self.model = function.__self__

    def forward(self, inputs):
        output = self.function(inputs)
        pooled = getattr(output, "pooler_output", None)
        return output.last_hidden_state if pooled is None else pooled


def measure(name, function, inputs):
    tower = Tower(function).eval()
    with torch.inference_mode():
        row(name, "PyTorch", lambda count: tower(inputs[:count]))
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "tower.onnx"
        batch = torch.export.Dim("batch", min=1, max=64)
        torch.onnx.export(tower, (inputs,), path, dynamic_shapes={"inputs": {0: batch}}, dynamo=True, verbose=False)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = THREADS
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        key, values = session.get_inputs()[0].name, inputs.numpy()
        row(name, "ONNX Runtime", lambda count: session.run(None, {key: values[:count]}))


def main():
    torch.set_num_threads(THREADS)
    torch.manual_seed(1)
    print(f"torch {torch.__version__}, onnxruntime {onnxruntime.__version__}")
    print("| input | program | batch 1 | batch 5 | batch 8 | cores |\n| --- | --- | --- | --- | --- | --- |")
    clip = CLIPModel(CLIPConfig()).eval()
    measure("image, ViT-B/32", clip.get_image_features, torch.rand(8, 3, 224, 224))
    clip_tokens, bert_tokens = TOKENS
    measure("text, ViT-B/32", clip.get_text_features, torch.randint(1, 49000, (8, clip_tokens)))
    bert = BertModel(
        BertConfig(hidden_size=384, intermediate_size=1536, num_hidden_layers=6, num_attention_heads=12), add_pooling_layer=False
    ).eval()
    measure("text, MiniLM", bert.forward, torch.randint(1, 30000, (8, bert_tokens)))


# Tokens of the longest text of the bench: letter by letter for CLIP's random model, word by word for MiniLM.
TOKENS = (30, 10)

if __name__ == "__main__":
    main()
