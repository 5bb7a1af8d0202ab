#include "volillum/cone_weights.h"

#include "ray_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using namespace volillum::bindings;

namespace {

using FloatOut = nb::ndarray<nb::numpy, float>;

FloatOut weights_of(const DoubleArray &axes, const DoubleArray &local,
                    const DoubleArray &local_weights, double spacing, std::int64_t first_u,
                    std::int64_t first_v, std::int64_t size_u, std::int64_t size_v, int threads,
                    Control *control) {
    const std::size_t axis_count = rows_of_three(axes, "axes");
    const std::size_t count = rows_of_three(local, "local");
    if (shape_of(local_weights) != std::vector<std::size_t>{count})
        fail("local_weights has shape " + shape_text(shape_of(local_weights)) +
             "; expected one for each of the " + std::to_string(count) + " directions");
    if (!(spacing > 0.0)) fail("spacing is " + std::to_string(spacing) + "; expected more than 0");
    if (size_u < 4 || size_v < 4)
        fail("the lattice has " + std::to_string(size_u) + " x " + std::to_string(size_v) +
             " nodes; expected at least 4 x 4");
    const std::size_t shape[2] = {std::size_t(size_u * size_v), axis_count};
    float *data = new float[shape[0] * shape[1]];
    nb::capsule owner(data, [](void *memory) noexcept { delete[] static_cast<float *>(memory); });
    {
        const nb::gil_scoped_release release;
        cone_weights({spacing, first_u, first_v, size_u, size_v}, axes.data(), axis_count,
                     local.data(), local_weights.data(), count, threads, control, data);
    }
    return FloatOut(data, 2, shape, owner);
}

}  // namespace

void bind_cone_weights(nb::module_ &module) {
    module.def("cone_weights", &weights_of, "axes"_a, "local"_a, "local_weights"_a, nb::kw_only(),
               "spacing"_a, "first_u"_a, "first_v"_a, "size_u"_a, "size_v"_a, "threads"_a = 0,
               "control"_a = nb::none(),
               R"(Weights of a lattice of directions for cones about many axes.

The lattice is square in Lambert's equal-area map about +z: node (a, b) sits at
(first_u + a, first_v + b) * spacing. Each cone's sub-directions are spread over it by Catmull-Rom
cubics, which integrates the lattice's cubic interpolant over the cone.

axes: float64 [n, 3], unit vectors in the map's frame.
local, local_weights: float64 [s, 3] and [s], a rule for the cone about +z.
Returns float32 [size_u * size_v, n]; each column sums to the sum of local_weights.
Raises ValueError for wrong shapes or an empty lattice.)");
}
