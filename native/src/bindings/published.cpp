#include "volillum/published.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "arrays.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using published::Buffer;

namespace {

using FloatOut = nb::ndarray<nb::numpy, float>;

[[noreturn]] void refuse(const std::string &message) {
    throw nb::value_error(message.c_str());
}

Buffer read_buffer(const std::string &name) {
    if (name == "float") return Buffer::full;
    if (name == "half") return Buffer::half;
    if (name == "byte") return Buffer::byte;
    refuse("buffer is '" + name + "'; expected float, half or byte");
}

Vec3d read_vector(const AnyArray &array, const char *name) {
    const double *values = require<double>(array, name, "[3]", {3});
    return {values[0], values[1], values[2]};
}

published::Volume read_volume(const AnyArray &sigma_t, const std::optional<AnyArray> &sigma_s,
                              const AnyArray &index_to_world) {
    published::Volume volume;
    volume.sigma_t = require<float>(sigma_t, "sigma_t", "[c, nx, ny, nz]", {-1, -1, -1, -1});
    for (std::size_t a = 0; a < 3; ++a) volume.shape[a] = int(sigma_t.shape(a + 1));
    volume.channels = int(sigma_t.shape(0));
    volume.sigma_s =
        sigma_s
            ? require<float>(*sigma_s, "sigma_s", "of sigma_t's shape",
                             {volume.channels, volume.shape[0], volume.shape[1], volume.shape[2]})
            : nullptr;
    volume.index_to_world = require<double>(index_to_world, "index_to_world", "[4, 4]", {4, 4});
    return volume;
}

// A new array [planes][nx][ny][nz] filled by `work`, without the interpreter's lock.
template <class Work>
FloatOut filled(std::size_t planes, const Index3 &n, Work &&work) {
    const std::size_t shape[4] = {planes, std::size_t(n[0]), std::size_t(n[1]), std::size_t(n[2])};
    std::unique_ptr<float[]> data(new float[shape[0] * shape[1] * shape[2] * shape[3]]);
    {
        const nb::gil_scoped_release release;
        work(data.get());
    }
    nb::capsule owner(data.get(), [](void *p) noexcept { delete[] static_cast<float *>(p); });
    return FloatOut(data.release(), 4, shape, owner);
}

FloatOut blurred_slices(const AnyArray &sigma_t, const AnyArray &index_to_world,
                        const AnyArray &toward, const std::optional<AnyArray> &sigma_s,
                        const std::optional<AnyArray> &eye, double distance, double pixel,
                        double theta, int taps, const std::string &buffer, int threads,
                        Control *control) {
    const published::Volume volume = read_volume(sigma_t, sigma_s, index_to_world);
    const published::Slices slices{read_vector(toward, "toward"),
                                   eye ? require<double>(*eye, "eye", "[3]", {3}) : nullptr,
                                   distance,
                                   pixel,
                                   theta,
                                   taps,
                                   read_buffer(buffer)};
    if (!(distance > 0)) refuse("distance is " + std::to_string(distance) + "; expected above 0");
    if (!(pixel > 0)) refuse("pixel is " + std::to_string(pixel) + "; expected above 0");
    if (!(theta >= 0 && theta < std::numbers::pi / 2))
        refuse("theta is " + std::to_string(theta) + "; expected 0 to below pi / 2");
    if (taps < 1 || taps > 64) refuse("taps is " + std::to_string(taps) + "; expected 1 to 64");
    return filled(std::size_t(volume.channels), volume.shape, [&](float *out) {
        published::blurred_slices(volume, slices, threads, control, out);
    });
}

FloatOut propagated_shadow(const AnyArray &sigma_t, const AnyArray &sigma_s,
                           const AnyArray &index_to_world, const AnyArray &toward, int neighbours,
                           const std::string &buffer, int threads, Control *control) {
    const published::Volume volume = read_volume(sigma_t, sigma_s, index_to_world);
    if (neighbours != 0 && neighbours != 4 && neighbours != 8)
        refuse("neighbours is " + std::to_string(neighbours) + "; expected 0, 4 or 8");
    const Vec3d direction = read_vector(toward, "toward");
    const Buffer kind = read_buffer(buffer);
    return filled(2 * std::size_t(volume.channels), volume.shape, [&](float *out) {
        published::propagated_shadow(volume, direction, neighbours, kind, threads, control, out);
    });
}

FloatOut composed_visibility(const AnyArray &local, const AnyArray &index_offset, int steps,
                             int threads, Control *control) {
    const float *values = require<float>(local, "local", "[nx, ny, nz]", {-1, -1, -1});
    const Index3 shape = {int(local.shape(0)), int(local.shape(1)), int(local.shape(2))};
    const Vec3d offset = read_vector(index_offset, "index_offset");
    return filled(1, shape, [&](float *out) {
        published::composed_visibility(shape, values, offset, steps, threads, control, out);
    });
}

}  // namespace

void bind_published(nb::module_ &module) {
    module.def(
        "blurred_slices", &blurred_slices, "sigma_t"_a, "index_to_world"_a, "toward"_a,
        nb::kw_only(), "sigma_s"_a = nb::none(), "eye"_a = nb::none(), "distance"_a, "pixel"_a,
        "theta"_a, "taps"_a = 4, "buffer"_a = "float", "threads"_a = 0, "control"_a = nb::none(),
        R"(The published slice algorithm of half angle slicing and (multi)directional occlusion.

Slices lie across `toward` [3], a unit vector to the light or the eye, `distance` (world) apart. From
slice to slice the buffer, 1 at first, is averaged over taps x taps places in the square of half edge
distance * tan(theta), then multiplied by exp(-sigma_t distance), or, where sigma_s is given, by that
plus albedo times what it takes away. `eye` [3]: slices as seen from there; `pixel` is their
resolution (world, at the volume's middle). buffer: float, half or byte is what is kept between
slices. It does not solve the models' equations: penumbras narrow as the slices get denser.
sigma_t, sigma_s: float32 [c, nx, ny, nz]. Returns float32 [c, nx, ny, nz].)");
    module.def("propagated_shadow", &propagated_shadow, "sigma_t"_a, "sigma_s"_a,
               "index_to_world"_a, "toward"_a, nb::kw_only(), "neighbours"_a = 0,
               "buffer"_a = "float", "threads"_a = 0, "control"_a = nb::none(),
               R"(The published algorithm of shadow volume propagation, slice by slice of the grid.

Colour = (1 - alpha) colour + alpha albedo and occlusion = (1 - alpha) occlusion + alpha, each read one
slice nearer to the light (`toward` [3], a unit vector) as the mean of a bilinear lookup and of 0, 4
or 8 neighbours. alpha = 1 - exp(-sigma_t h) with the slices' distance h whatever the light's angle.
sigma_t, sigma_s: float32 [c, nx, ny, nz]. Returns float32 [2 c, nx, ny, nz]: colour, occlusion.)");
    module.def("composed_visibility", &composed_visibility, "local"_a, "index_offset"_a,
               nb::kw_only(), "steps"_a, "threads"_a = 0, "control"_a = nb::none(),
               R"(Product of a local visibility at x, x + offset, ..., `steps` places in all.

local: float32 [nx, ny, nz], interpolated trilinearly, 1 outside. index_offset: float64 [3], voxels.
Returns float32 [1, nx, ny, nz].)");
}
