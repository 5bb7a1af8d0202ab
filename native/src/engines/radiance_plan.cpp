#include "radiance_plan.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

#include "volillum/affine.h"
#include "volillum/parallel.h"

namespace volillum::radiance_detail {
namespace {

// Keeps squares of optical depths finite: a step of this depth is opaque whatever it holds.
constexpr double kLargestDepth = 1e12;
// And sums of what a ray gathers.
constexpr double kLargestSource = 1e25;
// Rounding of weights that are 0.
constexpr double kNoWeight = 1e-7;

// Where a ray from a voxel's centre crosses into another cell, and the middles between.
std::vector<double> node_distances(double row_slope, double column_slope, int slices) {
    std::vector<double> breaks{0.0};
    for (const double slope : {1.0, std::abs(row_slope), std::abs(column_slope)})
        for (int crossed = 1; crossed <= slope * slices; ++crossed)
            breaks.push_back(crossed / slope);
    std::sort(breaks.begin(), breaks.end());
    std::vector<double> distances{0.0};
    for (const double next : breaks)
        if (next > distances.back() + 1e-6) {
            distances.push_back(0.5 * (distances.back() + next));
            distances.push_back(next);
        }
    return distances;
}

// The weights of the voxels around a place on the ray, by their offsets.
using Weights = std::map<std::array<int, 3>, double>;

Weights trilinear(double distance, double row_slope, double column_slope) {
    const double at[3] = {distance, row_slope * distance, column_slope * distance};
    Weights weights;
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1.0;
        std::array<int, 3> offset;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const int low = static_cast<int>(std::floor(at[axis])), upper = corner >> axis & 1;
            const double fraction = at[axis] - low;
            weight *= upper ? fraction : 1.0 - fraction;
            offset[axis] = low + upper;
        }
        weights[offset] += weight;
    }
    return weights;
}

// Nodes at cell walls and in the middles between. A step takes the medium as linear from node to
// node; between walls it is a cubic, of which 4/3 of the middle's value minus 1/6 of the walls' in
// place of the middle's keeps the integral (Simpson's rule is exact for it). As the mean of two of
// the cubic's Bezier coefficients it is not negative.
std::vector<Node> plan_near_field(double row_slope, double column_slope, int slices) {
    std::vector<Node> nodes;
    const std::vector<double> distances = node_distances(row_slope, column_slope, slices);
    for (std::size_t i = 0; i < distances.size(); ++i) {
        Weights weights = trilinear(distances[i], row_slope, column_slope);
        if (i % 2 == 1) {
            for (auto &[offset, weight] : weights) weight *= 4.0 / 3.0;
            for (const std::size_t wall : {i - 1, i + 1})
                for (const auto &[offset, weight] :
                     trilinear(distances[wall], row_slope, column_slope))
                    weights[offset] -= weight / 6.0;
        }
        Node node{distances[i], {}};
        for (const auto &[offset, weight] : weights)
            if (std::abs(weight) > kNoWeight)
                node.taps.push_back(
                    {offset[0], offset[1], offset[2], static_cast<Real>(std::max(weight, 0.0))});
        nodes.push_back(node);
    }
    return nodes;
}

}  // namespace

