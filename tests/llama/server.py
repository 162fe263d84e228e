"""A llama.cpp server with a language model of two layers and random weights, for tests: `server.py FOLDER [SEED]`.

It knows nothing, but everything about it is real: the protocol, the tokens, the grammar that holds its answers to a JSON
schema. It leans to opening and closing, so that answers are short. Prints its address on a line and serves until killed.
"""

import sys
import threading
from pathlib import Path

import gguf
import numpy as np
import xllamacpp

EMBEDDING, HEADS, FEED_FORWARD, LAYERS, CONTEXT = 64, 4, 128, 2, 16384
LEANING = {'"': 0.6, "]": 0.4, "}": 0.4, "{": 0.4}


def write_model(path, seed):
    rng = np.random.default_rng(seed)
    letters = [chr(c) for c in range(32, 127)]
    tokens = ["<unk>", "<s>", "</s>"] + [f"<0x{byte:02X}>" for byte in range(256)] + letters
    kind = gguf.TokenType
    types = [kind.UNKNOWN, kind.CONTROL, kind.CONTROL] + [kind.BYTE] * 256 + [kind.NORMAL] * len(letters)

    writer = gguf.GGUFWriter(path, "llama")
    writer.add_context_length(CONTEXT)
    writer.add_embedding_length(EMBEDDING)
    writer.add_block_count(LAYERS)
    writer.add_feed_forward_length(FEED_FORWARD)
    writer.add_head_count(HEADS)
    writer.add_head_count_kv(HEADS)
    writer.add_rope_dimension_count(EMBEDDING // HEADS)
    writer.add_layer_norm_rms_eps(1e-5)
    writer.add_vocab_size(len(tokens))
    writer.add_tokenizer_model("llama")
    writer.add_token_list(tokens)
    writer.add_token_scores([0.0] * len(tokens))
    writer.add_token_types(types)
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    writer.add_unk_token_id(0)

    def random(*shape):
        return rng.normal(0, 0.1, shape).astype(np.float32)

    # The first number of every embedding is the same and large, so that the output can lean on it: towards what
    # opens and closes, and away from bytes that make no letter.
    embedding, output = random(len(tokens), EMBEDDING), random(len(tokens), EMBEDDING)
    embedding[:, 0] = 4
    output[:, 0] = [LEANING.get(token, -4.0 if of == kind.BYTE else 0.0) for token, of in zip(tokens, types)]
    writer.add_tensor("token_embd.weight", embedding)
    writer.add_tensor("output.weight", output)
    writer.add_tensor("output_norm.weight", np.ones(EMBEDDING, np.float32))
    for layer in range(LAYERS):
        for name in ("attn_q", "attn_k", "attn_v", "attn_output"):
            writer.add_tensor(f"blk.{layer}.{name}.weight", random(EMBEDDING, EMBEDDING))
        for name in ("attn_norm", "ffn_norm"):
            writer.add_tensor(f"blk.{layer}.{name}.weight", np.ones(EMBEDDING, np.float32))
        writer.add_tensor(f"blk.{layer}.ffn_gate.weight", random(FEED_FORWARD, EMBEDDING))
        writer.add_tensor(f"blk.{layer}.ffn_up.weight", random(FEED_FORWARD, EMBEDDING))
        writer.add_tensor(f"blk.{layer}.ffn_down.weight", random(EMBEDDING, FEED_FORWARD))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


def main(folder, seed="1"):
    model = Path(folder) / "random.gguf"
    write_model(model, int(seed))
    params = xllamacpp.CommonParams()
    params.model.path = str(model)
    params.n_ctx = CONTEXT
    params.n_parallel = 1
    params.n_gpu_layers = 0
    params.cpuparams.n_threads = 1
    params.port = 0
    params.warmup = False
    params.chat_template = "{% for message in messages %}{{ message['content'] }}\n{% endfor %}"
    server = xllamacpp.Server(params)
    print(server.listening_address, flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
