// Sums over half balls, each about its own voxel's direction: not a convolution, so they are
// direct.
//
//   out(x) = sum over d of w_d 2 F_d(n) field(x + d)
//
// w_d are the weights of the whole ball (convolution_kernel.h), F_d(n) the share of the weight of
// voxel d on the side of n. y . n = 0 cuts in index space as in the world, because the gradient is
// a covector: the sign is that of d . n with n the negative gradient by index. Seen along n a
// voxel's hat has the mean d . n and the variance |n|^2 / 6 whatever the direction; F is the
// distribution of this mean and variance with the density (1 - x^2)^3, whose kurtosis is between
// that of hats along an axis and along a diagonal. The nearest voxels count most and the weight
// changes most within them: their shares are integrals (hemisphere_near.h). Opposite voxels are
// taken together: F_-d = 1 - F_d.
//
// All terms are positive, nothing cancels: beside an opaque voxel thin matter keeps its precision.
#include "volillum/hemisphere.h"

#include <algorithm>
#include <cmath>

#include "convolution_kernel.h"
#include "hemisphere_near.h"
#include "volillum/huge_array.h"
#include "volillum/opacity.h"
#include "volillum/pack.h"
#include "volillum/parallel.h"

namespace volillum {
namespace {

// Gradients below this share of the voxel's own value, per voxel, are the rounding of a constant.
constexpr double kFlat = 1e-5;
// Half the support of the density (1 - x^2)^3 with the variance 1/6 of a hat: its own is 1/9.
constexpr double kSupport = 1.2247448713915890;
// Voxels of a row that are summed at once.
constexpr int kChunk = 2 * kLanes;

// A voxel and, mirrored, its opposite: its offset along the row, d / kSupport, and its weight.
struct Offset {
    int k;
    Real along[3], weight;
};
// A nearest voxel and its opposite: their rows from where they are summed, and their weight.
struct Nearest {
    const Real *ahead, *behind;
    Real weight;
};
// Neighbouring rows at (i, j) and (-i, -j), with their offsets.
struct RowPair {
    int i, j;
    std::vector<Offset> offsets;
};

std::vector<RowPair> row_pairs(const KernelWeights &kernel) {
    std::vector<RowPair> pairs;
    const auto [r0, r1, r2] = kernel.reach;
    for (int i = 0; i <= r0; ++i)
        for (int j = i ? -r1 : 0; j <= r1; ++j) {
            RowPair pair{i, j, {}};
            const double *weights = kernel.row(i, j);
            for (int k = i || j ? -r2 : 1; k <= r2; ++k)
                if (const double weight = weights[k + r2];
                    weight > 0 && std::max({i, std::abs(j), std::abs(k)}) > 1)
                    pair.offsets.push_back(
                        {k,
                         {Real(i / kSupport), Real(j / kSupport), Real(k / kSupport)},
                         Real(weight)});
            if (!pair.offsets.empty()) pairs.push_back(std::move(pair));
        }
    return pairs;
}

// sums[k] += weights of one pair of rows times ahead[k + d] and behind[k - d], for k < kChunk.
// `normal` holds three rows of kChunk.
void add_rows(const Offset *offsets, std::size_t count, const Real *ahead, const Real *behind,
              const Real *normal, Real *sums) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int p = 0; p < kChunk; p += lanes_of<Pack>) {
            const Pack x = pack<Pack>(normal + p), y = pack<Pack>(normal + kChunk + p),
                       z = pack<Pack>(normal + 2 * kChunk + p);
            const Pack one = Pack{} + Real(1);
            Pack sum{};
            for (std::size_t n = 0; n < count; ++n) {
                const Offset &d = offsets[n];
                Pack t = d.along[0] * x + d.along[1] * y + d.along[2] * z;
                t = t < one ? t : one;
                t = t > -one ? t : -one;
                // 2 F - 1, the integral of the density; 1 at 1 exactly.
                const Pack s = t * t;
                const Pack side = t * (((s * Real(-0.3125) + Real(1.3125)) * s - Real(2.1875)) * s +
                                       Real(2.1875));
                sum += d.weight * ((one + side) * pack<Pack>(ahead + p + d.k) +
                                   (one - side) * pack<Pack>(behind + p - d.k));
            }
            pack<Pack>(sums + p) += sum;
        }
    });
}

