#!/usr/bin/env bash
# The render node within the folder that ops/monado.sh made, with its libraries and its OpenXR runtime. A launch file starts it
# in the place of the render node:
#
#     XDG_RUNTIME_DIR=FOLDER supergaussian up launch/vr.toml --set service.render-view.exec=../ops/room-under-monado.sh \
#         --set "service.render-view.read=['$SUPERGAUSSIAN_MONADO']"
#
# where monado-service runs with the same XDG_RUNTIME_DIR. SUPERGAUSSIAN_RENDER_NODE names the executable where it is neither on
# PATH nor built in this checkout.
set -euo pipefail
here=$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")
. "$here/tools.sh"

node=${SUPERGAUSSIAN_RENDER_NODE:-$(command -v supergaussian-render-node || echo "${CARGO_TARGET_DIR:-$here/../target}/release/supergaussian-render-node")}
[[ -x $SUPERGAUSSIAN_MONADO/run ]] || { echo "room-under-monado.sh: no $SUPERGAUSSIAN_MONADO/run; ops/monado.sh makes it" >&2; exit 2; }
[[ -x $node ]] || { echo "room-under-monado.sh: no $node; build it with \`cargo build --release\`" >&2; exit 2; }
exec "$SUPERGAUSSIAN_MONADO/run" "$node" "$@"
