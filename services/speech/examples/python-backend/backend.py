#!/usr/bin/env python3
"""A recognizer and synthesizer in another program.

Serves supergaussian.backend.v1.SpeechBackendService, so that the speech service of a launch file may choose it with
`recognizer = "grpc"` and `synthesizer = "grpc"`. Put a real model where `transcribe` and `synthesize` are; everything else
can stay. Here pocketsphinx listens for the expected sentences, and espeak-ng speaks.
"""

import argparse
import importlib
import re
import subprocess
import sys
import tempfile
import wave
from concurrent import futures
from pathlib import Path

import grpc
from grpc_tools import protoc

PROTO = Path(__file__).resolve().parents[4] / "proto"
MODELS = Path("/usr/share/pocketsphinx/model/en-us")
NAME = "pocketsphinx-expected"


def contract(folder):
    """Compiles the schema into `folder` and returns its module of messages."""
    source = "supergaussian/backend/v1/speech.proto"
    if protoc.main(["protoc", f"-I{PROTO}", f"--python_out={folder}", source]) != 0:
        sys.exit(f"{PROTO / source} could not be compiled")
    sys.path.insert(0, folder)
    return importlib.import_module("supergaussian.backend.v1.speech_pb2")


def words(sentence):
    return re.findall(r"[a-z']+", sentence.lower())


def dictionary():
    """The words that the recognizer can pronounce."""
    with open(MODELS / "cmudict-en-us.dict", encoding="utf-8") as lines:
        return {line.split(maxsplit=1)[0] for line in lines if line.strip()}


KNOWN = dictionary()


def transcribe(request, seconds):
    """The expected sentence that is likeliest, or nothing."""
    # The dictionary has no digits.
    plain = [s for s in request.expected if re.fullmatch(r"[A-Za-z' ]+", s)]
    expected = {" ".join(words(s)): s for s in plain if words(s) and set(words(s)) <= KNOWN}
    if not expected:
        return ""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "u.raw").write_bytes(request.samples)
        (folder / "list").write_text("u\n")
        (folder / "expected.jsgf").write_text(f"#JSGF V1.0;\ngrammar g;\npublic <s> = {' | '.join(expected)};\n")
        command = ["pocketsphinx_batch", "-hmm", MODELS / "en-us", "-dict", MODELS / "cmudict-en-us.dict"]
        command += ["-jsgf", folder / "expected.jsgf", "-ctl", folder / "list", "-cepdir", folder, "-cepext", ".raw"]
        command += ["-adcin", "yes", "-samprate", str(request.rate), "-hyp", folder / "text", "-bestpath", "no"]
        subprocess.run(command, check=True, timeout=seconds, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        said = (folder / "text").read_text().rsplit(" (u", 1)[0].strip()
    return expected.get(said, said)


def synthesize(request, seconds):
    """The rate and the samples of a sentence."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/sound.wav"
        command = ["espeak-ng", "-v", request.voice or "en-us", "-w", out, "--stdin"]
        subprocess.run(command, check=True, timeout=seconds, input=request.text.encode())
        with wave.open(out) as sound:
            return sound.getframerate(), sound.readframes(sound.getnframes())


def serve(messages, address):
    def answer_with(method):
        def answer(request, context):
            try:
                return method(request, max(request.deadline_ms, 100) / 1000)
            except (OSError, subprocess.SubprocessError) as error:
                return context.abort(grpc.StatusCode.INTERNAL, str(error))

        return answer

    def heard(request, seconds):
        return messages.TranscribeResponse(text=transcribe(request, seconds), model=NAME)

    def spoken(request, seconds):
        rate, samples = synthesize(request, seconds)
        return messages.SynthesizeResponse(rate=rate, samples=samples)

    handlers = {
        name: grpc.unary_unary_rpc_method_handler(answer_with(method), request.FromString, response.SerializeToString)
        for name, method, request, response in [
            ("Transcribe", heard, messages.TranscribeRequest, messages.TranscribeResponse),
            ("Synthesize", spoken, messages.SynthesizeRequest, messages.SynthesizeResponse),
        ]
    }
    server = grpc.server(futures.ThreadPoolExecutor(max_workers=4))
    service = grpc.method_handlers_generic_handler("supergaussian.backend.v1.SpeechBackendService", handlers)
    server.add_generic_rpc_handlers((service,))
    port = server.add_insecure_port(address)
    server.start()
    print(f"serving {address if address.startswith('unix:') else f'http://127.0.0.1:{port}'}", flush=True)
    server.wait_for_termination()


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("address", nargs="?", default="127.0.0.1:0", help="127.0.0.1:PORT (0: any) or unix:/PATH")
    with tempfile.TemporaryDirectory() as folder:
        serve(contract(folder), arguments.parse_args().address)
