// The medium on a row of lattice points.
#include <algorithm>

#include "cone_transport_kernels.h"
#include "volillum/no_alias.h"
#include "volillum/pairs.h"

namespace volillum::cone_detail {
namespace {

// Points whose places in the grid are worked out before their values are fetched.
constexpr int kChunk = 4 * kLanes;

// Of one axis, for each point: the lower neighbour's element, the step to the upper one, and both
// weights. Beyond the support both weigh 0.
struct AxisPlaces {
    int low[kChunk], step[kChunk];
    Real low_weight[kChunk], high_weight[kChunk];
};

VOLILLUM_INLINE void place(double begin, double step, int size, int stride, AxisPlaces &places) {
    // Without a branch, also for what is stored: a masked store would not become vector code.
    const double beyond = size;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kChunk; ++c) {
        const double at = begin + c * step;
        const double above = at > -1.0 ? at : -1.0, clipped = above < beyond ? above : beyond;
        const int floor = int(clipped + 1.0) - 1;
        const Real fraction = Real(clipped - floor);
        const int low_inside = int(floor >= 0) & int(floor < size);
        const int high_inside = int(floor + 1 < size);
        places.low_weight[c] = Real(low_inside) * (1 - fraction);
        places.high_weight[c] = Real(high_inside) * fraction;
        const int low = floor < size ? floor : size - 1;
        places.low[c] = stride * (low > 0 ? low : 0);
        places.step[c] = stride * (int(floor >= 0) & high_inside);
    }
}

// Of the last axis: the element of a pair of neighbours, and their weights. A pair that would begin
// or end beyond the row is moved inside, its weights with it.
VOLILLUM_INLINE void place_pair(double begin, double step, int size, AxisPlaces &places) {
    const double beyond = size;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kChunk; ++c) {
        const double at = begin + c * step;
        const double above = at > -1.0 ? at : -1.0, clipped = above < beyond ? above : beyond;
        const int floor = int(clipped + 1.0) - 1;
        const int low = floor > 0 ? floor : 0, last = size > 1 ? size - 2 : 0;
        places.low[c] = low < last ? low : last;
        // The hat functions of both elements.
        const Real from = Real(clipped - places.low[c]), one = 1 - from, two = 2 - from;
        const Real rising = 1 + from;
        const Real first = from < 0 ? rising : one, second = from < 1 ? from : two;
        places.low_weight[c] = first > 0 ? first : Real(0);
        places.high_weight[c] = second > 0 && size > 1 ? second : Real(0);
    }
}

VOLILLUM_INLINE void fetch(const Real *values, const AxisPlaces &x, const AxisPlaces &y,
                           const AxisPlaces &z, Real *out) {
    Pair pairs[4][kChunk];
    for (int c = 0; c < kChunk; ++c) {
        const Real *at = values + (x.low[c] + y.low[c] + z.low[c]);
        pairs[0][c] = pair_at(at);
        pairs[1][c] = pair_at(at + y.step[c]);
        pairs[2][c] = pair_at(at + x.step[c]);
        pairs[3][c] = pair_at(at + x.step[c] + y.step[c]);
    }
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kChunk; ++c) {
        const Real w00 = x.low_weight[c] * y.low_weight[c];
        const Real w01 = x.low_weight[c] * y.high_weight[c];
        const Real w10 = x.high_weight[c] * y.low_weight[c];
        const Real w11 = x.high_weight[c] * y.high_weight[c];
        const Real near = w00 * pairs[0][c].first + w01 * pairs[1][c].first +
                          w10 * pairs[2][c].first + w11 * pairs[3][c].first;
        const Real far = w00 * pairs[0][c].second + w01 * pairs[1][c].second +
                         w10 * pairs[2][c].second + w11 * pairs[3][c].second;
        out[c] = z.low_weight[c] * near + z.high_weight[c] * far;
    }
}

}  // namespace

VOLILLUM_DISPATCH void sample_medium(const MediumRow &row, int count) {
    AxisPlaces x, y, z;
    Real total[kChunk], scattering[kChunk];
    for (int begin = 0; begin < count; begin += kChunk) {
        const auto at = [&](int axis) { return row.index[axis] + begin * row.step[axis]; };
        place(at(0), row.step[0], row.shape[0], row.shape[1] * row.shape[2], x);
        place(at(1), row.step[1], row.shape[1], row.shape[2], y);
        place_pair(at(2), row.step[2], row.shape[2], z);
        const int size = std::min(kChunk, count - begin);
        fetch(row.sigma_t, x, y, z, total);
        for (int c = 0; c < size; ++c) {
            total[c] = total[c] < row.largest ? total[c] : row.largest;
            row.extinction[begin + c] = total[c];
        }
        for (int i = 0; i < row.albedos; ++i) {
            fetch(row.sigma_s[i], x, y, z, scattering);
            for (int c = 0; c < size; ++c) {
                const Real a = total[c] - scattering[c];
                row.absorption[i][begin + c] = a > 0 ? a : Real(0);
            }
        }
    }
}

}  // namespace volillum::cone_detail
