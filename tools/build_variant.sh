#!/bin/sh
# Builds the native core in another way than the installed one: tools/build_variant.sh NAME OPTIONS
# makes build/NAME/volillum_native*.so with the options for cmake. Python takes it before the
# installed one where PYTHONPATH names that folder.
set -eu

folder="build/$1"
shift
log="$folder.log"
python="$PWD/.venv/bin/python"
PATH="$PWD/.venv/bin:$PATH"
mkdir -p "$folder"
echo "Building the native core with $* ..."
# The stub is left out: making it loads the core into a Python that is not prepared for it.
if ! { cmake -S native -B "$folder" -G Ninja -DCMAKE_BUILD_TYPE=Release -DPython_EXECUTABLE="$python" \
        -Dnanobind_DIR="$("$python" -m nanobind --cmake_dir)" "$@" &&
        cmake --build "$folder" --target volillum_native; } >"$log" 2>&1; then
    grep -E 'error|ERROR' "$log" | head -n 20 >&2 || true
    echo "the native core does not build with $*; see $log" >&2
    exit 1
fi
