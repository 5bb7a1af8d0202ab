// L = int tau (sigma_s max(0, L_i) + emission) ds along a ray, L_i = sum_terms weight * product of
// trilinear channels * angular factor; cell by cell with 4-point Gauss-Legendre quadrature.
//
// Along a straight piece inside a cell sigma_t is a cubic. Its values at the four nodes fix it, so
// the optical depth up to each node is the same linear combination of them for every piece (the
// Butcher matrix of the 4-stage Gauss-Legendre method), and exact. A piece is halved until its
// depth D is at most 1/2. The rule's error is (4!)^4 / (9 (8!)^3) = 5.6e-10 times the 8th
// derivative: of D exp(-D t), below 2e-12; of the ramp 2 D t exp(-D t^2), below 2e-7.
#include "volillum/line_integral.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "line_integral_fields.h"
#include "volillum/cell_walk.h"
#include "volillum/parallel.h"

namespace volillum {

namespace {

constexpr std::size_t nodes = 4;
constexpr double deepest_piece = 0.5;
// Where clamping at 0 bends the integrand inside a piece, the piece is halved this many times: the
// kink's error falls by 4 each time, from about 1e-2 of the cell to below 1e-6.
constexpr int kink_halvings = 8;
// Depth beyond which nothing is seen (tau < 4e-44), as in any float32 image.
constexpr double opaque_depth = 100.0;

struct GaussRule {
    std::array<double, nodes> abscissa, weight;         // on [0, 1]
    std::array<std::array<double, nodes>, nodes> upto;  // int_0^abscissa[i] of Lagrange's j-th
    std::array<std::array<double, nodes>, nodes> hull;  // Bernstein coefficients of Lagrange's j-th

    GaussRule() {
        const double inner = std::sqrt(3.0 / 7.0 - 2.0 / 7.0 * std::sqrt(6.0 / 5.0));
        const double outer = std::sqrt(3.0 / 7.0 + 2.0 / 7.0 * std::sqrt(6.0 / 5.0));
        const double large = (18.0 + std::sqrt(30.0)) / 72.0,
                     small = (18.0 - std::sqrt(30.0)) / 72.0;
        abscissa = {0.5 - 0.5 * outer, 0.5 - 0.5 * inner, 0.5 + 0.5 * inner, 0.5 + 0.5 * outer};
        weight = {small, large, large, small};
        for (std::size_t j = 0; j < nodes; ++j) {
            // Lagrange's polynomials are cubics: the rule itself integrates them exactly.
            for (std::size_t i = 0; i < nodes; ++i) {
                upto[i][j] = 0.0;
                for (std::size_t k = 0; k < nodes; ++k)
                    upto[i][j] += abscissa[i] * weight[k] * lagrange(j, abscissa[i] * abscissa[k]);
            }
            // A cubic's Bernstein coefficients from its values at 0, 1/3, 2/3 and 1.
            const double a = lagrange(j, 0.0), b = lagrange(j, 1.0 / 3.0),
                         c = lagrange(j, 2.0 / 3.0), d = lagrange(j, 1.0);
            hull[0][j] = a;
            hull[1][j] = (-5.0 * a + 18.0 * b - 9.0 * c + 2.0 * d) / 6.0;
            hull[2][j] = (2.0 * a - 9.0 * b + 18.0 * c - 5.0 * d) / 6.0;
            hull[3][j] = d;
        }
    }
    double lagrange(std::size_t j, double t) const {
        double value = 1.0;
        for (std::size_t l = 0; l < nodes; ++l)
            if (l != j) value *= (t - abscissa[l]) / (abscissa[j] - abscissa[l]);
        return value;
    }
};

// Light gathered along one ray so far.
class Gather {
public:
    Gather(const VolumeFields &volume, const GaussRule &rule, const LatticeRay &ray, Sight &sight,
           std::vector<double> &scratch)
        : volume_(volume), rule_(rule), ray_(ray), sight_(sight), values_(scratch) {
        values_.resize(nodes * volume.field.channels());
    }

