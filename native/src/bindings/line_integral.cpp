#include "volillum/line_integral.h"

#include <nanobind/stl/optional.h>

#include "ray_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using namespace volillum::bindings;

namespace {

std::vector<ChannelProduct> terms_of(const nb::list &list, std::size_t channels) {
    std::vector<ChannelProduct> terms;
    for (nb::handle item : list) {
        const std::string name = "terms[" + std::to_string(terms.size()) + "]";
        nb::tuple fields, indices;
        if (!nb::try_cast(item, fields) || fields.size() != 2 ||
            !nb::try_cast(nb::handle(fields[0]), indices) ||
            (indices.size() != 1 && indices.size() != 2))
            fail(name + " is not a tuple (channels, weight) with one or two channels");
        ChannelProduct term;
        for (nb::handle index : indices) {
            std::size_t channel = 0;
            if (!nb::try_cast(index, channel) || channel >= channels)
                fail(name + " names a channel that is not an integer from 0 to " +
                     std::to_string(channels) + " - 1");
            term.channels.push_back(channel);
        }
        term.weight = as_vector(fields[1], name + "'s weight");
        terms.push_back(std::move(term));
    }
    return terms;
}

nb::tuple line_integral_image(const PlanesArray &sigma_t, const PlanesArray &sigma_s,
                              const std::optional<PlanesArray> &emission,
                              const DoubleArray &index_to_world, const PlanesArray &channels,
                              const nb::list &terms, const DoubleArray &rays, std::int64_t width,
                              std::int64_t height, std::int64_t subpixels, bool clamp, int threads,
                              Control *control) {
    const Size3 grid = grid_shape(sigma_t, "sigma_t");
    require_grid(sigma_s, "sigma_s", grid);
    if (emission) require_grid(*emission, "emission", grid, {3});
    require_grid(channels, "channels", grid, {});
    const Lattice map = lattice(index_to_world);
    const auto [w, h] = image_size(width, height);
    const std::array<Vec3, 6> camera = camera_rays(rays, w, h);
    if (subpixels < 1) fail("subpixels is " + std::to_string(subpixels) + "; expected 1 or more");
    const BakedVolume volume{planes(sigma_t),
                             planes(sigma_s),
                             emission ? planes(*emission) : Bricks::Planes{},
                             planes(channels),
                             terms_of(terms, channels.shape(0)),
                             clamp};
    auto [radiance, radiance_array] = output({h, w, 3});
    auto [transmittance, transmittance_array] = output({h, w, 3});
    {
        const nb::gil_scoped_release release;
        line_integral(map, grid, volume, {camera.data(), w, h, std::size_t(subpixels)}, threads,
                      control, radiance, transmittance);
    }
    return nb::make_tuple(radiance_array, transmittance_array);
}

}  // namespace

void bind_line_integral(nb::module_ &module) {
    module.def("line_integral", &line_integral_image, "sigma_t"_a.noconvert(),
               "sigma_s"_a.noconvert(), "emission"_a.noconvert().none(), "index_to_world"_a,
               "channels"_a.noconvert(), "terms"_a, "rays"_a, "width"_a, "height"_a, nb::kw_only(),
               "subpixels"_a = 4, "clamp"_a = true, "threads"_a = 0, "control"_a = nb::none(),
               R"(Image of a baked illumination, without noise:

    L = int tau (sigma_s L_i + emission) ds,   L_i = sum_terms weight * product of channels

every factor interpolated trilinearly by itself, as a display does it, zero outside the grid;
L_i below 0 becomes 0 when `clamp`.
sigma_t, sigma_s: float32 [1 or 3, nx, ny, nz]; emission: None or float32 [3, nx, ny, nz], radiance
per length; channels: float32 [m, nx, ny, nz]. terms: a list of (channel indices, weight): a tuple
of one or two integers, and RGB. rays, width, height as in exact_image; each pixel is the mean of
subpixels x subpixels regular rays, each integrated to a relative 1e-5 or better.
Returns radiance and transmittance, float64 [height, width, 3] each.)");
}
