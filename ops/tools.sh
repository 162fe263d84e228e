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
