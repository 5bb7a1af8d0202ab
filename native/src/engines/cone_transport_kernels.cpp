#include "cone_transport_kernels.h"

#include "volillum/exp_negative.h"
#include "volillum/no_alias.h"

namespace volillum::cone_detail {
namespace {

// Radiance below this share of the light's counts as none: it would become denormal, and slow.
constexpr Real kDark = Real(1e-30);

template <class Pack>
VOLILLUM_INLINE void sample(const Rows &rows, const Taps &taps, int c, Pack &value) {
    value = taps.w00 * pack<Pack>(rows.upper + c) + taps.w01 * pack<Pack>(rows.upper + c + 1) +
            taps.w10 * pack<Pack>(rows.lower + c) + taps.w11 * pack<Pack>(rows.lower + c + 1);
}

template <class Pack>
VOLILLUM_INLINE void settle(const Real *known, const Real *missing, const Pack &in_scattered,
                            Pack &radiance) {
    radiance = pack<Pack>(known) + (Real(1) - pack<Pack>(missing)) * in_scattered;
}

// Where on its step a ray loses its light, on average: 0 at the end, 1 at the begin, for an
// extinction that is linear between a (begin) and b (end), both times the length. That is the
// integral of u exp(-tau(u)) tau'(u) over [0, 1], over 1 - exp(-(a + b) / 2), with
// tau(u) = b u + (a - b) u^2 / 2. A rational fit with the exact limits for thin steps,
// (2 a + b) / (3 (a + b)), and for thick ones, 1 / b; off by at most 0.017 between.
template <class Pack>
VOLILLUM_INLINE void mean_distance(const Pack &a, const Pack &b, Pack &distance) {
    constexpr Real tiny = Real(1e-20);
    const Pack linear = a + a + b + tiny;
    const Pack sum = Real(3) * (a + b) + 2 * tiny;
    const Pack above = linear + a * (Real(0.0106) * a + Real(0.4132) * b) + Real(0.0888) * b * b;
    const Pack below =
        sum + a * (Real(0.2315) * a + Real(1.0724) * b) +
        b * (Real(0.5109) * b + Real(0.0888) * b * b + a * (Real(0.3969) * b + Real(0.0680) * a));
    distance = above / below;
}

// The columns of the lanes from c on.
template <class Pack>
VOLILLUM_INLINE void columns_of(int c, Pack &columns) {
    for (int lane = 0; lane < lanes_of<Pack>; ++lane) columns[lane] = Real(c + lane);
}

// The lines that a step of rays reads and writes.
template <int Albedos>
struct StepLines {
    SliceRows before, here;
    RayRow rays;
    const Real *missing[Albedos];
    Taps taps_before, taps_here;
    int shift;
};

// `Packs` of them at a time: a step is a long chain of operations, each of which waits for the one
// before, so those of two packs take hardly longer than one's.
template <class Pack, int Packs, int Albedos, bool ends>
VOLILLUM_INLINE void step(const StepRow &row, const StepLines<Albedos> &lines, int first) {
    const RayRow &rays = lines.rays;
    const SliceRows &before = lines.before, &here = lines.here;
    const Taps &taps_before = lines.taps_before, &taps_here = lines.taps_here;
    const int shift = lines.shift;
    Pack a[Packs], b[Packs], length[Packs], transmitted[Packs], toward_a[Packs], toward_b[Packs],
        per_lost[Packs];
    const auto at = [=](int p) { return first + p * lanes_of<Pack>; };
    for (int p = 0; p < Packs; ++p) {
        __builtin_prefetch(row.soon.seen + at(p), 1);
        for (int i = 0; i < Albedos; ++i) {
            __builtin_prefetch(row.soon.known[i] + at(p), 1);
            __builtin_prefetch(row.soon.missing[i] + at(p), 1);
        }
    }
    for (int p = 0; p < Packs; ++p) {
        sample(before.sigma_t, taps_before, at(p), a[p]);
        sample(here.sigma_t, taps_here, at(p), b[p]);
        length[p] = Pack{} + row.length;
        if constexpr (ends) {
            Pack share;
            columns_of(at(p), share);
            share = row.end_start - share * row.end_slope;
            share = share > 0 ? share : Pack{};
            length[p] *= share < 1 ? share : Pack{} + 1;
        }
        a[p] *= length[p];
        b[p] *= length[p];
        transmitted[p] = Real(0.5) * (a[p] + b[p]);
    }
    for (int p = 0; p < Packs; ++p) mean_distance(a[p], b[p], toward_a[p]);
    for (int p = 0; p < Packs; ++p) exp_negative(transmitted[p]);
    for (int p = 0; p < Packs; ++p) {
        toward_b[p] = Real(1) - toward_a[p];
        const Pack lost = toward_a[p] * a[p] + toward_b[p] * b[p];
        per_lost[p] = lost > 0 ? length[p] / lost : Pack{};
    }
    for (int i = 0; i < Albedos; ++i) {
        Pack known[Packs], missing[Packs];
        for (int p = 0; p < Packs; ++p) {
            const Pack interacting = Real(1) - transmitted[p];
            const int c = at(p);
            Pack absorbed_a, absorbed_b, in_scattered;
            sample(before.sigma_a[i], taps_before, c, absorbed_a);
            sample(here.sigma_a[i], taps_here, c, absorbed_b);
            sample(before.in_scattered[i], taps_before, c, in_scattered);
            const Pack absorbed_share =
                per_lost[p] * (toward_a[p] * absorbed_a + toward_b[p] * absorbed_b);
            Pack radiance;
            settle(rays.known[i] + c - shift, lines.missing[i] + c - shift, in_scattered, radiance);
            const Pack scattered = interacting * (Real(1) - absorbed_share);
            // The same sum twice: without absorption the two agree to the last bit where the
            // radiance and L_i are 1.
            const Pack scattered_a = scattered * toward_a[p];
            const Pack k = transmitted[p] * radiance + scattered_a * in_scattered;
            known[p] = k > kDark ? k : Pack{};
            missing[p] = transmitted[p] + scattered_a + interacting * absorbed_share;
        }
        for (int p = 0; p < Packs; ++p) {
            pack<Pack>(rays.known[i] + at(p)) = known[p];
            pack<Pack>(rays.missing[i] + at(p)) = missing[p];
        }
    }
    Pack seen[Packs];
    for (int p = 0; p < Packs; ++p)
        seen[p] = transmitted[p] * pack<Pack>(rays.seen + at(p) - shift);
    for (int p = 0; p < Packs; ++p)
        pack<Pack>(rays.seen + at(p)) = seen[p] > kDark ? seen[p] : Pack{};
}

template <class Pack, int Albedos, bool ends>
VOLILLUM_INLINE void step_all(const StepRow &row, int begin, int count) {
    StepLines<Albedos> lines{row.before,      row.here,      row.rays, {},
                             row.taps_before, row.taps_here, row.shift};
    lines.before.sigma_t.move(-row.shift_of_before);
    for (int i = 0; i < Albedos; ++i) {
        lines.before.sigma_a[i].move(-row.shift_of_before);
        lines.before.in_scattered[i].move(-row.shift_of_before);
        lines.missing[i] = row.missing[i];
    }
    // In place: where rays move to larger columns the last come first.
    constexpr int two = 2 * lanes_of<Pack>;
    int c = begin;
    if (row.shift > 0) {
        c += count;
        for (; c - two >= begin; c -= two) step<Pack, 2, Albedos, ends>(row, lines, c - two);
        if (c > begin) step<Pack, 1, Albedos, ends>(row, lines, begin);
    } else {
        for (; c + two <= begin + count; c += two) step<Pack, 2, Albedos, ends>(row, lines, c);
        if (c < begin + count) step<Pack, 1, Albedos, ends>(row, lines, c);
    }
}

template <class Pack>
VOLILLUM_INLINE void settle_all(const SettleRow &row, int albedos, int begin, int count) {
    for (int i = 0; i < albedos; ++i)
        for (int c = begin; c < begin + count; c += lanes_of<Pack>) {
            Pack in_scattered, radiance;
            sample(row.here.in_scattered[i], row.taps, c, in_scattered);
            settle(row.rays.known[i] + c, row.rays.missing[i] + c, in_scattered, radiance);
            pack<Pack>(row.rays.known[i] + c) = radiance;
        }
}

template <class Pack, bool local, int Directions>
VOLILLUM_INLINE void add(const AddRow *rows, const Real *const *values, int begin, int count,
                         Real *own, Real *next) {
    Real before[Directions], at[Directions], here[Directions], below[Directions];
    for (int d = 0; d < Directions; ++d) {
        before[d] = rows[d].weight * rows[d].column_fraction;
        at[d] = rows[d].weight * (1 - rows[d].column_fraction);
        here[d] = 1 - rows[d].row_fraction;
        below[d] = rows[d].row_fraction;
    }
    for (int c = begin; c < begin + count; c += lanes_of<Pack>) {
        Pack own_sum = pack<Pack>(own + c), next_sum = pack<Pack>(next + c);
        for (int d = 0; d < Directions; ++d) {
            const Pack mean =
                before[d] * pack<Pack>(values[d] + c - 1) + at[d] * pack<Pack>(values[d] + c);
            Pack for_own = here[d] * mean, for_next = below[d] * mean;
            if constexpr (local) {
                for_own *= pack<Pack>(rows[d].own_weights + c);
                for_next *= pack<Pack>(rows[d].next_weights + c);
            }
            own_sum = own_sum + for_own;
            next_sum = next_sum + for_next;
        }
        pack<Pack>(own + c) = own_sum;
        pack<Pack>(next + c) = next_sum;
    }
}

template <class Pack, bool local, int Directions>
VOLILLUM_INLINE void add_all(const AddRow *rows, const RayRow &own, const RayRow &next, int albedos,
                             int begin, int count) {
    const auto add_each = [&](auto quantity) VOLILLUM_LAMBDA {
        const Real *values[Directions];
        for (int d = 0; d < Directions; ++d) values[d] = quantity(rows[d].rays);
        add<Pack, local, Directions>(rows, values, begin, count, quantity(own), quantity(next));
    };
    add_each([](const RayRow &row) VOLILLUM_LAMBDA { return row.seen; });
    for (int i = 0; i < albedos; ++i) {
        add_each([=](const RayRow &row) VOLILLUM_LAMBDA { return row.known[i]; });
        add_each([=](const RayRow &row) VOLILLUM_LAMBDA { return row.missing[i]; });
    }
}

template <int Albedos, bool ends>
void step_in_packs(const StepRow &row, int begin, int count) {
    in_packs([=, &row]<class Pack>(Width<Pack>)
                 VOLILLUM_LAMBDA { step_all<Pack, Albedos, ends>(row, begin, count); });
}

template <bool local, int Directions>
void add_in_packs(const AddRow *rows, const RayRow &own, const RayRow &next, int albedos, int begin,
                  int count) {
    in_packs([=, &own, &next]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        add_all<Pack, local, Directions>(rows, own, next, albedos, begin, count);
    });
}

}  // namespace

