// Copies into and out of the layouts that the marches work on.
#include <algorithm>
#include <type_traits>

#include "sweep_kernels.h"

namespace volillum::sweep_detail {

VOLILLUM_DISPATCH bool copy_row(const Real *source, int count, Real largest, std::ptrdiff_t next,
                                Real *target) {
    // Whether any number differs from 0 is asked of their bits: that is vector code.
    using Bits = std::conditional_t<sizeof(Real) == 4, std::uint32_t, std::uint64_t>;
    for (int c = 0; c < count; c += kLanes) __builtin_prefetch(source + next + c);
    const Real *__restrict from = source;
    Real *__restrict to = target;
    Bits bits = 0;
    for (int c = 0; c < count; ++c) {
        const Real value = from[c] < largest ? from[c] : largest;
        to[c] = value;
        bits |= std::bit_cast<Bits>(value);
    }
    return bits != 0;
}

namespace {

using Four [[gnu::vector_size(4 * sizeof(Real))]] = Real;
constexpr int kFour = 4;
constexpr int kLine = 64 / int(sizeof(Real));  // numbers of a cache line
constexpr int kFetched = 32;

// Rows at a distance of `pitch`; copies, because they are aligned to one value only.
VOLILLUM_INLINE void load(const Real *from, std::ptrdiff_t pitch, Four *rows) {
    for (int i = 0; i < kFour; ++i) __builtin_memcpy(&rows[i], from + i * pitch, sizeof(Four));
}
VOLILLUM_INLINE void store(const Four *rows, Real *to, std::ptrdiff_t pitch) {
    for (int i = 0; i < kFour; ++i) __builtin_memcpy(to + i * pitch, &rows[i], sizeof(Four));
}

// Fetches the columns that follow those from c on a little later, of this row or of the next.
VOLILLUM_INLINE void fetch(const Real *row, std::ptrdiff_t pitch, std::ptrdiff_t next, int c,
                           int columns, int count) {
    c += kFetched;
    const Real *from = c < columns ? row + c * pitch : row + next + (c - columns) * pitch;
    for (int i = 0; i < kFour; ++i)
        for (int t = 0; t < count; t += kLine) __builtin_prefetch(from + i * pitch + t);
}

VOLILLUM_INLINE void transpose(Four *rows) {
    const Four low01 = __builtin_shufflevector(rows[0], rows[1], 0, 4, 1, 5);
    const Four high01 = __builtin_shufflevector(rows[0], rows[1], 2, 6, 3, 7);
    const Four low23 = __builtin_shufflevector(rows[2], rows[3], 0, 4, 1, 5);
    const Four high23 = __builtin_shufflevector(rows[2], rows[3], 2, 6, 3, 7);
    rows[0] = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
    rows[1] = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
    rows[2] = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
    rows[3] = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
}

}  // namespace

VOLILLUM_DISPATCH bool transpose_in(const Real *source, std::ptrdiff_t column_stride,
                                    std::ptrdiff_t next, int columns, int slices, bool backward,
                                    Real largest, Real *target, std::ptrdiff_t slice_pitch) {
    if (backward) {  // from the last slice on
        source -= slices - 1;
        target += (slices - 1) * slice_pitch;
        slice_pitch = -slice_pitch;
    }
    const int whole_columns = columns / kFour * kFour, whole_slices = slices / kFour * kFour;
    Four any{};
    for (int c = 0; c < whole_columns; c += kFour) {
        fetch(source, column_stride, next, c, whole_columns, slices);
        for (int t = 0; t < whole_slices; t += kFour) {
            Four rows[kFour];
            load(source + c * column_stride + t, column_stride, rows);
            for (Four &row : rows) {
                row = row < largest ? row : Four{} + largest;
                any += row;
            }
            transpose(rows);
            store(rows, target + t * slice_pitch + c, slice_pitch);
        }
    }
    Real sum = any[0] + any[1] + any[2] + any[3];
    const auto single = [&](int t, int c) {
        const Real value = std::min(source[c * column_stride + t], largest);
        target[t * slice_pitch + c] = value;
        sum += value;
    };
    for (int c = 0; c < columns; ++c)
        for (int t = c < whole_columns ? whole_slices : 0; t < slices; ++t) single(t, c);
    return sum != 0;
}

VOLILLUM_DISPATCH void transpose_out(const Real *source, std::ptrdiff_t slice_pitch, int slices,
                                     int columns, bool backward, bool add, Real *target,
                                     std::ptrdiff_t column_stride, std::ptrdiff_t next) {
    if (backward) {
        target -= slices - 1;
        source += (slices - 1) * slice_pitch;
        slice_pitch = -slice_pitch;
    }
    const int whole_columns = columns / kFour * kFour, whole_slices = slices / kFour * kFour;
    for (int c = 0; c < whole_columns; c += kFour) {
        fetch(target, column_stride, next, c, whole_columns, slices);
        for (int t = 0; t < whole_slices; t += kFour) {
            Four rows[kFour];
            Real *to = target + c * column_stride + t;
            load(source + t * slice_pitch + c, slice_pitch, rows);
            transpose(rows);
            if (add) {
                Four before[kFour];
                load(to, column_stride, before);
                for (int i = 0; i < kFour; ++i) rows[i] += before[i];
            }
            store(rows, to, column_stride);
        }
    }
    for (int c = 0; c < columns; ++c)
        for (int t = c < whole_columns ? whole_slices : 0; t < slices; ++t) {
            Real &to = target[c * column_stride + t];
            to = (add ? to : 0) + source[t * slice_pitch + c];
        }
}

VOLILLUM_DISPATCH void take_row(const Real *source, int count, bool add, Real *target) {
    const Real *__restrict from = source;
    Real *__restrict to = target;
    if (add)
        for (int c = 0; c < count; ++c) to[c] += from[c];
    else
        for (int c = 0; c < count; ++c) to[c] = from[c];
}

}  // namespace volillum::sweep_detail
