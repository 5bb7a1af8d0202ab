// The equation that the judge solves, read from Python: terms (lobes and their light) and a dict.
#pragma once

#include <nanobind/stl/string.h>

#include <algorithm>
#include <limits>

#include "ray_arguments.h"
#include "volillum/exact.h"

namespace volillum::bindings {

// One of `choices`, by its place among them.
inline std::size_t choice(nb::handle value, const std::string &name,
                   const std::vector<std::string> &choices) {
    std::string found;
    std::string expected;
    if (!nb::try_cast(value, found)) fail(name + " is not a string");
    for (std::size_t i = 0; i < choices.size(); ++i) {
        if (found == choices[i]) return i;
        expected += (i ? ", '" : "'") + choices[i] + "'";
    }
    fail(name + " is '" + found + "'; expected one of " + expected);
}

inline std::vector<exact::Term> terms_of(const nb::list &list) {
    std::vector<exact::Term> terms;
    for (nb::handle item : list) {
        const std::string name = "terms[" + std::to_string(terms.size()) + "]";
        nb::tuple fields;
        if (!nb::try_cast(item, fields) || fields.size() != 4)
            fail(name + " is not a tuple (axis, toward, cos_theta, radiance)");
        exact::Term term;
        term.axis = as_vector(fields[0], name + "'s axis");
        term.toward = exact::Term::Toward(
            choice(fields[1], name + "'s toward", {"direction", "point", "lamp"}));
        if (!nb::try_cast(fields[2], term.cos_theta) ||
            !(term.cos_theta >= -1.0 && term.cos_theta <= 1.0))
            fail(name + "'s cos_theta is not a number from -1 to 1");
        if (term.toward == exact::Term::Toward::direction && term.cos_theta > -1.0 &&
            !(length(term.axis) > 0.0))
            fail(name + "'s axis is zero; expected a direction");
        const DoubleArray radiance = as_doubles(fields[3], name + "'s radiance");
        const auto shape = shape_of(radiance);
        if (shape.size() != 2 || shape[1] != 3 ||
            (shape[0] != 1 && shape[0] != 4 && shape[0] != 9 && shape[0] != 16))
            fail(name + "'s radiance has shape " + shape_text(shape) +
                 "; expected (k, 3), k = 1, 4, 9 or 16");
        for (std::size_t i = 0; i < shape[0]; ++i)
            term.radiance.push_back(
                {radiance.data()[3 * i], radiance.data()[3 * i + 1], radiance.data()[3 * i + 2]});
        terms.push_back(std::move(term));
    }
    return terms;
}

// What a dict says of the equation; every key must be known. Keeps the arrays alive.
class EquationReader {
public:
    EquationReader(const nb::dict &fields, const nb::list &terms, double radius,
                   const exact::Medium &medium)
        : fields_(fields), shape_(medium.shape) {
        require_radius(radius);
        equation_.terms = terms_of(terms);
        equation_.radius = radius;
        using Kind = exact::Equation::Kind;
        equation_.kind = Kind(choice(take("kind"), "equation's kind",
                                     {"gather", "scattered", "occluded", "coloured"}));
        if (equation_.kind == Kind::scattered) require_scattering(medium);
        if (equation_.kind == Kind::occluded) read_occluded();
        if (equation_.kind == Kind::coloured) read_coloured(medium);
        for (const auto &[key, value] : fields_)
            if (std::find(known_.begin(), known_.end(), nb::str(key).c_str()) == known_.end())
                fail("equation has the unknown key " + std::string(nb::repr(key).c_str()));
    }
    const exact::Equation &equation() const { return equation_; }

private:
    void read_occluded() {
        equation_.occluder = take_planes("occluder", {1, 3});
        if (!take("outward").is_none()) equation_.outward = take_planes("outward", {3});
        equation_.weight_p = take_number("weight_p", 0.0, 2.99);
        equation_.scale = take_number("scale", 0.0, std::numeric_limits<double>::infinity());
        if (!std::isfinite(equation_.radius))
            fail("radius is infinite; an equation of this kind needs an end");
    }
    void read_coloured(const exact::Medium &medium) {
        equation_.beta = take_number("beta", 0.0, 1e6);
        equation_.colour = take_number("colour", 0.0, 1.0);
        equation_.gathers_emission = take_number("emission", 0.0, 1.0) != 0.0;
        equation_.split = take_number("split", 0.0, 1.0) != 0.0;
        if (equation_.colour > 0.0) require_scattering(medium);
        for (const exact::Term &term : equation_.terms)
            if (equation_.beta > 0.0 && term.cos_theta < 0.0)
                fail("a lobe with the weight cos^beta is wider than a half space");
    }
    static void require_scattering(const exact::Medium &medium) {
        if (medium.sigma_s.channels == 0)
            fail("sigma_s is None; an equation of this kind needs it");
    }
    nb::object take(const char *key) {
        known_.emplace_back(key);
        if (!fields_.contains(key)) fail(std::string("equation has no key '") + key + "'");
        return fields_[key];
    }
    double take_number(const char *key, double low, double high) {
        double value = 0.0;
        if (!nb::try_cast(take(key), value) || !(value >= low && value <= high))
            fail(std::string("equation's ") + key + " is not a number from " + std::to_string(low) +
                 " to " + std::to_string(high));
        return value;
    }
    exact::Planes take_planes(const char *key, const std::vector<std::size_t> &channels) {
        const std::string name = std::string("equation's ") + key;
        PlanesArray array;
        if (!nb::try_cast(take(key), array, false))
            fail(name + " is not a C-contiguous array of float32");
        require_grid(array, name.c_str(), shape_, channels);
        arrays_.push_back(array);
        return planes(array);
    }

    const nb::dict &fields_;
    Size3 shape_;
    std::vector<std::string> known_;
    std::vector<PlanesArray> arrays_;
    exact::Equation equation_;
};


}  // namespace volillum::bindings
