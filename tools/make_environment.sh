#!/bin/sh
# Makes .venv anew from requirements.lock, unless it was made from the same one. Whatever fails, the
# last line says what was missing.
set -eu

fail() {
    echo "set-up failed: $*" >&2
    exit 1
}

# A checkout of another commit and back changes the time of the lock but not what it says.
stamp=.venv/.environment
key=$(cat requirements.lock tools/make_environment.sh | cksum)
if [ -e "$stamp" ] && [ "$(cat "$stamp")" = "$key" ]; then
    touch "$stamp"
    exit 0
fi

# The compiler first: it is needed last, after everything was fetched.
compiler=""
for candidate in "${CXX:-}" c++ g++ clang++; do
    if [ -n "$candidate" ] && command -v "${candidate%% *}" >/dev/null 2>&1; then
        compiler=$candidate
        break
    fi
done
[ -n "$compiler" ] || fail "no C++ compiler (looked at \$CXX, c++, g++, clang++);" \
    "on Debian: apt-get install g++"
python=$(tools/find_python.sh 2>&1) || fail "$python"

echo "Setting up .venv with $python and $compiler (some minutes: about 550 MB to fetch) ..."
log=build/setup.log
mkdir -p build
# A build folder remembers the interpreter of the old environment.
rm -rf .venv native/build
"$python" -m venv .venv >"$log" 2>&1 || fail "$python -m venv .venv; see $log"
.venv/bin/python -m pip install --disable-pip-version-check --no-deps --only-binary :all: \
    --require-hashes --requirement requirements.lock >>"$log" 2>&1 ||
    fail "the packages of requirements.lock could not be installed: $(grep -m 1 ERROR "$log" ||
        tail -n 1 "$log"); see $log"
# Blender's module needs a few libraries of the desktop even without a window.
missing=$(.venv/bin/python -c "import bpy" 2>&1) ||
    fail "Blender's module does not load: $(echo "$missing" | tail -n 1); on Debian: apt-get" \
        "install libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1"
echo "$key" >"$stamp"
