// The near field: exact optical depth of the first slices from each voxel, as a stencil.
#pragma once

#include "sweep_tile.h"

namespace volillum::sweep_detail {

// Taps as runs on a block, for sums in some unit.
void set_runs(const Tap *begin, const Tap *end, const Block &block, Real unit, Stencil &stencil);

// Slices of a piece of a long near field. Of few directions it is summed piece by piece, each from
// the part of the grid that lies under the tile there: a block that holds all of it is as large as
// the grid, where rays are oblique several times that, and no cache holds it. With many directions
// the blocks would be copied again and again.
constexpr int kPieceSlices = 16;

// The sums of a direction's near field at some voxels.
class NearSums {
public:
    // Returns whether any differs from 0; values are clipped to `largest`.
    bool sum(const Frame &frame, const Real *sigma_t, Real largest, const Direction &direction,
             Real unit, const Box &voxels);
    const Real *row(int t, int b) const { return sums_.data() + place(t, b); }

private:
    std::size_t place(int t, int b) const {
        return std::size_t((t - voxels_.slices.begin) * voxels_.rows.size() + b -
                           voxels_.rows.begin) *
               std::size_t(lanes());
    }
    int lanes() const { return round_up(voxels_.columns.size()); }
    void add_piece();

    Box voxels_{};
    Block block_;
    Stencil stencil_;
    Reals sums_, piece_;
};

}  // namespace volillum::sweep_detail
