#include "volillum/sweep.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <array>
#include <climits>
#include <functional>
#include <limits>
#include <optional>

#include "arrays.h"

namespace nb = nanobind;
using namespace nb::literals;
using volillum::AnyArray;
using volillum::Control;
using volillum::Index3;
using volillum::Quantity;
using volillum::Real;
using volillum::require;
using volillum::SweepScene;
using volillum::SweepSettings;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

bool is_real_array(nb::handle handle) {
    return nb::isinstance<nb::ndarray<Real>>(handle);
}

// An array that numpy made; the signature says of what.
struct RealArray : nb::object {
    NB_OBJECT_DEFAULT(RealArray, nb::object, "numpy.typing.NDArray[numpy.float32]", is_real_array)
};

SweepScene read_scene(const AnyArray &sigma_t, const AnyArray &index_to_world,
                      const AnyArray &directions) {
    SweepScene scene;
    scene.sigma_t = require<Real>(sigma_t, "sigma_t", "[nx, ny, nz]", {-1, -1, -1});
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Slices, rows and columns are counted in int, with room for a ray's lateral reach.
        if (sigma_t.shape(axis) > INT_MAX / 8)
            throw nb::value_error(("sigma_t has shape " + volillum::shape_text(sigma_t) +
                                   "; expected sides below " + std::to_string(INT_MAX / 8))
                                      .c_str());
        scene.shape[axis] = int(sigma_t.shape(axis));
    }
    scene.index_to_world = require<double>(index_to_world, "index_to_world", "[4, 4]", {4, 4});
    scene.directions = require<double>(directions, "directions", "[d, 3] with d >= 1", {-1, 3});
    if (directions.shape(0) > 1000000)
        throw nb::value_error("directions holds more than 1000000 directions");
    scene.count = int(directions.shape(0));
    return scene;
}

// Two corners of a box of voxels, or none for all of them.
using Wanted = std::optional<std::array<std::array<int, 3>, 2>>;

void set_wanted(SweepSettings &settings, const Wanted &wanted) {
    if (!wanted) return;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        settings.wanted_begin[axis] = (*wanted)[0][axis];
        settings.wanted_end[axis] = (*wanted)[1][axis];
    }
}

Quantity read_quantity(const std::string &name) {
    if (name == "transmittance") return Quantity::transmittance;
    if (name == "optical_depth") return Quantity::optical_depth;
    throw nb::value_error(
        ("quantity is '" + name + "'; expected 'transmittance' or 'optical_depth'").c_str());
}

struct Output {
    RealArray array;
    Real *data;
    std::ptrdiff_t pitch;  // from one of the first axis to the next
};

Output output(const nb::object &out, const AnyArray &sigma_t,
              std::initializer_list<std::int64_t> shape, bool zeros, bool apart = false) {
    const auto [array, data] = volillum::output(out, shape, zeros, apart);
    std::int64_t inner = 1;
    for (const std::int64_t *side = shape.begin() + 1; side != shape.end(); ++side) inner *= *side;
    const std::int64_t count = *shape.begin();
    // A lone one may have any stride.
    const std::int64_t pitch = count > 1 ? nb::cast<AnyArray>(array).stride(0) : inner;
    volillum::refuse_shared(data, std::size_t((count - 1) * pitch + inner), sigma_t, "sigma_t");
    return {nb::borrow<RealArray>(array), data, pitch};
}

void refuse_adding_to_none(const nb::object &out, bool add) {
    if (add && out.is_none()) throw nb::value_error("out is None; expected an array to add to");
}

RealArray sweep(const AnyArray &sigma_t, const AnyArray &index_to_world, const AnyArray &directions,
                const AnyArray &weights, double radius, int near_slices,
                const std::string &quantity, const Wanted &wanted, int threads, Control *control,
                const nb::object &out_or_none, bool add) {
    refuse_adding_to_none(out_or_none, add);
    const SweepScene scene = read_scene(sigma_t, index_to_world, directions);
    const Real *weight =
        require<Real>(weights, "weights", "[d, c], one row per direction", {scene.count, -1});
    SweepSettings settings{.radius = radius,
                           .near_slices = near_slices,
                           .quantity = read_quantity(quantity),
                           .threads = threads,
                           .control = control,
                           .add = add};
    set_wanted(settings, wanted);
    const int channels = int(weights.shape(1));
    const Output out =
        output(out_or_none, sigma_t, {channels, scene.shape[0], scene.shape[1], scene.shape[2]},
               wanted.has_value(), true);
    settings.channel_pitch = out.pitch;
    {
        const nb::gil_scoped_release release;
        volillum::sweep(scene, weight, channels, settings, out.data);
    }
    return out.array;
}

