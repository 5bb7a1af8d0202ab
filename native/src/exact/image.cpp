// The exact image: per pixel the integral over its area of
//     int tau(s) (sigma_s L_i + emission) ds,
// the scattering by points chosen in proportion to collision probability, the emission by one
// stratified sample per cell and unit of optical depth.
#include <limits>
#include <optional>

#include "visibility.h"
#include "volillum/parallel.h"

namespace volillum::exact {

namespace {

struct Body {
    Extinction extinction;
    Field sigma_s;
    std::optional<Field> emission;

    Body(const Lattice &lattice, const Size3 &shape, const Planes &t, const Planes &s,
         const Planes &e)
        : extinction(lattice, shape, t, e), sigma_s(Extinction::load(extinction.bricks, s)) {
        if (e.channels > 0) emission.emplace(Extinction::load(extinction.bricks, e));
    }
};

template <std::size_t Channels>
VOLILLUM_INLINE double absorbed(const Depth<Channels> &depth) {
    double sum = 0.0;
    for (std::size_t c = 0; c < Channels; ++c) sum -= std::expm1(-depth[c]);
    return sum;
}

template <std::size_t Channels>
VOLILLUM_INLINE Depth<Channels> deeper(const Field &sigma_t, const LatticeRay &ray,
                                       const Cell &cell, const Depth<Channels> &depth, double t0,
                                       double t1) {
    Depth<Channels> result;
    for (std::size_t c = 0; c < Channels; ++c)
        result[c] = depth[c] + cell_depth<Channels>(sigma_t, ray, cell, t0, t1, c);
    return result;
}

// Depth of the whole ray; adds the emission that it sees, sampled at `jitter` of each stratum.
template <std::size_t Channels>
VOLILLUM_INLINE Depth<Channels> cross(const Body &body, const LatticeRay &ray, double jitter,
                                      Vec3 &emitted) {
    Depth<Channels> depth{};
    walk_cells(
        body.extinction.bricks, ray, std::numeric_limits<double>::infinity(),
        [&](const Cell &cell, double t0, double t1) {
            const Field &sigma_t = body.extinction.field;
            const auto after = deeper<Channels>(sigma_t, ray, cell, depth, t0, t1);
            if (body.emission) {
                double gain = 0.0;
                for (std::size_t c = 0; c < Channels; ++c)
                    gain = std::max(gain, after[c] - depth[c]);
                // A stratum per unit of depth keeps each sample's variance bounded.
                const double strata = 1.0 + std::floor(gain), step = (t1 - t0) / strata;
                auto reached = depth;
                for (double i = 0.0; i < strata && !is_opaque<Channels>(reached); ++i) {
                    const double begin = t0 + i * step, t = begin + jitter * step;
                    const auto here = deeper<Channels>(sigma_t, ray, cell, reached, begin, t);
                    Vec3 source;
                    body.emission->interpolate(cell, ray.at(t), source.data());
                    for (std::size_t c = 0; c < 3; ++c)
                        emitted[c] += step * source[c] * std::exp(-here[channel_of<Channels>(c)]);
                    reached = deeper<Channels>(sigma_t, ray, cell, reached, begin, begin + step);
                }
            }
            depth = after;
            return !is_opaque<Channels>(depth);
        });
    return depth;
}

struct Collision {
    double t = 0.0;
    Vec3 weight{};  // of sigma_s L_i: transmittance over the density of the choice, times sigma_s
};

// The point where the absorbed sum over channels F(t) = sum_c (1 - tau_c(t)) reaches the fraction
// `xi` of `total` = F(infinity). Its density is sum_c sigma_c tau_c / total, so that the weight
// sigma_s tau / density of any channel stays below total max(sigma_s / sigma_t).
template <std::size_t Channels>
VOLILLUM_INLINE Collision collide(const Body &body, const LatticeRay &ray, double xi,
                                  double total) {
    const Field &sigma_t = body.extinction.field;
    const double target = xi * total;
    Depth<Channels> depth{};
    Collision collision;
    walk_cells(body.extinction.bricks, ray, std::numeric_limits<double>::infinity(),
               [&](const Cell &cell, double t0, double t1) {
                   const auto after = deeper<Channels>(sigma_t, ray, cell, depth, t0, t1);
                   if (absorbed<Channels>(after) < target && !is_opaque<Channels>(after)) {
                       depth = after;
                       return true;
                   }
                   // Newton's method inside the bracket [low, high], bisection where it would leave
                   // it.
                   double low = t0, high = t1, t = 0.5 * (t0 + t1);
                   Depth<Channels> here;
                   std::array<double, Channels> sigma;
                   double density = 0.0;
                   for (int iteration = 0; iteration < 100; ++iteration) {
                       here = deeper<Channels>(sigma_t, ray, cell, depth, t0, t);
                       sigma_t.interpolate(cell, ray.at(t), sigma.data());
                       density = 0.0;
                       for (std::size_t c = 0; c < Channels; ++c)
                           density += sigma[c] * std::exp(-here[c]);
                       const double excess = absorbed<Channels>(here) - target;
                       (excess < 0.0 ? low : high) = t;
                       double next = density > 0.0 ? t - excess / density : low;
                       if (!(next > low && next < high)) next = 0.5 * (low + high);
                       // Far below what the float32 voxel values resolve.
                       if (std::abs(next - t) <= 1e-12 * (t1 - t0)) break;
                       t = next;
                   }
                   collision.t = t;
                   if (!(density > 0.0)) return false;
                   std::array<double, 3> scattering;
                   body.sigma_s.interpolate(cell, ray.at(t), scattering.data());
                   for (std::size_t c = 0; c < 3; ++c)
                       collision.weight[c] = scattering[body.sigma_s.channels() == 1 ? 0 : c] *
                                             std::exp(-here[channel_of<Channels>(c)]) / density *
                                             total;
                   return false;
               });
    return collision;
}

template <std::size_t Channels>
VOLILLUM_INLINE Vec3 pixel_estimate(const Body &body, const std::vector<Lobe> &lobes,
                                    const Image &view, std::size_t x, std::size_t y,
                                    std::size_t points, const Sampling &sampling,
                                    std::uint64_t key) {
    const RotatedLattice area(hash(key, 0));
    const double shift = uniform(hash(key, 1)), jitter = uniform(hash(key, 2));
    Vec3 sum{};
    for (std::size_t i = 0; i < points; ++i) {
        const double u = double(x) + area.u(i), v = double(y) + area.v(i);
        const Vec3 origin = view.rays[0] + u * view.rays[1] + v * view.rays[2];
        Vec3 direction = view.rays[3] + u * view.rays[4] + v * view.rays[5];
        direction = (1.0 / length(direction)) * direction;
        const LatticeRay ray{body.extinction.lattice.point(origin),
                             body.extinction.lattice.vector(direction)};
        const double stratum = double(i) / double(points);
        Vec3 radiance{};
        const double total =
            absorbed<Channels>(cross<Channels>(body, ray, fraction(stratum + jitter), radiance));
        if (total > 0.0) {
            const Collision collision =
                collide<Channels>(body, ray, fraction(stratum + shift), total);
            const Vec3 in_scattered = estimate_in_scattered<Channels>(
                body.extinction, lobes, origin + collision.t * direction, sampling.radius,
                sampling.directions, i * sampling.directions, hash(key, 3));
            for (std::size_t c = 0; c < 3; ++c)
                radiance[c] += collision.weight[c] *
                               (sampling.clamp ? std::max(0.0, in_scattered[c]) : in_scattered[c]);
        }
        sum = sum + radiance;
    }
    return (1.0 / double(points)) * sum;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 estimate_grey(const Body &body,
                                                      const std::vector<Lobe> &lobes,
                                                      const Image &view, std::size_t x,
                                                      std::size_t y, std::size_t points,
                                                      const Sampling &sampling, std::uint64_t key) {
    return pixel_estimate<1>(body, lobes, view, x, y, points, sampling, key);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 estimate_rgb(const Body &body,
                                                     const std::vector<Lobe> &lobes,
                                                     const Image &view, std::size_t x,
                                                     std::size_t y, std::size_t points,
                                                     const Sampling &sampling, std::uint64_t key) {
    return pixel_estimate<3>(body, lobes, view, x, y, points, sampling, key);
}

}  // namespace

void image(const Lattice &lattice, const Size3 &shape, const Planes &sigma_t, const Planes &sigma_s,
           const Planes &emission, const std::vector<Term> &terms, const Image &view,
           std::size_t points, const Sampling &sampling, double *radiance, double *error) {
    const Body body(lattice, shape, sigma_t, sigma_s, emission);
    const std::vector<Lobe> lobes(terms.begin(), terms.end());
    const auto estimate = sigma_t.channels == 1 ? estimate_grey : estimate_rgb;
    parallel_for(
        view.width * view.height, sampling.threads, sampling.control, [&](std::size_t pixel, int) {
            Replicates replicates;
            const std::uint64_t key = hash(sampling.seed, pixel);
            for (std::size_t r = 0; r < sampling.replicates; ++r)
                replicates.add(estimate(body, lobes, view, pixel % view.width, pixel / view.width,
                                        points, sampling, hash(key, r)));
            for (std::size_t c = 0; c < 3; ++c) {
                radiance[3 * pixel + c] = replicates.mean(c);
                error[3 * pixel + c] = replicates.standard_error(c);
            }
        });
}

}  // namespace volillum::exact
