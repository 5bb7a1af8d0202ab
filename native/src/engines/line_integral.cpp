// L = int tau (sigma_s max(0, L_i) + emission) ds along a ray, L_i = sum_terms weight * product of
// trilinear channels; cell by cell with 4-point Gauss-Legendre quadrature.
//
// Along a straight piece inside a cell sigma_t is a cubic. Its values at the four nodes fix it, so
// the optical depth up to each node is the same linear combination of them for every piece (the
// Butcher matrix of the 4-stage Gauss-Legendre method), and exact. A piece is halved until its
// depth is at most 1: the rule's relative error for exp(-t) on [0, 1] is (4!)^4 / (9 (8!)^3) <
// 1e-9.
#include "volillum/line_integral.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "volillum/cell_walk.h"
#include "volillum/parallel.h"

namespace volillum {

namespace {

constexpr std::size_t nodes = 4;
// Where clamping at 0 bends the integrand inside a piece, the piece is halved this many times: the
// kink's error falls by 4 each time, from about 1e-2 of the piece to 1e-5.
constexpr int kink_halvings = 5;
// Depth beyond which nothing is seen (tau < 4e-44), as in any float32 image.
constexpr double opaque_depth = 100.0;

struct GaussRule {
    std::array<double, nodes> abscissa, weight;         // on [0, 1]
    std::array<std::array<double, nodes>, nodes> upto;  // int_0^abscissa[i] of Lagrange's j-th

    GaussRule() {
        const double inner = std::sqrt(3.0 / 7.0 - 2.0 / 7.0 * std::sqrt(6.0 / 5.0));
        const double outer = std::sqrt(3.0 / 7.0 + 2.0 / 7.0 * std::sqrt(6.0 / 5.0));
        const double large = (18.0 + std::sqrt(30.0)) / 72.0,
                     small = (18.0 - std::sqrt(30.0)) / 72.0;
        abscissa = {0.5 - 0.5 * outer, 0.5 - 0.5 * inner, 0.5 + 0.5 * inner, 0.5 + 0.5 * outer};
        weight = {small, large, large, small};
        // Lagrange's polynomials are cubics: the rule itself integrates them exactly.
        for (std::size_t i = 0; i < nodes; ++i)
            for (std::size_t j = 0; j < nodes; ++j) {
                upto[i][j] = 0.0;
                for (std::size_t k = 0; k < nodes; ++k) {
                    double value = 1.0;
                    for (std::size_t l = 0; l < nodes; ++l)
                        if (l != j)
                            value *= (abscissa[i] * abscissa[k] - abscissa[l]) /
                                     (abscissa[j] - abscissa[l]);
                    upto[i][j] += abscissa[i] * weight[k] * value;
                }
            }
    }
};

// What one point of the volume holds, all fields interleaved: one interpolation serves them all.
// Terms of a single channel are summed per voxel before (interpolation is linear).
class Volume {
public:
    Volume(const Size3 &shape, const BakedVolume &baked)
        : sigma_t(0),
          sigma_s(baked.sigma_t.channels),
          emission(sigma_s + baked.sigma_s.channels),
          linear(emission + baked.emission.channels),
          products(linear + 3),
          grey_t(baked.sigma_t.channels == 1),
          grey_s(baked.sigma_s.channels == 1),
          emits(baked.emission.channels == 3),
          clamp(baked.clamp),
          terms(product_terms(baked)),
          bricks(shape, {baked.sigma_t, baked.sigma_s, baked.emission}),
          field(bricks, products + 2 * terms.size()) {
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
                if (term.channels.size() != 1 || term.weight[rgb] == 0.0) continue;
                const float *channel = baked.channels.values + term.channels[0] * voxels;
                for (std::size_t n = 0; n < voxels; ++n)
                    sum[n] += term.weight[rgb] * double(channel[n]);
            }
            std::transform(sum.begin(), sum.end(), plane.begin(),
                           [](double value) { return float(value); });
            field.set(bricks, linear + rgb, plane.data());
        }
        for (std::size_t n = 0; n < terms.size(); ++n)
            for (std::size_t factor = 0; factor < 2; ++factor)
                field.set(bricks, products + 2 * n + factor,
                          baked.channels.values + terms[n].channels[factor] * voxels);
    }

