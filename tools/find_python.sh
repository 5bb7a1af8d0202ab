#!/bin/sh
# Prints the path of a CPython 3.13 that can build the environment, or one line that says what was
# tried and why it did not do. A candidate must really run: a pyenv shim can exist and refuse.
check='
import importlib.util, os, sys, sysconfig
if sys.implementation.name != "cpython" or sys.version_info[:2] != (3, 13):
    print("is", sys.implementation.name, "%d.%d" % sys.version_info[:2])
elif not all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")):
    print("lacks venv or ensurepip, on Debian the package python3.13-venv")
elif not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    print("lacks Python.h, on Debian the package python3.13-dev")
else:
    print("ok", sys.executable)
'
tried=""

try() {
    [ -n "$1" ] || return 0
    answer=$("$1" -I -c "$check" 2>/dev/null) || answer="does not run"
    case $answer in
        "ok "*) echo "${answer#ok }"; exit 0 ;;
        *) tried="$tried; $1 $answer" ;;
    esac
}

try "${PYTHON:-}"
for found in $(which -a python3.13 2>/dev/null); do try "$found"; done
for found in "$HOME"/.pyenv/versions/3.13*/bin/python3.13; do
    if [ -x "$found" ]; then try "$found"; fi
done
for uv in uv "$HOME/.local/bin/uv" "$HOME/.cargo/bin/uv"; do
    if command -v "$uv" >/dev/null 2>&1; then try "$("$uv" python find 3.13 2>/dev/null)"; fi
done

echo "no usable CPython 3.13 (looked at \$PYTHON, python3.13 on PATH, ~/.pyenv/versions," \
    "uv python find 3.13)$tried; install one (uv python install 3.13, pyenv install 3.13, or on" \
    "Debian python3.13-venv and python3.13-dev) or name it: make PYTHON=/path/to/python3.13" >&2
exit 1
