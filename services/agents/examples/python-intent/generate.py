"""Generates the Python classes of the contract's messages and prints their folder.

    python generate.py            # found from this file: the checkout's proto/
    python generate.py PROTO      # or the folder that holds supergaussian/

The folder is named after the schema's content and lies in the user's cache, so that a changed schema is generated anew
and an unchanged one never twice.
"""

import hashlib
import os
import pathlib
import shutil
import sys
import tempfile


def proto_folder() -> pathlib.Path:
    """The folder of the schema: SUPERGAUSSIAN_PROTO, else the `proto/` of this checkout."""
    named = os.environ.get("SUPERGAUSSIAN_PROTO")
    if named:
        return pathlib.Path(named)
    for folder in pathlib.Path(__file__).resolve().parents:
        if (folder / "proto" / "supergaussian").is_dir():
            return folder / "proto"
    raise SystemExit("no proto/ above this file; name the schema's folder with SUPERGAUSSIAN_PROTO")


def generated(proto: pathlib.Path) -> pathlib.Path:
    """The folder of generated classes for a schema. It is created if it is missing."""
    files = sorted(str(path.relative_to(proto)) for path in proto.glob("supergaussian/*/*/*.proto"))
    if not files:
        raise SystemExit(f"{proto}: no supergaussian/<domain>/<version>/*.proto in here")
    import google.protobuf

    content = hashlib.sha256(google.protobuf.__version__.encode())
    for name in files:
        content.update(name.encode() + b"\0" + (proto / name).read_bytes() + b"\0")
    cache = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache")
    target = cache / "supergaussian" / "python-messages" / content.hexdigest()[:16]
    if target.is_dir():
        return target
    from grpc_tools import protoc

    target.parent.mkdir(parents=True, exist_ok=True)
    # Written under another name and renamed, so that a second service never sees a partial folder.
    part = pathlib.Path(tempfile.mkdtemp(dir=target.parent))
    try:
        if protoc.main(["protoc", f"-I{proto}", f"--python_out={part}", *files]) != 0:
            raise SystemExit(f"{proto}: the schema could not be compiled")
        try:
            part.rename(target)
        except OSError:
            if not target.is_dir():
                raise
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return target


if __name__ == "__main__":
    print(generated(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else proto_folder()))
