// Arguments that the ray-based functions share, checked and worded in one place: what was found,
// what was expected, where.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "volillum/trilinear.h"

namespace volillum::bindings {

namespace nb = nanobind;

// Voxel planes [c, nx, ny, nz]; never converted, they are large.
using PlanesArray = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using DoubleArray = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using OutArray = nb::ndarray<nb::numpy, double>;

inline std::string shape_text(const std::vector<std::size_t> &shape) {
    std::string text = "(";
    for (std::size_t i = 0; i < shape.size(); ++i)
        text += (i ? ", " : "") + std::to_string(shape[i]);
    return text + (shape.size() == 1 ? ",)" : ")");
}

template <class Array>
std::vector<std::size_t> shape_of(const Array &array) {
    std::vector<std::size_t> shape;
    for (std::size_t i = 0; i < array.ndim(); ++i) shape.push_back(array.shape(i));
    return shape;
}

[[noreturn]] inline void fail(const std::string &message) {
    throw nb::value_error(message.c_str());
}

// The grid's [nx, ny, nz] from planes whose number of channels must be among `allowed` (any number
// when it is empty).
inline Size3 grid_shape(const PlanesArray &planes, const char *name,
                        const std::vector<std::size_t> &allowed = {1, 3}) {
    const auto shape = shape_of(planes);
    bool right = shape.size() == 4 && shape[1] > 0 && shape[2] > 0 && shape[3] > 0;
    std::string expected = "[c, nx, ny, nz]";
    if (!allowed.empty()) {
        bool found = false;
        expected += ", c";
        for (std::size_t i = 0; i < allowed.size(); ++i) {
            expected += (i ? " or " : " = ") + std::to_string(allowed[i]);
            found = found || (right && shape[0] == allowed[i]);
        }
        right = right && found;
    }
    if (!right)
        fail(std::string(name) + " has shape " + shape_text(shape) + "; expected " + expected);
    return {shape[1], shape[2], shape[3]};
}

inline void require_grid(const PlanesArray &planes, const char *name, const Size3 &grid,
                         const std::vector<std::size_t> &allowed = {1, 3}) {
    if (grid_shape(planes, name, allowed) != grid)
        fail(std::string(name) + " has shape " + shape_text(shape_of(planes)) +
             "; expected the grid of sigma_t, " + shape_text({grid[0], grid[1], grid[2]}));
}

inline void require_finite(const DoubleArray &array, const char *name) {
    for (std::size_t i = 0; i < array.size(); ++i)
        if (!std::isfinite(array.data()[i]))
            fail(std::string(name) + " holds a value that is not finite, at flat index " +
                 std::to_string(i));
}

inline Lattice lattice(const DoubleArray &index_to_world) {
    if (shape_of(index_to_world) != std::vector<std::size_t>{4, 4})
        fail("index_to_world has shape " + shape_text(shape_of(index_to_world)) +
             "; expected (4, 4)");
    try {
        return Lattice(index_to_world.data());
    } catch (const std::invalid_argument &error) {
        fail(error.what());
    }
}

inline Bricks::Planes planes(const PlanesArray &array) {
    return {array.data(), array.shape(0)};
}

// Number of rows of an [n, 3] array of finite numbers.
inline std::size_t rows_of_three(const DoubleArray &array, const char *name) {
    const auto shape = shape_of(array);
    if (shape.size() != 2 || shape[1] != 3)
        fail(std::string(name) + " has shape " + shape_text(shape) + "; expected (n, 3)");
    require_finite(array, name);
    return shape[0];
}

// Anything that numpy makes an array of float64 of; held alive by the result.
inline DoubleArray as_doubles(nb::handle value, const std::string &name) {
    const nb::object numpy = nb::module_::import_("numpy");
    DoubleArray array;
    if (!nb::try_cast(numpy.attr("ascontiguousarray")(value, numpy.attr("float64")), array))
        fail(name + " is not an array of numbers");
    require_finite(array, name.c_str());
    return array;
}

inline Vec3 as_vector(nb::handle value, const std::string &name) {
    const DoubleArray array = as_doubles(value, name);
    if (shape_of(array) != std::vector<std::size_t>{3})
        fail(name + " has shape " + shape_text(shape_of(array)) + "; expected (3,)");
    return {array.data()[0], array.data()[1], array.data()[2]};
}

inline std::pair<std::size_t, std::size_t> image_size(std::int64_t width, std::int64_t height) {
    if (width < 1 || height < 1)
        fail("image of " + std::to_string(width) + " x " + std::to_string(height) +
             " pixels; expected at least 1 x 1");
    return {std::size_t(width), std::size_t(height)};
}

// The six vectors of a camera; every corner of the image must have a direction.
inline std::array<Vec3, 6> camera_rays(const DoubleArray &rays, std::size_t width,
                                       std::size_t height) {
    if (shape_of(rays) != std::vector<std::size_t>{6, 3})
        fail("rays has shape " + shape_text(shape_of(rays)) + "; expected (6, 3)");
    require_finite(rays, "rays");
    std::array<Vec3, 6> result;
    for (std::size_t i = 0; i < 6; ++i)
        result[i] = {rays.data()[3 * i], rays.data()[3 * i + 1], rays.data()[3 * i + 2]};
    for (const double u : {0.0, double(width)})
        for (const double v : {0.0, double(height)})
            if (!(length(result[3] + u * result[4] + v * result[5]) > 0.0))
                fail("rays have no direction at image position (" + std::to_string(u) + ", " +
                     std::to_string(v) + ")");
    return result;
}

inline void require_radius(double radius) {
    if (!(radius > 0.0)) fail("radius is " + std::to_string(radius) + "; expected more than 0");
}

// An uninitialised array that Python owns.
inline std::pair<double *, OutArray> output(std::vector<std::size_t> shape) {
    std::size_t size = 1;
    for (const std::size_t extent : shape) size *= extent;
    double *data = new double[size];
    nb::capsule owner(data, [](void *memory) noexcept { delete[] static_cast<double *>(memory); });
    return {data, OutArray(data, shape.size(), shape.data(), owner)};
}

}  // namespace volillum::bindings
