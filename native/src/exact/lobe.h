// The lobes that light is gathered in, as they stand at a point.
#pragma once

#include <algorithm>
#include <limits>

#include "sampling.h"
#include "volillum/exact.h"

namespace volillum::exact {

// A lobe at one point: its frame, and how far away what its axis points to is.
struct LobeAt {
    Frame frame;
    double distance;
};

// One term as it is evaluated: its fixed frame, if it has one, and its angular radiance.
class Lobe {
public:
    explicit Lobe(const Term &term) : term_(term), frame_(Vec3{0.0, 0.0, 1.0}) {
        const double norm = length(term.axis);
        if (term.toward == Term::Toward::direction && term.cos_theta > -1.0 && norm > 0.0)
            frame_ = Frame((1.0 / norm) * term.axis);
    }
    // Directions that `wanted` samples come down to: a lobe without width needs only one.
    std::size_t samples(std::size_t wanted) const { return term_.cos_theta >= 1.0 ? 1 : wanted; }

    VOLILLUM_INLINE LobeAt at(const Vec3 &point) const {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        if (term_.toward == Term::Toward::direction || term_.cos_theta <= -1.0)
            return {frame_, infinity};
        const Vec3 to_axis = term_.axis - point;
        const double distance = length(to_axis);
        // At the axis point itself any direction is as right as another.
        return {distance > 0.0 ? Frame((1.0 / distance) * to_axis) : frame_, distance};
    }
    VOLILLUM_INLINE Vec3 direction(const LobeAt &at, double u, double v, double beta = 0.0) const {
        return beta == 0.0 ? at.frame.cone(term_.cos_theta, u, v)
                           : at.frame.phong(term_.cos_theta, beta, u, v);
    }
    // How far a ray sees: to where it is nearest to the lamp, and beyond it leads away from it.
    VOLILLUM_INLINE double reach(const LobeAt &at, const Vec3 &direction) const {
        if (term_.toward != Term::Toward::lamp) return std::numeric_limits<double>::infinity();
        return at.distance * std::max(0.0, dot(at.frame.z, direction));
    }
    // The lamp's fall-off with distance; 1 of everything else.
    VOLILLUM_INLINE double falloff(const LobeAt &at) const {
        if (term_.toward != Term::Toward::lamp) return 1.0;
        return 1.0 / std::max(at.distance * at.distance, std::numeric_limits<double>::min());
    }
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

}  // namespace volillum::exact
