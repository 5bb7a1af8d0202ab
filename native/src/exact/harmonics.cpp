// The visibility's spherical harmonics at points: the mean of 4 pi T Y_lm over random directions.
#include "body.h"
#include "sampling.h"
#include "volillum/parallel.h"

namespace volillum::exact {

namespace {

constexpr std::size_t most_harmonics = 16;

// V[lm][channel], the mean over directions [0, count) of the randomisation `key`.
template <std::size_t Channels>
VOLILLUM_INLINE void project(const Body &body, double radius, const Vec3 &point,
                             std::size_t harmonics, std::size_t count, std::uint64_t key,
                             double *mean) {
    const RotatedLattice lattice(key);
    const Frame frame(Vec3{0.0, 0.0, 1.0});
    LatticeRay ray{body.lattice.point(point), {}};
    std::fill_n(mean, harmonics * Channels, 0.0);
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3 direction = frame.cone(-1.0, lattice.u(i), lattice.v(i));
        ray.direction = body.lattice.vector(direction);
        const Depth<Channels> depth = body.depth<Channels>(ray, radius, opaque_depth);
        std::array<double, most_harmonics> basis;
        spherical_harmonics(direction, harmonics, basis.data());
        for (std::size_t c = 0; c < Channels; ++c) {
            const double weight = 4.0 * std::numbers::pi / double(count) * std::exp(-depth[c]);
            for (std::size_t m = 0; m < harmonics; ++m) mean[m * Channels + c] += weight * basis[m];
        }
    }
}

[[gnu::flatten]] VOLILLUM_DISPATCH void project_grey(const Body &body, double radius,
                                                     const Vec3 &point, std::size_t harmonics,
                                                     std::size_t count, std::uint64_t key,
                                                     double *mean) {
    project<1>(body, radius, point, harmonics, count, key, mean);
}

[[gnu::flatten]] VOLILLUM_DISPATCH void project_rgb(const Body &body, double radius,
                                                    const Vec3 &point, std::size_t harmonics,
                                                    std::size_t count, std::uint64_t key,
                                                    double *mean) {
    project<3>(body, radius, point, harmonics, count, key, mean);
}

}  // namespace

void visibility_harmonics(const Medium &medium, double radius, std::size_t harmonics,
                          const double *points, std::size_t count, const Sampling &sampling,
                          double *value, double *error) {
    const Body body(medium);
    const std::size_t channels = medium.sigma_t.channels, size = harmonics * channels;
    const auto one = channels == 1 ? project_grey : project_rgb;
    const std::size_t each = (sampling.directions + sampling.replicates - 1) / sampling.replicates;
    parallel_for(count, sampling.threads, sampling.control, [&](std::size_t n, int) {
        const Vec3 point = {points[3 * n], points[3 * n + 1], points[3 * n + 2]};
        const std::uint64_t key = hash(sampling.seed, n);
        std::array<double, 3 * most_harmonics> found;
        double *mean = value + size * n, *squares = error + size * n;
        std::fill_n(mean, size, 0.0);
        std::fill_n(squares, size, 0.0);
        for (std::size_t r = 0; r < sampling.replicates; ++r) {
            one(body, radius, point, harmonics, each, hash(key, r), found.data());
            for (std::size_t m = 0; m < size; ++m) {  // Welford, as in Replicates
                const double delta = found[m] - mean[m];
                mean[m] += delta / double(r + 1);
                squares[m] += delta * (found[m] - mean[m]);
            }
        }
        const double replicates = double(sampling.replicates);
        for (std::size_t m = 0; m < size; ++m)
            squares[m] = std::sqrt(squares[m] / (replicates * (replicates - 1.0)));
    });
}

}  // namespace volillum::exact
