// Sampling, summing, un-shearing and exponential of one direction's rows, and the weighted sums.
#include "sweep_kernels.h"

#include <type_traits>

namespace volillum::sweep_detail {
namespace {

// Adds x of any sign to high + low exactly (Knuth's two-sum): samples that leave a window take
// away what they brought, to the last bit.
template <class Pack>
VOLILLUM_INLINE void add_exactly(Pack &high, Pack &low, const Pack &x) {
    const Pack sum = high + x, part = sum - high;
    low += (high - (sum - part)) + (x - part);
    high = sum;
}

template <class Pack>
VOLILLUM_INLINE void interpolate(const Real *row, Real fraction, Pack &value) {
    value = (1 - fraction) * pack<Pack>(row) + fraction * pack<Pack>(row + 1);
}

template <class Pack>
VOLILLUM_INLINE void sample(const Bilinear &slice, std::ptrdiff_t at, Pack &value) {
    Pack lower;
    interpolate(slice.first + at, slice.column_fraction, value);
    interpolate(slice.first + at + slice.pitch, slice.column_fraction, lower);
    value = (1 - slice.row_fraction) * value + slice.row_fraction * lower;
}

// Within a slab the samples are summed plainly, and the slab's sum joins those before it: samples
// are not negative, so that nothing cancels and each of a few additions errs by half a unit of the
// last place. Rays that end lose samples later on, to the last bit, and need the pair high + low.
// Several packs at a time, because a sum waits for the one before it.
template <class Pack, int packs>
VOLILLUM_INLINE void advance_packs(const Bilinear *samplers, int slices, int row, int v, int width,
                                   Real *across, Real *high, Real *low, Real *depth) {
    constexpr int lanes = lanes_of<Pack>;
    across += v;
    high += v;
    if (low) low += v;
    depth += v;
    Pack before[packs], sum[packs];
    for (int i = 0; i < packs; ++i) {
        before[i] = pack<Pack>(high + i * lanes);
        if (low) before[i] += pack<Pack>(low + i * lanes);
        sum[i] = Pack{};
    }
    for (int t = 0; t < slices; ++t, across += width, depth += width) {
        const Bilinear slice = samplers[t];  // a copy: stores to `depth` do not change it
        const Real *lower = slice.first + (row + 1) * slice.pitch + v;
        for (int i = 0; i < packs; ++i) {
            Pack next;
            interpolate(lower + i * lanes, slice.column_fraction, next);
            const Pack sample = (1 - slice.row_fraction) * pack<Pack>(across + i * lanes) +
                                slice.row_fraction * next;
            pack<Pack>(across + i * lanes) = next;
            // The trapezoid rule counts half of the slice's own sample.
            pack<Pack>(depth + i * lanes) = before[i] + (sum[i] + Real(0.5) * sample);
            sum[i] += sample;
        }
    }
    for (int i = 0; i < packs; ++i) {
        if (!low) {
            pack<Pack>(high + i * lanes) = before[i] + sum[i];
            continue;
        }
        Pack h = pack<Pack>(high + i * lanes), l = pack<Pack>(low + i * lanes);
        add_exactly(h, l, sum[i]);
        pack<Pack>(high + i * lanes) = h;
        pack<Pack>(low + i * lanes) = l;
    }
}

// out[i] = or += sums[i] for the first `count` of a pack.
template <class Pack>
VOLILLUM_INLINE void emit(const Pack &sums, int count, bool add, Real *out) {
    if (count >= lanes_of<Pack>) {
        if (add)
            pack<Pack>(out) += sums;
        else
            pack<Pack>(out) = sums;
    } else {
        for (int k = 0; k < count; ++k) out[k] = add ? out[k] + sums[k] : sums[k];
    }
}

// The values at some packs, one after the other: operations of several are independent.
template <bool far, bool near, bool exponential, int packs, class Pack>
VOLILLUM_INLINE void values_at(const Row &r, const WeightedPower &power, int c, Pack *q) {
    constexpr int lanes = lanes_of<Pack>;
    for (int i = 0; i < packs; ++i, c += lanes) {
        if constexpr (far) {
            const Pack level =
                r.left * pack<Pack>(r.depth + c) + r.right * pack<Pack>(r.depth + c + 1);
            // In this order what must wait for `level` is one fused operation.
            q[i] = r.here * level + r.above * pack<Pack>(r.level + c);
            pack<Pack>(r.level + c) = level;
        }
        if constexpr (far && near)
            q[i] += pack<Pack>(r.near + c);
        else if constexpr (near)
            q[i] = pack<Pack>(r.near + c);
    }
    for (int i = 0; i < packs; ++i) {
        if constexpr (exponential)
            power.apply(q[i]);
        else
            q[i] *= r.weight;
    }
}

template <class Pack, bool far, bool near, bool exponential>
VOLILLUM_INLINE void finish(const Row &row) {
    constexpr int lanes = lanes_of<Pack>, packs = 2;
    const Row r = row;  // copies: stores to `out` do not change them
    const WeightedPower power = *row.power;
    const int whole = r.count / (packs * lanes) * (packs * lanes);
    Pack q[packs];
    if (r.add)
        for (int c = 0; c < whole; c += packs * lanes) {
            values_at<far, near, exponential, packs>(r, power, c, q);
            for (int i = 0; i < packs; ++i) pack<Pack>(r.out + c + i * lanes) += q[i];
        }
    else
        for (int c = 0; c < whole; c += packs * lanes) {
            values_at<far, near, exponential, packs>(r, power, c, q);
            for (int i = 0; i < packs; ++i) {
                __builtin_prefetch(r.out + c + i * lanes + r.next, 1);
                pack<Pack>(r.out + c + i * lanes) = q[i];
            }
        }
    for (int c = whole; c < r.count; c += lanes) {
        values_at<far, near, exponential, 1>(r, power, c, q);
        emit(q[0], r.count - c, r.add, r.out + c);
    }
}

template <class Pack, bool far, bool near>
VOLILLUM_INLINE void finish(const Row &row) {
    if (row.exponential)
        finish<Pack, far, near, true>(row);
    else
        finish<Pack, far, near, false>(row);
}

}  // namespace

void interpolate_across(const Bilinear *samplers, int begin, int end, int row, int width,
                        Real *across) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int t = begin; t < end; ++t) {
            const Bilinear slice = samplers[t];
            for (int v = 0; v < width; v += lanes_of<Pack>) {
                Pack value;
                interpolate(slice.first + row * slice.pitch + v, slice.column_fraction, value);
                pack<Pack>(across + t * width + v) = value;
            }
        }
    });
}

