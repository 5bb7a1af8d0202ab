#include "volillum/photons.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/unique_ptr.h>

#include "ray_arguments.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using namespace volillum::bindings;

namespace {

using Kind = PhotonSource::Kind;
using Sums = nb::ndarray<float, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<std::int32_t, nb::c_contig, nb::device::cpu>;

Vec3 unit_vector(nb::handle value, const char *name) {
    const Vec3 vector = as_vector(value, name);
    const double size = length(vector);
    if (!(std::abs(size - 1.0) < 1e-6))
        fail(std::string(name) + " has length " + std::to_string(size) + "; expected 1");
    return (1.0 / size) * vector;
}

void require_cosine(double cosine) {
    if (!(cosine >= -1.0 && cosine <= 1.0))
        fail("cos_half_angle is " + std::to_string(cosine) + "; expected -1 to 1");
}

PhotonSource distant(nb::handle direction, double cos_half_angle) {
    require_cosine(cos_half_angle);
    PhotonSource source;
    source.kind = Kind::distant;
    source.direction = -1.0 * unit_vector(direction, "direction");
    source.cos_half_angle = cos_half_angle;
    return source;
}

PhotonSource environment() {
    return {};
}

// Radiance over its mean over the colours, where those differ at all.
std::vector<float> colours_of(const double *rgb, std::size_t count, std::vector<double> &means) {
    std::vector<float> colours(3 * count, 1.0f);
    bool grey = true;
    for (std::size_t i = 0; i < count; ++i) {
        means[i] = (rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) / 3.0;
        for (std::size_t c = 0; c < 3; ++c) {
            if (!(rgb[3 * i + c] >= 0.0))
                fail("a source holds a negative value; expected 0 or more");
            if (means[i] > 0.0) colours[3 * i + c] = float(rgb[3 * i + c] / means[i]);
            grey = grey && rgb[3 * i + c] == rgb[3 * i];
        }
    }
    if (grey) colours.clear();
    return colours;
}

AliasTable table_of(const std::vector<double> &weights) {
    try {
        return AliasTable(weights);
    } catch (const std::invalid_argument &error) {
        fail(error.what());
    }
}

PhotonSource image(const DoubleArray &radiance, const DoubleArray &rotation) {
    const auto shape = shape_of(radiance);
    if (shape.size() != 3 || shape[2] != 3 || shape[0] == 0 || shape[1] == 0)
        fail("radiance has shape " + shape_text(shape) + "; expected (h, w, 3)");
    if (shape_of(rotation) != std::vector<std::size_t>{3, 3})
        fail("rotation has shape " + shape_text(shape_of(rotation)) + "; expected (3, 3)");
    require_finite(radiance, "radiance");
    require_finite(rotation, "rotation");
    PhotonSource source;
    source.kind = Kind::image;
    source.height = shape[0];
    source.width = shape[1];
    std::vector<double> weights(shape[0] * shape[1]);
    source.colours = colours_of(radiance.data(), weights.size(), weights);
    for (std::size_t row = 0; row < shape[0]; ++row) {
        const double top = std::sin(M_PI * (0.5 - double(row) / double(shape[0]))),
                     bottom = std::sin(M_PI * (0.5 - double(row + 1) / double(shape[0])));
        for (std::size_t column = 0; column < shape[1]; ++column)
            weights[row * shape[1] + column] *= (top - bottom) * 2.0 * M_PI / double(shape[1]);
    }
    source.table = table_of(weights);
    for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b) source.rotation[a][b] = rotation.data()[3 * a + b];
    return source;
}

PhotonSource point(nb::handle position) {
    PhotonSource source;
    source.kind = Kind::point;
    source.position = as_vector(position, "position");
    return source;
}

PhotonSource spot(nb::handle position, nb::handle direction, double cos_half_angle, double blend) {
    require_cosine(cos_half_angle);
    PhotonSource source = point(position);
    source.kind = Kind::spot;
    source.direction = unit_vector(direction, "direction");
    source.cos_half_angle = cos_half_angle;
    source.blend = blend;
    return source;
}

PhotonSource area(nb::handle position, nb::handle direction, nb::handle half_axes, bool ellipse) {
    PhotonSource source = point(position);
    source.kind = Kind::area;
    source.direction = unit_vector(direction, "direction");
    const DoubleArray axes = as_doubles(half_axes, "half_axes");
    if (shape_of(axes) != std::vector<std::size_t>{2, 3})
        fail("half_axes has shape " + shape_text(shape_of(axes)) + "; expected (2, 3)");
    for (std::size_t a = 0; a < 2; ++a)
        source.half_axes[a] = {axes.data()[3 * a], axes.data()[3 * a + 1], axes.data()[3 * a + 2]};
    source.ellipse = ellipse;
    return source;
}

