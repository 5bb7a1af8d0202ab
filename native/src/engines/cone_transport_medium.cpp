// The medium on a row of lattice points.
#include <algorithm>

#include "cone_transport_kernels.h"
#include "volillum/no_alias.h"

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

VOLILLUM_INLINE void fetch(const Real *values, const AxisPlaces &x, const AxisPlaces &y,
                           const AxisPlaces &z, Real *out) {
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kChunk; ++c) {
        const int at = x.low[c] + y.low[c] + z.low[c];
        const int dx = x.step[c], dy = y.step[c], dz = z.step[c];
        const Real w00 = x.low_weight[c] * y.low_weight[c];
        const Real w01 = x.low_weight[c] * y.high_weight[c];
        const Real w10 = x.high_weight[c] * y.low_weight[c];
        const Real w11 = x.high_weight[c] * y.high_weight[c];
        const Real near = w00 * values[at] + w01 * values[at + dy] + w10 * values[at + dx] +
                          w11 * values[at + dx + dy];
        const Real far = w00 * values[at + dz] + w01 * values[at + dy + dz] +
                         w10 * values[at + dx + dz] + w11 * values[at + dx + dy + dz];
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
        place(at(2), row.step[2], row.shape[2], 1, z);
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
