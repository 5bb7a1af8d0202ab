#!/bin/sh
# Runs tests of the native core under sanitizers: tools/sanitize.sh [address,undefined] [thread],
# each with its own build in build/sanitize/. The first report ends a run, and it has failed. Other
# tests than the kernels' own, or arguments of pytest, come in ARGS.
set -eu

compiler=${CXX:-c++}
[ $# -gt 0 ] || set -- address,undefined thread
# Leaks of the interpreter are not ours. Tests ask for more memory than there is, which is to fail as
# it does without a sanitizer. What a kernel needs of memory is not measured: a sanitizer keeps what
# is freed.
export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1
export UBSAN_OPTIONS=print_stacktrace=1
export TSAN_OPTIONS=halt_on_error=1:allocator_may_return_null=1

library() {
    "$compiler" -print-file-name="$1"
}

summary=""
failed=0
for sanitizers; do
    folder="sanitize/$sanitizers"
    tools/build_variant.sh "$folder" -DVOLILLUM_SANITIZE="$sanitizers" -DCMAKE_CXX_COMPILER="$compiler"
    case "$sanitizers" in
    *thread*) preload=$(library libtsan.so) ;;
    *) preload="$(library libasan.so) $(library libubsan.so)" ;;
    esac
    # The C++ runtime too: a sanitizer that starts before it does not find its exceptions. Without
    # random addresses: a thread sanitizer's own have no place among them on every kernel. pytest
    # must not keep what a report writes before it ends the process.
    # shellcheck disable=SC2086
    if LD_PRELOAD="$preload $(library libstdc++.so)" PYTHONPATH="build/$folder" \
        setarch --addr-no-randomize .venv/bin/python -m pytest -q --capture=sys \
            --ignore=tests/native/test_sweep_memory.py ${ARGS:-tests/native}; then
        summary="$summary
$sanitizers: nothing found"
    else
        summary="$summary
$sanitizers: FAILED"
        failed=1
    fi
done
echo "$summary"
exit "$failed"
