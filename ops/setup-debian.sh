#!/usr/bin/env bash
# Installs on a Debian machine what `ops/check` needs and the machine lacks: compilers of C and C++, git, `ip`, a Vulkan driver made
# of processor cores (lavapipe), a display without a screen (Xvfb) with a window manager (openbox) and what presses its keys (xdotool), ffmpeg,
# the sound library, speech programs (espeak-ng, flite, pocketsphinx), cargo-nextest, cargo-deny, buf, the Python environment of the tests (ops/python.sh), their models (ops/models.sh) and their OpenXR runtime
# (ops/monado.sh). Does nothing where everything is there; the Rust toolchain itself comes from rustup.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. ops/tools.sh

have() { command -v "$1" >/dev/null 2>&1; }

if ! have cargo || ! have rustc; then
    echo "setup-debian: no Rust toolchain; install stable with rustup (https://rustup.rs) and run this again" >&2
    exit 2
fi

packages=()
have cc || packages+=(gcc libc6-dev)
have c++ || packages+=(g++)
have git || packages+=(git)
have ip || packages+=(iproute2)
have Xvfb || packages+=(xvfb)
have xdotool || packages+=(xdotool)
have openbox || packages+=(openbox)
have ffmpeg || packages+=(ffmpeg)
[[ -e /usr/include/alsa/asoundlib.h ]] || packages+=(libasound2-dev pkg-config)
have espeak-ng || packages+=(espeak-ng)
have flite || packages+=(flite)
have pocketsphinx_batch || packages+=(pocketsphinx)
[[ -e /usr/share/pocketsphinx/model/en-us/en-us/mdef ]] || packages+=(pocketsphinx-en-us)
have npm || packages+=(nodejs npm)
# A graphics card's own driver, if there is one, stays what is used; tests need any.
compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || packages+=(mesa-vulkan-drivers)
ldconfig -p | grep -q 'libvulkan\.so\.1' || packages+=(libvulkan1)
# A test makes the index of synonyms again from these files.
[[ -e /usr/share/wordnet/data.noun ]] || packages+=(wordnet-base)
python3 -c 'import venv, ensurepip' 2>/dev/null || packages+=(python3 python3-venv)
if ((${#packages[@]})); then
    as_root=()
    ((EUID == 0)) || as_root=(sudo)
    echo "setup-debian: installing ${packages[*]}"
    "${as_root[@]}" apt-get update -q
    DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -q -y --no-install-recommends "${packages[@]}"
fi

mkdir -p "$tools_dir/bin"

# A tool is built in a folder named after its version and only then linked, so that a build that was cut short leaves
# nothing that looks finished.
link() { ln -sfn "$1" "$tools_dir/bin/$(basename "$1")"; }

cargo_tool() {
    local name=$1 version=$2 root=$tools_dir/$1-$2
    if [[ ! -x $root/bin/$name ]]; then
        echo "setup-debian: building $name $version"
        CARGO_TARGET_DIR=$tools_dir/build cargo install --quiet --locked --root "$root" --version "$version" "$name"
        rm -rf "$tools_dir/build"
    fi
    link "$root/bin/$name"
}

# Any nextest that is there will do: what it prints and how it is configured has been stable for years.
have cargo-nextest || cargo_tool cargo-nextest "$cargo_nextest_version"
cargo_tool cargo-deny "$cargo_deny_version"

buf_root=$tools_dir/buf-$buf_version
if [[ ! -x $buf_root/node_modules/.bin/buf ]]; then
    echo "setup-debian: installing buf $buf_version"
    npm install --silent --no-audit --no-fund --prefix "$buf_root" "@bufbuild/buf@$buf_version"
fi
link "$buf_root/node_modules/.bin/buf"

ops/python.sh
ops/models.sh
ops/monado.sh

echo "setup-debian: $(rustc --version); $(cargo nextest --version | head -n 1); $(cargo deny --version); buf $(buf --version); $("$SUPERGAUSSIAN_PYTHON" --version)"
