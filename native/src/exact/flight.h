// Free flights of a random walk by regular tracking: the depth of every cell is exact, and the cell
// that holds the collision is solved for its place. No majorant, no rejected collisions.
#pragma once

#include "body.h"
#include "sampling.h"

namespace volillum::exact {

// Where a flight ended: at a collision, or at the end of the last piece with matter.
struct Collision {
    bool happened = false;
    double t = 0.0, depth = 0.0;
    Cell cell{};
};

// sigma(s) = c0 + c1 s + c2 s^2 + c3 s^3 of one channel over the piece [t0, t1], s from 0 to 1.
template <std::size_t Channels>
VOLILLUM_INLINE std::array<double, 4> piece_cubic(const Field &field, const LatticeRay &ray,
                                                  const Cell &cell, double t0, double t1,
                                                  std::size_t channel) {
    std::array<double, 4> f;  // at s = 0, 1/3, 2/3, 1
    for (std::size_t i = 0; i < 4; ++i) {
        std::array<double, Channels> value;
        field.interpolate(cell, ray.at(t0 + double(i) / 3.0 * (t1 - t0)), value.data());
        f[i] = value[channel];
    }
    return {f[0], 0.5 * (-11.0 * f[0] + 18.0 * f[1] - 9.0 * f[2] + 2.0 * f[3]),
            4.5 * (2.0 * f[0] - 5.0 * f[1] + 4.0 * f[2] - f[3]),
            4.5 * (-f[0] + 3.0 * f[1] - 3.0 * f[2] + f[3])};
}

// The s in [0, 1] up to which the cubic's integral is `target`: Newton's method inside a bracket,
// bisection where it would leave it.
VOLILLUM_INLINE double invert_integral(const std::array<double, 4> &c, double target) {
    const double total = c[0] + c[1] / 2.0 + c[2] / 3.0 + c[3] / 4.0;
    double low = 0.0, high = 1.0, s = std::min(1.0, target / total);
    for (int iteration = 0; iteration < 60; ++iteration) {
        const double sigma = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        const double excess =
            s * (c[0] + s * (c[1] / 2.0 + s * (c[2] / 3.0 + s * c[3] / 4.0))) - target;
        (excess < 0.0 ? low : high) = s;
        double next = sigma > 0.0 ? s - excess / sigma : low;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        // Far below what the float32 voxel values resolve.
        const bool settled = std::abs(next - s) <= 1e-12 * s;
        s = next;
        if (settled) break;
    }
    return s;
}

// Follows the ray to the point where the depth of `channel` is `target`, or to t_max or the border;
// `passed(cell, t0, t1)` is told of every piece on the way.
template <std::size_t Channels, class Passed>
VOLILLUM_INLINE Collision fly(const Body &body, const LatticeRay &ray, double t_max, double target,
                              std::size_t channel, Passed &&passed) {
    Collision collision;
    walk_cells(body.bricks, ray, t_max, [&](const Cell &cell, double t0, double t1) {
        const double gain = cell_depth<Channels>(body.sigma_t, ray, cell, t0, t1, channel);
        collision.cell = cell;
        if (collision.depth + gain <= target) {
            collision.depth += gain;
            collision.t = t1;
            passed(cell, t0, t1);
            return true;
        }
        const auto cubic = piece_cubic<Channels>(body.sigma_t, ray, cell, t0, t1, channel);
        const double rest = (target - collision.depth) / (t1 - t0);
        collision.happened = true;
        collision.t = t0 + (t1 - t0) * invert_integral(cubic, rest);
        collision.depth = target;
        passed(cell, t0, collision.t);
        return false;
    });
    return collision;
}

template <std::size_t Channels>
VOLILLUM_INLINE double sigma_t_at(const Body &body, const LatticeRay &ray,
                                  const Collision &collision, std::size_t channel) {
    std::array<double, Channels> sigma_t;
    body.sigma_t.interpolate(collision.cell, ray.at(collision.t), sigma_t.data());
    return sigma_t[channel];
}

// What scatters where a flight of `channel` ended: of grey extinction all colours, otherwise that
// one colour three times.
template <std::size_t Channels>
VOLILLUM_INLINE Vec3 sigma_s_at(const Body &body, const LatticeRay &ray, const Collision &collision,
                                std::size_t channel) {
    const Vec3 rgb = colour_at(*body.sigma_s, collision.cell, ray.at(collision.t));
    return Channels == 1 ? rgb : Vec3{rgb[channel], rgb[channel], rgb[channel]};
}

template <std::size_t Channels>
VOLILLUM_INLINE Vec3 albedo_at(const Body &body, const LatticeRay &ray, const Collision &collision,
                               std::size_t channel) {
    const double sigma_t = sigma_t_at<Channels>(body, ray, collision, channel);
    if (!(sigma_t > 0.0)) return {};  // rounding at the very edge of matter
    return (1.0 / sigma_t) * sigma_s_at<Channels>(body, ray, collision, channel);
}

// Russian roulette: walks of little weight end, or go on with the weight of those that ended.
// False: it ended.
VOLILLUM_INLINE bool survives(Vec3 &weight, Random &random) {
    constexpr double small = 0.25, kept = 0.5;
    const double most = largest(weight);
    if (most >= small) return true;
    if (!(random.next() * kept < most)) return false;
    weight = (kept / most) * weight;
    return true;
}

}  // namespace volillum::exact
