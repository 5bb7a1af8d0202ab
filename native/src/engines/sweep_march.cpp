// The kernel of the sweep: sampling, summing, un-shearing, near field and exponential of one
// direction in one tile.
#include "sweep_tile.h"

namespace volillum::sweep_detail {
namespace {

// Bilinear sample of a slice along a lattice row: four weights, constant per slice.
struct Bilinear {
    const Real *upper, *lower;  // rows b and b + 1 of the block
    Real w00, w01, w10, w11;
    VOLILLUM_INLINE Bilinear(const Block &block, int t, const Crossing &crossing, int row,
                             int column)
        : upper(block.at(t, row + crossing.row, column + crossing.column)),
          lower(upper + block.row_pitch()) {
        const Real f = crossing.row_fraction, g = crossing.column_fraction;
        w00 = (1 - f) * (1 - g);
        w01 = (1 - f) * g;
        w10 = f * (1 - g);
        w11 = f * g;
    }
    VOLILLUM_INLINE Real operator()(int v) const {
        return w00 * upper[v] + w01 * upper[v + 1] + w10 * lower[v] + w11 * lower[v + 1];
    }
};

// Adds x >= 0 to high + low. Fast two-sum: where x exceeds `high` its error is not caught, which
// happens at most once per doubling and so costs a few units of the last place in all.
VOLILLUM_INLINE void add_sample(Real &high, Real &low, Real x) {
    const Real sum = high + x;
    low += x - (sum - high);
    high = sum;
}

// Adds x of any sign to high + low exactly (Knuth's two-sum): samples that leave a window take
// away what they brought, to the last bit.
VOLILLUM_INLINE void add_exactly(Real &high, Real &low, Real x) {
    const Real sum = high + x, part = sum - high;
    low += (high - (sum - part)) + (x - part);
    high = sum;
}

// depth[v]: optical depth, in slice lengths, from the ray's point on the slice to the border
// (trapezoid rule), then the slice's own sample joins the sum.
VOLILLUM_INLINE void advance(const Bilinear &sample, int count, Real *__restrict high,
                             Real *__restrict low, Real *__restrict depth) {
    for (int v = 0; v < count; ++v) {
        const Real s = sample(v);
        depth[v] = high[v] + (low[v] + Real(0.5) * s);
        add_sample(high[v], low[v], s);
    }
}

// The same for a ray that ends n + f slices away, n = Direction::tail: the sum holds the n samples
// before this slice's own, and the end lies between the samples `last` (n slices away) and
// `beyond`: half of this slice's, minus half of the last one's that the trapezoid rule has too
// much, plus the integral of the linear interpolant over the remaining f.
VOLILLUM_INLINE void advance_window(const Bilinear &sample, const Bilinear &last,
                                    const Bilinear &beyond, Real fraction, int count,
                                    Real *__restrict high, Real *__restrict low,
                                    Real *__restrict depth) {
    const Real w_beyond = Real(0.5) * fraction * fraction;
    const Real w_last = fraction - w_beyond - Real(0.5);
    for (int v = 0; v < count; ++v) {
        const Real s = sample(v), s_last = last(v);
        const Real ends = Real(0.5) * s + w_last * s_last + w_beyond * beyond(v);
        depth[v] = std::max(Real(0), high[v] + (low[v] + ends));
        add_exactly(high[v], low[v], s);
        add_exactly(high[v], low[v], -s_last);
    }
}

// Optical depth at a row of voxels from the lattice rows on both sides of it.
VOLILLUM_INLINE void unshear(const Real *__restrict above, const Real *__restrict here,
                             const Crossing &crossing, Real slice_length, int count,
                             Real *__restrict row) {
    const Real f = crossing.row_fraction, g = crossing.column_fraction;
    const Real w00 = slice_length * f * g, w01 = slice_length * f * (1 - g);
    const Real w10 = slice_length * (1 - f) * g, w11 = slice_length * (1 - f) * (1 - g);
    for (int c = 0; c < count; ++c)
        row[c] = w00 * above[c] + w01 * above[c + 1] + w10 * here[c] + w11 * here[c + 1];
}

// The stencil of the near field at a row of voxels, four vectors at a time in registers.
VOLILLUM_INLINE void add_near_field(const Real *block, const Scratch &scratch, int count,
                                    Real *row) {
    const std::size_t taps = scratch.offsets.size();
    const std::ptrdiff_t *offsets = scratch.offsets.data();
    const Real *coefficients = scratch.coefficients.data();
    int c = 0;
    for (; c + 4 * kLanes <= count; c += 4 * kLanes) {
        Pack s0 = pack(row + c), s1 = pack(row + c + kLanes);
        Pack s2 = pack(row + c + 2 * kLanes), s3 = pack(row + c + 3 * kLanes);
        for (std::size_t tap = 0; tap < taps; ++tap) {
            const Real *p = block + c + offsets[tap];
            const Real w = coefficients[tap];
            s0 += w * pack(p);
            s1 += w * pack(p + kLanes);
            s2 += w * pack(p + 2 * kLanes);
            s3 += w * pack(p + 3 * kLanes);
        }
        pack(row + c) = s0;
        pack(row + c + kLanes) = s1;
        pack(row + c + 2 * kLanes) = s2;
        pack(row + c + 3 * kLanes) = s3;
    }
    for (; c < count; c += kLanes) {
        Pack s = pack(row + c);
        for (std::size_t tap = 0; tap < taps; ++tap)
            s += coefficients[tap] * pack(block + c + offsets[tap]);
        pack(row + c) = s;
    }
}

VOLILLUM_DISPATCH void advance_row(const March &m, int t, int u, const Crossing &crossing,
                                   Real *depth) {
    const int v = m.sums.columns.begin, count = m.sums.columns.size();
    Real *high = m.sums.high.data() + m.sums.offset(u, v);
    Real *low = m.sums.low.data() + m.sums.offset(u, v);
    const Bilinear sample(m.block, t, crossing, u, v);
    if (!m.tail) return advance(sample, count, high, low, depth);
    const Direction &direction = m.direction;
    const int t_last = t - direction.tail, t_beyond = t_last - 1;
    advance_window(sample, Bilinear(*m.tail, t_last, direction.crossing(t_last), u, v),
                   Bilinear(*m.tail, t_beyond, direction.crossing(t_beyond), u, v),
                   static_cast<Real>(direction.tail_fraction), count, high, low, depth);
}

VOLILLUM_DISPATCH void finish_row(const March &m, int t, int b, const Crossing &crossing,
                                  const Real *above, const Real *here, Real *result) {
    const int count = round_up(m.tile.columns.size());
    Real *__restrict row = m.scratch.row.data();
    const int left = m.tile.columns.begin - crossing.column - 1 - m.sums.columns.begin;
    if (above)
        unshear(above + left, here + left, crossing, m.direction.slice_length, count, row);
    else
        for (int c = 0; c < count; ++c) row[c] = 0;
    if (!m.direction.near_field.empty())
        add_near_field(m.block.at(t, b, m.tile.columns.begin), m.scratch, count, row);
    Real *__restrict out = result;
    if (m.quantity == Quantity::transmittance)
        for (int c = 0; c < count; ++c) out[c] = exp_negative(row[c]);
    else
        for (int c = 0; c < count; ++c) out[c] = row[c];
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
    const Direction &direction = m.direction;
    const Range &slices = m.tile.slices, &rows = m.tile.rows;
    const std::size_t width = std::size_t(m.sums.columns.size());
    const std::size_t padded = std::size_t(round_up(m.tile.columns.size()));
    Scratch &scratch = m.scratch;
    // A row of voxels reads up to a vector past its last column: its values go to the padding.
    scratch.depth_above.resize(width + kLanes);
    scratch.depth_here.resize(width + kLanes);
    scratch.row.resize(padded);
    scratch.offsets.clear();
    scratch.coefficients.clear();
    for (const Tap &tap : direction.near_field) {
        scratch.offsets.push_back(-tap.slices_outward * m.block.slice_pitch() +
                                  tap.row * m.block.row_pitch() + tap.column);
        scratch.coefficients.push_back(tap.coefficient);
    }
    const int last_row = direction.crossing(slices.end - 1).row;
    for (int t = slices.begin; t < slices.end; ++t) {
        Real *result =
            m.result ? m.result + std::size_t((t - slices.begin) * rows.size()) * padded : nullptr;
        const Crossing here = direction.crossing(t);
        if (!direction.has_far_field) {
            for (int b = rows.begin; result && b < rows.end; ++b, result += padded)
                finish_row(m, t, b, here, nullptr, nullptr, result);
            continue;
        }
        // Rays that a later slice of the tile needs must pass this one too.
        const Crossing sampled = direction.crossing(t - m.near_slices);
        const int begin = rows.begin - 1 - std::max(here.row, last_row);
        const int end = rows.end - std::min(here.row, last_row);
        for (int u = begin; u < end; ++u) {
            std::swap(scratch.depth_above, scratch.depth_here);
            advance_row(m, t - m.near_slices, u, sampled, scratch.depth_here.data());
            const int b = u + here.row;
            if (!result || b < rows.begin || b >= rows.end) continue;
            finish_row(m, t, b, here, scratch.depth_above.data(), scratch.depth_here.data(),
                       result);
            result += padded;
        }
    }
}

}  // namespace volillum::sweep_detail
