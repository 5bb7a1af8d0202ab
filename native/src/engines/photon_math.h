// Random numbers and elementary functions of the photon engine, inlined into its kernels.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "volillum/cpu.h"

namespace volillum {

// One stream a photon, started from a hash of what the photon is, so that results depend on no
// thread. The generator is xoshiro128++ (Blackman and Vigna 2021, public domain; it passes BigCrush
// and PractRand): its 32-bit steps are also those of vector code, one photon a lane.
class Random {
public:
    using State = std::array<std::uint32_t, 4>;

    VOLILLUM_INLINE Random() = default;
    VOLILLUM_INLINE explicit Random(const State &state) : state_(state) {}
    VOLILLUM_INLINE Random(std::uint64_t key, std::uint64_t number) {
        const std::uint64_t low = mix(key + number * kWeyl), high = mix(low + kWeyl);
        state_ = {std::uint32_t(low), std::uint32_t(low >> 32), std::uint32_t(high),
                  std::uint32_t(high >> 32)};
    }
    VOLILLUM_INLINE const State &state() const { return state_; }

    VOLILLUM_INLINE std::uint32_t next() {
        return step(state_[0], state_[1], state_[2], state_[3]);
    }
    // Uniform in [0, 1), 53 bits.
    VOLILLUM_INLINE double unit() {
        const std::uint64_t high = next();
        return double((high << 32 | next()) >> 11) * 0x1p-53;
    }

    // The generator's step, of one state or of a vector of them.
    template <class Word>
    static VOLILLUM_INLINE Word step(Word &a, Word &b, Word &c, Word &d) {
        const Word sum = a + d, result = (sum << 7 | sum >> 25) + a, shifted = b << 9;
        c ^= a;
        d ^= b;
        b ^= c;
        a ^= d;
        c ^= shifted;
        d = d << 11 | d >> 21;
        return result;
    }

    // The finaliser of splitmix64.
    static VOLILLUM_INLINE std::uint64_t mix(std::uint64_t z) {
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return z ^ (z >> 31);
    }

private:
    static constexpr std::uint64_t kWeyl = 0x9e3779b97f4a7c15u;
    State state_{};
};

// A random word as a uniform in [0, 1), 24 bits.
VOLILLUM_INLINE float unit_of(std::uint32_t word) {
    return float(std::int32_t(word >> 8)) * 0x1p-24f;
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

// sqrt(4 pi) Y_lm for l <= 2, in the order and signs of core/harmonics.py: the first is 1.
VOLILLUM_INLINE void harmonics(float x, float y, float z, float *out) {
    constexpr float a = 1.7320508075688772f, b = 3.872983346207417f, c = 1.118033988749895f;
    out[0] = 1.0f;
    out[1] = a * y;
    out[2] = a * z;
    out[3] = a * x;
    out[4] = b * x * y;
    out[5] = b * y * z;
    out[6] = c * (3.0f * z * z - 1.0f);
    out[7] = b * x * z;
    out[8] = 0.5f * b * (x * x - y * y);
}

}  // namespace volillum