void step_row(const StepRow &row, int albedos, int begin, int count) {
    if (row.ends)
        (albedos == 1 ? step_in_packs<1, true> : step_in_packs<3, true>)(row, begin, count);
    else
        (albedos == 1 ? step_in_packs<1, false> : step_in_packs<3, false>)(row, begin, count);
}

void settle_row(const SettleRow &row, int albedos, int begin, int count) {
    in_packs([=, &row]<class Pack>(Width<Pack>)
                 VOLILLUM_LAMBDA { settle_all<Pack>(row, albedos, begin, count); });
}

void add_rows(const AddRow *rows, int directions, const RayRow &own, const RayRow &next,
              int albedos, int begin, int count) {
    const bool local = rows->own_weights;
    if (directions == kAdded)
        return (local ? add_in_packs<true, kAdded>
                      : add_in_packs<false, kAdded>)(rows, own, next, albedos, begin, count);
    for (int d = 0; d < directions; ++d)
        (local ? add_in_packs<true, 1> : add_in_packs<false, 1>)(rows + d, own, next, albedos,
                                                                 begin, count);
}

VOLILLUM_DISPATCH void expand_row(const Real *nodes, int spacing, int begin, int count,
                                  Real *values) {
    const Real per_column = Real(1) / Real(spacing);
    VOLILLUM_NO_ALIAS
    for (int i = 0; i < count; ++i) {
        const Real at = Real(begin + i) * per_column;
        const int low = int(at);
        const Real fraction = at - Real(low);
        values[i] = (1 - fraction) * nodes[low] + fraction * nodes[low + 1];
    }
}

VOLILLUM_DISPATCH void solve_row(const Real *known, const Real *missing, int begin, int end,
                                 Real *in_scattered) {
    for (int c = begin; c < end; ++c) {
        const Real value = missing[c] > 0 ? known[c] / missing[c] : Real(1);
        in_scattered[c] = value > kDark ? value : Real(0);
    }
}

}  // namespace volillum::cone_detail
