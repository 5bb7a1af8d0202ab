#include "volillum/radiance_sweep.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <climits>
#include <memory>

#include "arrays.h"

namespace nb = nanobind;
using namespace nb::literals;
using volillum::AnyArray;
using volillum::Control;
using volillum::RadianceScene;
using volillum::RadianceSettings;
using volillum::Real;
using volillum::require;
using volillum::Source;
using volillum::SweepScene;
using volillum::SweepSettings;
using volillum::UniformColour;
using volillum::Vec3d;

namespace {

using Result = nb::ndarray<nb::numpy, Real, nb::ndim<4>>;

// The last three sides of sigma_t.
volillum::Index3 read_shape(const AnyArray &sigma_t) {
    volillum::Index3 shape;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t size = sigma_t.shape(sigma_t.ndim() - 3 + axis);
        // Rows and columns of sheared lattices are counted in int.
        if (size > INT_MAX / 8)
            throw nb::value_error(("sigma_t has shape " + volillum::shape_text(sigma_t) +
                                   "; expected sides below " + std::to_string(INT_MAX / 8))
                                      .c_str());
        shape[axis] = int(size);
    }
    return shape;
}

// index_to_world, directions and their number.
template <class Scene>
void read_directions(const AnyArray &index_to_world, const AnyArray &directions, Scene &scene) {
    scene.index_to_world = require<double>(index_to_world, "index_to_world", "[4, 4]", {4, 4});
    scene.directions = require<double>(directions, "directions", "[d, 3] with d >= 1", {-1, 3});
    if (directions.shape(0) > 1000000)
        throw nb::value_error("directions holds more than 1000000 directions");
    scene.count = int(directions.shape(0));
}

Vec3d read_rgb(const AnyArray &array, const char *name) {
    const double *rgb = require<double>(array, name, "[3]", {3});
    return {rgb[0], rgb[1], rgb[2]};
}

// What `fill` writes to [3, shape], computed without the interpreter's lock.
template <class Fill>
Result three_channels(const volillum::Index3 &shape, Fill &&fill) {
    const std::size_t size[3] = {std::size_t(shape[0]), std::size_t(shape[1]),
                                 std::size_t(shape[2])};
    auto data = std::make_unique_for_overwrite<Real[]>(3 * size[0] * size[1] * size[2]);
    {
        const nb::gil_scoped_release release;
        fill(data.get());
    }
    Real *values = data.release();
    const nb::capsule owner(values, [](void *p) noexcept { delete[] static_cast<Real *>(p); });
    return Result(values, {3, size[0], size[1], size[2]}, owner);
}

// A field of 1 or 3 channels and, unless that is white, its colour.
Source read_source(const AnyArray &values, const volillum::Index3 &shape, const char *name,
                   const std::optional<AnyArray> &colour, const char *colour_name) {
    Source source;
    const char *expected = "[1 or 3, nx, ny, nz], sigma_t's lattice";
    source.values = require<Real>(values, name, expected, {-1, shape[0], shape[1], shape[2]});
    if (values.shape(0) != 1 && values.shape(0) != 3)
        throw nb::value_error((std::string(name) + " has shape " + volillum::shape_text(values) +
                               "; expected " + expected)
                                  .c_str());
    source.channels = int(values.shape(0));
    if (colour) source.colour = read_rgb(*colour, colour_name);
    return source;
}

Result mean_hue(const AnyArray &sigma_t, const AnyArray &source, const AnyArray &index_to_world,
                const AnyArray &directions, const AnyArray &weights, const AnyArray &hue,
                const std::optional<AnyArray> &colour, const std::optional<AnyArray> &emission,
                const std::optional<AnyArray> &emission_colour, int node_spacing, int near_slices,
                int threads, Control *control) {
    RadianceScene scene;
    scene.sigma_t = require<Real>(sigma_t, "sigma_t", "[1 or 3, nx, ny, nz]", {-1, -1, -1, -1});
    if (sigma_t.shape(0) != 1 && sigma_t.shape(0) != 3)
        throw nb::value_error(("sigma_t has shape " + volillum::shape_text(sigma_t) +
                               "; expected 1 or 3 channels [c, nx, ny, nz]")
                                  .c_str());
    scene.extinction_channels = int(sigma_t.shape(0));
    scene.shape = read_shape(sigma_t);
    scene.scattered = read_source(source, scene.shape, "source", colour, "colour");
    if (emission)
        scene.emitted =
            read_source(*emission, scene.shape, "emission", emission_colour, "emission_colour");
    read_directions(index_to_world, directions, scene);
    const Real *weight = nullptr;
    if (node_spacing < 0)
        throw nb::value_error(("node_spacing is " + std::to_string(node_spacing) +
                               "; expected 1 or more voxels, or 0 for even weights")
                                  .c_str());
    if (node_spacing == 0) {
        weight = require<Real>(weights, "weights", "[d], one for each direction", {scene.count});
    } else {
        std::int64_t nodes[3];
        for (std::size_t axis = 0; axis < 3; ++axis)
            nodes[axis] = volillum::weight_nodes(scene.shape[axis], node_spacing);
        weight = require<Real>(weights, "weights", "[d, gi, gj, gk] at the nodes",
                               {scene.count, nodes[0], nodes[1], nodes[2]});
    }
    scene.hue = read_rgb(hue, "hue");
    const RadianceSettings settings{near_slices, threads, control};
    return three_channels(scene.shape, [&](Real *out) {
        volillum::mean_hue(scene, weight, node_spacing, settings, out);
    });
}

