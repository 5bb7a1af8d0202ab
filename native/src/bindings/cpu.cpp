#include "volillum/cpu.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include "volillum/parallel.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

int set_threads(int count) {
    if (count < 0)
        throw nb::value_error(
            ("count is " + std::to_string(count) + "; expected at least 0").c_str());
    return volillum::default_threads.exchange(count);
}

void limit_instruction_set(const std::string &most) {
    using volillum::InstructionLevel;
    if (most == "x86-64-v4")
        volillum::limit_instructions(InstructionLevel::v4);
    else if (most == "x86-64-v3")
        volillum::limit_instructions(InstructionLevel::v3);
    else if (most == "baseline")
        volillum::limit_instructions(InstructionLevel::baseline);
    else
        throw nb::value_error(
            ("most is '" + most + "'; expected 'x86-64-v4', 'x86-64-v3' or 'baseline'").c_str());
}

}  // namespace

void bind_cpu(nb::module_ &module) {
    module.def("instruction_set", &volillum::instruction_set,
               "The vector instructions in use: 'x86-64-v4', 'x86-64-v3' or 'baseline'.");
    module.def(
        "limit_instruction_set", &limit_instruction_set, "most"_a,
        R"(Uses no better vector instructions than these from now on, for tests of the lesser ones.

For the whole process. Results differ in rounding only.)");
    module.def("set_threads", &set_threads, "count"_a,
               R"(Threads of every later call that is not given its own number; 0: all cores.

For the whole process. Returns the number before. Results are the same, bit for bit, for any.)");
}