    // Adds the piece [t0, t1] inside `cell`, halved as often as its depth, a kink or a light nearby
    // asks for.
    VOLILLUM_INLINE void add_piece(const Cell &cell, double t0, double t1) {
        const double smallest = (t1 - t0) * std::exp2(-kink_halvings);
        std::array<double, 64> ends;  // of the halves still to come, the nearest last
        std::size_t waiting = 1;
        ends[0] = t1;
        while (waiting > 0 && !is_opaque()) {
            const double end = ends[waiting - 1], middle = 0.5 * (t0 + end);
            evaluate(cell, t0, end);
            const bool bent = end - t0 > smallest &&
                              (sight_.is_near(t0, end) || (volume_.clamp && changes_sign()));
            if ((deepest() > deepest_piece || bent) && t0 < middle && middle < end &&
                waiting < ends.size()) {
                ends[waiting++] = middle;
                continue;
            }
            add_evaluated(end - t0);
            t0 = end;
            --waiting;
        }
    }
    VOLILLUM_INLINE bool is_opaque() const {
        return std::min(depth_[0], std::min(depth_[1], depth_[2])) > opaque_depth;
    }
    const Vec3 &radiance() const { return radiance_; }
    const Vec3 &depth() const { return depth_; }

private:
    VOLILLUM_INLINE double sigma_t(std::size_t node, std::size_t rgb) const {
        return values_[node * volume_.field.channels() + volume_.sigma_t +
                       (volume_.grey_t ? 0 : rgb)];
    }
    VOLILLUM_INLINE void evaluate(const Cell &cell, double t0, double t1) {
        const double size = t1 - t0;
        const std::size_t count = volume_.field.channels();
        gain_ = {};
        for (std::size_t i = 0; i < nodes; ++i) {
            double *values = &values_[i * count];
            const double t = t0 + rule_.abscissa[i] * size;
            volume_.field.interpolate(cell, ray_.at(t), values);
            in_scattered_[i] = volume_.in_scattered(values, sight_.at(t));
            for (std::size_t c = 0; c < 3; ++c) gain_[c] += size * rule_.weight[i] * sigma_t(i, c);
        }
    }
    VOLILLUM_INLINE double deepest() const {
        return std::max(gain_[0], std::max(gain_[1], gain_[2]));
    }
    // Whether a channel's light may change sign inside the piece. A cubic lies within its Bernstein
    // coefficients, so none is missed where the light is a sum of channels; products of two are
    // judged by the cubic through the nodes.
    VOLILLUM_INLINE bool changes_sign() const {
        for (std::size_t c = 0; c < 3; ++c) {
            double low = 0.0, high = 0.0;
            for (const auto &row : rule_.hull) {
                double coefficient = 0.0;
                for (std::size_t j = 0; j < nodes; ++j) coefficient += row[j] * in_scattered_[j][c];
                low = std::min(low, coefficient);
                high = std::max(high, coefficient);
            }
            // Rounding beside a light that falls to zero at the grid's border is no kink.
            if (low < -1e-12 * high && high > -1e-12 * low) return true;
        }
        return false;
    }
    VOLILLUM_INLINE void add_evaluated(double size) {
        for (std::size_t c = 0; c < 3; ++c) {
            for (std::size_t i = 0; i < nodes; ++i) {
                double depth = depth_[c];
                for (std::size_t j = 0; j < nodes; ++j)
                    depth += size * rule_.upto[i][j] * sigma_t(j, c);
                const double *values = &values_[i * volume_.field.channels()];
                const double light = in_scattered_[i][c];
                double source = values[volume_.sigma_s + (volume_.grey_s ? 0 : c)] *
                                (volume_.clamp ? std::max(0.0, light) : light);
                if (volume_.emits) source += values[volume_.emission + c];
                radiance_[c] += size * rule_.weight[i] * source * std::exp(-depth);
            }
            depth_[c] += gain_[c];
        }
    }

    const VolumeFields &volume_;
    const GaussRule &rule_;
    const LatticeRay &ray_;
    Sight &sight_;
    std::vector<double> &values_;  // [node][field] of the piece last evaluated
    std::array<Vec3, nodes> in_scattered_{};
    Vec3 gain_{}, radiance_{}, depth_{};
};

[[gnu::flatten]] VOLILLUM_DISPATCH void add_ray(const VolumeFields &volume, const GaussRule &rule,
                                                const LatticeRay &ray, Sight &sight,
                                                std::vector<double> &scratch, double share,
                                                Vec3 &light, Vec3 &through) {
    Gather gather(volume, rule, ray, sight, scratch);
    walk_cells(volume.bricks, ray, std::numeric_limits<double>::infinity(),
               [&](const Cell &cell, double t0, double t1) {
                   gather.add_piece(cell, t0, t1);
                   return !gather.is_opaque();
               });
    light = light + share * gather.radiance();
    for (std::size_t c = 0; c < 3; ++c) through[c] += share * std::exp(-gather.depth()[c]);
}

}  // namespace

void line_integral(const Lattice &lattice, const Size3 &shape, const BakedVolume &baked,
                   const PixelRays &view, int threads, Control *control, double *radiance,
                   double *transmittance) {
    const VolumeFields volume(shape, baked);
    const GaussRule rule;
    const std::size_t s = view.subpixels;
    const double share = 1.0 / (double(s) * double(s));
    const auto pixel_value = [&](std::size_t pixel, std::vector<double> &scratch) {
        Vec3 light{}, through{};
        for (std::size_t sub = 0; sub < s * s; ++sub) {
            const double u = double(pixel % view.width) + (double(sub % s) + 0.5) / double(s);
            const double v = double(pixel / view.width) + (double(sub / s) + 0.5) / double(s);
            const Vec3 origin = view.rays[0] + u * view.rays[1] + v * view.rays[2];
            const Vec3 toward = view.rays[3] + u * view.rays[4] + v * view.rays[5];
            const Vec3 forward = (1.0 / length(toward)) * toward;
            const LatticeRay ray{lattice.point(origin), lattice.vector(forward)};
            Sight sight(volume.angular, origin, forward);
            add_ray(volume, rule, ray, sight, scratch, share, light, through);
        }
        std::copy(light.begin(), light.end(), radiance + 3 * pixel);
        std::copy(through.begin(), through.end(), transmittance + 3 * pixel);
    };
    parallel_for(view.height, threads, control, [&](std::size_t row, int) {
        std::vector<double> scratch;
        for (std::size_t x = 0; x < view.width; ++x) {
            if (control && control->cancelled()) throw Cancelled();
            pixel_value(row * view.width + x, scratch);
        }
    });
}

}  // namespace volillum
