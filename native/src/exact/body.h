// The medium as the judge holds it: fields that share their bricks, and depths along rays.
#pragma once

#include <array>
#include <limits>
#include <optional>

#include "volillum/cell_walk.h"
#include "volillum/exact.h"

namespace volillum::exact {

// Beyond this depth a ray contributes less than 4e-44 of its radiance and is not followed on.
inline constexpr double opaque_depth = 100.0;

template <std::size_t Channels>
using Depth = std::array<double, Channels>;

template <std::size_t Channels>
VOLILLUM_INLINE double least(const Depth<Channels> &depth) {
    double result = depth[0];
    for (std::size_t c = 1; c < Channels; ++c) result = std::min(result, depth[c]);
    return result;
}

template <std::size_t Channels>
VOLILLUM_INLINE bool is_opaque(const Depth<Channels> &depth) {
    return least<Channels>(depth) > opaque_depth;
}

// Channel of the extinction that colour `rgb` sees.
template <std::size_t Channels>
constexpr std::size_t channel_of(std::size_t rgb) {
    return Channels == 1 ? 0 : rgb;
}

struct Body {
    Lattice lattice;
    Bricks bricks;
    Field sigma_t;
    std::optional<Field> sigma_s, emission, occluder, outward;

    explicit Body(const Medium &medium, const Equation &equation = {})
        : lattice(medium.lattice),
          bricks(medium.shape,
                 {medium.sigma_t, medium.emission, equation.occluder, equation.outward}),
          sigma_t(load(medium.sigma_t)) {
        const auto set = [&](std::optional<Field> &field, const Planes &planes) {
            if (planes.channels > 0) field.emplace(load(planes));
        };
        set(sigma_s, medium.sigma_s);
        set(emission, medium.emission);
        set(occluder, equation.occluder);
        set(outward, equation.outward);
    }

    VOLILLUM_INLINE LatticeRay ray(const Vec3 &origin, const Vec3 &direction) const {
        return {lattice.point(origin), lattice.vector(direction)};
    }

    // Optical depths of a ray of length `radius`, or of as much of it as exceeds `limit` in all.
    template <std::size_t Channels>
    VOLILLUM_INLINE Depth<Channels> depth(const LatticeRay &along, double radius,
                                          double limit) const {
        Depth<Channels> total{};
        walk_cells(bricks, along, radius, [&](const Cell &cell, double t0, double t1) {
            for (std::size_t c = 0; c < Channels; ++c)
                total[c] += cell_depth<Channels>(sigma_t, along, cell, t0, t1, c);
            return least<Channels>(total) <= limit;
        });
        return total;
    }

private:
    Field load(const Planes &planes) const {
        const Size3 &shape = bricks.shape();
        Field field(bricks, planes.channels);
        for (std::size_t c = 0; c < planes.channels; ++c)
            field.set(bricks, c, planes.values + c * shape[0] * shape[1] * shape[2]);
        return field;
    }
};

VOLILLUM_INLINE double largest(const Vec3 &v) {
    return std::max(v[0], std::max(v[1], v[2]));
}

// RGB of a field with one channel or three.
VOLILLUM_INLINE Vec3 colour_at(const Field &field, const Cell &cell, const Vec3 &q) {
    Vec3 rgb;
    field.interpolate(cell, q, rgb.data());
    if (field.channels() == 1) rgb[1] = rgb[2] = rgb[0];
    return rgb;
}

VOLILLUM_INLINE Vec3 times(const Vec3 &a, const Vec3 &b) {
    return {a[0] * b[0], a[1] * b[1], a[2] * b[2]};
}

}  // namespace volillum::exact
