// Which vector instructions the run-time dispatch of this machine chooses.
#pragma once

#include <string>

// Compiles a leaf kernel once per x86-64 level and lets the loader choose; a no-op elsewhere.
// Helpers that such a kernel calls must be inlined into it, hence VOLILLUM_INLINE.
#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(VOLILLUM_NO_DISPATCH)
#define VOLILLUM_DISPATCH \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define VOLILLUM_DISPATCH
#endif
#define VOLILLUM_INLINE inline __attribute__((always_inline))

namespace volillum {

// "x86-64-v4", "x86-64-v3" or "baseline".
std::string instruction_set();

}  // namespace volillum
