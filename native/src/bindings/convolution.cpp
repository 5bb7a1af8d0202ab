#include "volillum/convolution.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <climits>
#include <cmath>
#include <limits>

#include "arrays.h"
#include "volillum/hemisphere.h"

namespace nb = nanobind;
using namespace nb::literals;
using volillum::AnyArray;
using volillum::Control;
using volillum::ConvolutionSettings;
using volillum::Guide;
using volillum::Index3;
using volillum::require;

namespace {

bool is_float_array(nb::handle handle) {
    return nb::isinstance<nb::ndarray<float>>(handle);
}
struct FloatArray : nb::object {
    NB_OBJECT_DEFAULT(FloatArray, nb::object, "numpy.typing.NDArray[numpy.float32]", is_float_array)
};

[[noreturn]] void fail(const std::string &message) {
    throw nb::value_error(message.c_str());
}

bool is_double(const std::string &name) {
    if (name == "single") return false;
    if (name == "double") return true;
    fail("precision is '" + name + "'; expected 'single' or 'double'");
}

// Checked arguments of both kinds of sums, and the array that they fill.
struct Sums {
    const float *field;
    Index3 shape;
    const double *affine;
    ConvolutionSettings settings;
    FloatArray out;

    Sums(const AnyArray &array, const AnyArray &index_to_world, const ConvolutionSettings &given)
        : field(require<float>(array, "field", "[c, nx, ny, nz]", {-1, -1, -1, -1})),
          affine(require<double>(index_to_world, "index_to_world", "[4, 4]", {4, 4})),
          settings(given) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            if (array.shape(axis + 1) > INT_MAX / 8)
                fail("field has shape " + volillum::shape_text(array) + "; expected sides below " +
                     std::to_string(INT_MAX / 8));
            shape[axis] = int(array.shape(axis + 1));
        }
        const auto &[radius, weight_p, total] = settings.neighbourhood;
        if (!(radius > 0) || !std::isfinite(radius))
            fail("radius is " + std::to_string(radius) + "; expected a finite length above 0");
        if (weight_p < 0 || weight_p > 2)
            fail("weight_p is " + std::to_string(weight_p) + "; expected 0, 1 or 2");
        if (!std::isfinite(total) || !(settings.opacity_length >= 0) || !(settings.upper >= 0))
            fail(
                "total, opacity_length or upper is not a number in range; expected finite, at "
                "least 0, at least 0");
        const auto make = nb::module_::import_("numpy").attr("empty");
        out = nb::borrow<FloatArray>(
            make(nb::make_tuple(array.shape(0), shape[0], shape[1], shape[2]), "float32"));
    }
    float *data() const {
        return static_cast<float *>(nb::cast<nb::ndarray<nb::device::cpu>>(out).data());
    }
};

FloatArray convolve(const AnyArray &field, const AnyArray &index_to_world, double radius,
                    int weight_p, double total, double opacity_length, double upper,
                    bool complement, const std::string &precision, int threads, Control *control) {
    const Sums sums(field, index_to_world,
                    {{radius, weight_p, total},
                     opacity_length,
                     upper,
                     complement,
                     is_double(precision),
                     threads,
                     control});
    float *data = sums.data();
    {
        const nb::gil_scoped_release release;
        volillum::convolve(sums.field, int(field.shape(0)), sums.shape, sums.affine, sums.settings,
                           data);
    }
    return sums.out;
}

FloatArray hemisphere_sums(const AnyArray &field, const AnyArray &guide,
                           const AnyArray &index_to_world, double radius, int weight_p,
                           double total, double opacity_length, double upper, bool complement,
                           int threads, Control *control) {
    const Sums sums(
        field, index_to_world,
        {{radius, weight_p, total}, opacity_length, upper, complement, false, threads, control});
    const auto &[n0, n1, n2] = sums.shape;
    const Guide outside{
        require<float>(guide, "guide", "[c, nx, ny, nz] of field's shape", {-1, n0, n1, n2}),
        int(guide.shape(0))};
    float *data = sums.data();
    {
        const nb::gil_scoped_release release;
        volillum::hemisphere_sums(sums.field, int(field.shape(0)), outside, sums.shape, sums.affine,
                                  sums.settings, data);
    }
    return sums.out;
}

}  // namespace

void bind_convolution(nb::module_ &module) {
    module.def("convolve", &convolve, "field"_a, "index_to_world"_a, nb::kw_only(), "radius"_a,
               "weight_p"_a = 1, "total"_a = 1.0, "opacity_length"_a = 0.0,
               "upper"_a = std::numeric_limits<double>::infinity(), "complement"_a = false,
               "precision"_a = "single", "threads"_a = 0, "control"_a = nb::none(),
               R"(Sums of a field over the neighbourhood of every voxel.

    out(x) = total (3 - p) / (4 pi R^(3 - p)) integral over |y| < R of field(x + y) |y|^-p dV

The field is the trilinear interpolant of its voxels, zero outside; y and R are in world units. A
homogeneous field of 1 gives `total`. By Fourier transforms; the kernel is integrated against the
hat functions of the trilinear interpolant, so the only error is rounding.

field: float32 [c, nx, ny, nz], C-contiguous, finite, not negative.
index_to_world: float64 [4, 4]; any invertible affine; only its linear part matters.
radius: R, world units. weight_p: p, 0 (box), 1 or 2.
opacity_length: above 0, the field is sigma_t and 1 - exp(-sigma_t opacity_length) is summed.
upper: sums lie in [0, upper]; what rounding puts outside is cut.
complement: 1 - sum instead of the sum.
precision: of the transforms. Rounding in 'single' is about 1e-7 of the largest sums everywhere:
what is small beside them needs 'double', at twice the time and memory.
threads: 0: all cores. The result is the same, bit for bit, for any number.
control: cancels (raises Cancelled) and tells the progress.
Returns float32 [c, nx, ny, nz].
Raises ValueError for wrong shapes, a singular affine or settings out of range; TypeError for wrong
types.)");
    module.def("hemisphere_sums", &hemisphere_sums, "field"_a, "guide"_a, "index_to_world"_a,
               nb::kw_only(), "radius"_a, "weight_p"_a = 1, "total"_a = 1.0,
               "opacity_length"_a = 0.0, "upper"_a = std::numeric_limits<double>::infinity(),
               "complement"_a = false, "threads"_a = 0, "control"_a = nb::none(),
               R"(Sums of a field over the open half of the neighbourhood of every voxel.

    out(x) = total (3 - p) / (2 pi R^(3 - p))
             integral over |y| < R, y . grad guide(x) < 0 of field(x + y) |y|^-p dV

over the whole ball, and half as much, where the guide changes by less than 1e-5 of its value from
voxel to voxel. Direct sums: the time grows with the cube of R.

guide: float32 [1 or more, nx, ny, nz], whose mean's central differences are the gradient, 0
outside. All else as for `convolve`.)");
}
