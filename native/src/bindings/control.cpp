#include "volillum/control.h"

#include <nanobind/nanobind.h>

namespace nb = nanobind;
using volillum::Control;

void bind_control(nb::module_ &module) {
    nb::class_<Control>(module, "Control",
                        "Cancels a running kernel and tells how far it is; safe from any thread.")
        .def(nb::init<>())
        .def("cancel", &Control::cancel, "Ask the running kernel to stop; it raises Cancelled.")
        .def("restart_progress", &Control::restart_progress,
             "Set the progress to 0 for the next kernel of the same work.")
        .def_prop_ro("cancelled", &Control::cancelled, "Whether a stop was asked for.")
        .def_prop_ro("progress", &Control::progress, "Fraction of the running kernel, 0 to 1.");
    nb::exception<volillum::Cancelled>(module, "Cancelled");
}