RealArray sweep_weighted(const AnyArray &sigma_t, const AnyArray &index_to_world,
                         const AnyArray &directions, const AnyArray &weights, int spacing,
                         double radius, int near_slices, const Wanted &wanted, int threads,
                         Control *control, const nb::object &out_or_none, bool add) {
    refuse_adding_to_none(out_or_none, add);
    const SweepScene scene = read_scene(sigma_t, index_to_world, directions);
    if (spacing < 1)
        throw nb::value_error(
            ("spacing is " + std::to_string(spacing) + "; expected 1 or more voxels").c_str());
    std::int64_t nodes[3];
    for (int axis = 0; axis < 3; ++axis)
        nodes[axis] = volillum::weight_nodes(scene.shape[axis], spacing);
    const std::string axes = "[d, gi, gj, gk] = (" + std::to_string(scene.count) + ", " +
                             std::to_string(nodes[0]) + ", " + std::to_string(nodes[1]) + ", " +
                             std::to_string(nodes[2]) + ")";
    const Real *weight = require<Real>(weights, "weights", axes.c_str(),
                                       {scene.count, nodes[0], nodes[1], nodes[2]});
    SweepSettings settings{.radius = radius,
                           .near_slices = near_slices,
                           .threads = threads,
                           .control = control,
                           .add = add};
    set_wanted(settings, wanted);
    const Output out = output(out_or_none, sigma_t,
                              {scene.shape[0], scene.shape[1], scene.shape[2]}, wanted.has_value());
    {
        const nb::gil_scoped_release release;
        volillum::sweep_weighted(scene, weight, spacing, settings, out.data);
    }
    return out.array;
}

constexpr const char *sweep_doc =
    R"(Weighted sums over directions of the transmittance or optical depth from every voxel.

out[c] = sum_d weights[d, c] Q(x, directions[d]), where Q is exp(-od) or od, and od is the
integral of sigma_t along the ray from the voxel's centre to the border of the grid, or for
`radius` world units. sigma_t is the trilinear interpolant of its voxels, zero outside: it
falls to zero over one voxel beyond the border voxels.

Optical depth is summed along a lattice of rays, sheared to each direction, and interpolated
once (second order); the first `near_slices` slices from each voxel along the direction's
major index axis are integrated exactly. With as many near slices as the grid has, all is
exact, at a price. Opposite directions keep sums of their own: none is a difference.

sigma_t: float32 [nx, ny, nz] per world unit, C-contiguous, finite, not negative.
index_to_world: float64 [4, 4]; any invertible affine; only its linear part matters.
directions: float64 [d, 3], unit vectors in world space, from the voxel outward.
weights: float32 [d, c].
radius: world units; inf: to the border.
quantity: 'transmittance' or 'optical_depth'.
wanted: two corners of the box [begin, end) of voxels whose sums are wanted, None: all; the others
stay as they are in `out`, 0 in a new array, and cost next to nothing.
threads: 0: all cores. The result is the same, bit for bit, for any number.
control: cancels (raises Cancelled) and tells the progress.
out: an array to write to instead of a new one; the system takes as long to give new pages as
the sweep takes to fill them. Its channels may lie apart in memory.
add: adds to what `out` holds.
Returns float32 [c, nx, ny, nz].
Raises ValueError for wrong shapes, a singular affine, directions that are not of unit length
to 1e-6, or settings out of range; TypeError for wrong types.)";

constexpr const char *sweep_weighted_doc =
    R"(Like sweep, one channel of transmittance, with weights that vary from voxel to voxel.

out = sum_d w_d(x) exp(-od(x, directions[d])); w_d is the trilinear interpolant of
weights[d, a, b, c], which stand at the voxels (a, b, c) * spacing, with
ceil((n - 1) / spacing) + 1 nodes along an axis of n voxels. A direction costs next to nothing
in tiles where its weights are zero and through which none of its rays reach others.

weights: float32 [d, gi, gj, gk]; the other arguments as in sweep.
Returns float32 [nx, ny, nz].)";

}  // namespace

void bind_sweep(nb::module_ &module) {
    module.def("sweep", &sweep, "sigma_t"_a, "index_to_world"_a, "directions"_a, "weights"_a,
               nb::kw_only(), "radius"_a = infinity, "near_slices"_a = 4,
               "quantity"_a = "transmittance", "wanted"_a = nb::none(), "threads"_a = 0,
               "control"_a = nb::none(), "out"_a = nb::none(), "add"_a = false, sweep_doc);
    module.def("sweep_weighted", &sweep_weighted, "sigma_t"_a, "index_to_world"_a, "directions"_a,
               "weights"_a, "spacing"_a, nb::kw_only(), "radius"_a = infinity, "near_slices"_a = 4,
               "wanted"_a = nb::none(), "threads"_a = 0, "control"_a = nb::none(),
               "out"_a = nb::none(), "add"_a = false, sweep_weighted_doc);
}
