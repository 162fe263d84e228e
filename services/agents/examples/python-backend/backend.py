#!/usr/bin/env python3
"""A backend with keyword rules for German, in place of a language model.

Serves supergaussian.backend.v1.BackendService, so that any agent of a launch file may choose it with `backend = "grpc"`.
Put a real model where `understand`, `choose` and `paraphrase` are; everything else can stay.
"""

import argparse
import importlib
import json
import re
import sys
import tempfile
from concurrent import futures
from pathlib import Path

import grpc
from grpc_tools import protoc

PROTO = Path(__file__).resolve().parents[4] / "proto"
NAME = "german-keywords"

COLORS = {"rot": (1, 0, 0), "grün": (0, 0.5, 0), "blau": (0, 0, 1), "gelb": (1, 1, 0), "weiß": (1, 1, 1), "schwarz": (0, 0, 0)}
OTHER_WORDS = {"beule": "sac", "aussackung": "sac", "gefäß": "vessel", "ader": "vessel", "gefäße": "vessels"}


def contract(folder):
    """Compiles the schema into `folder` and returns its module of messages."""
    source = "supergaussian/backend/v1/backend.proto"
    if protoc.main(["protoc", f"-I{PROTO}", f"--python_out={folder}", source]) != 0:
        sys.exit(f"{PROTO / source} could not be compiled")
    sys.path.insert(0, folder)
    return importlib.import_module("supergaussian.backend.v1.backend_pb2")


def reference(part, units):
    """The target of a part of an utterance."""
    named = [unit for unit in units if re.search(rf"\b{re.escape(unit.lower())}\b", part)]
    # Unknown names stay as they were spoken; the function agent resolves them.
    if not named:
        named = re.findall(r"\b(?:der|die|das|den)\s+(?!auswahl|rest\b|alles\b)(\w+)", part)
    return {
        "names": named,
        "selection": "auswahl" in part,
        "everything": not named and re.search(r"\balles\b", part) is not None,
        "complement": re.search(r"\brest\b", part) is not None,
        "focus": not named and re.search(r"\b(?:es|sie|ihn)\b", part) is not None,
    }


def clause(part, units):
    """One clause in the form of `json_schema`, or None."""
    target = reference(part, units)
    color = next((c for c in COLORS if re.search(rf"\b{c}(?:e[nrms]?)?\b", part)), None)
    if "hintergrund" in part and color:
        fields = {"act": "ACT_SET_BACKGROUND", "color": rgb(color), "color_name": color}
    elif color:
        fields = {"act": "ACT_SET_COLOR", "target": target, "color": rgb(color), "color_name": color}
    elif found := re.search(r"(\d+)\s*(?:%|prozent)", part):
        amount = min(int(found[1]), 100) / 100
        fields = {"act": "ACT_SET_OPACITY", "target": target, "amount": amount, "relative": False}
    elif re.search(r"\b(?:versteck|verbirg|ohne)", part):
        fields = {"act": "ACT_HIDE", "target": target}
    elif re.search(r"\bzeige?\b", part):
        fields = {"act": "ACT_SHOW", "target": target}
    elif part in ("hilfe", "help"):
        # During a swap the supervisor probes an intent agent with "help".
        fields = {"act": "ACT_HELP"}
    elif "rückgängig" in part:
        fields = {"act": "ACT_UNDO", "amount": None}
    else:
        return None
    return fields | {"words": part}


def rgb(color):
    return dict(zip(("red", "green", "blue"), COLORS[color]))


def understand(asked):
    """agent-intent: an utterance becomes clauses."""
    parts = [p.strip(" .!?") for p in re.split(r"\s+und\s+|,", asked["utterance"].lower())]
    read = [(part, clause(part, asked["units"])) for part in parts if part]
    clauses = [c for _, c in read if c]
    return json.dumps({"clauses": clauses, "not_understood": [part for part, c in read if not c]})


def choose(asked):
    """agent-function: the unit for an unknown name, or null."""
    unit = OTHER_WORDS.get(asked["spoken"].lower())
    return json.dumps({"unit": unit if unit in asked["units"] else None})


def paraphrase(asked):
    """agent-core: the reply in other words."""
    return ("Erledigt: " if asked["done"] else "Nicht alles ging: ") + asked["facts"]


AGENTS = {"agent-intent": understand, "agent-function": choose, "agent-core": paraphrase}


def serve(messages, address):
    def complete(request, context):
        answer = AGENTS.get(request.agent)
        if answer is None:
            context.abort(grpc.StatusCode.INVALID_ARGUMENT, f"no rules for {request.agent}")
        return messages.CompleteResponse(text=answer(json.loads(request.user)), model=NAME)

    handler = grpc.unary_unary_rpc_method_handler(
        complete, messages.CompleteRequest.FromString, messages.CompleteResponse.SerializeToString
    )
    service = grpc.method_handlers_generic_handler("supergaussian.backend.v1.BackendService", {"Complete": handler})
    server = grpc.server(futures.ThreadPoolExecutor(max_workers=4))
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
