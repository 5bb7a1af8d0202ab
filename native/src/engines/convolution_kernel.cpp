// w_d = total (3 - p) / (4 pi R^(3 - p)) integral over |y| < R of |y|^-p hat_d(y) dV.
//
// Integrated cell by cell: the eight corners of a cell share its nodes. Cells at the origin hold
// the singularity: there, pyramids with their apex at the origin turn |y|^-p dV into u^(2-p) du
// times a smooth factor (Duffy). The others are halved until they are no larger than their distance
// from the origin; where the sphere |y| = R cuts one, the axis that crosses it most steeply is
// integrated over the exact piece inside.
#include "convolution_kernel.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gauss.h"
#include "volillum/affine.h"
#include "volillum/parallel.h"

namespace volillum {
namespace {

using Corners = std::array<double, 8>;

// A box whose diagonal is this share of its distance from the origin or less is integrated with
// this many nodes an axis: relative errors of 1/r^2 below 1e-6 (2 nodes at 0.3: h^4 f''''/4320).
constexpr double kShare[] = {0.0, 0.0, 0.25, 0.5, 0.75, 0.9, 1.0};
// Boxes that the sphere cuts are halved down to this share of its radius: the kinks where the
// sphere leaves a box are then resolved by 6 x 6 columns (sum of all weights right to 1e-6).
constexpr double kCutShare = 1.0 / 8;
// Patches of a pyramid's base that the sphere cuts are halved down to this share of their distance.
constexpr double kCutPatch = 1.0 / 16;

class CellIntegral {
public:
    CellIntegral(const double *affine, double radius, int p) : radius_(radius), p_(p) {
        for (int axis = 0; axis < 3; ++axis)
            for (int row = 0; row < 3; ++row) edge_[axis][row] = affine[4 * row + axis];
        for (int n = 1; n <= 6; ++n) rules_[n] = gauss(n);
    }

    // Integrals of |y|^-p times the eight hats over the part of the cell [base, base + 1] inside
    // the sphere, in index units. Corner c is base + (c & 1, c >> 1 & 1, c >> 2).
    Corners operator()(const Index3 &base) const {
        Corners sums{};
        bool at_origin = true;
        for (int axis = 0; axis < 3; ++axis)
            at_origin = at_origin && (base[axis] == 0 || base[axis] == -1);
        if (at_origin)
            for (int axis = 0; axis < 3; ++axis) pyramid(base, axis, {0, 0}, {1, 1}, sums);
        else
            box(base, {double(base[0]), double(base[1]), double(base[2])}, {1, 1, 1}, sums);
        return sums;
    }

private:
    using Pair = std::array<double, 2>;

    Vec3d world(const Vec3d &index) const {
        Vec3d y;
        for (int row = 0; row < 3; ++row)
            y[row] = edge_[0][row] * index[0] + edge_[1][row] * index[1] + edge_[2][row] * index[2];
        return y;
    }
    static double norm(const Vec3d &y) {
        return std::sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    }
    double power(double square) const {
        return p_ == 0 ? 1.0 : p_ == 1 ? 1 / std::sqrt(square) : 1 / square;
    }
    static void add(const Index3 &base, const Vec3d &index, double value, Corners &sums) {
        const double x = index[0] - base[0], y = index[1] - base[1], z = index[2] - base[2];
        const double low = value * (1 - z), high = value * z;
        const double a = (1 - x) * (1 - y), b = x * (1 - y), c = (1 - x) * y, d = x * y;
        sums[0] += low * a, sums[1] += low * b, sums[2] += low * c, sums[3] += low * d;
        sums[4] += high * a, sums[5] += high * b, sums[6] += high * c, sums[7] += high * d;
    }
    // The longest diagonal of a box of these sides.
    double diagonal(const Vec3d &size) const {
        double longest = 0.0;
        for (const double s : {1.0, -1.0})
            for (const double t : {1.0, -1.0})
                longest = std::max(longest, norm(world({size[0], s * size[1], t * size[2]})));
        return longest;
    }
    int longest_axis(const Vec3d &size) const {
        int longest = 0;
        double length = 0.0;
        for (int axis = 0; axis < 3; ++axis)
            if (norm(edge_[axis]) * size[axis] > length)
                length = norm(edge_[axis]) * size[axis], longest = axis;
        return longest;
    }

