#!/usr/bin/env bash
# Makes the Python environment of the tests: $cache_dir/python with the packages of ops/tools.sh. Does nothing where it
# is there with just these. Needs Python 3.10 or newer with its module venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. ops/tools.sh

stamp=$python_dir/packages
wanted=$(printf '%s\n' "${python_packages[@]}")
complete() { [[ -x $python_dir/bin/python && -f $stamp && $(<"$stamp") == "$wanted" ]] && "$python_dir/bin/python" -c '' 2>/dev/null; }

complete && exit 0
mkdir -p "$cache_dir"
exec 9>"$cache_dir/python.lock"
# Two clones on one machine set up one after the other.
flock --timeout 900 9 || { echo "python.sh: somebody else has been setting up $python_dir for 15 minutes" >&2; exit 1; }
complete && exit 0

python=$(command -v python3) || { echo "python.sh: no python3; install Python 3.10 or newer" >&2; exit 2; }
if ! "$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
    echo "python.sh: $python is older than 3.10 or lacks venv (Debian: apt-get install python3-venv)" >&2
    exit 2
fi
echo "python.sh: installing ${python_packages[*]}"
rm -rf "$python_dir"
"$python" -m venv "$python_dir"
"$python_dir/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: "${python_packages[@]}"
printf '%s\n' "$wanted" >"$stamp"
