// The kernel of the sweep: sampling, summing, un-shearing, near field and exponential of one
// direction in one tile.
#include "sweep_tile.h"

namespace volillum::sweep_detail {

Bilinear::Bilinear(const Block &block, int t, const Crossing &crossing, int row, int column)
    : upper(block.at(t, row + crossing.row, column + crossing.column)), pitch(block.row_pitch()) {
    const Real f = crossing.row_fraction, g = crossing.column_fraction;
    w00 = (1 - f) * (1 - g);
    w01 = (1 - f) * g;
    w10 = f * (1 - g);
    w11 = f * g;
}

namespace {

// Adds a pack of x >= 0 to high + low. Fast two-sum: where x exceeds `high` its error is not
// caught, which happens at most once per doubling and so costs a few units of the last place in
// all.
VOLILLUM_INLINE void add_sample(Pack &high, Pack &low, const Pack &x) {
    const Pack sum = high + x;
    low += x - (sum - high);
    high = sum;
}

// Adds x of any sign to high + low exactly (Knuth's two-sum): samples that leave a window take
// away what they brought, to the last bit.
VOLILLUM_INLINE void add_exactly(Pack &high, Pack &low, const Pack &x) {
    const Pack sum = high + x, part = sum - high;
    low += (high - (sum - part)) + (x - part);
    high = sum;
}

VOLILLUM_INLINE void sample(const Bilinear &slice, std::ptrdiff_t at, Pack &value) {
    const Real *upper = slice.upper + at, *lower = upper + slice.pitch;
    value = slice.w00 * pack(upper) + slice.w01 * pack(upper + 1) + slice.w10 * pack(lower) +
            slice.w11 * pack(lower + 1);
}

// Marches a row of rays through `slices` slices. depth[t * width + v]: optical depth, in slice
// lengths, from the ray's point on slice t to the border (trapezoid rule); then the slice's own
// sample joins the sum. `row` counts from the first lattice row.
VOLILLUM_DISPATCH void advance(const std::vector<Bilinear> &samplers, int slices, int row,
                               int width, Real *high, Real *low, Real *depth) {
    const Bilinear *first = samplers.data();
    for (int v = 0; v < width; v += kLanes) {
        Pack h = pack(high + v), l = pack(low + v), s;
        Real *to = depth + v;
        for (int t = 0; t < slices; ++t, to += width) {
            sample(first[t], row * first[t].pitch + v, s);
            pack(to) = h + (l + Real(0.5) * s);
            add_sample(h, l, s);
        }
        pack(high + v) = h;
        pack(low + v) = l;
    }
}

// The same for rays that end n + f slices away, n = Direction::tail: the sum holds the n samples
// before a slice's own, and the end lies between the samples `last` (n slices away) and `beyond`:
// half of the slice's own, minus half of the last one's that the trapezoid rule has too much, plus
// the integral of the linear interpolant over the remaining f. `tails` has `beyond` of the first
// slice, and then each slice's `last`, which is the next one's `beyond`.
VOLILLUM_DISPATCH void advance_window(const std::vector<Bilinear> &samplers,
                                      const std::vector<Bilinear> &tails, Real fraction, int slices,
                                      int row, int width, Real *high, Real *low, Real *depth) {
    const Real w_beyond = Real(0.5) * fraction * fraction;
    const Real w_last = fraction - w_beyond - Real(0.5);
    for (int v = 0; v < width; v += kLanes) {
        Pack h = pack(high + v), l = pack(low + v), s, last, beyond;
        sample(tails[0], row * tails[0].pitch + v, beyond);
        Real *to = depth + v;
        for (int t = 0; t < slices; ++t, to += width) {
            const Bilinear &head = samplers[std::size_t(t)], &tail = tails[std::size_t(t) + 1];
            sample(head, row * head.pitch + v, s);
            sample(tail, row * tail.pitch + v, last);
            const Pack left = h + (l + (Real(0.5) * s + w_last * last + w_beyond * beyond));
            pack(to) = left > Real(0) ? left : Pack{};  // negative only by rounding
            add_exactly(h, l, s);
            last = -last;
            add_exactly(h, l, last);
            beyond = -last;
        }
        pack(high + v) = h;
        pack(low + v) = l;
    }
}

// Optical depth at a row of voxels from the lattice rows on both sides of it.
struct Unshear {
    const Real *__restrict above, *__restrict here;
    Real w00, w01, w10, w11;
    VOLILLUM_INLINE Unshear(const Real *above_, const Real *here_, const Crossing &crossing,
                            Real slice_length)
        : above(above_), here(here_) {
        const Real f = crossing.row_fraction, g = crossing.column_fraction;
        w00 = slice_length * f * g;
        w01 = slice_length * f * (1 - g);
        w10 = slice_length * (1 - f) * g;
        w11 = slice_length * (1 - f) * (1 - g);
    }
    VOLILLUM_INLINE Real operator()(int c) const {
        return w00 * above[c] + w01 * above[c + 1] + w10 * here[c] + w11 * here[c + 1];
    }
};

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

// The quantity at a row of voxels.
VOLILLUM_DISPATCH void finish_row(const March &m, int t, int b, const Crossing &crossing,
                                  const Real *above, const Real *here, Real *result) {
    const int count = round_up(m.tile.columns.size());
    const int left = m.tile.columns.begin - crossing.column - 1 - m.sums.columns.begin;
    const bool transmittance = m.quantity == Quantity::transmittance;
    Real *__restrict row = result;
    const std::ptrdiff_t offset = above ? left : 0;
    const Unshear unshear(above + offset, here + offset, crossing, m.direction.slice_length);
    if (above && transmittance && m.direction.near_field.empty()) {
        for (int c = 0; c < count; ++c) row[c] = exp_negative(unshear(c));
        return;
    }
    if (above)
        for (int c = 0; c < count; ++c) row[c] = unshear(c);
    else
        std::fill_n(row, count, Real(0));
    add_near_field(m.block.at(t, b, m.tile.columns.begin), m.scratch, count, row);
    if (transmittance)
        for (int c = 0; c < count; ++c) row[c] = exp_negative(row[c]);
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
    const int width = m.sums.columns.size(), count = slices.size();
    const std::size_t padded = std::size_t(round_up(m.tile.columns.size()));
    Scratch &scratch = m.scratch;
    scratch.offsets.clear();
    scratch.coefficients.clear();
    for (const Tap &tap : direction.near_field) {
        scratch.offsets.push_back(-tap.slices_outward * m.block.slice_pitch() +
                                  tap.row * m.block.row_pitch() + tap.column);
        scratch.coefficients.push_back(tap.coefficient);
    }
    const auto result = [&](int t, int b) {
        return m.result + std::size_t((t - slices.begin) * rows.size() + b - rows.begin) * padded;
    };
    if (!direction.has_far_field) {
        for (int t = slices.begin; m.result && t < slices.end; ++t)
            for (int b = rows.begin; b < rows.end; ++b)
                finish_row(m, t, b, direction.crossing(t), nullptr, nullptr, result(t, b));
        return;
    }
    const auto sampler = [&](const Block &block, int t) {
        return Bilinear(block, t, direction.crossing(t), m.sums.rows.begin, m.sums.columns.begin);
    };
    scratch.samplers.clear();
    scratch.tails.clear();
    for (int t = slices.begin; t < slices.end; ++t)
        scratch.samplers.push_back(sampler(m.block, t - m.near_slices));
    if (m.tail)
        for (int t = slices.begin - 1; t < slices.end; ++t)
            scratch.tails.push_back(sampler(*m.tail, t - m.near_slices - direction.tail));

    // A row of rays at a time through all slices: its sums stay in registers, and the depths of
    // this row and the one above in the first-level cache. A row of voxels reads up to a vector
    // past its last column: its values go to the padding.
    scratch.depth_above.resize(std::size_t(width * count + kLanes));
    scratch.depth_here.resize(std::size_t(width * count + kLanes));
    scratch.crossings.clear();
    for (int t = slices.begin; t < slices.end; ++t)
        scratch.crossings.push_back(direction.crossing(t));
    const int last_row = scratch.crossings.back().row;
    for (int u = m.sums.rows.begin; u < m.sums.rows.end; ++u) {
        // A row is done when it has left the tile sideways; until then it passes every slice.
        int end = count;
        while (end > 0) {
            const int row = scratch.crossings[std::size_t(end - 1)].row;
            if (u >= rows.begin - 1 - std::max(row, last_row) &&
                u < rows.end - std::min(row, last_row))
                break;
            --end;
        }
        std::swap(scratch.depth_above, scratch.depth_here);
        Real *high = m.sums.high.data() + m.sums.offset(u, m.sums.columns.begin);
        Real *low = m.sums.low.data() + m.sums.offset(u, m.sums.columns.begin);
        const int row = u - m.sums.rows.begin;
        if (m.tail)
            advance_window(scratch.samplers, scratch.tails,
                           static_cast<Real>(direction.tail_fraction), end, row, width, high, low,
                           scratch.depth_here.data());
        else
            advance(scratch.samplers, end, row, width, high, low, scratch.depth_here.data());
        for (int t = slices.begin; m.result && t < slices.begin + end; ++t) {
            const Crossing &here = scratch.crossings[std::size_t(t - slices.begin)];
            const int b = u + here.row;
            const std::size_t offset = std::size_t((t - slices.begin) * width);
            if (b >= rows.begin && b < rows.end)
                finish_row(m, t, b, here, scratch.depth_above.data() + offset,
                           scratch.depth_here.data() + offset, result(t, b));
        }
    }
}

}  // namespace volillum::sweep_detail
