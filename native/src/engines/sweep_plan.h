// Geometry of the sweep: for each pair of major axis and sign, the frame in which slices are
// counted from the far border, and each direction's shear and near-field stencil in it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "volillum/sweep.h"

namespace volillum::sweep_detail {

// The grid seen along one major axis: slices t (t = 0 at the border where the rays leave), rows b
// and columns c. For the axes i and j columns are k, contiguous in memory; for the axis k they are
// j, and tiles are transposed on their way in and out.
struct Frame {
    int axis, row_axis, column_axis;
    bool forward;  // whether the rays leave at the axis's upper end
    int slices, rows, columns;
    std::ptrdiff_t slice_stride, row_stride, column_stride;  // slice_stride is negative if forward
    std::ptrdiff_t origin;                                   // element of (t, b, c) = (0, 0, 0)

    Frame(const Index3 &shape, int major_axis, bool is_forward);
    bool transposed() const { return axis == 2; }
    bool rows_are_inner() const { return axis == 0; }  // in memory, slices are otherwise
    int index_along_axis(int t) const { return forward ? slices - 1 - t : t; }
    std::ptrdiff_t element(int t, int b, int c) const {
        return origin + t * slice_stride + b * row_stride + c * column_stride;
    }
};

// Where the lattice ray (u, v) = (0, 0) meets a slice: at row + row_fraction and so on. A function
// of the slice alone, so that every use of a sample has the same bits.
struct Crossing {
    int row, column;
    Real row_fraction, column_fraction;
};

struct Tap {
    int slices_outward, row, column;
    Real coefficient;
};

struct Direction {
    int index;                       // into the caller's list
    double row_slope, column_slope;  // lateral shift in voxels per slice outward, within [-1, 1]
    Real slice_length;               // world length of a ray from slice to slice
    std::vector<Tap> near_field;     // exact optical depth of the first slices; by slice, column,
                                     // row
    bool has_far_field;
    bool finite;  // the ray ends `tail` + tail_fraction slices past the near
    int tail;     // field, inside the lattice part
    double tail_fraction;

    Crossing crossing(int t) const {
        const double row = -row_slope * t, column = -column_slope * t;
        const double row_floor = std::floor(row), column_floor = std::floor(column);
        return {static_cast<int>(row_floor), static_cast<int>(column_floor),
                static_cast<Real>(row - row_floor), static_cast<Real>(column - column_floor)};
    }
};

// Directions that share a frame; each pass is one march through the grid.
struct Pass {
    Frame frame;
    int near_slices;  // at most the number of slices: every ray has left by then
    std::vector<Direction> directions;

    bool any_finite() const {
        return std::any_of(directions.begin(), directions.end(),
                           [](const Direction &direction) { return direction.finite; });
    }
};

// Throws std::invalid_argument for a singular affine, a direction
// that is not of unit length to 1e-6, a radius that is not positive, or a negative number of near
// slices.
std::vector<Pass> plan_passes(const SweepScene &scene, const SweepSettings &settings);

}  // namespace volillum::sweep_detail
