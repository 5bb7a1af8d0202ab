// The exact image: per pixel the integral over its area of
//     int tau(s) (sigma_s L_i + emission) ds,
// the scattering by points chosen in proportion to collision probability, the emission by one
// stratified sample per cell and unit of optical depth.
#include "estimator.h"
#include "volillum/parallel.h"

namespace volillum::exact {

namespace {

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
VOLILLUM_INLINE Depth<Channels> cross(const Body &body, const Field *emission,
                                      const LatticeRay &ray, double jitter, Vec3 &emitted) {
    Depth<Channels> depth{};
    walk_cells(
        body.bricks, ray, std::numeric_limits<double>::infinity(),
        [&](const Cell &cell, double t0, double t1) {
            const Field &sigma_t = body.sigma_t;
            const auto after = deeper<Channels>(sigma_t, ray, cell, depth, t0, t1);
            if (emission != nullptr) {
                double gain = 0.0;
                for (std::size_t c = 0; c < Channels; ++c)
                    gain = std::max(gain, after[c] - depth[c]);
                // A stratum per unit of depth keeps each sample's variance bounded.
                const double strata = 1.0 + std::floor(gain), step = (t1 - t0) / strata;
                auto reached = depth;
                for (double i = 0.0; i < strata && !is_opaque<Channels>(reached); ++i) {
                    const double begin = t0 + i * step, t = begin + jitter * step;
                    const auto here = deeper<Channels>(sigma_t, ray, cell, reached, begin, t);
                    const Vec3 source = colour_at(*emission, cell, ray.at(t));
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

struct Scattering {
    double t = 0.0;
    Vec3 weight{};  // of sigma_s L_i: transmittance over the density of the choice, times sigma_s
};

// The point where the absorbed sum over channels F(t) = sum_c (1 - tau_c(t)) reaches the fraction
// `xi` of `total` = F(infinity). Its density is sum_c sigma_c tau_c / total, so that the weight
// sigma_s tau / density of any channel stays below total max(sigma_s / sigma_t).
template <std::size_t Channels>
VOLILLUM_INLINE Scattering collide(const Body &body, const LatticeRay &ray, double xi,
                                   double total) {
    const Field &sigma_t = body.sigma_t;
    const double target = xi * total;
    Depth<Channels> depth{};
    Scattering collision;
    walk_cells(body.bricks, ray, std::numeric_limits<double>::infinity(),
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
                   const Vec3 scattering = colour_at(*body.sigma_s, cell, ray.at(t));
                   for (std::size_t c = 0; c < 3; ++c)
                       collision.weight[c] = scattering[c] *
                                             std::exp(-here[channel_of<Channels>(c)]) / density *
                                             total;
                   return false;
               });
    return collision;
}

// The random ray through pixel (x, y) of point i: the emission that it sees and where it scatters.
struct Draw {
    Vec3 emitted{}, origin, direction;
    Scattering scattering;
};

template <std::size_t Channels>
VOLILLUM_INLINE Draw draw(const Body &body, const Field *emission, const Image &view,
                          const Vec3 &position, double jitter, double xi) {
    const double u = position[0], v = position[1];
    Draw result;
    result.origin = view.rays[0] + u * view.rays[1] + v * view.rays[2];
    const Vec3 direction = view.rays[3] + u * view.rays[4] + v * view.rays[5];
    result.direction = (1.0 / length(direction)) * direction;
    const LatticeRay ray = body.ray(result.origin, result.direction);
    const double total =
        absorbed<Channels>(cross<Channels>(body, emission, ray, jitter, result.emitted));
    if (total > 0.0) result.scattering = collide<Channels>(body, ray, xi, total);
    return result;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Draw draw_grey(const Body &body, const Field *emission,
                                                  const Image &view, const Vec3 &position,
                                                  double jitter, double xi) {
    return draw<1>(body, emission, view, position, jitter, xi);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Draw draw_rgb(const Body &body, const Field *emission,
                                                 const Image &view, const Vec3 &position,
                                                 double jitter, double xi) {
    return draw<3>(body, emission, view, position, jitter, xi);
}

}  // namespace

void image(const Medium &medium, const Equation &equation, bool emits, const Image &view,
           std::size_t points, const Sampling &sampling, const Results &results) {
    const Body body(medium, equation);
    const Field *emission = emits && body.emission ? &*body.emission : nullptr;
    const auto solution = estimator(body, equation);
    const auto draw_point = body.sigma_t.channels() == 1 ? draw_grey : draw_rgb;

    const auto estimate = [&](std::size_t pixel, std::uint64_t key) {
        const double x = double(pixel % view.width), y = double(pixel / view.width);
        const RotatedLattice area(hash(key, 0));
        const double shift = uniform(hash(key, 1)), jitter = uniform(hash(key, 2));
        Sample sum;
        for (std::size_t i = 0; i < points; ++i) {
            const double stratum = double(i) / double(points);
            const Draw point = draw_point(body, emission, view, {x + area.u(i), y + area.v(i), 0.0},
                                          fraction(stratum + jitter), fraction(stratum + shift));
            sum.radiance = sum.radiance + point.emitted;
            if (!(largest(point.scattering.weight) > 0.0)) continue;
            const Sample sample = solution->estimate(
                point.origin + point.scattering.t * point.direction, -1.0 * point.direction,
                i * sampling.directions, sampling.directions, hash(key, 3));
            for (std::size_t c = 0; c < 3; ++c)
                sum.radiance[c] +=
                    point.scattering.weight[c] *
                    (sampling.clamp ? std::max(0.0, sample.radiance[c]) : sample.radiance[c]);
            sum.neglected += sample.neglected;
        }
        return sum;
    };
    parallel_for(view.width * view.height, sampling.threads, sampling.control,
                 [&](std::size_t pixel, int) {
                     Replicates replicates;
                     double neglected = 0.0;
                     const std::uint64_t key = hash(sampling.seed, pixel);
                     for (std::size_t r = 0; r < sampling.replicates; ++r) {
                         const Sample sample = estimate(pixel, hash(key, r));
                         replicates.add((1.0 / double(points)) * sample.radiance);
                         neglected += sample.neglected;
                     }
                     for (std::size_t c = 0; c < 3; ++c) {
                         results.value[3 * pixel + c] = replicates.mean(c);
                         results.error[3 * pixel + c] = replicates.standard_error(c);
                     }
                     results.neglected[pixel] = neglected / double(points * sampling.replicates);
                 });
}

}  // namespace volillum::exact
