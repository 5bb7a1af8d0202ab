// Which vector instructions the run-time dispatch of this machine chooses.
#pragma once

#include <string>

// VOLILLUM_DISPATCH compiles a leaf kernel once per x86-64 level and lets the loader choose; a
// no-op elsewhere. VOLILLUM_TARGET is one such version (in_packs of pack.h chooses); where there
// are any, VOLILLUM_HAS_TARGETS is defined and a version may name its instructions. Helpers that a
// kernel calls must be inlined into it, hence VOLILLUM_INLINE, and VOLILLUM_LAMBDA behind the
// parameters of a lambda.
#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(VOLILLUM_NO_DISPATCH)
#define VOLILLUM_DISPATCH \
    __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#define VOLILLUM_TARGET(level) __attribute__((target(level)))
#define VOLILLUM_HAS_TARGETS
#else
#define VOLILLUM_DISPATCH
#define VOLILLUM_TARGET(level)
#endif
#define VOLILLUM_INLINE inline __attribute__((always_inline))
#define VOLILLUM_LAMBDA __attribute__((always_inline))

namespace volillum {

enum class InstructionLevel { baseline, v3, v4 };

// The best that this machine and this build have, unless it is limited.
InstructionLevel instruction_level();

// For kernels that in_packs chooses: the level is from now on at most this one. VOLILLUM_DISPATCH
// is decided when the library is loaded, and stays.
void limit_instructions(InstructionLevel most);

// "x86-64-v4", "x86-64-v3" or "baseline".
std::string instruction_set();

}  // namespace volillum
