// Where the weighted sums of a tile go.
#pragma once

#include "sweep_tile.h"

namespace volillum::sweep_detail {

// Rows of a tile's voxels for the values of so many directions, each of which is a channel;
// `values` is room for them.
Rows rows_of_values(const Box &tile, std::size_t directions, Reals &values);
std::size_t numbers_of_values(const Box &tile);

// [channels, n0, n1, n2]. The sums of a tile are made in an array of their own where they leave
// transposed, along k, or where so many directions add to them that it pays to have their rows
// begin with a cache line: those of numpy's arrays do not.
class Output {
public:
    Output(Real *first, std::ptrdiff_t channel_pitch)
        : first_(first), channel_pitch_(channel_pitch) {}

    // Calls visit(box, channels) for parts of a tile whose sums can be written and delivered one
    // after the other: those that leave transposed are small enough for the cache.
    template <class Visit>
    static void for_parts(const Frame &frame, const Box &tile, int channels, Visit &&visit) {
        if (!frame.transposed()) return visit(tile, Range{0, channels});
        Box row = tile;
        for (int b = tile.rows.begin; b < tile.rows.end; ++b) {
            row.rows = {b, b + 1};
            for (int first = 0; first < channels; first += kChannelGroup)
                visit(row, Range{first, std::min(first + kChannelGroup, channels)});
        }
    }

    // What `result` is for a channel of a box that is apart.
    static std::size_t numbers(const Box &box);
    // Rows to write the sums of a box's voxels to, of the first of some channels; `result` is room
    // for them, to be used if `apart` or they leave transposed. `add`: whether the output holds
    // what they are to be added to.
    Rows rows(const Frame &frame, const Box &box, const Range &channels, bool add, bool apart,
              Reals &result) const;
    // Takes what was written there to the output.
    void deliver(const Frame &frame, const Box &box, const Range &channels, bool add,
                 const Rows &rows) const;

private:
    // An odd number of lines apart: rows at a distance of 2^n would evict each other from the
    // cache.
    static std::ptrdiff_t row_pitch(const Box &box) {
        return round_up(box.columns.size()) + kLanes;
    }
    static std::ptrdiff_t slice_pitch(const Box &box) {
        return row_pitch(box) * box.rows.size() + kLanes;
    }
    Real *at(const Frame &frame, const Box &box, const Range &channels) const {
        return first_ + channels.begin * channel_pitch_ +
               frame.element(box.slices.begin, box.rows.begin, box.columns.begin);
    }
    Real *first_;
    std::ptrdiff_t channel_pitch_;
};

}  // namespace volillum::sweep_detail