Result mean_hue_uniform(const AnyArray &sigma_t, const AnyArray &index_to_world,
                        const AnyArray &directions, const AnyArray &weights, const AnyArray &hue,
                        const AnyArray &extinction, const AnyArray &source_function,
                        int near_slices, int threads, Control *control) {
    SweepScene scene;
    scene.sigma_t = require<Real>(sigma_t, "sigma_t", "[nx, ny, nz]", {-1, -1, -1});
    scene.shape = read_shape(sigma_t);
    read_directions(index_to_world, directions, scene);
    const Real *weight =
        require<Real>(weights, "weights", "[d], one for each direction", {scene.count});
    const UniformColour colour{read_rgb(hue, "hue"), read_rgb(extinction, "extinction"),
                               read_rgb(source_function, "source_function")};
    SweepSettings settings;
    settings.near_slices = near_slices;
    settings.threads = threads;
    settings.control = control;
    return three_channels(scene.shape, [&](Real *out) {
        volillum::mean_hue_uniform(scene, colour, weight, settings, out);
    });
}

constexpr const char *mean_hue_doc =
    R"(Mean over directions of the hue of the radiance that arrives at every voxel.

out[c] = sum_d weights[d] L_c / Y(L), Y = 0.2126 L_r + 0.7152 L_g + 0.0722 L_b,
L_c(x, w) = hue_c exp(-od_c) + int exp(-od_c(s)) source_c ds along the ray from x to the border;
where Y(L) is below 1e-6, the light's hue stands for L / Y(L). The medium is the trilinear
interpolant of sigma_t and source, zero outside.

Radiance is carried along a lattice of rays, sheared to each direction, and interpolated once
(second order); through the first `near_slices` slices it is carried along the voxel's own ray, from
cell to cell.

sigma_t, source: float32 [1 or 3, nx, ny, nz] per world unit; the source is radiance in units of the
light's luminance. C-contiguous, finite, not negative.
index_to_world: float64 [4, 4]; any invertible affine; only its linear part matters.
directions: float64 [d, 3], unit vectors in world space, from the voxel outward.
weights: float32 [d]; or, with a node_spacing, [d, gi, gj, gk] at nodes every so many voxels, linear
between them, as in sweep_weighted.
hue: float64 [3], the light's radiance over its luminance.
colour: None, or float64 [3]: the source's values are times this.
emission, emission_colour: None, or another source that is added, and its colour.
threads: 0: all cores. The result is the same, bit for bit, for any number.
control: cancels (raises Cancelled) and tells the progress.
Returns float32 [3, nx, ny, nz].
Raises ValueError for wrong shapes, a singular affine, directions that are not of unit length
to 1e-6, or settings out of range; TypeError for wrong types.)";

constexpr const char *mean_hue_uniform_doc =
    R"(mean_hue in a medium of one colour, many times as fast: only optical depth is swept.

Its extinctions are `extinction` times sigma_t and its source function source_c / extinction_c is
the same everywhere, so L_c = hue_c T_c + source_function_c (1 - T_c) with T_c = exp(-extinction_c
od), od as in sweep. Through the first `near_slices` slices od is exact.

sigma_t: float32 [nx, ny, nz], C-contiguous, finite, not negative.
extinction: float64 [3], not negative.
source_function: float64 [3], not negative, in units of the light's luminance.
The other arguments, result and errors as in mean_hue.)";

}  // namespace

void bind_radiance_sweep(nb::module_ &module) {
    module.def("mean_hue", &mean_hue, "sigma_t"_a, "source"_a, "index_to_world"_a, "directions"_a,
               "weights"_a, "hue"_a, nb::kw_only(), "colour"_a = nb::none(),
               "emission"_a = nb::none(), "emission_colour"_a = nb::none(), "node_spacing"_a = 0,
               "near_slices"_a = 4, "threads"_a = 0, "control"_a = nb::none(), mean_hue_doc);
    module.def("mean_hue_uniform", &mean_hue_uniform, "sigma_t"_a, "index_to_world"_a,
               "directions"_a, "weights"_a, "hue"_a, "extinction"_a, "source_function"_a,
               nb::kw_only(), "near_slices"_a = 4, "threads"_a = 0, "control"_a = nb::none(),
               mean_hue_uniform_doc);
}