// Likewise the nearest voxels.
void add_nearest(const NearShares &shares, const Nearest *nearest, const Real *normal, Real *sums) {
    const auto *terms = shares.terms;
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        constexpr int degree = NearShares::kDegree, pairs = NearShares::kPairs;
        const Pack one = Pack{} + Real(1);
        for (int p = 0; p < kChunk; p += lanes_of<Pack>) {
            Pack powers[3][degree + 1];
            for (int axis = 0; axis < 3; ++axis) {
                powers[axis][0] = one;
                for (int n = 1; n <= degree; ++n)
                    powers[axis][n] = powers[axis][n - 1] * pack<Pack>(normal + axis * kChunk + p);
            }
            Pack sides[pairs] = {};
            const auto *term = terms;
            for (int a = 0; a <= degree; ++a)
                for (int b = 0; a + b <= degree; ++b, ++term) {
                    const Pack power = powers[0][a] * powers[1][b] * powers[2][degree - a - b];
#pragma GCC unroll 13
                    for (int n = 0; n < pairs; ++n) sides[n] += (*term)[n] * power;
                }
            Pack sum{};
            for (int n = 0; n < pairs; ++n) {
                Pack side = sides[n];
                side = side < one ? side : one;
                side = side > -one ? side : -one;
                sum += nearest[n].weight * ((one + side) * pack<Pack>(nearest[n].ahead + p) +
                                            (one - side) * pack<Pack>(nearest[n].behind + p));
            }
            pack<Pack>(sums + p) += sum;
        }
    });
}

// Rows of a field with zeros before and after, and where each one has matter.
class Rows {
public:
    Rows(const float *field, const Index3 &shape, int margin, double opacity_length, int threads,
         Control *control)
        : shape_(shape),
          margin_(margin),
          pitch_((shape[2] + kChunk - 1) / kChunk * kChunk + 2 * margin),
          rows_(std::size_t(shape[0]) * std::size_t(shape[1]) + 1),
          values_(rows_ * std::size_t(pitch_)),
          extents_(rows_, {0, 0}) {
        std::fill_n(values_.data() + (rows_ - 1) * std::size_t(pitch_), pitch_, Real(0));
        const float length = float(opacity_length);
        parallel_for(
            rows_ - 1, threads, control,
            [&](std::size_t row, int) {
                const float *from = field + row * std::size_t(shape_[2]);
                Real *to = values_.data() + row * std::size_t(pitch_);
                std::fill_n(to, pitch_, Real(0));
                auto &[begin, end] = extents_[row];
                for (int k = 0; k < shape_[2]; ++k) {
                    to[margin_ + k] = length > 0 ? opacity(from[k] * length) : from[k];
                    if (from[k] == 0) continue;
                    if (end == 0) begin = k;
                    end = k + 1;
                }
            },
            0.0, 0.05);
    }

    std::size_t at(int i, int j) const {
        const bool inside = i >= 0 && i < shape_[0] && j >= 0 && j < shape_[1];
        return inside ? std::size_t(i) * std::size_t(shape_[1]) + std::size_t(j) : rows_ - 1;
    }
    const Real *values(std::size_t row) const {
        return values_.data() + row * std::size_t(pitch_) + margin_;
    }
    bool is_empty(std::size_t row, int begin, int end) const {
        return extents_[row].end <= begin || extents_[row].begin >= end;
    }

private:
    struct Extent {
        int begin, end;
    };
    Index3 shape_;
    int margin_, pitch_;
    std::size_t rows_;
    HugeArray<Real> values_;
    std::vector<Extent> extents_;
};

// Negative gradients of the guide by index, of length 1, or 0 where there is none.
class Normals {
public:
    Normals(const Guide &guide, const Index3 &shape) : guide_(guide), shape_(shape) {}

    // Those of voxels [k0, k0 + kChunk) of a row; 0 beyond its end.
    void row(int i, int j, int k0, Real *normal) const {
        std::fill_n(normal, 3 * kChunk, Real(0));
        for (int k = k0; k < std::min(k0 + kChunk, shape_[2]); ++k) {
            const Vec3d falls{mean(i - 1, j, k) - mean(i + 1, j, k),
                              mean(i, j - 1, k) - mean(i, j + 1, k),
                              mean(i, j, k - 1) - mean(i, j, k + 1)};
            const double length = std::hypot(falls[0], falls[1], falls[2]);
            if (!(length > 2 * kFlat * mean(i, j, k))) continue;
            for (int axis = 0; axis < 3; ++axis)
                normal[axis * kChunk + k - k0] = Real(falls[std::size_t(axis)] / length);
        }
    }

private:
    double mean(int i, int j, int k) const {
        if (i < 0 || i >= shape_[0] || j < 0 || j >= shape_[1] || k < 0 || k >= shape_[2]) return 0;
        const std::size_t plane = std::size_t(shape_[1]) * std::size_t(shape_[2]);
        const std::size_t at =
            std::size_t(i) * plane + std::size_t(j) * std::size_t(shape_[2]) + std::size_t(k);
        double sum = 0;
        for (int c = 0; c < guide_.channels; ++c)
            sum += guide_.values[std::size_t(c) * std::size_t(shape_[0]) * plane + at];
        return sum / guide_.channels;
    }

