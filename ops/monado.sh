#!/usr/bin/env bash
# Makes the OpenXR runtime of the tests: Monado with its loader, Vulkan driver and C library, unpacked from Debian's packages
# into $monado_dir. Nothing of it is installed and nothing needs root: programs run in it by its own dynamic loader
# ($monado_dir/run PROGRAM …). Does nothing where it is there. The mirror is the one apt is configured with; needs apt.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. ops/tools.sh

complete() { [[ -x $monado_dir/run && -f $monado_dir/packages && $(<"$monado_dir/packages") == "$wanted" ]]; }
wanted=$(printf '%s\n' "$monado_suite" "${monado_packages[@]}")
complete && exit 0

mkdir -p "$cache_dir"
exec 9>"$cache_dir/monado.lock"
# Two clones on one machine set up one after the other.
flock --timeout 900 9 || { echo "monado.sh: somebody else has been setting up $monado_dir for 15 minutes" >&2; exit 1; }
complete && exit 0

for program in apt-get dpkg-deb; do
    command -v "$program" >/dev/null || { echo "monado.sh: no $program; on other systems than Debian install Monado 25 yourself" >&2; exit 2; }
done
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
[[ -f $keyring ]] || { echo "monado.sh: no $keyring (apt-get install debian-archive-keyring)" >&2; exit 2; }
mirror=$(apt-get indextargets --format '$(SITE)' 'Created-By: Packages' | grep -m 1 -E '/debian/?$' || true)
[[ -n $mirror ]] || { echo "monado.sh: apt is configured with no mirror of Debian" >&2; exit 2; }

echo "monado.sh: unpacking ${monado_packages[*]} of Debian $monado_suite from $mirror"
# Made under another name and renamed when it is whole, so that a build that was cut short leaves nothing that looks finished.
build=$monado_dir.building
rm -rf "$build"
mkdir -p "$build"/apt/{state/lists/partial,cache/archives/partial,etc} "$build/tree"
: >"$build/apt/status"
printf 'deb [signed-by=%s] %s %s main\n' "$keyring" "$mirror" "$monado_suite" >"$build/apt/sources.list"
# An apt of its own beside the system's, that takes nothing for installed.
private=(
    -o Dir::State="$build/apt/state" -o Dir::State::status="$build/apt/status" -o Dir::Cache="$build/apt/cache"
    -o Dir::Etc::sourcelist="$build/apt/sources.list" -o Dir::Etc::parts="$build/apt/etc" -o Dir::Etc::sourceparts="$build/apt/etc" -o Dir::Etc::preferencesparts="$build/apt/etc"
    -o APT::Sandbox::User="$(id -un)" -o Acquire::Languages=none -o Acquire::Retries=3
)
apt-get "${private[@]}" -qq update
apt-get "${private[@]}" -qq -y --no-install-recommends --download-only install "${monado_packages[@]}" >/dev/null
for package in "$build"/apt/cache/archives/*.deb; do
    # Debian's folders at the root are links into usr; unpacked one package at a time they have to be there first.
    for folder in bin lib lib64 sbin; do
        mkdir -p "$build/tree/usr/$folder"
        [[ -e $build/tree/$folder ]] || ln -s "usr/$folder" "$build/tree/$folder"
    done
    dpkg-deb --fsys-tarfile "$package" | tar -x -C "$build/tree" --keep-directory-symlink --no-same-owner
done
rm -rf "$build/apt" "$build"/tree/usr/share/{doc,man,locale,icons,info}

cat >"$build/run" <<'RUN'
#!/bin/sh
# Runs a program with the libraries, the OpenXR runtime and the Vulkan driver of the tree beside this file.
#
#   run PROGRAM ARGUMENTS…
set -eu
tree=$(dirname "$(readlink -f "$0")")/tree
program=$1
shift
[ -x "$tree/usr/bin/$program" ] && program=$tree/usr/bin/$program
for loader in "$tree"/usr/lib64/ld-linux-*.so.* "$tree"/usr/lib/ld-linux-*.so.*; do [ -x "$loader" ] && break; done
libraries=$(dirname "$(readlink -f "$loader")")
export XR_RUNTIME_JSON="$tree/usr/share/openxr/1/openxr_monado.json"
export VK_DRIVER_FILES="$tree/usr/share/vulkan/icd.d/lvp_icd.json"
exec "$loader" --library-path "$libraries:$libraries/blas:$libraries/lapack:$libraries/pulseaudio:$tree/usr/lib" "$program" "$@"
RUN
chmod +x "$build/run"
# It ends at once for want of a terminal, unless a library is missing.
status=0
XRT_COMPOSITOR_NULL=1 timeout 60 "$build/run" monado-service </dev/null >"$build/first-start" 2>&1 || status=$?
if ((status >= 124 && status <= 127)); then
    echo "monado.sh: monado-service does not start: $(tail -n 1 "$build/first-start")" >&2
    exit 1
fi
printf '%s\n' "$wanted" >"$build/packages"
rm -rf "$monado_dir"
mv "$build" "$monado_dir"
