// Randomised quasi-Monte-Carlo: hashed rotations of the R2 lattice, directions in a cone, and the
// spherical harmonics that radiance is given in.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "volillum/trilinear.h"

namespace volillum::exact {

// splitmix64's finaliser (Steele, Lea, Flood 2014): every output bit depends on every input bit.
VOLILLUM_INLINE std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}
VOLILLUM_INLINE std::uint64_t hash(std::uint64_t seed, std::uint64_t value) {
    return mix(seed + 0x9e3779b97f4a7c15u * (value + 1));
}
VOLILLUM_INLINE double uniform(std::uint64_t bits) {
    return double(bits >> 11) * 0x1p-53;
}

// A stream of pseudo-random numbers in [0, 1): splitmix64.
struct Random {
    std::uint64_t state;

    VOLILLUM_INLINE double next() { return uniform(mix(state += 0x9e3779b97f4a7c15u)); }
    // Of an exponential distribution of mean 1; finite, because next() stays below 1.
    VOLILLUM_INLINE double exponential() { return -std::log1p(-next()); }
};

VOLILLUM_INLINE double fraction(double x) {
    return x - double(std::int64_t(x));
}

// Point `i` of the R2 lattice (Roberts 2018: the plastic number's powers) rotated by a uniformly
// random vector (Cranley and Patterson 1976): each point alone is uniform, so means are unbiased.
struct RotatedLattice {
    double shift_u, shift_v, shift_w;

    VOLILLUM_INLINE explicit RotatedLattice(std::uint64_t key)
        : shift_u(uniform(hash(key, 0))),
          shift_v(uniform(hash(key, 1))),
          shift_w(uniform(hash(key, 2))) {}
    VOLILLUM_INLINE double u(std::size_t i) const {
        return fraction(shift_u + double(i) * 0.7548776662466927600495);
    }
    VOLILLUM_INLINE double v(std::size_t i) const {
        return fraction(shift_v + double(i) * 0.5698402909980532659114);
    }
    // A third number, by the golden ratio.
    VOLILLUM_INLINE double w(std::size_t i) const {
        return fraction(shift_w + double(i) * 0.6180339887498948482046);
    }
};

VOLILLUM_INLINE double dot(const Vec3 &a, const Vec3 &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Two unit vectors that complete `axis` to a frame (Duff et al. 2017).
struct Frame {
    Vec3 x, y, z;

    VOLILLUM_INLINE explicit Frame(const Vec3 &axis) : z(axis) {
        const double sign = std::copysign(1.0, z[2]);
        const double a = -1.0 / (sign + z[2]), b = z[0] * z[1] * a;
        x = {1.0 + sign * z[0] * z[0] * a, sign * b, -sign * z[0]};
        y = {b, sign + z[1] * z[1] * a, -z[1]};
    }
    // Uniform in solid angle over the cone about z. 1 - cos is kept, not cos: narrow cones.
    VOLILLUM_INLINE Vec3 cone(double cos_theta, double u, double v) const {
        return about(u * (1.0 - cos_theta), v);
    }
    // In proportion to cos^beta over the cone about z, at most a half space: cos^(beta + 1) is
    // uniform from cos_theta^(beta + 1) to 1.
    VOLILLUM_INLINE Vec3 phong(double cos_theta, double beta, double u, double v) const {
        const double power = beta + 1.0;
        const double span = std::expm1(power * std::log1p(cos_theta - 1.0));
        return about(-std::expm1(std::log1p(u * span) / power), v);
    }
    VOLILLUM_INLINE Vec3 about(double drop, double v) const {
        const double radial = std::sqrt(drop * (2.0 - drop)), phi = 2.0 * std::numbers::pi * v;
        return (radial * std::cos(phi)) * x + (radial * std::sin(phi)) * y + (1.0 - drop) * z;
    }
};

// Real orthonormal Y_lm at index l (l + 1) + m, without the Condon-Shortley sign: Y_1 is
// sqrt(3 / 4 pi) (y, z, x).
VOLILLUM_INLINE void spherical_harmonics(const Vec3 &w, std::size_t count, double *out) {
    using std::numbers::pi;
    const double x = w[0], y = w[1], z = w[2];
    out[0] = std::sqrt(1.0 / (4.0 * pi));
    if (count > 1) {
        const double c = std::sqrt(3.0 / (4.0 * pi));
        out[1] = c * y;
        out[2] = c * z;
        out[3] = c * x;
    }
    if (count > 4) {
        const double c = std::sqrt(15.0 / (4.0 * pi));
        out[4] = c * x * y;
        out[5] = c * y * z;
        out[6] = std::sqrt(5.0 / (16.0 * pi)) * (3.0 * z * z - 1.0);
        out[7] = c * x * z;
        out[8] = 0.5 * c * (x * x - y * y);
    }
    if (count > 9) {
        const double c3 = std::sqrt(35.0 / (32.0 * pi)), c2 = std::sqrt(105.0 / (4.0 * pi)),
                     c1 = std::sqrt(21.0 / (32.0 * pi)), c0 = std::sqrt(7.0 / (16.0 * pi));
        out[9] = c3 * y * (3.0 * x * x - y * y);
        out[10] = c2 * x * y * z;
        out[11] = c1 * y * (5.0 * z * z - 1.0);
        out[12] = c0 * z * (5.0 * z * z - 3.0);
        out[13] = c1 * x * (5.0 * z * z - 1.0);
        out[14] = 0.5 * c2 * z * (x * x - y * y);
        out[15] = c3 * x * (x * x - 3.0 * y * y);
    }
}

// Mean and standard error of the mean of `replicates` independent estimates of RGB.
class Replicates {
public:
    VOLILLUM_INLINE void add(const Vec3 &value) {
        ++count_;
        for (std::size_t c = 0; c < 3; ++c) {  // Welford: no cancellation
            const double delta = value[c] - mean_[c];
            mean_[c] += delta / double(count_);
            squares_[c] += delta * (value[c] - mean_[c]);
        }
    }
    double mean(std::size_t c) const { return mean_[c]; }
    double standard_error(std::size_t c) const {
        return std::sqrt(squares_[c] / (double(count_) * double(count_ - 1)));
    }

private:
    std::size_t count_ = 0;
    Vec3 mean_{}, squares_{};
};

}  // namespace volillum::exact