    Guide guide_;
    Index3 shape_;
};

}  // namespace

void hemisphere_sums(const float *field, int channels, const Guide &guide, const Index3 &shape,
                     const double *index_to_world, const ConvolutionSettings &settings,
                     float *out) {
    const Index3 largest{shape[0] - 1, shape[1] - 1, shape[2] - 1};
    const KernelWeights kernel = kernel_weights(index_to_world, settings.neighbourhood, largest,
                                                settings.threads, settings.control);
    const std::vector<RowPair> pairs = row_pairs(kernel);
    const NearShares shares(index_to_world, settings.neighbourhood);
    const int reach = kernel.reach[2];
    const Real self = Real(kernel.row(0, 0)[reach]);
    Real weights[NearShares::kPairs];
    for (std::size_t n = 0; n < NearShares::kPairs; ++n)
        weights[n] = Real(kernel.weight(shares.offsets[n]));
    const double upper = settings.upper;
    const Normals normals(guide, shape);
    const std::size_t rows = std::size_t(shape[0]) * std::size_t(shape[1]);
    for (int c = 0; c < channels; ++c) {
        const Rows source(field + std::size_t(c) * rows * std::size_t(shape[2]), shape,
                          std::max(reach, 1), settings.opacity_length, settings.threads,
                          settings.control);
        float *to = out + std::size_t(c) * rows * std::size_t(shape[2]);
        parallel_for(
            rows, settings.threads, settings.control,
            [&](std::size_t row, int) {
                const int i = int(row) / shape[1], j = int(row) % shape[1];
                alignas(64) Real normal[3 * kChunk], sums[kChunk];
                for (int k0 = 0; k0 < shape[2]; k0 += kChunk) {
                    normals.row(i, j, k0, normal);
                    const Real *own = source.values(row) + k0;
                    for (int k = 0; k < kChunk; ++k) sums[k] = self * own[k];
                    Nearest nearest[NearShares::kPairs];
                    bool is_empty = true;
                    for (std::size_t n = 0; n < NearShares::kPairs; ++n) {
                        const auto [di, dj, dk] = shares.offsets[n];
                        const std::size_t ahead = source.at(i + di, j + dj);
                        const std::size_t behind = source.at(i - di, j - dj);
                        is_empty = is_empty && source.is_empty(ahead, k0 - 1, k0 + kChunk + 1) &&
                                   source.is_empty(behind, k0 - 1, k0 + kChunk + 1);
                        nearest[n] = {source.values(ahead) + k0 + dk,
                                      source.values(behind) + k0 - dk, weights[n]};
                    }
                    if (!is_empty) add_nearest(shares, nearest, normal, sums);
                    const int begin = k0 - reach, end = k0 + kChunk + reach;
                    for (const RowPair &pair : pairs) {
                        const std::size_t ahead = source.at(i + pair.i, j + pair.j);
                        const std::size_t behind = source.at(i - pair.i, j - pair.j);
                        if (source.is_empty(ahead, begin, end) &&
                            source.is_empty(behind, begin, end))
                            continue;
                        add_rows(pair.offsets.data(), pair.offsets.size(),
                                 source.values(ahead) + k0, source.values(behind) + k0, normal,
                                 sums);
                    }
                    const int count = std::min(kChunk, shape[2] - k0);
                    for (int k = 0; k < count; ++k) {
                        const double sum = std::min(double(sums[k]), upper);
                        to[row * std::size_t(shape[2]) + std::size_t(k0 + k)] =
                            float(settings.complement ? 1 - sum : sum);
                    }
                }
            },
            0.05 + 0.95 * c / channels, 0.05 + 0.95 * (c + 1) / channels);
    }
}

}  // namespace volillum
