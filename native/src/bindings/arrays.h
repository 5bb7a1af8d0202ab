// Arguments of kernels: refuses arrays of the wrong type, shape or layout with words of our own,
// because nanobind's refusal names none of them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <functional>
#include <initializer_list>
#include <string>
#include <utility>

#include "volillum/real.h"

namespace volillum {

namespace nb = nanobind;
using AnyArray = nb::ndarray<nb::ro, nb::device::cpu>;

inline std::string shape_text(const AnyArray &array) {
    std::string text = "(";
    for (std::size_t axis = 0; axis < array.ndim(); ++axis)
        text += (axis ? ", " : "") + std::to_string(array.shape(axis));
    return text + (array.ndim() == 1 ? ",)" : ")");
}

// Throws nb::type_error or nb::value_error unless `array` is C-contiguous, of type Scalar and of
// `shape`, where -1 allows any positive length and `axes` names what was expected. `apart`: what
// the first axis counts may lie at any distance.
template <class Scalar>
const Scalar *require(const AnyArray &array, const char *name, const char *axes,
                      std::initializer_list<std::int64_t> shape, bool apart = false) {
    const std::string label = name;
    if (array.dtype() != nb::dtype<Scalar>()) {
        const std::string expected = sizeof(Scalar) == 4 ? "float32" : "float64";
        throw nb::type_error(
            (label + " has another type than " + expected + "; expected " + expected + " " + axes)
                .c_str());
    }
    bool fits = array.ndim() == shape.size();
    for (std::size_t axis = 0; fits && axis < shape.size(); ++axis) {
        const std::int64_t wanted = shape.begin()[axis], found = std::int64_t(array.shape(axis));
        fits = wanted < 0 ? found > 0 : found == wanted;
    }
    if (!fits)
        throw nb::value_error(
            (label + " has shape " + shape_text(array) + "; expected " + axes).c_str());
    std::int64_t stride = 1;
    for (std::size_t axis = array.ndim(); axis-- > 0;) {
        const bool given =
            axis == 0 && apart ? array.stride(0) >= stride : array.stride(axis) == stride;
        if (array.shape(axis) > 1 && !given)
            throw nb::value_error(
                (label + " is not C-contiguous; expected " + axes + " in C order").c_str());
        stride *= std::int64_t(array.shape(axis));
    }
    return static_cast<const Scalar *>(array.data());
}

// The caller's array `out` or, for None, a new one that owns its memory, made by numpy so that a
// large one gets the pages that numpy asks for. `apart` as in `require`.
inline std::pair<nb::object, Real *> output(const nb::object &out,
                                            std::initializer_list<std::int64_t> shape,
                                            bool zeros = false, bool apart = false) {
    nb::object array = out;
    if (out.is_none()) {
        nb::list sizes;
        for (const std::int64_t size : shape) sizes.append(size);
        array = nb::module_::import_("numpy").attr(zeros ? "zeros" : "empty")(
            nb::tuple(sizes), sizeof(Real) == 4 ? "float32" : "float64");
    }
    nb::ndarray<nb::device::cpu> view;
    if (!nb::try_cast(array, view))
        throw nb::type_error("out is not a writable array; expected float32 as is returned");
    const Real *data =
        require<Real>(nb::cast<AnyArray>(array), "out", "the shape that is returned", shape, apart);
    return {array, const_cast<Real *>(data)};
}

// Throws nb::value_error where `size` numbers from `out` on are also some of `other`.
inline void refuse_shared(const Real *out, std::size_t size, const AnyArray &other,
                          const char *name) {
    const Real *begin = static_cast<const Real *>(other.data());
    if (std::less<>()(out, begin + other.size()) && std::less<>()(begin, out + size))
        throw nb::value_error(
            ("out shares memory with " + std::string(name) + "; expected another array").c_str());
}

}  // namespace volillum
