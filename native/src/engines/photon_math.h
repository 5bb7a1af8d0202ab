// Random numbers and elementary functions of the photon engine, inlined into its kernels.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#include "volillum/cpu.h"

namespace volillum {

__extension__ using Wide = unsigned __int128;

// One stream a photon, started from a hash of what the photon is, so that results depend on no
// thread. The generator is wyrand (Wang Yi, public domain): a Weyl sequence through one 128-bit
// product; it passes BigCrush and PractRand.
class Random {
public:
    VOLILLUM_INLINE Random() = default;
    VOLILLUM_INLINE Random(std::uint64_t key, std::uint64_t number)
        : state_(mix(key + number * 0x9e3779b97f4a7c15u)) {}

    VOLILLUM_INLINE std::uint64_t next() {
        state_ += 0xa0761d6478bd642fu;
        const Wide product = Wide(state_) * (state_ ^ 0xe7037ed1a0b428dbu);
        return std::uint64_t(product >> 64) ^ std::uint64_t(product);
    }
    // Uniform in [0, 1).
    VOLILLUM_INLINE double unit() { return double(next() >> 11) * 0x1p-53; }

    // The finaliser of splitmix64.
    static VOLILLUM_INLINE std::uint64_t mix(std::uint64_t z) {
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return z ^ (z >> 31);
    }

private:
    std::uint64_t state_ = 0;
};

// The high and low half of one random word as uniforms in [0, 1), 24 bits each.
VOLILLUM_INLINE float high_unit(std::uint64_t word) {
    return float(word >> 40) * 0x1p-24f;
}
VOLILLUM_INLINE float low_unit(std::uint64_t word) {
    return float(std::uint32_t(word) >> 8) * 0x1p-24f;
}

// -log of a uniform in (0, 1] made of 32 random bits: an exponential variate up to 22.9, relative
// error 1e-6. Polynomial as in Cephes' logf (S. Moshier).
VOLILLUM_INLINE float exponential(std::uint32_t bits) {
    const float u = float(bits) + 0.5f;  // times 2^-32
    const std::int32_t raw = std::bit_cast<std::int32_t>(u);
    // Mantissa in [sqrt(1/2), sqrt(2)).
    const std::int32_t shifted = raw - 0x3f3504f3;
    const std::int32_t exponent = shifted >> 23;
    const float m = std::bit_cast<float>((shifted & 0x007fffff) + 0x3f3504f3) - 1.0f;
    float p = 7.0376836292e-2f;
    p = p * m - 1.1514610310e-1f;
    p = p * m + 1.1676998740e-1f;
    p = p * m - 1.2420140846e-1f;
    p = p * m + 1.4249322787e-1f;
    p = p * m - 1.6668057665e-1f;
    p = p * m + 2.0000714765e-1f;
    p = p * m - 2.4999993993e-1f;
    p = p * m + 3.3333331174e-1f;
    const float squared = m * m;
    const float log_m = m + squared * (m * p - 0.5f);
    const float result = float(32 - exponent) * 0.693147180559945f - log_m;
    return result > 0.0f ? result : 0.0f;
}

// Sine and cosine of 2 pi turn, turn in [0, 1]; error below 1e-6.
VOLILLUM_INLINE void sine_cosine(float turn, float &sine, float &cosine) {
    const float quarters = 4.0f * turn;
    const int quadrant = int(quarters + 0.5f);
    const float r = (quarters - float(quadrant)) * 1.57079632679490f, r2 = r * r;
    const float s =
        r + r * r2 * (-1.6666654611e-1f + r2 * (8.3321608736e-3f - r2 * 1.9515295891e-4f));
    const float c =
        1.0f - 0.5f * r2 +
        r2 * r2 *
            (4.166664568298827e-2f + r2 * (-1.388731625493765e-3f + r2 * 2.443315711809948e-5f));
    const bool swapped = quadrant & 1;
    sine = swapped ? c : s;
    cosine = swapped ? s : c;
    if (quadrant & 2) sine = -sine;
    if ((quadrant + 1) & 2) cosine = -cosine;
}

// Cosine of the Henyey-Greenstein angle for a uniform u: the inverse of the distribution, written
// so that it has no cancellation at g = 0.
VOLILLUM_INLINE float henyey_greenstein_cosine(float g, float u) {
    const float s = 2.0f * u - 1.0f, t = 1.0f + g * s;
    const float cosine =
        (s + 0.5f * g * (3.0f + s * s) + g * g * s + 0.5f * g * g * g * (s * s - 1.0f)) / (t * t);
    return cosine > 1.0f ? 1.0f : cosine < -1.0f ? -1.0f : cosine;
}

// `direction` (unit) turned by the angle of the given cosine, about a random azimuth (turns).
VOLILLUM_INLINE void turn_direction(float *direction, float cosine, float azimuth) {
    float s, c;
    sine_cosine(azimuth, s, c);
    const float sine2 = 1.0f - cosine * cosine;
    const float sine = std::sqrt(sine2 > 0.0f ? sine2 : 0.0f);
    const float x = direction[0], y = direction[1], z = direction[2];
    // Orthonormal basis of Duff et al. 2017.
    const float sign = z >= 0.0f ? 1.0f : -1.0f;
    const float a = -1.0f / (sign + z), b = x * y * a;
    const float u = sine * c, v = sine * s;
    float turned[3] = {u * (1.0f + sign * x * x * a) + v * b + cosine * x,
                       u * (sign * b) + v * (sign + y * y * a) + cosine * y,
                       -u * (sign * x) - v * y + cosine * z};
    const float scale =
        1.0f / std::sqrt(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2]);
    for (int i = 0; i < 3; ++i) direction[i] = turned[i] * scale;
}

VOLILLUM_INLINE void uniform_direction(float *direction, float u, float azimuth) {
    float s, c;
    sine_cosine(azimuth, s, c);
    const float z = 1.0f - 2.0f * u, sine2 = 1.0f - z * z;
    const float sine = std::sqrt(sine2 > 0.0f ? sine2 : 0.0f);
    direction[0] = sine * c;
    direction[1] = sine * s;
    direction[2] = z;
}

}  // namespace volillum