    void box(const Index3 &base, const Vec3d &low, const Vec3d &size, Corners &sums) const {
        const Vec3d centre =
            world({low[0] + size[0] / 2, low[1] + size[1] / 2, low[2] + size[2] / 2});
        const double distance = norm(centre), extent = diagonal(size);
        if (distance - extent / 2 >= radius_) return;
        const bool inside = distance + extent / 2 <= radius_;
        if (extent > distance || (!inside && extent > kCutShare * radius_)) {
            const int axis = longest_axis(size);
            Vec3d half = size, middle = low;
            half[axis] /= 2;
            middle[axis] += half[axis];
            box(base, low, half, sums);
            box(base, middle, half, sums);
        } else if (inside) {
            int nodes = 2;
            while (nodes < 6 && extent > kShare[nodes] * distance) ++nodes;
            product(base, low, size, rules_[nodes], sums);
        } else {
            columns(base, low, size, centre, sums);
        }
    }

    void product(const Index3 &base, const Vec3d &low, const Vec3d &size, const Rule &rule,
                 Corners &sums) const {
        const double volume = size[0] * size[1] * size[2];
        for (int i = 0; i < rule.count; ++i)
            for (int j = 0; j < rule.count; ++j)
                for (int k = 0; k < rule.count; ++k) {
                    const Vec3d index{low[0] + size[0] * rule.x[i], low[1] + size[1] * rule.x[j],
                                      low[2] + size[2] * rule.x[k]};
                    const Vec3d y = world(index);
                    const double square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
                    add(base, index, volume * rule.w[i] * rule.w[j] * rule.w[k] * power(square),
                        sums);
                }
    }

    void columns(const Index3 &base, const Vec3d &low, const Vec3d &size, const Vec3d &centre,
                 Corners &sums) const {
        int along = 0;
        double steepest = -1.0;
        for (int axis = 0; axis < 3; ++axis) {
            const Vec3d &e = edge_[axis];
            const double slope =
                std::abs(centre[0] * e[0] + centre[1] * e[1] + centre[2] * e[2]) * size[axis];
            if (slope > steepest) steepest = slope, along = axis;
        }
        const int b = (along + 1) % 3, c = (along + 2) % 3;
        const Rule &across = rules_[6], &inner = rules_[3];
        const double volume = size[0] * size[1] * size[2];
        const Vec3d &e = edge_[along];
        const double quadratic =
            (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) * size[along] * size[along];
        for (int i = 0; i < across.count; ++i)
            for (int j = 0; j < across.count; ++j) {
                Vec3d index = low;
                index[b] += size[b] * across.x[i];
                index[c] += size[c] * across.x[j];
                const Vec3d y = world(index);
                const double linear = (y[0] * e[0] + y[1] * e[1] + y[2] * e[2]) * size[along];
                const double constant = y[0] * y[0] + y[1] * y[1] + y[2] * y[2] - radius_ * radius_;
                const double discriminant = linear * linear - quadratic * constant;
                if (discriminant <= 0) continue;
                const double root = std::sqrt(discriminant);
                const double begin = std::max(0.0, (-linear - root) / quadratic);
                const double end = std::min(1.0, (-linear + root) / quadratic);
                if (begin >= end) continue;
                for (int k = 0; k < inner.count; ++k) {
                    const double t = begin + (end - begin) * inner.x[k];
                    index[along] = low[along] + size[along] * t;
                    double square = 0.0;
                    for (int row = 0; row < 3; ++row) {
                        const double component = y[row] + e[row] * size[along] * t;
                        square += component * component;
                    }
                    add(base, index,
                        volume * across.w[i] * across.w[j] * inner.w[k] * (end - begin) *
                            power(square),
                        sums);
                }
            }
    }

