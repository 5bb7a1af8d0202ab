#include "volillum/line_integral.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include "ray_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using namespace volillum::bindings;

namespace {

std::vector<Angular> angular_of(const nb::list &list) {
    std::vector<Angular> found;
    for (nb::handle item : list) {
        const std::string name = "angular[" + std::to_string(found.size()) + "]";
        nb::tuple fields;
        std::string kind;
        if (nb::try_cast(item, fields) && fields.size() > 0) nb::try_cast(fields[0], kind);
        const bool moment = kind == "moment" && fields.size() == 2;
        if (!moment && !((kind == "direction" || kind == "position") && fields.size() == 3))
            fail(name +
                 " is not ('direction', g, vector), ('position', g, point) or ('moment', index)");
        Angular angular{Angular::Kind::moment, 0.0, {}, 0};
        if (moment) {
            if (!nb::try_cast(fields[1], angular.index) || angular.index >= Angular::moments)
                fail(name + "'s index is not an integer from 0 to " +
                     std::to_string(Angular::moments - 1));
        } else {
            if (!nb::try_cast(fields[1], angular.g) || !(std::abs(angular.g) < 1.0))
                fail(name + "'s g is not a number between -1 and 1");
            angular.source = as_vector(fields[2], name + "'s " + kind);
            angular.kind = kind == "position" ? Angular::Kind::position : Angular::Kind::direction;
            if (kind == "direction" && std::abs(length(angular.source) - 1.0) > 1e-9)
                fail(name + "'s direction has length " + std::to_string(length(angular.source)) +
                     "; expected 1");
        }
        found.push_back(angular);
    }
    return found;
}

std::vector<ChannelProduct> terms_of(const nb::list &list, std::size_t channels,
                                     std::size_t angular) {
    std::vector<ChannelProduct> terms;
    for (nb::handle item : list) {
        const std::string name = "terms[" + std::to_string(terms.size()) + "]";
        nb::tuple fields, indices;
        if (!nb::try_cast(item, fields) || (fields.size() != 2 && fields.size() != 3) ||
            !nb::try_cast(nb::handle(fields[0]), indices) ||
            (indices.size() != 1 && indices.size() != 2))
            fail(
                name +
                " is not a tuple (channels, weight) or (channels, weight, angular) with one or two "
                "channels");
        ChannelProduct term;
        for (nb::handle index : indices) {
            std::size_t channel = 0;
            if (!nb::try_cast(index, channel) || channel >= channels)
                fail(name + " names a channel that is not an integer from 0 to " +
                     std::to_string(channels) + " - 1");
            term.channels.push_back(channel);
        }
        term.weight = as_vector(fields[1], name + "'s weight");
        if (fields.size() == 3 && !fields[2].is_none()) {
            std::size_t index = 0;
            if (!nb::try_cast(fields[2], index) || index >= angular)
                fail(name + " names an angular dependence that is not None or an integer below " +
                     std::to_string(angular));
            term.angular = index;
        }
        terms.push_back(std::move(term));
    }
    return terms;
}

nb::tuple line_integral_image(const PlanesArray &sigma_t, const PlanesArray &sigma_s,
                              const std::optional<PlanesArray> &emission,
                              const DoubleArray &index_to_world, const PlanesArray &channels,
                              const nb::list &terms, const DoubleArray &rays, std::int64_t width,
                              std::int64_t height, const nb::list &angular, std::int64_t subpixels,
                              bool clamp, int threads, Control *control) {
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
                             terms_of(terms, channels.shape(0), angular.size()),
                             angular_of(angular),
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
               "angular"_a = nb::list(), "subpixels"_a = 4, "clamp"_a = true, "threads"_a = 0,
               "control"_a = nb::none(),
               R"(Image of a baked illumination, without noise:

    L = int tau (sigma_s L_i + emission) ds,   L_i = sum_terms weight * product of channels

every factor interpolated trilinearly by itself, as a display does it, zero outside the grid;
L_i below 0 becomes 0 when `clamp`.
A term may be multiplied by a factor that depends on the direction v toward the eye.
sigma_t, sigma_s: float32 [1 or 3, nx, ny, nz]; emission: None or float32 [3, nx, ny, nz], radiance
per length; channels: float32 [m, nx, ny, nz]. terms: a list of (channel indices, weight) or
(channel indices, weight, index into `angular` or None): a tuple of one or two integers, and RGB.
angular: a list of ("direction", g, unit vector toward a light), ("position", g, world point of a
light), both 4 pi times Henyey and Greenstein's phase function at the cosine -omega . v, and
("moment", l (l + 1) + m), the real harmonic Y_lm(-v) up to l = 2. rays, width, height as in exact_image; each pixel is the mean of
subpixels x subpixels regular rays, each integrated to a relative 1e-5 or better.
Returns radiance and transmittance, float64 [height, width, 3] each.)");
}
