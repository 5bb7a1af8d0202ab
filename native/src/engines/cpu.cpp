#include "volillum/cpu.h"

#include <algorithm>
#include <atomic>

namespace volillum {
namespace {

InstructionLevel detect() {
#if defined(__x86_64__) && defined(__GNUC__) && !defined(VOLILLUM_NO_DISPATCH)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("x86-64-v4")) return InstructionLevel::v4;
    if (__builtin_cpu_supports("x86-64-v3")) return InstructionLevel::v3;
#endif
    return InstructionLevel::baseline;
}

std::atomic<InstructionLevel> limit{InstructionLevel::v4};

}  // namespace

InstructionLevel instruction_level() {
    static const InstructionLevel level = detect();
    return std::min(level, limit.load(std::memory_order_relaxed));
}

void limit_instructions(InstructionLevel most) {
    limit.store(most, std::memory_order_relaxed);
}

std::string instruction_set() {
    switch (instruction_level()) {
        case InstructionLevel::v4:
            return "x86-64-v4";
        case InstructionLevel::v3:
            return "x86-64-v3";
        default:
            return "baseline";
    }
}

}  // namespace volillum
