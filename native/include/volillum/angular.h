// How scattered radiance depends on the direction of the eye. Directions are outward: omega toward
// the light, v toward the eye; the scattering angle's cosine is -omega . v.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "volillum/trilinear.h"

namespace volillum {

// One dependence of a baked volume's terms: Henyey and Greenstein's phase function for light of one
// direction or from one position, or a real spherical harmonic.
struct Angular {
    enum class Kind { direction, position, moment };
    static constexpr std::size_t moments = 9;  // bands 0 to 2

    Kind kind;
    double g;           // direction, position
    Vec3 source;        // unit vector toward the light, or its world position
    std::size_t index;  // moment: l (l + 1) + m
};

// 4 pi times the phase function: 1 for g = 0.
VOLILLUM_INLINE double henyey_greenstein(double g, double cosine) {
    const double base = 1.0 + g * g - 2.0 * g * cosine;
    return (1.0 - g * g) / (base * std::sqrt(base));
}

// Real orthonormal harmonics of bands 0 to 2, without the Condon-Shortley sign, at a unit vector.
VOLILLUM_INLINE std::array<double, Angular::moments> harmonics(const Vec3 &unit) {
    const auto [x, y, z] = unit;
    // sqrt(1 / 4 pi), sqrt(3 / 4 pi), sqrt(15 / 4 pi), sqrt(5 / 16 pi)
    constexpr double band_0 = 0.28209479177387814, band_1 = 0.4886025119029199,
                     band_2 = 1.0925484305920792, axial = 0.31539156525252005;
    return {band_0,
            band_1 * y,
            band_1 * z,
            band_1 * x,
            band_2 * x * y,
            band_2 * y * z,
            axial * (3.0 * z * z - 1.0),
            band_2 * x * z,
            0.5 * band_2 * (x * x - y * y)};
}

}  // namespace volillum
