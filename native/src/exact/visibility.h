// In-scattered radiance at one point from rays in the lobes of all terms.
#pragma once

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <vector>

#include "sampling.h"
#include "volillum/cell_walk.h"
#include "volillum/exact.h"

namespace volillum::exact {

// Beyond this depth a ray contributes less than 4e-44 of its radiance and is not followed on.
inline constexpr double opaque_depth = 100.0;

template <std::size_t Channels>
using Depth = std::array<double, Channels>;

template <std::size_t Channels>
VOLILLUM_INLINE bool is_opaque(const Depth<Channels> &depth) {
    double least = depth[0];
    for (std::size_t c = 1; c < Channels; ++c) least = std::min(least, depth[c]);
    return least > opaque_depth;
}

// Channel of the extinction that colour `rgb` sees.
template <std::size_t Channels>
constexpr std::size_t channel_of(std::size_t rgb) {
    return Channels == 1 ? 0 : rgb;
}

struct Extinction {
    Lattice lattice;
    Bricks bricks;
    Field field;

    // `emission` only widens the bricks, so that its own field can share them.
    Extinction(const Lattice &map, const Size3 &shape, const Planes &sigma_t,
               const Planes &emission = {})
        : lattice(map), bricks(shape, {sigma_t, emission}), field(load(bricks, sigma_t)) {}

    static Field load(const Bricks &bricks, const Planes &planes) {
        const Size3 &shape = bricks.shape();
        Field field(bricks, planes.channels);
        for (std::size_t c = 0; c < planes.channels; ++c)
            field.set(bricks, c, planes.values + c * shape[0] * shape[1] * shape[2]);
        return field;
    }

    template <std::size_t Channels>
    VOLILLUM_INLINE Depth<Channels> depth(const LatticeRay &ray, double radius,
                                          double limit) const {
        Depth<Channels> total{};
        walk_cells(bricks, ray, radius, [&](const Cell &cell, double t0, double t1) {
            for (std::size_t c = 0; c < Channels; ++c)
                total[c] += cell_depth<Channels>(field, ray, cell, t0, t1, c);
            double least = total[0];
            for (std::size_t c = 1; c < Channels; ++c) least = std::min(least, total[c]);
            return least <= limit;
        });
        return total;
    }
};

// One term as it is evaluated: its fixed frame, if it has one, and its angular radiance.
class Lobe {
public:
    explicit Lobe(const Term &term) : term_(term), frame_(Vec3{0.0, 0.0, 1.0}) {
        const double norm = length(term.axis);
        if (!term.local && term.cos_theta > -1.0 && norm > 0.0)
            frame_ = Frame((1.0 / norm) * term.axis);
    }
    // Directions that `wanted` samples come down to: a lobe without width needs only one.
    std::size_t samples(std::size_t wanted) const { return term_.cos_theta >= 1.0 ? 1 : wanted; }

    VOLILLUM_INLINE Frame frame(const Vec3 &point) const {
        if (!term_.local || term_.cos_theta <= -1.0) return frame_;
        const Vec3 to_axis = term_.axis - point;
        const double distance = length(to_axis);
        // At the axis point itself any direction is as right as another.
        return distance > 0.0 ? Frame((1.0 / distance) * to_axis) : frame_;
    }
    double cos_theta() const { return term_.cos_theta; }

    VOLILLUM_INLINE Vec3 radiance(const Vec3 &direction) const {
        std::array<double, 16> basis;
        const std::size_t count = term_.radiance.size();
        spherical_harmonics(direction, count, basis.data());
        Vec3 sum{};
        for (std::size_t i = 0; i < count; ++i) sum = sum + basis[i] * term_.radiance[i];
        return sum;
    }

private:
    const Term &term_;
    Frame frame_;
};

// One estimate of the in-scattered radiance at `point`: samples [first, first + directions) of each
// term's rotated lattice.
template <std::size_t Channels>
VOLILLUM_INLINE Vec3 estimate_in_scattered(const Extinction &extinction,
                                           const std::vector<Lobe> &lobes, const Vec3 &point,
                                           double radius, std::size_t directions, std::size_t first,
                                           std::uint64_t key) {
    LatticeRay ray{extinction.lattice.point(point), {}};
    Vec3 sum{};
    for (std::size_t term = 0; term < lobes.size(); ++term) {
        const Lobe &lobe = lobes[term];
        const RotatedLattice lattice(hash(key, term));
        const Frame frame = lobe.frame(point);
        const std::size_t samples = lobe.samples(directions);
        Vec3 mean{};
        for (std::size_t i = first; i < first + samples; ++i) {
            const Vec3 direction = frame.cone(lobe.cos_theta(), lattice.u(i), lattice.v(i));
            ray.direction = extinction.lattice.vector(direction);
            const Depth<Channels> depth = extinction.depth<Channels>(ray, radius, opaque_depth);
            const Vec3 radiance = lobe.radiance(direction);
            Depth<Channels> transmittance;
            for (std::size_t c = 0; c < Channels; ++c) transmittance[c] = std::exp(-depth[c]);
            for (std::size_t c = 0; c < 3; ++c)
                mean[c] += radiance[c] * transmittance[channel_of<Channels>(c)];
        }
        sum = sum + (1.0 / double(samples)) * mean;
    }
    return sum;
}

}  // namespace volillum::exact
