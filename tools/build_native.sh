#!/bin/sh
# Builds the native core's wheel into wheels/ (the only one there) and installs it into .venv.
set -eu

log=build/native.log
mkdir -p build wheels
rm -f wheels/volillum_native-*.whl
echo "Building the native core ..."
# cmake and ninja come from the environment, at the locked versions.
if ! PATH="$PWD/.venv/bin:$PATH" .venv/bin/python -m pip wheel --disable-pip-version-check \
    --no-deps --no-build-isolation --check-build-dependencies --wheel-dir wheels ./native \
    >"$log" 2>&1; then
    grep -E 'error|ERROR' "$log" | head -n 20 >&2 || true
    echo "set-up failed: the native core does not build; see $log" >&2
    exit 1
fi
.venv/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --no-index \
    --force-reinstall wheels/volillum_native-*.whl
