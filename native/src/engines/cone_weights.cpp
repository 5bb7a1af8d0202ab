#include "volillum/cone_weights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "volillum/parallel.h"

namespace volillum {

namespace {

// Below this 1 + cos, a direction is at the map's antipole, which has no one place on the map.
constexpr double antipole = 1e-12;

// Weights of the four neighbours of a place t in [0, 1] between the middle two.
std::array<double, 4> catmull_rom(double t) {
    return {t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t),
            t * (0.5 + t * (2.0 - 1.5 * t)), t * t * (-0.5 + 0.5 * t)};
}

struct Place {
    std::int64_t low;
    std::array<double, 4> share;
};

Place place(double position, std::int64_t size) {
    const std::int64_t low =
        std::clamp<std::int64_t>(std::int64_t(std::floor(position)), 1, size - 3);
    return {low, catmull_rom(position - double(low))};
}

}  // namespace

void cone_weights(const AngularLattice &lattice, const double *axes, std::size_t axis_count,
                  const double *local, const double *local_weights, std::size_t count, int threads,
                  Control *control, float *weights) {
    const std::size_t nodes = std::size_t(lattice.size_u * lattice.size_v);
    constexpr std::size_t batch = 16;  // axes at a time: the written rows stay whole cache lines
    parallel_for((axis_count + batch - 1) / batch, threads, control, [&](std::size_t item, int) {
        std::vector<double> total(nodes);
        const std::size_t end = std::min(axis_count, (item + 1) * batch);
        for (std::size_t n = item * batch; n < end; ++n) {
            std::fill(total.begin(), total.end(), 0.0);
            const double *w = axes + 3 * n;
            // A frame about the axis: any will do, the rule is symmetric enough.
            const bool upright = std::abs(w[2]) < 0.7;
            const double h[3] = {upright ? 0.0 : 1.0, 0.0, upright ? 1.0 : 0.0};
            double u[3] = {h[1] * w[2] - h[2] * w[1], h[2] * w[0] - h[0] * w[2],
                           h[0] * w[1] - h[1] * w[0]};
            const double norm = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
            for (double &x : u) x /= norm;
            const double v[3] = {w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2],
                                 w[0] * u[1] - w[1] * u[0]};
            for (std::size_t s = 0; s < count; ++s) {
                const double *d = local + 3 * s;
                double x[3];
                for (int i = 0; i < 3; ++i) x[i] = d[0] * u[i] + d[1] * v[i] + d[2] * w[i];
                const double stretch =
                    std::sqrt(2.0 / std::max(1.0 + x[2], antipole)) / lattice.spacing;
                const Place pu = place(x[0] * stretch - double(lattice.first_u), lattice.size_u);
                const Place pv = place(x[1] * stretch - double(lattice.first_v), lattice.size_v);
                for (int a = 0; a < 4; ++a) {
                    const double share = pu.share[std::size_t(a)] * local_weights[s];
                    double *row = total.data() + (pu.low + a - 1) * lattice.size_v + pv.low - 1;
                    for (int b = 0; b < 4; ++b) row[b] += share * pv.share[std::size_t(b)];
                }
            }
            for (std::size_t node = 0; node < nodes; ++node)
                weights[node * axis_count + n] = float(total[node]);
        }
    });
}

}  // namespace volillum
