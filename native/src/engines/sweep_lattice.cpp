#include "sweep_lattice.h"

#include <cstring>
#include <limits>

#include "sweep_near.h"

namespace volillum::sweep_detail {
namespace {

// Measured on 256^3. Whole rows suit the memory's prefetching; slabs of 8 keep the skew of a tile's
// rays small; high tiles have little overlap, low ones leave the sums of many directions in the
// second-level cache. The values of a batch of directions for several channels are more than that
// holds: smaller tiles or batches take longer, because rays beside the tile are marched again and
// the output is touched again. Slices that are contiguous in memory come by whole cache lines:
// by two where they are all that is waited for. For many directions one is as fast, and each thread
// holds half as much.
constexpr int kSlabSlices = 8, kTransposedSlab = kLanes, kHighTransposedSlab = 2 * kLanes,
              kTileColumns = 256;
constexpr int kHighTile = 64, kLowTile = 32;
// Batches of all threads together take no more than the grid, as far as tiles of so few rows do.
constexpr int kLowestTile = 8;

// Large arrays of numpy and malloc lie this far behind the begin of a cache line, and a slab that
// comes and goes by whole lines takes four fifths of the time. Not asked of the very array: where
// slabs begin shows in the last bit of sums.
constexpr int kArrayOffset = 16 / int(sizeof(Real));

// Slices that the first slab must lack so that the others begin or, forward, end with a line.
int line_offset(const Frame &frame, int slab_slices) {
    const int before = frame.forward ? frame.slices + kArrayOffset : slab_slices - kArrayOffset;
    const int first = before % slab_slices;
    return first == 0 ? 0 : slab_slices - first;
}

int even_tile(int size, int largest, int multiple) {
    const int tiles = (size + largest - 1) / largest;
    const int tile = (size + tiles - 1) / tiles;
    return (tile + multiple - 1) / multiple * multiple;
}

}  // namespace

Tiling::Tiling(const Pass &pass, int batches) : frame(pass.frame) {
    const bool only_few = pass.directions.size() <= kFewDirections;
    in_pieces = only_few && pass.near_slices > kPieceSlices;
    // Where a long near field takes the time, low tiles of thin slabs cost nothing.
    const bool few = only_few && !in_pieces;
    slab_slices = !frame.transposed() ? kSlabSlices : few ? kHighTransposedSlab : kTransposedSlab;
    tile_columns = even_tile(frame.columns, kTileColumns, kLanes);
    int most_rows = few ? kHighTile : kLowTile;
    if (batches > 0) {
        const double row = double(batches) * kBatch * slab_slices * tile_columns,
                     voxels = double(frame.slices) * frame.rows * frame.columns;
        most_rows = std::clamp(int(voxels / row), kLowestTile, most_rows);
    }
    tile_rows = even_tile(frame.rows, most_rows, 1);
    slab_offset = frame.transposed() ? line_offset(frame, slab_slices) : 0;
    slabs = (slab_offset + frame.slices + slab_slices - 1) / slab_slices;
    row_tiles = (frame.rows + tile_rows - 1) / tile_rows;
    column_tiles = (frame.columns + tile_columns - 1) / tile_columns;
}

Box Tiling::box(int slab, int tile) const {
    const int row = tile / column_tiles * tile_rows, column = tile % column_tiles * tile_columns;
    const int slice = slab * slab_slices - slab_offset;
    return {{std::max(slice, 0), std::min(slice + slab_slices, frame.slices)},
            {row, std::min(row + tile_rows, frame.rows)},
            {column, std::min(column + tile_columns, frame.columns)}};
}

Box Tiling::reach(const Box &tile, const Pass &pass) const {
    double low_row = 0, high_row = 0, low_column = 0, high_column = 0;
    for (const Direction &direction : pass.directions) {
        low_row = std::min(low_row, direction.row_slope);
        high_row = std::max(high_row, direction.row_slope);
        low_column = std::min(low_column, direction.column_slope);
        high_column = std::max(high_column, direction.column_slope);
    }
    // Outward from the tile's nearest slice, and one voxel on both sides for interpolation, one
    // more for the lattice ray beside the first voxel.
    const int slices = tile.slices.size() - 1 + pass.near_slices;
    return {{tile.slices.begin - pass.near_slices, tile.slices.end},
            {tile.rows.begin - 2 + int(std::floor(low_row * slices)),
             tile.rows.end + 2 + int(std::ceil(high_row * slices))},
            {tile.columns.begin - 2 + int(std::floor(low_column * slices)),
             tile.columns.end + 2 + int(std::ceil(high_column * slices))}};
}

Box reach_outward(const Direction &direction, const Box &tile, int distance,
                  const RayRanges &rays) {
    const Range slices{tile.slices.begin - distance - 1, tile.slices.end - distance};
    const Crossing first = direction.crossing(slices.begin);
    const Crossing last = direction.crossing(slices.end - 1);
    const auto [row_low, row_high] = std::minmax(first.row, last.row);
    const auto [column_low, column_high] = std::minmax(first.column, last.column);
    return {slices,
            {rays.rows.begin + row_low, rays.rows.end + row_high + 1},
            {rays.columns.begin + column_low, rays.columns.end + column_high + 1}};
}

void LatticePlanes::resize(const Tiling &tiling, bool pairs) {
    rows_ = tiling.frame.rows;
    columns_ = tiling.frame.columns;
    parts_ = tiling.column_tiles;
    tile_columns_ = tiling.tile_columns;
    for (int generation = 0; generation < 2; ++generation) {
        high_[generation].resize(reals(tiling.frame, false) / 2);
        if (pairs) low_[generation].resize(high_[generation].size());
        filled_[generation].resize(std::size_t(rows_ + 1) * std::size_t(parts_));
    }
}

bool LatticePlanes::any(int slab, const Crossing &crossing, const RayRanges &rays) const {
    const std::vector<unsigned char> &filled = filled_[(slab - 1) & 1];
    const int row_begin = std::max(-1, rays.rows.begin + crossing.row);
    const int row_end = std::min(rows_, rays.rows.end + crossing.row);
    const int column_begin = std::max(-1, rays.columns.begin + crossing.column);
    const int column_end = std::min(columns_, rays.columns.end + crossing.column);
    if (column_end <= column_begin) return false;
    for (int row = row_begin; row < row_end; ++row)
        for (std::size_t i = part(row, column_begin); i <= part(row, column_end - 1); ++i)
            if (filled[i]) return true;
    return false;
}

void LatticePlanes::load_row(int slab, int row, int column, int count, Real *high,
                             Real *low) const {
    const int begin = std::clamp(column, -1, columns_), left = std::min(begin - column, count);
    const int inside = std::min(column + count, columns_) - begin;
    const Real *from[2] = {high_[(slab - 1) & 1].data(), low_[(slab - 1) & 1].data()};
    Real *to[2] = {high, low};
    for (int half = 0; half < (low ? 2 : 1); ++half) {
        if (row < -1 || row >= rows_ || inside <= 0) {
            std::fill_n(to[half], count, Real(0));
            continue;
        }
        std::fill_n(to[half], left, Real(0));
        std::memcpy(to[half] + left, from[half] + offset(row, begin),
                    std::size_t(inside) * sizeof(Real));
        std::fill(to[half] + left + inside, to[half] + count, Real(0));
    }
}

void LatticePlanes::fetch_row(int slab, int row_before, int row_after, const Range &columns) const {
    const auto fetch = [&](const Reals &half, int row) {
        if (row < -1 || row >= rows_) return;
        for (int c = columns.begin; c < columns.end; c += kLanes)
            __builtin_prefetch(half.data() + offset(row, c));
    };
    for (const Reals *half : {high_, low_}) {
        if (half->empty()) continue;
        if (slab > 0) fetch(half[(slab - 1) & 1], row_before);
        fetch(half[slab & 1], row_after);
    }
}

void LatticePlanes::store_row(int slab, int row, const Range &columns, const Real *high,
                              const Real *low) {
    const std::size_t to = offset(row, columns.begin);
    filled_[slab & 1][part(row, columns.begin)] = copy_row(
        high, columns.size(), std::numeric_limits<Real>::max(), 0, high_[slab & 1].data() + to);
    if (low)
        std::memcpy(low_[slab & 1].data() + to, low, std::size_t(columns.size()) * sizeof(Real));
}

void LatticePlanes::clear(int slab, const Box &tile) {
    const Range rows = owned(tile.rows), columns = owned(tile.columns);
    for (int row = rows.begin; row < rows.end; ++row) {
        filled_[slab & 1][part(row, columns.begin)] = false;
        for (Reals *half : {&high_[slab & 1], &low_[slab & 1]})
            if (!half->empty())
                std::fill_n(half->begin() + std::ptrdiff_t(offset(row, columns.begin)),
                            columns.size(), Real(0));
    }
}

Needs::Needs(const Pass &pass, const Tiling &tiling, const Weights &weights, const Box &wanted)
    : slabs_(std::size_t(tiling.slabs)),
      tiles_(std::size_t(tiling.row_tiles) * std::size_t(tiling.column_tiles)),
      directions_(pass.directions.size()),
      needs_(directions_ * slabs_ * tiles_, Need::nothing) {
    for (std::size_t d = 0; d < directions_; ++d) {
        const Direction &direction = pass.directions[d];
        for (int slab = tiling.slabs - 1; slab >= 0; --slab)
            for (int tile = 0; tile < int(tiles_); ++tile) {
                const Box box = tiling.box(slab, tile);
                Need &need = needs_[(d * slabs_ + std::size_t(slab)) * tiles_ + std::size_t(tile)];
                const Box own = box.common(wanted);
                if (!own.empty() && weights.any(direction.index, pass.frame, own))
                    need = Need::values;
                if (need == Need::nothing || slab == 0 || !direction.has_far_field) continue;
                const RayRanges rays = rays_of(direction, box);
                const Crossing before = direction.crossing(box.slices.begin - 1);
                Need *sources = &needs_[(d * slabs_ + std::size_t(slab) - 1) * tiles_];
                tiling.all_between(
                    {rays.rows.begin + before.row, rays.rows.end + before.row},
                    {rays.columns.begin + before.column, rays.columns.end + before.column},
                    [&](int source) {
                        if (sources[source] == Need::nothing) sources[source] = Need::sums;
                        return true;
                    });
            }
    }
}

bool Needs::any(int slab, int tile) const {
    for (std::size_t d = 0; d < directions_; ++d)
        if (of(slab, tile, d) != Need::nothing) return true;
    return false;
}

}  // namespace volillum::sweep_detail
