#include "sweep_plan.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>

#include "volillum/affine.h"

namespace volillum::sweep_detail {
namespace {

// Exact line integral of the trilinear interpolant from a voxel centre over `length` slices, as
// coefficients per voxel offset. The interpolant is a cubic between breakpoints, the places where
// an index coordinate is an integer, so that two Gauss points integrate it exactly.
std::vector<Tap> near_field_stencil(double row_slope, double column_slope, double length,
                                    double slice_length) {
    std::vector<double> breaks{0.0, length};
    for (const double slope : {1.0, row_slope, column_slope})
        for (int crossed = 1; crossed < std::abs(slope) * length; ++crossed)
            breaks.push_back(crossed / std::abs(slope));
    std::sort(breaks.begin(), breaks.end());

    std::map<std::array<int, 3>, double> coefficients;
    constexpr double gauss = 0.5 * 0.57735026918962576451;  // 1 / (2 sqrt(3))
    for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
        const double width = breaks[i + 1] - breaks[i], middle = 0.5 * (breaks[i] + breaks[i + 1]);
        if (!(width > 0.0)) continue;
        const double cell[3] = {std::floor(middle), std::floor(row_slope * middle),
                                std::floor(column_slope * middle)};
        for (const double s : {middle - gauss * width, middle + gauss * width}) {
            const double fraction[3] = {s - cell[0], row_slope * s - cell[1],
                                        column_slope * s - cell[2]};
            for (int corner = 0; corner < 8; ++corner) {
                double weight = 0.5 * width * slice_length;
                std::array<int, 3> offset;
                for (int axis = 0; axis < 3; ++axis) {
                    const int upper = corner >> axis & 1;
                    weight *= upper ? fraction[axis] : 1.0 - fraction[axis];
                    offset[axis] = static_cast<int>(cell[axis]) + upper;
                }
                coefficients[{offset[0], offset[2], offset[1]}] += weight;
            }
        }
    }
    std::vector<Tap> taps;
    for (const auto &[offset, weight] : coefficients)
        if (weight != 0.0)
            taps.push_back({offset[0], offset[2], offset[1], static_cast<Real>(weight)});
    return taps;
}

Direction plan_direction(const Frame &frame, int index, const Vec3d &along, int near_slices,
                         double radius) {
    const double rate = std::abs(along[frame.axis]);  // slices per world length
    Direction direction;
    direction.index = index;
    direction.row_slope = along[frame.row_axis] / rate;
    direction.column_slope = along[frame.column_axis] / rate;
    direction.slice_length = static_cast<Real>(1.0 / rate);
    const double reach = radius * rate;  // in slices
    const double near_length = std::min<double>(near_slices, reach);
    if (near_length > 0.0)
        direction.near_field = near_field_stencil(direction.row_slope, direction.column_slope,
                                                  near_length, 1.0 / rate);
    const double far_length = reach - near_length;
    direction.has_far_field = far_length > 0.0 && near_slices < frame.slices;
    direction.finite = far_length < frame.slices + 1;  // beyond that every ray has left
    direction.tail = direction.finite ? static_cast<int>(std::floor(far_length)) : 0;
    direction.tail_fraction = direction.finite ? far_length - direction.tail : 0.0;
    return direction;
}

void check(const SweepScene &scene, const SweepSettings &settings) {
    if (!(settings.radius > 0.0))
        throw std::invalid_argument("radius is " + std::to_string(settings.radius) +
                                    "; expected a positive length in world units");
    if (settings.near_slices < 0)
        throw std::invalid_argument("near_slices is " + std::to_string(settings.near_slices) +
                                    "; expected 0 or more");
    for (int d = 0; d < scene.count; ++d) {
        const double *w = scene.directions + 3 * d;
        const double length = std::hypot(w[0], w[1], w[2]);
        if (!(std::abs(length - 1.0) <= 1e-6))
            throw std::invalid_argument("directions[" + std::to_string(d) + "] has length " +
                                        std::to_string(length) + "; expected unit vectors");
    }
}

}  // namespace

Frame::Frame(const Index3 &shape, int major_axis, bool is_forward)
    : axis(major_axis),
      row_axis(major_axis == 0 ? 1 : 0),
      column_axis(major_axis == 2 ? 1 : 2),
      forward(is_forward),
      slices(shape[axis]),
      rows(shape[row_axis]),
      columns(shape[column_axis]) {
    const std::ptrdiff_t strides[3] = {std::ptrdiff_t(shape[1]) * shape[2], shape[2], 1};
    slice_stride = forward ? -strides[axis] : strides[axis];
    row_stride = strides[row_axis];
    column_stride = strides[column_axis];
    origin = forward ? (slices - 1) * strides[axis] : 0;
}

std::vector<Pass> plan_passes(const SweepScene &scene, const SweepSettings &settings) {
    check(scene, settings);
    const Matrix3 to_index = inverse_linear(scene.index_to_world);
    std::vector<Pass> passes;
    for (const int axis : {0, 1, 2})
        for (const bool forward : {true, false}) {
            const Frame frame(scene.shape, axis, forward);
            passes.push_back({frame, std::min(settings.near_slices, frame.slices), {}});
        }
    for (int d = 0; d < scene.count; ++d) {
        const Vec3d along = multiply(to_index, scene.directions + 3 * d);
        int axis = 0;
        for (int other = 1; other < 3; ++other)
            if (std::abs(along[other]) > std::abs(along[axis])) axis = other;
        Pass &pass = passes[std::size_t(2 * axis + (along[axis] > 0.0 ? 0 : 1))];
        pass.directions.push_back(
            plan_direction(pass.frame, d, along, pass.near_slices, settings.radius));
    }
    std::erase_if(passes, [](const Pass &pass) { return pass.directions.empty(); });
    return passes;
}

}  // namespace volillum::sweep_detail
