// The work on one tile of voxels: compact copies, without a branch on the grid's borders.
#pragma once

#include <algorithm>

#include "sweep_kernels.h"
#include "sweep_plan.h"

namespace volillum::sweep_detail {

struct Range {
    int begin, end;
    int size() const { return end - begin; }
    // What both have; of no size where that is nothing.
    Range common(const Range &other) const {
        const int first = std::max(begin, other.begin);
        return {first, std::max(first, std::min(end, other.end))};
    }
};
struct Box {
    Range slices, rows, columns;

    Box common(const Box &other) const {
        return {slices.common(other.slices), rows.common(other.rows),
                columns.common(other.columns)};
    }
    bool empty() const { return !(slices.size() && rows.size() && columns.size()); }

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

// The voxels [begin, end) as a frame counts them.
Box box_of(const Frame &frame, const Index3 &begin, const Index3 &end);

// A zero-padded copy of sigma_t over a box of a frame (which may reach out of the grid). It makes
// the kernels free of border cases and of cache sets that alias where sides are powers of two.
class Block {
public:
    // sigma_t in the frame's layout; values are clipped to `largest`. Returns whether any differs
    // from 0.
    bool load(const Frame &frame, const Real *sigma_t, Real largest, const Box &box);
    // Makes room for boxes of the size of this one.
    void reserve(const Box &box);
    const Real *at(int t, int b, int c) const {
        return data_.data() + (t - box_.slices.begin) * slice_pitch_ +
               (b - box_.rows.begin) * row_pitch_ + phase_ + (c - box_.columns.begin);
    }
    std::ptrdiff_t row_pitch() const { return row_pitch_; }
    std::ptrdiff_t slice_pitch() const { return slice_pitch_; }

private:
    // Returns how many numbers it takes.
    std::size_t place(const Box &box);
    Box box_{};
    std::ptrdiff_t row_pitch_ = 0, slice_pitch_ = 0, phase_ = 0;
    Reals data_;
};

// Rows to write to, one per slice and row of a box, for each of some channels.
struct Rows {
    Real *first;  // null: nothing is to be written
    int first_slice, first_row;
    std::ptrdiff_t slice_pitch, row_pitch, channel_pitch;
    bool add;                 // whether they hold something already
    std::ptrdiff_t next = 0;  // to the row that follows in the memory
    // If they are a row that will be transposed: where its columns go, a line of slices each.
    const Real *columns = nullptr;
    std::ptrdiff_t column_pitch = 0, columns_channel_pitch = 0;
    Real *at(int t, int b) const {
        return first + (t - first_slice) * slice_pitch + (b - first_row) * row_pitch;
    }
    // What the memory should bring while a row of a slice is written: the row that follows, or that
    // row's part of the columns.
    Ahead ahead(int t, int b) const {
        if (!columns) return {at(t, b) + next, kLanes, channel_pitch};
        return {columns + (t - first_slice) * kLanes * column_pitch, column_pitch,
                columns_channel_pitch};
    }
};

// The lattice rays that a tile needs: those beside one of its voxels on any of its slices. A ray's
// row and column are its place on a slice minus that slice's Crossing.
struct RayRanges {
    Range rows, columns;
};
RayRanges rays_of(const Direction &direction, const Box &tile);

class LatticePlanes;
class NearSums;

struct Scratch {
    Reals high, low, across, depth, level, near;
    std::vector<Crossing> crossings;
    std::vector<Bilinear> samplers, tails;
    Stencil stencil;
};

// What optical depths are measured in: their transmittance is a power of 2.
inline Real unit_of(Quantity quantity) {
    return quantity == Quantity::transmittance ? Real(kLog2E) : Real(1);
}

// Marches one direction through a tile: continues the sums of its rays, which come from `planes`
// and go back there (null: there is one slab only), and writes weight times the quantity at those
// of the tile's voxels that are wanted.
struct March {
    const Direction &direction;
    const RayRanges &rays;
    const Box &tile, &wanted;
    int slab;
    LatticePlanes *planes;
    const Block &block;
    const NearSums *near;  // null: the near field lies in `block`
    const Block *tail;     // where the ray ends, null: has not begun to lose samples yet
    int near_slices;
    Quantity quantity;
    Real weight;
    const Rows &out;
    Scratch &scratch;

    const WeightedPower power{weight};
    Real unit() const { return unit_of(quantity); }
};
void march(const March &m);

}  // namespace volillum::sweep_detail
