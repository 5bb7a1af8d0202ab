#include "visibility.h"
#include "volillum/parallel.h"

namespace volillum::exact {

namespace {

template <std::size_t Channels>
VOLILLUM_INLINE void point_value(const Extinction &extinction, const std::vector<Lobe> &lobes,
                                 const Vec3 &point, const Sampling &sampling, std::uint64_t key,
                                 double *value, double *error) {
    const std::size_t each = (sampling.directions + sampling.replicates - 1) / sampling.replicates;
    Replicates replicates;
    for (std::size_t r = 0; r < sampling.replicates; ++r)
        replicates.add(estimate_in_scattered<Channels>(extinction, lobes, point, sampling.radius,
                                                       each, 0, hash(key, r)));
    for (std::size_t c = 0; c < 3; ++c) {
        value[c] = sampling.clamp ? std::max(0.0, replicates.mean(c)) : replicates.mean(c);
        error[c] = replicates.standard_error(c);
    }
}

[[gnu::flatten]] VOLILLUM_DISPATCH void point_value_grey(
    const Extinction &extinction, const std::vector<Lobe> &lobes, const Vec3 &point,
    const Sampling &sampling, std::uint64_t key, double *value, double *error) {
    point_value<1>(extinction, lobes, point, sampling, key, value, error);
}

[[gnu::flatten]] VOLILLUM_DISPATCH void point_value_rgb(const Extinction &extinction,
                                                        const std::vector<Lobe> &lobes,
                                                        const Vec3 &point, const Sampling &sampling,
                                                        std::uint64_t key, double *value,
                                                        double *error) {
    point_value<3>(extinction, lobes, point, sampling, key, value, error);
}

}  // namespace

void in_scattered(const Lattice &lattice, const Size3 &shape, const Planes &sigma_t,
                  const std::vector<Term> &terms, const double *points, std::size_t count,
                  const Sampling &sampling, double *value, double *error) {
    const Extinction extinction(lattice, shape, sigma_t);
    const std::vector<Lobe> lobes(terms.begin(), terms.end());
    parallel_for(count, sampling.threads, sampling.control, [&](std::size_t n, int) {
        const Vec3 point = {points[3 * n], points[3 * n + 1], points[3 * n + 2]};
        const auto evaluate = sigma_t.channels == 1 ? point_value_grey : point_value_rgb;
        evaluate(extinction, lobes, point, sampling, hash(sampling.seed, n), value + 3 * n,
                 error + 3 * n);
    });
}

}  // namespace volillum::exact
