// The Python module. Each file in bindings/ adds its functions; this one knows none of them.
#include <nanobind/nanobind.h>

#include "bindings.inc"

NB_MODULE(volillum_native, module) {
    module.doc() =
        "Illumination kernels of volillum. Arrays are C-contiguous, indexed [i, j, k] along the "
        "grid's own axes; lengths are in world units. Every kernel releases the GIL, polls its "
        "Control and gives the same result for any number of threads.";
    VOLILLUM_BIND_ALL(module)
}
