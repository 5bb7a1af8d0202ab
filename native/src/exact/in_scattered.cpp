#include "estimator.h"
#include "volillum/parallel.h"

namespace volillum::exact {

void in_scattered(const Medium &medium, const Equation &equation, const double *points,
                  const double *views, std::size_t count, const Sampling &sampling,
                  const Results &results) {
    const Body body(medium, equation);
    const auto solution = estimator(body, equation);
    const std::size_t each = (sampling.directions + sampling.replicates - 1) / sampling.replicates;
    parallel_for(count, sampling.threads, sampling.control, [&](std::size_t n, int) {
        const Vec3 point = {points[3 * n], points[3 * n + 1], points[3 * n + 2]};
        const Vec3 view = {views[3 * n], views[3 * n + 1], views[3 * n + 2]};
        const std::uint64_t key = hash(sampling.seed, n);
        Replicates replicates;
        double neglected = 0.0;
        for (std::size_t r = 0; r < sampling.replicates; ++r) {
            const Sample sample = solution->estimate(point, view, 0, each, hash(key, r));
            replicates.add(sample.radiance);
            neglected += sample.neglected;
        }
        for (std::size_t c = 0; c < 3; ++c) {
            const double mean = replicates.mean(c);
            results.value[3 * n + c] = sampling.clamp ? std::max(0.0, mean) : mean;
            results.error[3 * n + c] = replicates.standard_error(c);
        }
        results.neglected[n] = neglected / double(sampling.replicates);
    });
}

}  // namespace volillum::exact
