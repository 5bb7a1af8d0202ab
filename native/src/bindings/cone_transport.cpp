#include "volillum/cone_transport.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <climits>
#include <optional>

#include "arrays.h"

namespace nb = nanobind;
using namespace nb::literals;
using volillum::AnyArray;
using volillum::Control;
using volillum::Real;
using volillum::require;

namespace {

using Result = nb::ndarray<nb::numpy, Real, nb::ndim<4>>;

Result cone_transport(const AnyArray &sigma_t, const AnyArray &sigma_s,
                      const AnyArray &index_to_world, const AnyArray &axis,
                      const AnyArray &directions, const AnyArray &weights,
                      const std::optional<AnyArray> &transmittance, int node_spacing,
                      const std::optional<AnyArray> &lamp, double spacing, int threads,
                      Control *control, const nb::object &out_or_none) {
    volillum::ConeTransportScene scene{};
    const char *axes = "[1 or 3, nx, ny, nz]";
    scene.sigma_t = require<Real>(sigma_t, "sigma_t", axes, {-1, -1, -1, -1});
    scene.sigma_s = require<Real>(sigma_s, "sigma_s", "[1 or 3, nx, ny, nz] of sigma_t's lattice",
                                  {-1, std::int64_t(sigma_t.shape(1)),
                                   std::int64_t(sigma_t.shape(2)), std::int64_t(sigma_t.shape(3))});
    std::size_t voxels = 1, channels = 1;
    for (const AnyArray *array : {&sigma_t, &sigma_s}) {
        if (array->shape(0) != 1 && array->shape(0) != 3)
            throw nb::value_error(
                ((array == &sigma_t ? "sigma_t has shape " : "sigma_s has shape ") +
                 volillum::shape_text(*array) + "; expected " + axes)
                    .c_str());
        channels = std::max(channels, array->shape(0));
    }
    scene.extinctions = int(sigma_t.shape(0));
    scene.scatterings = int(sigma_s.shape(0));
    for (std::size_t i = 0; i < 3; ++i) {
        if (sigma_t.shape(i + 1) > INT_MAX / 8)
            throw nb::value_error(("sigma_t has shape " + volillum::shape_text(sigma_t) +
                                   "; expected sides below " + std::to_string(INT_MAX / 8))
                                      .c_str());
        scene.shape[i] = int(sigma_t.shape(i + 1));
        voxels *= sigma_t.shape(i + 1);
    }
    if (voxels > INT_MAX)
        throw nb::value_error(("sigma_t has shape " + volillum::shape_text(sigma_t) +
                               "; expected at most " + std::to_string(INT_MAX) + " voxels")
                                  .c_str());
    scene.index_to_world = require<double>(index_to_world, "index_to_world", "[4, 4]", {4, 4});
    const double *toward = require<double>(axis, "axis", "[3]", {3});
    scene.axis = {toward[0], toward[1], toward[2]};
    scene.directions = require<double>(directions, "directions", "[d, 3] with d >= 1", {-1, 3});
    if (directions.shape(0) > 1000000)
        throw nb::value_error("directions holds more than 1000000 directions");
    scene.count = int(directions.shape(0));
    if (weights.ndim() == 4) {
        scene.local_weights = require<Real>(weights, "weights", "[d, m0, m1, m2] at nodes",
                                            {scene.count, -1, -1, -1});
        if (!(node_spacing >= 1))
            throw nb::value_error(
                ("node_spacing is " + std::to_string(node_spacing) + "; expected at least 1 voxel")
                    .c_str());
        scene.node_spacing = node_spacing;
        for (std::size_t i = 0; i < 3; ++i) {
            scene.nodes[i] = int(weights.shape(i + 1));
            if ((std::int64_t(scene.nodes[i]) - 1) * node_spacing < scene.shape[i] - 1)
                throw nb::value_error(("weights has shape " + volillum::shape_text(weights) +
                                       "; expected nodes every " + std::to_string(node_spacing) +
                                       " voxels up to the last")
                                          .c_str());
        }
    } else {
        scene.weights = require<double>(weights, "weights", "[d], one per direction, or at nodes",
                                        {scene.count});
    }
    if (lamp) scene.lamp = require<double>(*lamp, "lamp", "[3]", {3});

    if (transmittance)
        scene.transmittance =
            require<Real>(*transmittance, "transmittance", "sigma_t's shape",
                          {std::int64_t(sigma_t.shape(0)), std::int64_t(sigma_t.shape(1)),
                           std::int64_t(sigma_t.shape(2)), std::int64_t(sigma_t.shape(3))});

    const auto [out, data] = volillum::output(
        out_or_none, {std::int64_t(channels), scene.shape[0], scene.shape[1], scene.shape[2]});
    volillum::refuse_shared(data, channels * voxels, sigma_t, "sigma_t");
    volillum::refuse_shared(data, channels * voxels, sigma_s, "sigma_s");
    // A voxel's transmittance is read before any of its channels is written.
    if (transmittance && data != scene.transmittance)
        volillum::refuse_shared(data, channels * voxels, *transmittance, "transmittance");
    {
        const nb::gil_scoped_release release;
        volillum::cone_transport(scene, {spacing, threads, control}, data);
    }
    return nb::cast<Result>(out);
}

constexpr const char *cone_transport_doc =
    R"(Light that is scattered again and again into one cone about the direction to the light.

Solves, for each channel,
L_i(x) = sum_d weights[d] [T(x, infinity) + integral T(x, y) sigma_s(y) L_i(y) ds] along the
rays y = x + s directions[d] through the trilinear interpolants of sigma_t and sigma_s (zero
outside), in units of the light's own radiance: 1 where nothing occludes. Light moves only away
from its source, so one march through a lattice in the light's frame solves it, to second
order in the voxel size; with sigma_s = sigma_t it is 1 everywhere to rounding.

sigma_t, sigma_s: float32 [1 or 3, nx, ny, nz] per world unit, C-contiguous, finite, not
negative, sigma_s at most sigma_t. One channel counts for all.
index_to_world: float64 [4, 4]; any invertible affine.
axis: float64 [3], unit vector toward the light.
directions: float64 [d, 3], unit vectors outward; cosine to the axis at least 0.001.
weights: float64 [d], not negative, sum 1. Or float32 [d, m0, m1, m2], at nodes every
`node_spacing` voxels from the first on: the cones of a lamp turn from place to place.
lamp: None, or float64 [3]: rays end where they are nearest to this place.
transmittance: None, or float32 of sigma_t's shape: sum_d weights[d] T(x, infinity) from the
`sweep`, which is better at hard surfaces than the light's lattice. The light that is lost,
1 - L_i, is then taken in proportion to 1 - transmittance; with sigma_s = 0 it is returned.
spacing: of the light's lattice, in voxels; time and memory grow with its inverse cube.
threads: 0: all cores. The result is the same, bit for bit, for any number.
control: cancels (raises Cancelled) and tells the progress.
out: an array to write to instead of a new one; may begin with `transmittance` itself, which is then
lost.
Returns float32 [1 or 3, nx, ny, nz].
Raises ValueError for wrong shapes, a singular affine, or a rule that does not fit; TypeError for
wrong types.)";

}  // namespace

void bind_cone_transport(nb::module_ &module) {
    module.def("cone_transport", &cone_transport, "sigma_t"_a, "sigma_s"_a, "index_to_world"_a,
               "axis"_a, "directions"_a, "weights"_a, nb::kw_only(), "transmittance"_a = nb::none(),
               "node_spacing"_a = 1, "lamp"_a = nb::none(), "spacing"_a = 1.0, "threads"_a = 0,
               "control"_a = nb::none(), "out"_a = nb::none(), cone_transport_doc);
}
