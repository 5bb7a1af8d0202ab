// How a pass is cut into tiles, what passes from slab to slab between them, and which of them a
// direction needs at all.
#pragma once

#include "sweep_weights.h"

namespace volillum::sweep_detail {

// So few go through the grid in the time that the system takes for new pages.
constexpr std::size_t kFewDirections = 3;
// Directions whose values are held at once where each voxel's are summed together.
constexpr int kBatch = 16;

// Slabs of slices, cut into tiles of rows and columns. What shows in the last bit of sums, slabs
// and batches, depends on the work alone, never on the number of threads.
struct Tiling {
    const Frame &frame;
    int slab_slices, tile_rows, tile_columns;
    int slab_offset;  // slices that the first slab lacks
    int slabs, row_tiles, column_tiles;
    bool in_pieces;  // whether near fields are summed piece by piece

    // `batches`: how many are held at once.
    Tiling(const Pass &pass, int batches);
    Box box(int slab, int tile) const;
    // As large as any tile.
    Box largest_box() const { return {{0, slab_slices}, {0, tile_rows}, {0, tile_columns}}; }
    // The part of the grid that the rays and near fields of a tile touch, those in pieces aside.
    Box reach(const Box &tile, const Pass &pass) const;
    // Calls visit(other) for the tiles of the slab before in which rays of this tile may have been,
    // until it returns false.
    template <class Visit>
    bool all_of_sources(int tile, Visit &&visit) const {
        // Rays move by at most one row a slice, and a tile takes one ray more than it has rows.
        const Box here = box(0, tile);
        const int margin = slab_slices + 2;
        return all_between({here.rows.begin - margin, here.rows.end + margin},
                           {here.columns.begin - margin, here.columns.end + margin}, visit);
    }
    // The same for rows and columns of voxels.
    template <class Visit>
    bool all_between(const Range &rows, const Range &columns, Visit &&visit) const {
        const auto tile_of = [](int index, int size, int tiles) {
            return std::clamp(index / size, 0, tiles - 1);
        };
        for (int i = tile_of(rows.begin, tile_rows, row_tiles);
             i <= tile_of(rows.end - 1, tile_rows, row_tiles); ++i)
            for (int j = tile_of(columns.begin, tile_columns, column_tiles);
                 j <= tile_of(columns.end - 1, tile_columns, column_tiles); ++j)
                if (!visit(i * column_tiles + j)) return false;
        return true;
    }
};

// The part of the grid where a direction's rays through a tile are so many slices further outward,
// and one slice more.
Box reach_outward(const Direction &direction, const Box &tile, int distance, const RayRanges &rays);

// One direction's sums of all lattice rays where they cross from slab to slab; of rays that end a
// pair each, high + low (null: there is no low half). They lie by the place where they meet the
// last slice; rays that have not entered the grid hold 0. Two generations: a tile may still read
// the old one while its neighbours write the new.
class LatticePlanes {
public:
    static std::size_t reals(const Frame &frame, bool pairs) {
        return (pairs ? 4 : 2) * std::size_t(frame.rows + 1) * std::size_t(frame.columns + 1);
    }
    void resize(const Tiling &tiling, bool pairs);
    // Whether any sum differs from 0 of the rays that a tile of `slab` takes over; `crossing` is
    // that of the slice before.
    bool any(int slab, const Crossing &crossing, const RayRanges &rays) const;
    // The row of rays that meets the slice before `slab` at a row and from a column on.
    void load_row(int slab, int row, int column, int count, Real *high, Real *low) const;
    // Fetches ahead what load_row and store_row will touch: rows are short for the hardware's
    // prefetching.
    void fetch_row(int slab, int row_before, int row_after, const Range &columns) const;
    // Stores the rays of a row that meet the last slice of `slab` in the columns that a tile owns.
    void store_row(int slab, int row, const Range &columns, const Real *high, const Real *low);
    // Stores zeros for all rays that a tile owns.
    void clear(int slab, const Box &tile);

private:
    std::size_t offset(int row, int column) const {
        return std::size_t(row + 1) * std::size_t(columns_ + 1) + std::size_t(column + 1);
    }
    std::size_t part(int row, int column) const {
        return std::size_t(row + 1) * std::size_t(parts_) +
               std::size_t(std::max(column, 0) / tile_columns_);
    }
    int rows_ = 0, columns_ = 0, parts_ = 0, tile_columns_ = 1;
    Reals high_[2], low_[2];
    std::vector<unsigned char> filled_[2];  // per row, whether any differs from 0 in a tile's part
};

// The rows or columns of rays that a tile owns where they meet its last slice: those that meet it
// before the first voxel are the first tile's.
inline Range owned(const Range &voxels) {
    return {voxels.begin == 0 ? -1 : voxels.begin, voxels.end};
}

// What a direction has to do in a tile: nothing where its weights are zero or no voxel is wanted,
// and no ray goes on to a tile that needs it, only the sums where one does.
enum class Need : unsigned char { nothing, sums, values };

class Needs {
public:
    Needs(const Pass &pass, const Tiling &tiling, const Weights &weights, const Box &wanted);
    Need of(int slab, int tile, std::size_t direction) const {
        return needs_[(direction * slabs_ + std::size_t(slab)) * tiles_ + std::size_t(tile)];
    }
    bool any(int slab, int tile) const;

private:
    std::size_t slabs_, tiles_, directions_;
    std::vector<Need> needs_;
};

}  // namespace volillum::sweep_detail
