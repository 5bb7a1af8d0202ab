// Copies into and out of a tile, and the weighted sums over directions.
#include "sweep_tile.h"

#include <type_traits>

namespace volillum::sweep_detail {
namespace {

// Whether any of many numbers differs from 0 is asked of their bits: that is vector code.
using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;

Range clip(const Range &range, int size) {
    const int begin = std::clamp(range.begin, 0, size);
    return {begin, std::max(begin, std::min(range.end, size))};
}

VOLILLUM_INLINE Real clipped(Real value, Real largest) {
    return value < largest ? value : largest;
}

}  // namespace

VOLILLUM_DISPATCH bool copy_row(const Real *source, int count, Real largest, std::ptrdiff_t next,
                                Real *target) {
    for (int c = 0; c < count; c += kLanes) __builtin_prefetch(source + next + c);
    const Real *__restrict from = source;
    Real *__restrict to = target;
    Bits bits = 0;
    for (int c = 0; c < count; ++c) {
        const Real value = clipped(from[c], largest);
        to[c] = value;
        bits |= std::bit_cast<Bits>(value);
    }
    return bits != 0;
}

bool Block::load(const Frame &frame, const Real *sigma_t, Real largest, const Box &box) {
    box_ = box;
    // One lane beyond: kernels read whole vectors. An odd number of lanes keeps the rows of a
    // column in different cache sets.
    row_pitch_ = round_up(box.columns.size()) + kLanes;
    if (row_pitch_ / kLanes % 2 == 0) row_pitch_ += kLanes;
    slice_pitch_ = row_pitch_ * box.rows.size();
    const std::size_t size = std::size_t(slice_pitch_) * std::size_t(box.slices.size());
    if (data_.size() < size + 4 * kLanes) data_.resize(size + 4 * kLanes);

    const Range slices = clip(box.slices, frame.slices), rows = clip(box.rows, frame.rows),
                columns = clip(box.columns, frame.columns);
    bool filled = false;
    box.for_rows(frame, [&](int t, int b) {
        Real *row = const_cast<Real *>(at(t, b, box.columns.begin));
        Real *row_end = row + box.columns.size();
        if (t < slices.begin || t >= slices.end || b < rows.begin || b >= rows.end ||
            columns.size() == 0) {
            std::fill(row, row_end, Real(0));
            return;
        }
        Real *inside = row + (columns.begin - box.columns.begin);
        std::fill(row, inside, Real(0));
        filled |= copy_row(sigma_t + frame.element(t, b, columns.begin), columns.size(), largest,
                           frame.inner_stride(), inside);
        std::fill(inside + columns.size(), row_end, Real(0));
    });
    return filled;
}

void RaySums::reset(const RayRanges &rays) {
    rows = rays.rows;
    columns = {rays.columns.begin, rays.columns.begin + round_up(rays.columns.size())};
    const std::size_t size = std::size_t(rows.size()) * std::size_t(columns.size());
    high.assign(size, 0);
    low.assign(size, 0);
}

namespace {

// out[i] = or += sums[i] for the first `count` of a pack.
VOLILLUM_INLINE void emit(const Pack &sums, int count, bool add, Real *out) {
    if (count >= kLanes) {
        if (add)
            pack(out) += sums;
        else
            pack(out) = sums;
    } else {
        for (int k = 0; k < count; ++k) out[k] = add ? out[k] + sums[k] : sums[k];
    }
}

VOLILLUM_DISPATCH void weigh_one(const Real *values, std::size_t value_stride, int directions,
                                 const Real *weights, int count, bool add, Real *out,
                                 std::ptrdiff_t next) {
    for (int i = 0; i < count; i += kLanes) {
        const Real *p = values + i;
        Pack s = weights[0] * pack(p);
        for (int d = 1; d < directions; ++d)
            s += weights[d * kChannelGroup] * pack(p += value_stride);
        __builtin_prefetch(out + i + next, 1);
        emit(s, count - i, add, out + i);
    }
}

VOLILLUM_DISPATCH void weigh_group(const Real *values, std::size_t value_stride, int directions,
                                   const Real *weights, int channels, int count, bool add,
                                   Real *out, std::ptrdiff_t out_stride, std::ptrdiff_t next) {
    for (int i = 0; i < count; i += kLanes) {
        const Real *p = values + i, *w = weights;
        Pack s0{}, s1{}, s2{}, s3{};
        for (int d = 0; d < directions; ++d, p += value_stride, w += kChannelGroup) {
            const Pack value = pack(p);
            s0 += w[0] * value;
            s1 += w[1] * value;
            s2 += w[2] * value;
            s3 += w[3] * value;
        }
        Real *to = out + i;
        for (int channel = 0; channel < channels; ++channel)
            __builtin_prefetch(to + channel * out_stride + next, 1);
        emit(s0, count - i, add, to);
        if (channels > 1) emit(s1, count - i, add, to + out_stride);
        if (channels > 2) emit(s2, count - i, add, to + 2 * out_stride);
        if (channels > 3) emit(s3, count - i, add, to + 3 * out_stride);
    }
}

}  // namespace

void weigh_row(const Real *values, std::size_t value_stride, int directions, const Real *weights,
               int channels, int count, bool add, Real *out, std::ptrdiff_t out_stride,
               std::ptrdiff_t next) {
    if (channels == 1)
        weigh_one(values, value_stride, directions, weights, count, add, out, next);
    else
        weigh_group(values, value_stride, directions, weights, channels, count, add, out,
                    out_stride, next);
}

VOLILLUM_DISPATCH void multiply_add(const Real *values, const Real *weights, int count,
                                    Real *sums) {
    const Real *__restrict p = values;
    const Real *__restrict w = weights;
    Real *__restrict sum = sums;
    for (int i = 0; i < count; ++i) sum[i] += w[i] * p[i];
}

VOLILLUM_DISPATCH void transpose(const Real *source, int rows, int columns, Real *target) {
    using Four [[gnu::vector_size(4 * sizeof(Real))]] = Real;
    constexpr int side = 16;  // one cache line; more rows of 2^n values would evict each other
    for (int r0 = 0; r0 < rows; r0 += side)
        for (int c0 = 0; c0 < columns; c0 += side) {
            const int r1 = std::min(r0 + side, rows), c1 = std::min(c0 + side, columns);
            for (int r = r0; r < r1; r += 4)
                for (int c = c0; c < c1; c += 4) {
                    const Real *from = source + std::ptrdiff_t(r) * columns + c;
                    Real *to = target + std::ptrdiff_t(c) * rows + r;
                    if (r + 4 > r1 || c + 4 > c1) {
                        for (int i = 0; i < std::min(4, r1 - r); ++i)
                            for (int j = 0; j < std::min(4, c1 - c); ++j)
                                to[std::ptrdiff_t(j) * rows + i] =
                                    from[std::ptrdiff_t(i) * columns + j];
                        continue;
                    }
                    // Copies, because rows of an odd width are aligned to one value only.
                    Four in[4];
                    for (int i = 0; i < 4; ++i)
                        __builtin_memcpy(&in[i], from + std::ptrdiff_t(i) * columns, sizeof(Four));
                    const Four low01 = __builtin_shufflevector(in[0], in[1], 0, 4, 1, 5);
                    const Four high01 = __builtin_shufflevector(in[0], in[1], 2, 6, 3, 7);
                    const Four low23 = __builtin_shufflevector(in[2], in[3], 0, 4, 1, 5);
                    const Four high23 = __builtin_shufflevector(in[2], in[3], 2, 6, 3, 7);
                    const Four turned[4] = {__builtin_shufflevector(low01, low23, 0, 1, 4, 5),
                                            __builtin_shufflevector(low01, low23, 2, 3, 6, 7),
                                            __builtin_shufflevector(high01, high23, 0, 1, 4, 5),
                                            __builtin_shufflevector(high01, high23, 2, 3, 6, 7)};
                    for (int j = 0; j < 4; ++j)
                        __builtin_memcpy(to + std::ptrdiff_t(j) * rows, &turned[j], sizeof(Four));
                }
        }
}

}  // namespace volillum::sweep_detail