void advance(const Bilinear *samplers, int slices, int row, int width, Real *across, Real *high,
             Real *low, Real *depth) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        constexpr int packs = 4;
        int v = 0;
        for (; v + packs * lanes_of<Pack> <= width; v += packs * lanes_of<Pack>)
            advance_packs<Pack, packs>(samplers, slices, row, v, width, across, high, low, depth);
        for (; v < width; v += lanes_of<Pack>)
            advance_packs<Pack, 1>(samplers, slices, row, v, width, across, high, low, depth);
    });
}

void advance_window(const Bilinear *samplers, const Bilinear *tails, Real fraction, int slices,
                    int row, int width, Real *high, Real *low, Real *depth) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        const Real w_beyond = Real(0.5) * fraction * fraction;
        const Real w_last = fraction - w_beyond - Real(0.5);
        for (int v = 0; v < width; v += lanes_of<Pack>) {
            Pack h = pack<Pack>(high + v), l = pack<Pack>(low + v), s, last, beyond;
            sample(tails[0], row * tails[0].pitch + v, beyond);
            Real *to = depth + v;
            for (int t = 0; t < slices; ++t, to += width) {
                const Bilinear &head = samplers[t], &tail = tails[t + 1];
                sample(head, row * head.pitch + v, s);
                sample(tail, row * tail.pitch + v, last);
                const Pack left = h + (l + (Real(0.5) * s + w_last * last + w_beyond * beyond));
                pack<Pack>(to) = left > Real(0) ? left : Pack{};  // negative only by rounding
                add_exactly(h, l, s);
                last = -last;
                add_exactly(h, l, last);
                beyond = -last;
            }
            pack<Pack>(high + v) = h;
            pack<Pack>(low + v) = l;
        }
    });
}

