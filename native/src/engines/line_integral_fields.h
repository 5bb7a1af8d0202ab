// What the line integral needs of a baked volume at a point, and of its angular terms along a ray.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "volillum/line_integral.h"

namespace volillum {

// Toward a local light that is d away from a piece's middle the phase function varies as an
// analytic function whose singularities are d away too. Pieces of at most d / 3 keep them 6
// half-lengths away, where the rule errs by at most 64 / 15 (6 + sqrt(35))^-8 = 1e-8 of what the
// function reaches between, forward peak included.
constexpr double light_distance = 3.0;

// What one point of the volume holds, all fields interleaved: one interpolation serves them all.
// Terms of a single channel that look alike from all sides are summed per voxel before
// (interpolation is linear).
class VolumeFields {
public:
    // A term that is not in the sum, with the places of its channels in a point's fields.
    struct Term {
        std::size_t first;
        std::optional<std::size_t> second, angular;
        Vec3 weight;
    };

    VolumeFields(const Size3 &shape, const BakedVolume &baked)
        : sigma_t(0),
          sigma_s(baked.sigma_t.channels),
          emission(sigma_s + baked.sigma_s.channels),
          linear(emission + baked.emission.channels),
          grey_t(baked.sigma_t.channels == 1),
          grey_s(baked.sigma_s.channels == 1),
          emits(baked.emission.channels == 3),
          clamp(baked.clamp),
          angular(baked.angular),
          channels(channels_apart(baked)),
          terms(terms_apart(baked)),
          bricks(shape, {baked.sigma_t, baked.sigma_s, baked.emission}),
          field(bricks, linear + 3 + channels.size()) {
        const std::size_t voxels = shape[0] * shape[1] * shape[2];
        const auto load = [&](std::size_t first, const Bricks::Planes &planes) {
            for (std::size_t c = 0; c < planes.channels; ++c)
                field.set(bricks, first + c, planes.values + c * voxels);
        };
        load(sigma_t, baked.sigma_t);
        load(sigma_s, baked.sigma_s);
        load(emission, baked.emission);
        std::vector<double> sum(voxels);
        std::vector<float> plane(voxels);
        for (std::size_t rgb = 0; rgb < 3; ++rgb) {
            std::fill(sum.begin(), sum.end(), 0.0);
            for (const ChannelProduct &term : baked.terms) {
                if (!is_summed(term) || term.weight[rgb] == 0.0) continue;
                const float *channel = baked.channels.values + term.channels[0] * voxels;
                for (std::size_t n = 0; n < voxels; ++n)
                    sum[n] += term.weight[rgb] * double(channel[n]);
            }
            std::transform(sum.begin(), sum.end(), plane.begin(),
                           [](double value) { return float(value); });
            field.set(bricks, linear + rgb, plane.data());
        }
        for (std::size_t n = 0; n < channels.size(); ++n)
            field.set(bricks, linear + 3 + n, baked.channels.values + channels[n] * voxels);
    }

    Vec3 in_scattered(const double *values, const double *seen) const {
        Vec3 sum = {values[linear], values[linear + 1], values[linear + 2]};
        for (const Term &term : terms) {
            double product = values[term.first];
            if (term.second) product *= values[*term.second];
            if (term.angular) product *= seen[*term.angular];
            sum = sum + product * term.weight;
        }
        return sum;
    }

    const std::size_t sigma_t, sigma_s, emission, linear;  // first field of each
    const bool grey_t, grey_s, emits, clamp;
    const std::vector<Angular> angular;
    const std::vector<std::size_t> channels;  // of the terms apart, after `linear`, each once
    const std::vector<Term> terms;
    const Bricks bricks;  // only where something absorbs, scatters or emits does light matter
    Field field;

private:
    static bool is_summed(const ChannelProduct &term) {
        return term.channels.size() == 1 && !term.angular;
    }
    static std::vector<std::size_t> channels_apart(const BakedVolume &baked) {
        std::vector<std::size_t> apart;
        for (const ChannelProduct &term : baked.terms)
            for (const std::size_t channel : term.channels)
                if (!is_summed(term) && std::ranges::find(apart, channel) == apart.end())
                    apart.push_back(channel);
        return apart;
    }
    std::vector<Term> terms_apart(const BakedVolume &baked) const {
        const auto place = [&](std::size_t channel) {
            return linear + 3 +
                   std::size_t(std::ranges::find(channels, channel) - channels.begin());
        };
        std::vector<Term> apart;
        for (const ChannelProduct &term : baked.terms) {
            if (is_summed(term)) continue;
            apart.push_back({place(term.channels[0]), {}, term.angular, term.weight});
            if (term.channels.size() == 2) apart.back().second = place(term.channels[1]);
        }
        return apart;
    }
};

// The angular factors as one ray sees them: along it only those of local lights vary.
class Sight {
public:
    Sight(const std::vector<Angular> &angular, const Vec3 &origin, const Vec3 &forward)
        : factors_(angular.size()) {
        // The direction toward the eye is -forward.
        for (std::size_t n = 0; n < angular.size(); ++n) {
            const Angular &one = angular[n];
            if (one.kind == Angular::Kind::direction)
                factors_[n] = henyey_greenstein(one.g, dot(one.source, forward));
            else if (one.kind == Angular::Kind::moment)
                factors_[n] = harmonics(forward)[one.index];
            else {
                const double along = dot(one.source - origin, forward);
                const double across = length(one.source - origin - along * forward);
                local_.push_back({n, one.g, along, across * across});
            }
        }
    }

    // The factors at length t of the ray.
    VOLILLUM_INLINE const double *at(double t) {
        for (const Local &light : local_) {
            const double ahead = light.along - t, distance = light.distance(t);
            factors_[light.index] =
                henyey_greenstein(light.g, distance > 0.0 ? ahead / distance : 0.0);
        }
        return factors_.data();
    }
    // Whether [t0, t1] is too long beside some light for one rule.
    VOLILLUM_INLINE bool is_near(double t0, double t1) const {
        for (const Local &light : local_)
            if (light_distance * (t1 - t0) > light.distance(0.5 * (t0 + t1))) return true;
        return false;
    }

private:
    struct Local {
        std::size_t index;
        double g, along, across_squared;

        VOLILLUM_INLINE double distance(double t) const {
            return std::sqrt((along - t) * (along - t) + across_squared);
        }
    };
    std::vector<double> factors_;
    std::vector<Local> local_;
};

}  // namespace volillum