PhotonSource emission(const PlanesArray &values) {
    const Size3 shape = grid_shape(values, "emission");
    PhotonSource source;
    source.kind = Kind::emission;
    source.emission = planes(values);
    source.height = shape[0] * shape[1] * shape[2];
    const std::size_t channels = source.emission.channels;
    std::vector<double> means(source.height);
    for (std::size_t i = 0; i < source.height; ++i) {
        for (std::size_t c = 0; c < channels; ++c) {
            const float value = source.emission.values[c * source.height + i];
            if (!(value >= 0.0f && std::isfinite(value)))
                fail("emission holds " + std::to_string(value) + "; expected 0 or more");
            means[i] += double(value);
        }
        means[i] /= double(channels);
    }
    source.table = table_of(means);
    return source;
}

// The tracer and the arrays that it reads.
class Photons {
public:
    Photons(const PlanesArray &sigma_t, const PlanesArray &sigma_s,
            const DoubleArray &index_to_world, double g, double least_majorant)
        : sigma_t_(sigma_t), sigma_s_(sigma_s), shape_(grid_shape(sigma_t, "sigma_t")) {
        require_grid(sigma_s, "sigma_s", shape_);
        lattice(index_to_world);
        if (!(std::abs(g) < 1.0))
            fail("g is " + std::to_string(g) + "; expected more than -1 and less than 1");
        if (!(least_majorant >= 0.0 && std::isfinite(least_majorant)))
            fail("least_majorant is " + std::to_string(least_majorant) + "; expected 0 or more");
        tracer_ = std::make_unique<PhotonTracer>(
            index_to_world.data(), shape_, PhotonMedium{planes(sigma_t_), planes(sigma_s_), g},
            least_majorant);
    }

    std::size_t colours(const PhotonSource &source) const { return tracer_->colours(source); }
    double deposit_unit(const PhotonSource &source, bool unscattered) const {
        return tracer_->deposit_unit(source, unscattered);
    }

    nb::dict run(const PhotonSource &source, Sums sums, Sums deviations,
                 std::optional<Integers> higher, std::optional<Integers> wraps, std::uint64_t seed,
                 std::uint64_t pass, std::int64_t photons, bool unscattered, double radius,
                 bool deposits, int threads, Control *control) {
        const std::size_t voxels = shape_[0] * shape_[1] * shape_[2], each = colours(source);
        const std::vector<std::size_t> plain{voxels, each}, moments{voxels, 8, each};
        const auto require = [](const auto &array, const char *name,
                                const std::vector<std::size_t> &shape) {
            if (shape_of(array) != shape)
                fail(std::string(name) + " has shape " + shape_text(shape_of(array)) +
                     "; expected " + shape_text(shape));
        };
        require(sums, "sums", plain);
        require(deviations, "deviations", plain);
        if (higher.has_value() != wraps.has_value())
            fail("higher and wraps are not given together; expected both or none");
        PhotonSums sums_of{sums.data(), deviations.data()};
        if (higher) {
            require(*higher, "higher", moments);
            require(*wraps, "wraps", moments);
            sums_of.higher = higher->data();
            sums_of.wraps = wraps->data();
        }
        if (photons < 1 || photons > 100000000)
            fail("photons is " + std::to_string(photons) + "; expected 1 to 100000000");
        if (source.kind == Kind::emission && source.height != voxels)
            fail("the emission has " + std::to_string(source.height) + " voxels; expected " +
                 std::to_string(voxels));
        PhotonRun pass_of;
        pass_of.seed = seed;
        pass_of.pass = pass;
        pass_of.photons = std::size_t(photons);
        if (!(radius >= 0.0 && std::isfinite(radius)))
            fail("radius is " + std::to_string(radius) + "; expected 0 or more");
        pass_of.unscattered = unscattered;
        pass_of.radius = radius;
        pass_of.deposits = deposits;
        pass_of.threads = threads;
        pass_of.control = control;
        PhotonTally tally;
        {
            const nb::gil_scoped_release release;
            tally = tracer_->run(source, pass_of, sums_of);
        }
        const auto list = [&](const PhotonTally::Each &values) {
            nb::list result;
            for (std::size_t c = 0; c < each; ++c) result.append(values[c]);
            return result;
        };
        nb::dict result;
        result["emitted"] = list(tally.emitted);
        result["missed"] = list(tally.missed);
        result["absorbed"] = list(tally.absorbed);
        result["roulette"] = list(tally.roulette);
        result["given_up"] = list(tally.given_up);
        nb::list faces;
        for (const PhotonTally::Each &face : tally.escaped) faces.append(list(face));
        result["escaped"] = faces;
        result["scatterings"] = tally.scatterings;
        result["endless"] = tally.endless;
        result["power_unit"] = tracer_->power_unit(source, unscattered);
        return result;
    }

private:
    PlanesArray sigma_t_, sigma_s_;
    Size3 shape_;
    std::unique_ptr<PhotonTracer> tracer_;
};

