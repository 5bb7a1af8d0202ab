// The number type of the kernels. One alias, so that a build in double precision
// (-DVOLILLUM_REAL=double) can tell rounding from discretisation.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "volillum/cpu.h"

#ifndef VOLILLUM_REAL
#define VOLILLUM_REAL float
#endif

namespace volillum {

using Real = VOLILLUM_REAL;
using Index3 = std::array<int, 3>;
using Vec3d = std::array<double, 3>;

// Lengths of rows that kernels loop over are rounded up to this many numbers, so that every loop
// is whole vectors (a cache line, 16 float lanes of AVX-512) and no remainder is computed in
// another order.
constexpr int kLanes = 16;
constexpr int round_up(int count) {
    return (count + kLanes - 1) / kLanes * kLanes;
}

// Buffers of kernels start on a cache line: vectors that straddle lines take twice the time.
template <class T>
struct LineAllocator {
    using value_type = T;
    static constexpr std::align_val_t line{64};
    LineAllocator() = default;
    template <class U>
    LineAllocator(const LineAllocator<U> &) {}
    T *allocate(std::size_t count) {
        return static_cast<T *>(::operator new(count * sizeof(T), line));
    }
    void deallocate(T *pointer, std::size_t) { ::operator delete(pointer, line); }
    friend bool operator==(const LineAllocator &, const LineAllocator &) { return true; }
};
using Reals = std::vector<Real, LineAllocator<Real>>;

// exp(-x) for x >= 0 without branches, so that loops over it become vector code. Relative error
// below 2e-7; exactly 0 from x = 87 on, where the result would become denormal (and slow).
// Range reduction and polynomial as in Cephes' expf (S. Moshier).
VOLILLUM_INLINE float exp_negative(float x) {
    constexpr float log2_e = 1.44269504088896341f;
    constexpr float ln2_high = 0.693359375f, ln2_low = -2.12194440e-4f;
    constexpr float round_magic = 12582912.0f;  // 1.5 * 2^23: adding it rounds to an integer
    const float y = x < 87.0f ? -x : -87.0f;
    const float shifted = y * log2_e + round_magic;
    const float n = shifted - round_magic;
    const float r = (y - n * ln2_high) - n * ln2_low;
    float p = 1.9875691500e-4f;
    p = p * r + 1.3981999507e-3f;
    p = p * r + 8.3334519073e-3f;
    p = p * r + 4.1665795894e-2f;
    p = p * r + 1.6666665459e-1f;
    p = p * r + 5.0000001201e-1f;
    p = p * (r * r) + r + 1.0f;
    // The low bits of `shifted` are n; moved into the exponent they multiply p by 2^n.
    const float value = std::bit_cast<float>(std::bit_cast<std::uint32_t>(p) +
                                             (std::bit_cast<std::uint32_t>(shifted) << 23));
    return x < 87.0f ? value : 0.0f;
}
VOLILLUM_INLINE double exp_negative(double x) {
    return x < 700.0 ? std::exp(-x) : 0.0;
}

}  // namespace volillum