    // The pyramid from the origin over the cell's far face across `axis`, over the patch
    // [low, low + size] of that face: index = u (1, v, w) with the cell's signs.
    void pyramid(const Index3 &base, int axis, const Pair &low, const Pair &size,
                 Corners &sums) const {
        const int b = (axis + 1) % 3, c = (axis + 2) % 3;
        Vec3d sign;
        for (int a = 0; a < 3; ++a) sign[a] = base[a] == 0 ? 1.0 : -1.0;
        const auto at = [&](double v, double w) {
            Vec3d index;
            index[axis] = sign[axis];
            index[b] = sign[b] * v;
            index[c] = sign[c] * w;
            return index;
        };
        const double distance = norm(world(at(low[0] + size[0] / 2, low[1] + size[1] / 2)));
        const double height = norm(edge_[b]) * size[0], width = norm(edge_[c]) * size[1];
        const double extent = height + width;
        const bool cut = distance - extent / 2 < radius_ && distance + extent / 2 > radius_;
        if (extent > (cut ? kCutPatch : 1.0) * distance) {
            const int longer = height > width ? 0 : 1;
            Pair half = size, middle = low;
            half[longer] /= 2;
            middle[longer] += half[longer];
            pyramid(base, axis, low, half, sums);
            pyramid(base, axis, middle, half, sums);
            return;
        }
        const Rule &rule = rules_[6], &inner = rules_[3];
        for (int i = 0; i < rule.count; ++i)
            for (int j = 0; j < rule.count; ++j) {
                const Vec3d far = at(low[0] + size[0] * rule.x[i], low[1] + size[1] * rule.x[j]);
                const Vec3d y = world(far);
                const double square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
                const double end = std::min(1.0, radius_ / std::sqrt(square));
                const double factor = size[0] * size[1] * rule.w[i] * rule.w[j] * power(square);
                for (int k = 0; k < inner.count; ++k) {
                    const double u = end * inner.x[k];
                    double moment = 1.0;
                    for (int n = 0; n < 2 - p_; ++n) moment *= u;
                    add(base, {u * far[0], u * far[1], u * far[2]},
                        factor * end * inner.w[k] * moment, sums);
                }
            }
    }

    std::array<Vec3d, 3> edge_;
    double radius_;
    int p_;
    Rule rules_[7];
};

}  // namespace

KernelWeights kernel_weights(const double *index_to_world, const Neighbourhood &neighbourhood,
                             const Index3 &largest, int threads, Control *control) {
    const double radius = neighbourhood.radius;
    const int p = neighbourhood.weight_p;
    const Matrix3 inverse = inverse_linear(index_to_world);
    KernelWeights kernel;
    for (int axis = 0; axis < 3; ++axis) {
        // The sphere reaches this far along an index axis, and a hat one voxel further.
        const Vec3d &row = inverse[axis];
        const double extent = radius * std::hypot(row[0], row[1], row[2]);
        kernel.reach[axis] = extent >= largest[axis] ? largest[axis] : int(std::ceil(extent));
    }
    const auto [r0, r1, r2] = kernel.reach;
    const std::size_t rows = kernel.rows(), columns = kernel.columns(), plane = rows * columns;
    // The layer of cells between planes i and i + 1 gives to both.
    std::vector<double> low((std::size_t(r0) + 1) * plane), high(low.size());
    const CellIntegral cell(index_to_world, radius, p);
    parallel_for(
        std::size_t(r0) + 1, threads, control,
        [&, r1 = r1, r2 = r2](std::size_t layer, int) {
            for (int j = -r1 - 1; j <= r1; ++j)
                for (int k = -r2 - 1; k <= r2; ++k) {
                    const Corners sums = cell({int(layer), j, k});
                    for (int c = 0; c < 8; ++c) {
                        const int dj = j + (c >> 1 & 1), dk = k + (c >> 2);
                        if (std::abs(dj) > r1 || std::abs(dk) > r2) continue;
                        const std::size_t at =
                            layer * plane + std::size_t(dj + r1) * columns + std::size_t(dk + r2);
                        ((c & 1) ? high : low)[at] += sums[c];
                    }
                }
        },
        0.0, 0.1);
    double determinant = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        const int b = (axis + 1) % 3, c = (axis + 2) % 3;
        const double *m = index_to_world;
        determinant += m[axis] * (m[4 + b] * m[8 + c] - m[4 + c] * m[8 + b]);
    }
    const double scale = neighbourhood.total * (3 - p) /
                         (4 * std::numbers::pi * std::pow(radius, 3 - p)) * std::abs(determinant);
    kernel.values.resize(low.size());
    for (std::size_t at = 0; at < low.size(); ++at) {
        // Plane 0 has its other half of cells by point reflection.
        const double other = at < plane ? low[plane - 1 - at] : high[at - plane];
        kernel.values[at] = scale * (low[at] + other);
    }
    return kernel;
}

}  // namespace volillum
