#include "volillum/cpu.h"

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

}  // namespace

InstructionLevel instruction_level() {
    static const InstructionLevel level = detect();
    return level;
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
