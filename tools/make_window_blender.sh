#!/bin/sh
# Makes a Debian system with a Blender that opens windows, a display to open them on, a hand to use
# them and another program to drag files from, in the folder that is given: 1.9 GB, some two minutes.
# Does nothing where all of it is there already. What is missing is said in one line on standard
# error.
set -eu

target=$1
packages=blender,python3-cattr,python3-numpy,python3-openvdb,python3-requests,python3-zstandard
packages=$packages,libegl1,libgl1,libgl1-mesa-dri,libglx-mesa0
packages=$packages,xvfb,xdotool,imagemagick,python3-tk,tkdnd
if [ "$(cat "$target/packages" 2>/dev/null)" = "$packages" ]; then exit 0; fi

fail() {
    echo "no Blender with a window: $*" >&2
    exit 1
}

[ "$(uname -s)" = Linux ] || fail "only Linux can hold a Debian system in a folder"
[ "$(id -u)" -eq 0 ] || fail "a system in a folder needs root"
command -v mmdebstrap >/dev/null 2>&1 ||
    fail "mmdebstrap is not there; on Debian: apt-get install mmdebstrap"
unshare --mount --net --pid --fork true 2>/dev/null ||
    fail "this machine allows no namespaces (unshare)"

echo "Making a Debian system with Blender in $target (1.9 GB, some minutes) ..."
mkdir -p "$(dirname "$target")"
log="$target.log"
rm -rf "$target"
# A mirror that is a snapshot may be older than its index says is valid.
if ! mmdebstrap --variant=minbase --mode=root --include="ca-certificates,$packages" \
    --aptopt='Acquire::Check-Valid-Until "false"' sid "$target" >"$log" 2>&1; then
    rm -rf "$target"
    fail "mmdebstrap: $(grep -m 1 '^E:' "$log" || tail -n 1 "$log"); see $log"
fi
# Last, so that it is only there when all the rest is.
echo "$packages" >"$target/packages"
