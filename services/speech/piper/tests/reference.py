"""Writes fixtures/joe-medium.json: what ONNX Runtime makes of a sentence without noise, for src/parity_tests.rs.

Needs the packages onnxruntime, numpy and piper-tts. Usage: reference.py VOICE.onnx
"""

import json
import pathlib
import sys

import numpy as np
import onnxruntime
from piper import PiperVoice

SENTENCE = "The quick brown fox jumps over the lazy dog near the river bank."
STEP, WINDOW = 61, 1024

model = pathlib.Path(sys.argv[1])
voice = PiperVoice.load(str(model), config_path=f"{model}.json")
phonemes = voice.phonemize(SENTENCE)
assert len(phonemes) == 1
ids = voice.phonemes_to_ids(phonemes[0])


def with_output(name: str) -> bytes:
    """The model with one more result: an entry in the list of the graph's results (fields 7 and 12 of onnx.proto)."""

    def varint(number: int) -> bytes:
        out = b""
        while number > 127:
            out += bytes([number & 127 | 128])
            number >>= 7
        return out + bytes([number])

    def field(number: int, content: bytes) -> bytes:
        return bytes([number << 3 | 2]) + varint(len(content)) + content

    # Messages of one field that are appended are merged into the one before.
    kind = field(1, bytes([8, 1]))
    return model.read_bytes() + field(7, field(12, field(1, name.encode()) + field(2, kind)))


inputs = {
    "input": np.array([ids], np.int64),
    "input_lengths": np.array([len(ids)], np.int64),
    "scales": np.array([0, 1, 0], np.float32),
}
session = onnxruntime.InferenceSession(with_output("/Ceil_output_0"), providers=["CPUExecutionProvider"])
sound, durations = session.run(None, inputs)
sound, durations = sound.reshape(-1).astype(np.float64), durations.reshape(-1)
windows = sound[: len(sound) // WINDOW * WINDOW].reshape(-1, WINDOW)
reference = {
    "sentence": SENTENCE,
    "ids": ids,
    "durations": [int(d) for d in durations],
    "samples": len(sound),
    "step": STEP,
    "every": [round(float(x), 7) for x in sound[::STEP]],
    "window": WINDOW,
    "energies": [round(float((w**2).mean()), 10) for w in windows],
}
text = json.dumps(reference, separators=(",", ":"))
path = pathlib.Path(__file__).with_name("fixtures") / "joe-medium.json"
path.write_text(text + "\n")
print(len(sound), abs(sound).max(), len(text))
