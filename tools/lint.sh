#!/bin/sh
# Style, types, formatting, and that no file names a path of the machine it was written on. All
# checks run; the last line counts the ones that failed.
failed=0

check() {
    name=$1
    shift
    if "$@"; then
        echo "$name: ok"
    else
        echo "$name: failed" >&2
        failed=$((failed + 1))
    fi
}

clang_format() {
    find native -name build -prune -o \( -name '*.h' -o -name '*.cpp' \) -print |
        xargs .venv/bin/clang-format --dry-run -Werror
}

# The [] keeps the pattern from finding itself.
machine_paths() {
    ! git grep -nIE '(^|[^[:alnum:]_./~-])/([r]oot|[w]ork|[t]mp/w)(/|[^[:alnum:]_]|$)' -- .
}

check "ruff" .venv/bin/ruff check --quiet .
check "ruff format" .venv/bin/ruff format --check --quiet .
check "mypy" .venv/bin/mypy --no-error-summary
check "clang-format" clang_format
if git rev-parse --git-dir >/dev/null 2>&1; then check "machine paths" machine_paths; fi

[ "$failed" -eq 0 ] || { echo "lint: $failed of the checks failed" >&2; exit 1; }
