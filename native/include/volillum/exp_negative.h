// The exponential of the kernels, one pack at a time.
#pragma once

#include <algorithm>
#include <cmath>

#include "volillum/pack.h"

namespace volillum {

// An optical depth times this is the negative logarithm of its transmittance to the base 2.
constexpr double kLog2E = 1.44269504088896340736;

namespace exp_detail {

// 2^r for r in [-1/2, 1/2], powers of r from the lowest: the minimax polynomial of degree 5 in the
// relative error that is 1 at 0 (0.9e-7).
constexpr Real kPower[6] = {Real(1),
                            Real(0x1.62e42ap-1),
                            Real(0x1.ebf9bcp-3),
                            Real(0x1.c6b752p-5),
                            Real(0x1.3cea88p-7),
                            Real(0x1.5bba14p-10)};
constexpr Real kRoundMagic = 12582912;  // 1.5 * 2^23: adding it rounds to an integer

// 2^-n times the polynomial of r, where adding -n to the magic number has made `shifted`; 0 where
// not `visible`.
template <class Pack, class Mask>
VOLILLUM_INLINE void raise(const Pack &shifted, const Pack &r, const Mask &visible,
                           const Real *coefficients, Pack &power) {
    // Without a sign: numbers with one must not overflow.
    using Bits [[gnu::vector_size(sizeof(Pack))]] = std::uint32_t;
    Pack p = r * coefficients[5] + coefficients[4];
    for (int i = 3; i >= 0; --i) p = p * r + coefficients[i];
    // The low bits of `shifted` are -n; moved into the exponent they multiply p by 2^-n.
    const Bits value = (Bits)p + ((Bits)shifted << 23);
    power = (Pack)(visible ? value : Bits{});  // of bits: the sum and the choice are one
}

}  // namespace exp_detail

// x = exp(-x) for x >= 0, without branches: 12 operations a pack (11 with AVX-512). Relative error
// below 2e-7 (with fused multiply-adds, and besides that of x itself); 1 at 0, and 0 from 87 on,
// where the result would become denormal (and slow).
template <class Pack>
VOLILLUM_INLINE void exp_negative(Pack &x) {
    if constexpr (sizeof(Real) == sizeof(float)) {
        constexpr Real log2_e = Real(kLog2E);
        const Pack shifted = exp_detail::kRoundMagic - x * log2_e;
        const Pack r = (exp_detail::kRoundMagic - shifted) - x * log2_e;
        exp_detail::raise(shifted, r, x < Real(87), exp_detail::kPower, x);
    } else {
        Pack value{};
        for (int lane = 0; lane < lanes_of<Pack>; ++lane) value[lane] = std::exp(-x[lane]);
        x = value;
    }
}

// weight 2^-y for y >= 0: an exponential of depths that are in units of log 2 because what they are
// made of is, and a weight, for no multiplication more, in the polynomial's coefficients.
class WeightedPower {
public:
    explicit WeightedPower(Real weight)
        : limit_(Real(std::min(87 * kLog2E, 126 + std::log2(std::abs(double(weight)))))) {
        for (int i = 0; i < 6; ++i) coefficients_[i] = weight * exp_detail::kPower[i];
    }
    // The relative error is that of exp_negative; 0 where 2^-y or its product with the weight would
    // become denormal.
    template <class Pack>
    VOLILLUM_INLINE void apply(Pack &y) const {
        if constexpr (sizeof(Real) == sizeof(float)) {
            const Pack shifted = exp_detail::kRoundMagic - y;
            const Pack r = (exp_detail::kRoundMagic - shifted) - y;
            exp_detail::raise(shifted, r, y < limit_, coefficients_, y);
        } else {
            Pack value{};
            for (int lane = 0; lane < lanes_of<Pack>; ++lane)
                value[lane] = coefficients_[0] * std::exp2(-y[lane]);
            y = value;
        }
    }

private:
    Real limit_, coefficients_[6];
};

}  // namespace volillum
