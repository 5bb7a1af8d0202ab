// The march of one direction through a tile.
#include "sweep_lattice.h"
#include "sweep_near.h"

namespace volillum::sweep_detail {
namespace {

Bilinear sampler(const Block &block, int t, const Crossing &crossing, const RayRanges &rays) {
    return {block.at(t, rays.rows.begin + crossing.row, rays.columns.begin + crossing.column),
            block.row_pitch(), crossing.row_fraction, crossing.column_fraction};
}

void prepare(const March &m) {
    Scratch &scratch = m.scratch;
    const Range &slices = m.tile.slices;
    if (!m.near) {
        const std::vector<Tap> &taps = m.direction.near_field;
        set_runs(taps.data(), taps.data() + taps.size(), m.block, m.unit(), scratch.stencil);
    }
    scratch.near.resize(
        std::size_t(slices.size() * kStencilRows * round_up(m.wanted.columns.size())));
    scratch.crossings.clear();
    for (int t = slices.begin; t < slices.end; ++t)
        scratch.crossings.push_back(m.direction.crossing(t));
    scratch.samplers.clear();
    scratch.tails.clear();
    if (!m.direction.has_far_field) return;
    for (int t = slices.begin; t < slices.end; ++t)
        scratch.samplers.push_back(
            sampler(m.block, t - m.near_slices, m.direction.crossing(t - m.near_slices), m.rays));
    for (int t = slices.begin - 1; m.tail && t < slices.end; ++t) {
        const int end = t - m.near_slices - m.direction.tail;
        scratch.tails.push_back(sampler(*m.tail, end, m.direction.crossing(end), m.rays));
    }
}

// The near field of a row of voxels, computed for kStencilRows rows of a slice together.
const Real *near_row(const March &m, int t, int b) {
    if (m.near) return m.near->row(t, b);
    const Range &rows = m.wanted.rows;
    const int lanes = round_up(m.wanted.columns.size());
    const bool together = rows.size() >= kStencilRows;
    // The last rows may have been among those of the group before.
    const int first = rows.begin + (b - rows.begin) / kStencilRows * kStencilRows;
    const int group = together ? std::min(first, rows.end - kStencilRows) : b;
    Real *near = m.scratch.near.data() + (t - m.tile.slices.begin) * kStencilRows * lanes;
    if (b == first || !together)
        apply_stencil(m.scratch.stencil, m.block.at(t, group, m.wanted.columns.begin),
                      m.block.row_pitch(), together ? kStencilRows : 1, m.wanted.columns.size(),
                      near, lanes);
    return near + (b - group) * lanes;
}

// The quantity at a row of voxels; `depth` is the row of lattice rays below it (null: there is no
// far field), `level` what the row above has left. One row before the first, only that.
void write_row(const March &m, int t, int b, const Crossing &crossing, const Real *depth,
               Real *level) {
    const int count = m.wanted.columns.size();
    Row row{};
    if (depth) {
        const Real length = m.direction.slice_length * m.unit();
        row.depth = depth + (m.wanted.columns.begin - crossing.column - 1 - m.rays.columns.begin);
        row.level = level;
        row.left = length * crossing.column_fraction;
        row.right = length * (1 - crossing.column_fraction);
        row.above = crossing.row_fraction;
        row.here = 1 - crossing.row_fraction;
        if (b < m.wanted.rows.begin) {
            level_row(row.depth, row.left, row.right, count, level);
            return;
        }
    }
    if (!depth || !m.direction.near_field.empty()) row.near = near_row(m, t, b);
    row.exponential = m.quantity == Quantity::transmittance;
    row.weight = m.weight;
    row.power = &m.power;
    row.add = m.out.add;
    row.count = count;
    row.out = m.out.at(t, b);
    row.next = m.out.row_pitch;
    finish_row(row);
}

// How many slices of the tile a row of rays must pass: it is done when it has left sideways.
int slices_of_row(const March &m, int u) {
    const std::vector<Crossing> &crossings = m.scratch.crossings;
    const Range &rows = m.tile.rows;
    const int last_row = crossings.back().row;
    int end = int(crossings.size());
    while (end > 0) {
        const int row = crossings[std::size_t(end - 1)].row;
        if (u >= rows.begin - 1 - std::max(row, last_row) && u < rows.end - std::min(row, last_row))
            break;
        --end;
    }
    return end;
}

void store_row(const March &m, int u) {
    const Crossing &last = m.scratch.crossings.back();
    const Range rows = owned(m.tile.rows), columns = owned(m.tile.columns);
    const int row = u + last.row;
    if (row < rows.begin || row >= rows.end) return;
    const int first = columns.begin - last.column - m.rays.columns.begin;
    m.planes->store_row(m.slab, row, columns, m.scratch.high.data() + first,
                        m.direction.finite ? m.scratch.low.data() + first : nullptr);
}

// The i-th of so many parts of a range, whole lines of numbers.
Range part_of(const Range &range, int i, int parts) {
    const int size = round_up((range.size() + parts - 1) / parts), begin = range.begin + i * size;
    return Range{begin, begin + size}.common(range);
}

}  // namespace

RayRanges rays_of(const Direction &direction, const Box &tile) {
    const Crossing first = direction.crossing(tile.slices.begin);
    const Crossing last = direction.crossing(tile.slices.end - 1);
    const auto [row_low, row_high] = std::minmax(first.row, last.row);
    const auto [column_low, column_high] = std::minmax(first.column, last.column);
    return {{tile.rows.begin - 1 - row_high, tile.rows.end - row_low},
            {tile.columns.begin - 1 - column_high, tile.columns.end - column_low}};
}

void march(const March &m) {
    prepare(m);
    const Range &slices = m.tile.slices, &rows = m.wanted.rows;
    const Range written = m.out.first ? m.wanted.slices : Range{0, 0};
    Scratch &scratch = m.scratch;
    if (!m.direction.has_far_field) {
        for (int t = written.begin; t < written.end; ++t)
            for (int b = rows.begin; b < rows.end; ++b)
                write_row(m, t, b, m.direction.crossing(t), nullptr, nullptr);
        return;
    }
    // A row of rays at a time through all slices: its sums stay in registers, and what the next row
    // needs of it in the first-level cache. A row of voxels reads up to a vector past its last
    // column: what comes of it is not written.
    const int rays = m.rays.columns.size(), width = round_up(rays), count = slices.size();
    const int lanes = round_up(m.wanted.columns.size());
    scratch.across.resize(std::size_t(width * count));
    scratch.depth.resize(std::size_t(width * count + kLanes));
    scratch.level.resize(std::size_t(lanes * count));
    scratch.high.assign(std::size_t(width), 0);
    scratch.low.assign(std::size_t(width), 0);
    Real *high = scratch.high.data(), *low = m.direction.finite ? scratch.low.data() : nullptr;
    const Crossing before = m.direction.crossing(slices.begin - 1);
    int interpolated = 0;  // slices whose row of voxels above the rays is in `across`
    for (int u = m.rays.rows.begin; u < m.rays.rows.end; ++u) {
        const int end = slices_of_row(m, u), row = u - m.rays.rows.begin;
        if (m.slab > 0)
            m.planes->load_row(m.slab, u + before.row, m.rays.columns.begin + before.column, rays,
                               high, low);
        else
            for (Reals *half : {&scratch.high, &scratch.low})
                std::fill(half->begin(), half->end(), Real(0));
        if (m.tail) {
            advance_window(scratch.samplers.data(), scratch.tails.data(),
                           Real(m.direction.tail_fraction), end, row, width, high, low,
                           scratch.depth.data());
        } else {
            interpolate_across(scratch.samplers.data(), interpolated, end, row, width,
                               scratch.across.data());
            advance(scratch.samplers.data(), end, row, width, scratch.across.data(), high, low,
                    scratch.depth.data());
            interpolated = end;
        }
        if (m.planes) store_row(m, u);
        for (int t = slices.begin; t < slices.end; ++t) {
            // A part of the next row with each slice: together they would be more than the first
            // level's cache waits for at once.
            if (m.planes)
                m.planes->fetch_row(m.slab, u + 1 + before.row,
                                    u + 1 + scratch.crossings.back().row,
                                    part_of(m.tile.columns, t - slices.begin, count));
            if (t < written.begin || t >= written.end || t >= slices.begin + end) continue;
            const Crossing &here = scratch.crossings[std::size_t(t - slices.begin)];
            const int b = u + here.row;
            if (b >= rows.begin - 1 && b < rows.end)
                write_row(m, t, b, here, scratch.depth.data() + (t - slices.begin) * width,
                          scratch.level.data() + (t - slices.begin) * lanes);
        }
    }
}

}  // namespace volillum::sweep_detail
