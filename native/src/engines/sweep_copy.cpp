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

// Whole target rows in order, as memory likes it; `source` is in the cache.
VOLILLUM_DISPATCH void transpose_cached(const Real *source, std::ptrdiff_t pitch, int rows,
                                        int columns, Real *target) {
    constexpr int side = kLanes;  // one cache line
    for (int c0 = 0; c0 < columns; c0 += side)
        for (int r = 0; r < rows; r += 4)
            for (int c = c0; c < std::min(c0 + side, columns); c += 4) {
                const Real *from = source + r * pitch + c;
                Real *to = target + std::ptrdiff_t(c) * rows + r;
                if (r + 4 > rows || c + 4 > columns) {
                    for (int i = 0; i < std::min(4, rows - r); ++i)
                        for (int j = 0; j < std::min(4, columns - c); ++j)
                            to[std::ptrdiff_t(j) * rows + i] = from[i * pitch + j];
                    continue;
                }
                // Copies, because rows of an odd width are aligned to one value only.
                Four in[4];
                for (int i = 0; i < 4; ++i)
                    __builtin_memcpy(&in[i], from + i * pitch, sizeof(Four));
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

}  // namespace

void transpose(const Real *source, int rows, int columns, Reals &plane, Real *target) {
    // First a copy, in the order of memory, with an odd number of lanes to the row: more than a few
    // rows of 2^n values would evict each other from the cache.
    const int lanes = round_up(columns) / kLanes;
    const std::ptrdiff_t pitch = (lanes % 2 == 0 ? lanes + 1 : lanes) * kLanes;
    plane.resize(std::size_t(rows) * std::size_t(pitch));
    for (int r = 0; r < rows; ++r)
        std::copy_n(source + std::ptrdiff_t(r) * columns, columns, plane.data() + r * pitch);
    transpose_cached(plane.data(), pitch, rows, columns, target);
}

}  // namespace volillum::sweep_detail