void level_row(const Real *depth, Real left, Real right, int count, Real *level) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int c = 0; c < count; c += lanes_of<Pack>)
            pack<Pack>(level + c) =
                left * pack<Pack>(depth + c) + right * pack<Pack>(depth + c + 1);
    });
}

void finish_row(const Row &row) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        if (row.depth && row.near)
            finish<Pack, true, true>(row);
        else if (row.depth)
            finish<Pack, true, false>(row);
        else
            finish<Pack, false, true>(row);
    });
}

void emit_constant(Real value, int count, bool add, Real *out) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        const Pack values = Pack{} + value;
        for (int c = 0; c < count; c += lanes_of<Pack>) emit(values, count - c, add, out + c);
    });
}

namespace {

// The sums of some packs: as many chains of additions, which wait for themselves, as channels times
// packs, and a weight serves all of the packs. Each direction's values are a stream of their own,
// more than the hardware foresees.
template <int channels, int packs, class Pack>
VOLILLUM_INLINE void weigh_packs(const Real *values, std::size_t value_stride, int directions,
                                 const Real *weights, Pack *sums) {
    for (int i = 0; i < channels * packs; ++i) sums[i] = Pack{};
    for (int d = 0; d < directions; ++d, values += value_stride, weights += kChannelGroup) {
        for (int p = 0; p < packs; ++p) {
            __builtin_prefetch(values + p * lanes_of<Pack> + 2 * kLanes);
            Pack value = pack<Pack>(values + p * lanes_of<Pack>);
            in_register(value);
            for (int channel = 0; channel < channels; ++channel)
                sums[channel * packs + p] += weights[channel] * value;
        }
    }
}

template <int channels>
void weigh(const Real *values, std::size_t value_stride, int directions, const Real *weights,
           int written, int count, bool add, Real *out, std::ptrdiff_t out_stride,
           const Ahead &ahead) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        constexpr int lanes = lanes_of<Pack>, packs = 2;
        const auto at = [=]<int some>(int i, std::integral_constant<int, some>) VOLILLUM_LAMBDA {
            Pack sums[channels * some];
            weigh_packs<channels, some>(values + i, value_stride, directions, weights, sums);
            for (int channel = 0; channel < channels; ++channel)
                for (int p = 0; p < some && channel < written; ++p) {
                    const int c = i + p * lanes;
                    __builtin_prefetch(
                        ahead.first + c / kLanes * ahead.step + channel * ahead.channel_pitch, 1);
                    emit(sums[channel * some + p], count - c, add, out + channel * out_stride + c);
                }
        };
        int i = 0;
        for (; i + lanes < count; i += packs * lanes) at(i, std::integral_constant<int, packs>{});
        if (i < count) at(i, std::integral_constant<int, 1>{});
    });
}

}  // namespace

void weigh_row(const Real *values, std::size_t value_stride, int directions, const Real *weights,
               int channels, int count, bool add, Real *out, std::ptrdiff_t out_stride,
               const Ahead &ahead) {
    (channels == 1 ? weigh<1> : weigh<kChannelGroup>)(values, value_stride, directions, weights,
                                                      channels, count, add, out, out_stride, ahead);
}

VOLILLUM_DISPATCH void multiply_add(const Real *values, const Real *weights, int count,
                                    Real *sums) {
    const Real *__restrict p = values;
    const Real *__restrict w = weights;
    Real *__restrict sum = sums;
    for (int i = 0; i < count; ++i) sum[i] += w[i] * p[i];
}

}  // namespace volillum::sweep_detail