    Vec3 in_scattered(const double *values) const {
        Vec3 sum = {values[linear], values[linear + 1], values[linear + 2]};
        for (std::size_t n = 0; n < terms.size(); ++n)
            sum = sum + (values[products + 2 * n] * values[products + 2 * n + 1]) * terms[n].weight;
        return sum;
    }

    const std::size_t sigma_t, sigma_s, emission, linear, products;  // first field of each
    const bool grey_t, grey_s, emits, clamp;
    const std::vector<ChannelProduct> terms;  // of two channels
    const Bricks bricks;  // only where something absorbs, scatters or emits does light matter
    Field field;

private:
    static std::vector<ChannelProduct> product_terms(const BakedVolume &baked) {
        std::vector<ChannelProduct> products;
        std::copy_if(baked.terms.begin(), baked.terms.end(), std::back_inserter(products),
                     [](const ChannelProduct &term) { return term.channels.size() == 2; });
        return products;
    }
};

// Light gathered along one ray so far.
class Gather {
public:
    Gather(const Volume &volume, const GaussRule &rule, const LatticeRay &ray,
           std::vector<double> &scratch)
        : volume_(volume), rule_(rule), ray_(ray), values_(scratch) {
        values_.resize(nodes * volume.field.channels());
    }

    // Adds the piece [t0, t1] inside `cell`, halved as often as its depth or a kink asks for.
    VOLILLUM_INLINE void add_piece(const Cell &cell, double t0, double t1) {
        const double smallest_kink = (t1 - t0) * std::exp2(-kink_halvings);
        std::array<double, 64> ends;  // of the halves still to come, the nearest last
        std::size_t waiting = 1;
        ends[0] = t1;
        while (waiting > 0 && !is_opaque()) {
            const double end = ends[waiting - 1], middle = 0.5 * (t0 + end);
            evaluate(cell, t0, end);
            const bool bent = volume_.clamp && end - t0 > smallest_kink && changes_sign();
            if ((deepest() > 1.0 || bent) && t0 < middle && middle < end && waiting < ends.size()) {
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
            volume_.field.interpolate(cell, ray_.at(t0 + rule_.abscissa[i] * size), values);
            in_scattered_[i] = volume_.in_scattered(values);
            for (std::size_t c = 0; c < 3; ++c) gain_[c] += size * rule_.weight[i] * sigma_t(i, c);
        }
    }
    VOLILLUM_INLINE double deepest() const {
        return std::max(gain_[0], std::max(gain_[1], gain_[2]));
    }
    VOLILLUM_INLINE bool changes_sign() const {
        for (std::size_t c = 0; c < 3; ++c) {
            double low = in_scattered_[0][c], high = low;
            for (std::size_t i = 1; i < nodes; ++i) {
                low = std::min(low, in_scattered_[i][c]);
                high = std::max(high, in_scattered_[i][c]);
            }
            if (low < 0.0 && high > 0.0) return true;
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

    const Volume &volume_;
    const GaussRule &rule_;
    const LatticeRay &ray_;
    std::vector<double> &values_;  // [node][field] of the piece last evaluated
    std::array<Vec3, nodes> in_scattered_{};
    Vec3 gain_{}, radiance_{}, depth_{};
};

[[gnu::flatten]] VOLILLUM_DISPATCH void add_ray(const Volume &volume, const GaussRule &rule,
                                                const LatticeRay &ray, std::vector<double> &scratch,
                                                double share, Vec3 &light, Vec3 &through) {
    Gather gather(volume, rule, ray, scratch);
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
    const Volume volume(shape, baked);
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
            const LatticeRay ray{lattice.point(origin),
                                 lattice.vector((1.0 / length(toward)) * toward)};
            add_ray(volume, rule, ray, scratch, share, light, through);
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
