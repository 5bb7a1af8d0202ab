// One randomised estimate of a model's in-scattered radiance at a point: what the drivers (points,
// images) average, and what every kind of equation provides.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "body.h"
#include "lobe.h"

namespace volillum::exact {

// A walk that still scatters after so many collisions is given up, and its weight is reported: the
// work is bounded in white media of any depth.
inline constexpr int most_collisions = 1 << 14;

struct Sample {
    Vec3 radiance{};
    double neglected = 0.0;  // mean weight of the walks that were given up, 0 to 1
};

class Estimator {
public:
    virtual ~Estimator() = default;
    // Toward the unit direction `view`, unbiased but for `neglected`, from samples [first, first +
    // count) of the randomisation `key`.
    virtual Sample estimate(const Vec3 &point, const Vec3 &view, std::size_t first,
                            std::size_t count, std::uint64_t key) const = 0;
};

// Both hold on to what they are given.
std::unique_ptr<Estimator> gather(const Body &body, const Equation &equation);
std::unique_ptr<Estimator> scattered(const Body &body, const Equation &equation);
std::unique_ptr<Estimator> occluded(const Body &body, const Equation &equation);
std::unique_ptr<Estimator> coloured(const Body &body, const Equation &equation);
std::unique_ptr<Estimator> transported(const Body &body, const Equation &equation);

inline std::unique_ptr<Estimator> estimator(const Body &body, const Equation &equation) {
    constexpr std::array makers = {gather, scattered, occluded, coloured,
                                   transported};  // as in Kind
    return makers[std::size_t(equation.kind)](body, equation);
}

}  // namespace volillum::exact
