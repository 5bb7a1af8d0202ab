// The work on one tile of voxels: dispatched leaf kernels on compact copies, without a branch on
// the grid's borders.
#pragma once

#include <algorithm>
#include <vector>

#include "sweep_plan.h"

namespace volillum::sweep_detail {

struct Range {
    int begin, end;
    int size() const { return end - begin; }
};
struct Box {
    Range slices, rows, columns;

    // Calls visit(t, b) for every slice and row, in the order of memory.
    template <class Visit>
    void for_rows(const Frame &frame, Visit &&visit) const {
        if (frame.rows_are_inner())
            for (int t = slices.begin; t < slices.end; ++t)
                for (int b = rows.begin; b < rows.end; ++b) visit(t, b);
        else
            for (int b = rows.begin; b < rows.end; ++b)
                for (int t = slices.begin; t < slices.end; ++t) visit(t, b);
    }
};

// A zero-padded copy of sigma_t over a box of a frame (which may reach out of the grid). It makes
// the kernels free of border cases and of cache sets that alias where sides are powers of two.
class Block {
public:
    // sigma_t in the frame's layout; values are clipped to `largest`. Returns whether any differs
    // from 0.
    bool load(const Frame &frame, const Real *sigma_t, Real largest, const Box &box);
    const Real *at(int t, int b, int c) const {
        return data_.data() + (t - box_.slices.begin) * slice_pitch_ +
               (b - box_.rows.begin) * row_pitch_ + (c - box_.columns.begin);
    }
    std::ptrdiff_t row_pitch() const { return row_pitch_; }
    std::ptrdiff_t slice_pitch() const { return slice_pitch_; }

private:
    Box box_{};
    std::ptrdiff_t row_pitch_ = 0, slice_pitch_ = 0;
    Reals data_;
};

// The lattice rays that a tile needs: those beside one of its voxels on any of its slices. A ray's
// row and column are its place on a slice minus that slice's Crossing.
struct RayRanges {
    Range rows, columns;
};
RayRanges rays_of(const Direction &direction, const Box &tile);

// Sums of samples along the lattice rays of a tile, each a pair high + low, so that the rounding
// error does not grow along the ray.
struct RaySums {
    Range rows, columns;  // columns.size() is a whole number of lanes
    Reals high, low;
    void reset(const RayRanges &rays);
    std::size_t offset(int row, int column) const {
        return std::size_t(row - rows.begin) * std::size_t(columns.size()) +
               std::size_t(column - columns.begin);
    }
};

// How the lattice rays of a tile sample a slice: four weights, constant per slice.
struct Bilinear {
    Bilinear(const Block &block, int t, const Crossing &crossing, int row, int column);
    const Real *upper;     // at the first lattice row and column
    std::ptrdiff_t pitch;  // from row to row
    Real w00, w01, w10, w11;
};

struct Scratch {
    Reals depth_above, depth_here;
    std::vector<Crossing> crossings;
    std::vector<Bilinear> samplers, tails;
    std::vector<std::ptrdiff_t> offsets;
    std::vector<Real> coefficients;
};

// Marches one direction through a tile: adds the samples of each slice to the sums and writes the
// quantity at the tile's voxels to `result` as [slice][row][padded column] (null: only the sums).
struct March {
    const Direction &direction;
    const Box &tile;
    const Block &block;
    const Block *tail;  // where the ray ends, null: has not begun to lose samples yet
    int near_slices;
    Quantity quantity;
    RaySums &sums;
    Scratch &scratch;
    Real *result;
};
void march(const March &m);

// Copies, clipped to `largest`; returns whether any number differs from 0.
// Rows are short for the hardware's prefetching: the row at source + next is fetched ahead.
bool copy_row(const Real *source, int count, Real largest, std::ptrdiff_t next, Real *target);

// out[channel * out_stride + i] = sum_d weights[d * kChannelGroup + channel] values[d *
// value_stride
// + i], or += it, for i < count. Channels are summed in groups, so that a value is loaded once for
// several; a group that is not full has weights of 0. Values are padded to whole lanes.
constexpr int kChannelGroup = 4;
void weigh_row(const Real *values, std::size_t value_stride, int directions, const Real *weights,
               int channels, int count, bool add, Real *out, std::ptrdiff_t out_stride,
               std::ptrdiff_t next);

// sums[i] += weights[i] values[i]
void multiply_add(const Real *values, const Real *weights, int count, Real *sums);

// target[c, r] = source[r, c], both contiguous.
void transpose(const Real *source, int rows, int columns, Real *target);

}  // namespace volillum::sweep_detail
