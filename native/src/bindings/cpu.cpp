#include "volillum/cpu.h"

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

namespace nb = nanobind;

void bind_cpu(nb::module_ &module) {
    module.def("instruction_set", &volillum::instruction_set,
               "The vector instructions in use: 'x86-64-v4', 'x86-64-v3' or 'baseline'.");
}
