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

// The fields of a dict; every key must be known.
class FieldReader {
public:
    FieldReader(nb::dict fields, std::string name)
        : fields_(std::move(fields)), name_(std::move(name)) {}

    nb::object take(const char *key) {
        known_.emplace_back(key);
        if (!fields_.contains(key)) fail(name_ + " has no key '" + key + "'");
        return fields_[key];
    }
    std::string label(const char *key) const { return name_ + "'s " + key; }
    double number(const char *key, double low, double high) {
        double value = 0.0;
        if (!nb::try_cast(take(key), value) || !(value >= low && value <= high))
            fail(label(key) + " is not a number from " + std::to_string(low) + " to " +
                 std::to_string(high));
        return value;
    }
    Vec3 vector(const char *key) { return as_vector(take(key), label(key)); }
    std::size_t one_of(const char *key, const std::vector<std::string> &choices) {
        return choice(take(key), label(key), choices);
    }
    void refuse_others() const {
        for (const auto &[key, value] : fields_)
            if (std::find(known_.begin(), known_.end(), nb::str(key).c_str()) == known_.end())
                fail(name_ + " has the unknown key " + nb::repr(key).c_str());
    }

private:
    nb::dict fields_;
    std::string name_;
    std::vector<std::string> known_;
};

// What a dict says of the equation. Keeps the arrays alive.
class EquationReader {
public:
    EquationReader(const nb::dict &fields, const nb::list &terms, double radius,
                   const exact::Medium &medium)
        : fields_(fields, "equation"), medium_(medium) {
        require_radius(radius);
        equation_.terms = terms_of(terms);
        equation_.radius = radius;
        using Kind = exact::Equation::Kind;
        equation_.kind = Kind(
            fields_.one_of("kind", {"gather", "scattered", "occluded", "coloured", "transported"}));
        if (equation_.kind == Kind::scattered) require_scattering();
        if (equation_.kind == Kind::occluded) read_occluded();
        if (equation_.kind == Kind::coloured) read_coloured();
        if (equation_.kind == Kind::transported) read_transported();
        fields_.refuse_others();
    }
    const exact::Equation &equation() const { return equation_; }

private:
    static constexpr double infinity = std::numeric_limits<double>::infinity();

    void read_occluded() {
        equation_.occluder = take_planes("occluder", {1, 3});
        if (!fields_.take("outward").is_none()) equation_.outward = take_planes("outward", {3});
        equation_.weight_p = fields_.number("weight_p", 0.0, 2.99);
        equation_.scale = fields_.number("scale", 0.0, infinity);
        if (!std::isfinite(equation_.radius))
            fail("radius is infinite; an equation of this kind needs an end");
    }
    void read_coloured() {
        equation_.beta = fields_.number("beta", 0.0, 1e6);
        equation_.colour = fields_.number("colour", 0.0, 1.0);
        equation_.gathers_emission = fields_.number("emission", 0.0, 1.0) != 0.0;
        equation_.split = fields_.number("split", 0.0, 1.0) != 0.0;
        if (equation_.colour > 0.0) require_scattering();
        for (const exact::Term &term : equation_.terms)
            if (equation_.beta > 0.0 && term.cos_theta < 0.0)
                fail("a lobe with the weight cos^beta is wider than a half space");
    }
    void read_transported() {
        require_scattering();
        equation_.g = fields_.number("g", -0.999, 0.999);
        equation_.gathers_emission = fields_.number("emission", 0.0, 1.0) != 0.0;
        nb::list lights;
        if (!nb::try_cast(fields_.take("lights"), lights)) fail("equation's lights is not a list");
        for (nb::handle item : lights) {
            const std::string name = "lights[" + std::to_string(equation_.lights.size()) + "]";
            nb::dict light;
            if (!nb::try_cast(item, light)) fail(name + " is not a dict");
            equation_.lights.push_back(read_light(FieldReader(light, name)));
        }
    }
    exact::Light read_light(FieldReader fields) {
        exact::Light light{};
        using Kind = exact::Light::Kind;
        light.kind = Kind(fields.one_of("kind", {"distant", "lamp", "constant", "image"}));
        light.share = fields.number("share", 1e-9, infinity);
        if (light.kind == Kind::image)
            read_image(fields, light);
        else
            light.colour = fields.vector("colour");
        if (light.kind == Kind::distant) {
            light.direction = fields.vector("direction");
            light.cos_angle = fields.number("cos_angle", -1.0, 1.0);
        }
        if (light.kind == Kind::lamp) {
            light.position = fields.vector("position");
            light.shape = exact::Light::Shape(fields.one_of("shape", {"point", "spot", "flat"}));
            if (light.shape != exact::Light::Shape::point)
                light.direction = fields.vector("direction");
            if (light.shape == exact::Light::Shape::spot) {
                light.cos_angle = fields.number("cos_angle", -1.0, 1.0);
                light.blend = fields.number("blend", 0.0, 2.0);
            }
            if (light.shape == exact::Light::Shape::flat) {
                light.half_extent = {fields.vector("half_width"), fields.vector("half_height")};
                light.ellipse = fields.number("ellipse", 0.0, 1.0) != 0.0;
            }
        }
        fields.refuse_others();
        return light;
    }
    void read_image(FieldReader &fields, exact::Light &light) {
        const DoubleArray image = as_doubles(fields.take("image"), fields.label("image"));
        const DoubleArray turn = as_doubles(fields.take("rotation"), fields.label("rotation"));
        const auto shape = shape_of(image);
        if (shape.size() != 3 || shape[2] != 3 || image.size() == 0)
            fail(fields.label("image") + " has shape " + shape_text(shape) +
                 "; expected (h, w, 3)");
        if (shape_of(turn) != std::vector<std::size_t>{3, 3})
            fail(fields.label("rotation") + " has shape " + shape_text(shape_of(turn)) +
                 "; expected (3, 3)");
        light.image = image.data();
        light.height = shape[0];
        light.width = shape[1];
        light.colour = {1.0, 1.0, 1.0};
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t b = 0; b < 3; ++b) light.rotation[a][b] = turn.data()[3 * a + b];
        images_.push_back(image);
    }
    void require_scattering() const {
        if (medium_.sigma_s.channels == 0)
            fail("sigma_s is None; an equation of this kind needs it");
    }
    exact::Planes take_planes(const char *key, const std::vector<std::size_t> &channels) {
        PlanesArray array;
        if (!nb::try_cast(fields_.take(key), array, false))
            fail(fields_.label(key) + " is not a C-contiguous array of float32");
        require_grid(array, fields_.label(key).c_str(), medium_.shape, channels);
        arrays_.push_back(array);
        return planes(array);
    }

    FieldReader fields_;
    const exact::Medium &medium_;
    std::vector<PlanesArray> arrays_;
    std::vector<DoubleArray> images_;
    exact::Equation equation_;
};

}  // namespace volillum::bindings
