#include "cone_transport_kernels.h"

#include <algorithm>

// Rows that are read never overlap those that are written; with so many pointers the compiler gives
// up on finding that out at run time.
#if defined(__clang__)
#define VOLILLUM_NO_ALIAS _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define VOLILLUM_NO_ALIAS _Pragma("GCC ivdep")
#else
#define VOLILLUM_NO_ALIAS
#endif

namespace volillum::cone_detail {
namespace {

// Radiance below this share of the light's counts as none: it would become denormal, and slow.
constexpr Real kDark = Real(1e-30);

VOLILLUM_INLINE Real sample(const Rows &rows, const Taps &taps, int c) {
    return taps.w00 * rows.upper[c] + taps.w01 * rows.upper[c + 1] + taps.w10 * rows.lower[c] +
           taps.w11 * rows.lower[c + 1];
}

// Where on its step a ray loses its light, on average: 0 at the end, 1 at the begin, for an
// extinction that is linear between a (begin) and b (end), both times the length. That is the
// integral of u exp(-tau(u)) tau'(u) over [0, 1], over 1 - exp(-(a + b) / 2), with
// tau(u) = b u + (a - b) u^2 / 2. A rational fit with the exact limits for thin steps,
// (2 a + b) / (3 (a + b)), and for thick ones, 1 / b; off by at most 0.017 between.
VOLILLUM_INLINE Real mean_distance(Real a, Real b) {
    constexpr Real tiny = Real(1e-20);
    const Real linear = a + a + b + tiny;
    const Real sum = Real(3) * (a + b) + 2 * tiny;
    const Real above = linear + a * (Real(0.0106) * a + Real(0.4132) * b) + Real(0.0888) * b * b;
    const Real below =
        sum + a * (Real(0.2315) * a + Real(1.0724) * b) +
        b * (Real(0.5109) * b + Real(0.0888) * b * b + a * (Real(0.3969) * b + Real(0.0680) * a));
    return above / below;
}

}  // namespace

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

VOLILLUM_DISPATCH void sample_medium(const Real *sigma_t, const Real *sigma_s, const Index3 &shape,
                                     const Vec3d &index, const Vec3d &step, Real largest, int count,
                                     Real *extinction, Real *absorption) {
    AxisPlaces x, y, z;
    Real total[kChunk], scattering[kChunk];
    for (int begin = 0; begin < count; begin += kChunk) {
        place(index[0] + begin * step[0], step[0], shape[0], shape[1] * shape[2], x);
        place(index[1] + begin * step[1], step[1], shape[1], shape[2], y);
        place(index[2] + begin * step[2], step[2], shape[2], 1, z);
        fetch(sigma_t, x, y, z, total);
        fetch(sigma_s, x, y, z, scattering);
        const int size = std::min(kChunk, count - begin);
        for (int c = 0; c < size; ++c) {
            const Real t = total[c] < largest ? total[c] : largest;
            const Real a = t - scattering[c];
            extinction[begin + c] = t;
            absorption[begin + c] = a > 0 ? a : Real(0);
        }
    }
}

VOLILLUM_DISPATCH void step_row(const StepRow &row, int count) {
    const RaysIn rays = row.rays;
    const RaysOut out = row.rays_here;
    const SliceRows before = row.before, here = row.here;
    const Taps taps_before = row.taps_before, taps_here = row.taps_here;
    const Real length = row.length;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < count; ++c) {
        const Real in_scattered = sample(before.in_scattered, taps_before, c);
        const Real radiance = rays.known[c] + (1 - rays.missing[c]) * in_scattered;
        const Real a = length * sample(before.sigma_t, taps_before, c);
        const Real b = length * sample(here.sigma_t, taps_here, c);
        const Real transmitted = exp_negative(Real(0.5) * (a + b));
        const Real toward_a = mean_distance(a, b), toward_b = 1 - toward_a;
        const Real lost = toward_a * a + toward_b * b;
        const Real absorbed = length * (toward_a * sample(before.sigma_a, taps_before, c) +
                                        toward_b * sample(here.sigma_a, taps_here, c));
        const Real absorbed_share = lost > 0 ? absorbed / lost : Real(0);
        const Real interacting = 1 - transmitted;
        const Real scattered = interacting * (1 - absorbed_share);
        // The same sum twice: without absorption the two agree to the last bit where the radiance
        // and L_i are 1.
        const Real scattered_a = scattered * toward_a;
        const Real k = transmitted * radiance + scattered_a * in_scattered;
        const Real t = transmitted * rays.seen[c];
        out.known[c] = k > kDark ? k : Real(0);
        out.missing[c] = transmitted + scattered_a + interacting * absorbed_share;
        out.seen[c] = t > kDark ? t : Real(0);
    }
}

VOLILLUM_DISPATCH void add_row(const RaysIn &above, const RaysIn &here, Real row_fraction,
                               Real column_fraction, Real weight, int count, const RaysOut &sums) {
    // A lattice point lies row_fraction before the rays of its own row.
    const Real f = row_fraction, g = column_fraction;
    const Real w00 = weight * f * g, w01 = weight * f * (1 - g);
    const Real w10 = weight * (1 - f) * g, w11 = weight * (1 - f) * (1 - g);
    const auto at = [&](const Real *upper, const Real *lower, int c) {
        return w00 * upper[c - 1] + w01 * upper[c] + w10 * lower[c - 1] + w11 * lower[c];
    };
    const RaysIn a = above, b = here;
    const RaysOut to = sums;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < count; ++c) {
        to.known[c] += at(a.known, b.known, c);
        to.missing[c] += at(a.missing, b.missing, c);
        to.seen[c] += at(a.seen, b.seen, c);
    }
}

VOLILLUM_DISPATCH void solve_row(const RaysOut &sums, int count) {
    const RaysOut to = sums;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < count; ++c) {
        const Real value = to.missing[c] > 0 ? to.known[c] / to.missing[c] : Real(1);
        to.known[c] = value > kDark ? value : Real(0);
    }
}

}  // namespace volillum::cone_detail