nb::ndarray<nb::numpy, float> transmittance(const PlanesArray &sigma_t,
                                            const DoubleArray &index_to_world, nb::handle position,
                                            int threads, Control *control) {
    const Size3 shape = grid_shape(sigma_t, "sigma_t");
    const Lattice map = lattice(index_to_world);
    const Vec3 target = as_vector(position, "point");
    const std::size_t channels = sigma_t.shape(0);
    const std::size_t size = channels * shape[0] * shape[1] * shape[2];
    float *data = new float[size];
    nb::capsule owner(data, [](void *memory) noexcept { delete[] static_cast<float *>(memory); });
    const std::size_t extents[4] = {channels, shape[0], shape[1], shape[2]};
    nb::ndarray<nb::numpy, float> result(data, 4, extents, owner);
    {
        const nb::gil_scoped_release release;
        transmittance_to(map, index_to_world.data(), shape, planes(sigma_t), target, threads,
                         control, data);
    }
    return result;
}

}  // namespace

void bind_photons(nb::module_ &module) {
    nb::class_<PhotonSource>(module, "PhotonSource",
                             "Where photons come from, of strength 1 (Photons.deposit_unit).")
        .def_static("distant", &distant, "direction"_a, "cos_half_angle"_a,
                    "A uniform disc about the unit vector toward it; strength: fluence.")
        .def_static("environment", &environment, "Constant radiance all around.")
        .def_static(
            "image", &image, "radiance"_a.noconvert(), "rotation"_a.noconvert(),
            R"(A latitude-longitude image, float64 [h, w, 3], first row up; `rotation`, float64
[3, 3], takes world directions to the image's. Pixels are chosen in proportion to their mean
radiance times their solid angle.)")
        .def_static("point", &point, "position"_a, "Strength: radiant intensity.")
        .def_static("spot", &spot, "position"_a, "direction"_a, "cos_half_angle"_a, "blend"_a,
                    "A point that shines along `direction`; strength: intensity on the axis.")
        .def_static(
            "area", &area, "position"_a, "direction"_a, "half_axes"_a, "ellipse"_a,
            R"(A rectangle (position +- half axes [2, 3]) or the ellipse in it, that shines to the
side of `direction` with one radiance; strength: intensity on the axis.)")
        .def_static("emission", &emission, "emission"_a.noconvert(), nb::keep_alive<0, 1>(),
                    "The medium's own emission sigma_a L_e, float32 [1 or 3, nx, ny, nz], kept, "
                    "not copied.");

    nb::class_<Photons>(module, "Photons", R"(Photon tracing in one medium.

sigma_t, sigma_s: float32 [1 or 3, nx, ny, nz], kept, not copied; index_to_world: float64 [4, 4];
g: mean cosine of the Henyey-Greenstein phase function; least_majorant: possible collisions a unit
of length, at least, also in the void, for the kernel estimate.)")
        .def(nb::init<const PlanesArray &, const PlanesArray &, const DoubleArray &, double,
                      double>(),
             "sigma_t"_a.noconvert(), "sigma_s"_a.noconvert(), "index_to_world"_a, "g"_a = 0.0,
             "least_majorant"_a = 0.0)
        .def("colours", &Photons::colours, "source"_a,
             "Colours of the deposits, 1 or 3: as few as medium and source allow.")
        .def("deposit_unit", &Photons::deposit_unit, "source"_a, "unscattered"_a = false,
             "In-scattered radiance of one unit of `sums`, times the number of photons.")
        .def("run", &Photons::run, "source"_a, "sums"_a.noconvert(), "deviations"_a.noconvert(),
             "higher"_a.noconvert() = nb::none(), "wraps"_a.noconvert() = nb::none(), nb::kw_only(),
             "seed"_a, "pass_index"_a, "photons"_a, "unscattered"_a = false, "radius"_a = 0.0,
             "deposits"_a = true, "threads"_a = 0, "control"_a = nb::none(),
             R"(Traces one pass and adds it to the sums, whole or (when cancelled) not at all.

sums: float32 [voxels, colours], the track lengths of each voxel's box; deviations: float32 of the
same shape, the squared deviations of the passes from their mean. higher, wraps: None, or int32
[voxels, 8, colours]: the track lengths times sqrt(4 pi) Y_lm of the directions to the source, l = 1
and 2, are (higher + 2^32 wraps) * `higher_unit` in units of the sums. `seed` and `pass_index` choose the
random numbers; `pass_index` is also how many passes the sums hold already. `unscattered`:
light that comes straight from the source counts too. `radius`: 0, or that of the kernel estimate
(world units): possible collisions within it of a voxel's centre, over the ball's volume and the
majorant. `deposits` False: only traces, to be timed.
Returns exact integers of power for each colour, in units of `power_unit` over `photons`: emitted =
missed + absorbed + roulette + given_up + sum of escaped (through the low and high face of each
index axis); and the numbers of `scatterings`, and of `endless` photons, given up after the most
scatterings that are followed, `most_scatterings`.)");
    module.attr("higher_unit") = volillum::kHigherUnit;
    module.attr("most_scatterings") = volillum::kMostScatterings;

    module.def(
        "transmittance_to", &transmittance, "sigma_t"_a.noconvert(), "index_to_world"_a, "point"_a,
        nb::kw_only(), "threads"_a = 0, "control"_a = nb::none(),
        R"(Transmittance between every voxel centre and a world point, without quadrature error.

sigma_t: float32 [1 or 3, nx, ny, nz]. Returns float32 of the same shape.)");
}