Layers::Layers(const RadianceScene &scene, int major_axis, int near_slices, double longest_step,
               int threads)
    : axis(major_axis),
      row_axis(major_axis == 0 ? 1 : 0),
      column_axis(major_axis == 2 ? 1 : 2),
      slices(scene.shape[axis]),
      rows(scene.shape[row_axis]),
      columns(scene.shape[column_axis]),
      channels(scene.extinction_channels + 3),
      // Zeros on both sides for as far as a ray may get sideways in its near field and the corner
      // beyond; they serve neighbouring rows and channels alike. Behind the last there is room for
      // the rest of a vector, which elsewhere holds other numbers: nothing comes of them.
      margin_(near_slices + 2),
      pitch_(round_up(columns + margin_)),
      data_(place(slices, 0) + std::size_t(margin_ + kLanes)),
      zeros_(std::size_t(channels * pitch_ + margin_ + kLanes)),
      filled_(std::size_t(slices) * std::size_t(rows)) {
    const std::ptrdiff_t strides[3] = {std::ptrdiff_t(scene.shape[1]) * scene.shape[2],
                                       scene.shape[2], 1};
    const std::ptrdiff_t volume = scene.shape[0] * strides[0];
    const Real densest = static_cast<Real>(kLargestDepth / longest_step);
    const Real brightest = static_cast<Real>(kLargestSource / longest_step);
    const int extinctions = scene.extinction_channels;
    std::fill_n(data_.data() + place(slices, 0), margin_ + kLanes, Real(0));
    parallel_for(std::size_t(slices), threads, nullptr, [&](std::size_t slice, int) {
        for (int b = 0; b < rows; ++b) {
            Real *to = data_.data() + place(int(slice), b);
            std::fill_n(to, channels * pitch_, Real(0));
            to += margin_;
            const std::ptrdiff_t from =
                std::ptrdiff_t(slice) * strides[axis] + b * strides[row_axis];
            bool any = false;
            for (int c = 0; c < columns; ++c) {
                const std::ptrdiff_t voxel = from + c * strides[column_axis];
                for (int k = 0; k < 3; ++k) {
                    const int extinction = std::min(k, extinctions - 1);
                    const Real sigma_t = scene.sigma_t[extinction * volume + voxel];
                    const Real thinner = sigma_t > densest ? densest / sigma_t : Real(1);
                    const Real gathered =
                        scene.scattered.at(voxel, volume, k) + scene.emitted.at(voxel, volume, k);
                    const Real source = std::min(gathered * thinner, brightest);
                    if (k < extinctions) to[k * pitch_ + c] = std::min(sigma_t, densest);
                    to[(extinctions + k) * pitch_ + c] = source;
                    any |= sigma_t != 0 || source != 0;
                }
            }
            filled_[slice * std::size_t(rows) + std::size_t(b)] = any;
        }
    });
}

Crossing Direction::crossing(int t) const {
    const double row = -row_slope * t, column = -column_slope * t;
    const double row_floor = std::floor(row), column_floor = std::floor(column);
    return {static_cast<int>(row_floor), static_cast<int>(column_floor),
            static_cast<Real>(row - row_floor), static_cast<Real>(column - column_floor)};
}

std::array<std::vector<Direction>, 3> plan_directions(const RadianceScene &scene, int near_slices) {
    if (near_slices < 0)
        throw std::invalid_argument("near_slices is " + std::to_string(near_slices) +
                                    "; expected 0 or more");
    const Matrix3 to_index = inverse_linear(scene.index_to_world);
    std::array<std::vector<Direction>, 3> plan;
    for (int d = 0; d < scene.count; ++d) {
        const double *w = scene.directions + 3 * d;
        const double norm = std::hypot(w[0], w[1], w[2]);
        if (!(std::abs(norm - 1.0) <= 1e-6))
            throw std::invalid_argument("directions[" + std::to_string(d) + "] has length " +
                                        std::to_string(norm) + "; expected unit vectors");
        const Vec3d along = multiply(to_index, w);
        int axis = 0;
        for (int other = 1; other < 3; ++other)
            if (std::abs(along[other]) > std::abs(along[axis])) axis = other;
        const double rate = std::abs(along[axis]);  // slices per world length
        Direction direction;
        direction.index = d;
        direction.forward = along[axis] > 0.0;
        direction.row_slope = along[axis == 0 ? 1 : 0] / rate;
        direction.column_slope = along[axis == 2 ? 1 : 2] / rate;
        direction.slice_length = 1.0 / rate;
        const int slices = std::min(near_slices, scene.shape[std::size_t(axis)]);
        direction.near_field = plan_near_field(direction.row_slope, direction.column_slope, slices);
        plan[std::size_t(axis)].push_back(direction);
    }
    return plan;
}

}  // namespace volillum::radiance_detail
