// Sampling, summing, un-shearing and exponential of one direction's rows, and the weighted sums.
#include "sweep_kernels.h"

#include "volillum/exp_negative.h"

namespace volillum::sweep_detail {
namespace {

// Adds x of any sign to high + low exactly (Knuth's two-sum): samples that leave a window take
// away what they brought, to the last bit.
VOLILLUM_INLINE void add_exactly(Pack &high, Pack &low, const Pack &x) {
    const Pack sum = high + x, part = sum - high;
    low += (high - (sum - part)) + (x - part);
    high = sum;
}

VOLILLUM_INLINE void interpolate(const Real *row, Real fraction, Pack &value) {
    value = (1 - fraction) * pack(row) + fraction * pack(row + 1);
}

VOLILLUM_INLINE void sample(const Bilinear &slice, std::ptrdiff_t at, Pack &value) {
    Pack lower;
    interpolate(slice.first + at, slice.column_fraction, value);
    interpolate(slice.first + at + slice.pitch, slice.column_fraction, lower);
    value = (1 - slice.row_fraction) * value + slice.row_fraction * lower;
}

// Within a slab the samples are summed plainly, and only the slab's sum joins the pair high + low:
// samples are not negative, so each of a few additions errs by a unit of the last place of the
// slab's own part, and the errors do not grow along the ray.
template <int packs>
VOLILLUM_INLINE void advance_packs(const Bilinear *samplers, int slices, int row, int v, int width,
                                   Real *across, Real *high, Real *low, Real *depth) {
    across += v;
    high += v;
    low += v;
    depth += v;
    Pack before[packs], sum[packs];
    for (int i = 0; i < packs; ++i) {
        before[i] = pack(high + i * kLanes) + pack(low + i * kLanes);
        sum[i] = Pack{};
    }
    for (int t = 0; t < slices; ++t, across += width, depth += width) {
        const Bilinear slice = samplers[t];  // a copy: stores to `depth` do not change it
        const Real *lower = slice.first + (row + 1) * slice.pitch + v;
        // Half of the sample, for the trapezoid rule.
        const Real w0 = Real(0.5) * (1 - slice.row_fraction), w1 = Real(0.5) * slice.row_fraction;
        for (int i = 0; i < packs; ++i) {
            Pack next;
            interpolate(lower + i * kLanes, slice.column_fraction, next);
            const Pack half = w0 * pack(across + i * kLanes) + w1 * next;
            pack(across + i * kLanes) = next;
            sum[i] += half;
            pack(depth + i * kLanes) = before[i] + sum[i];
            sum[i] += half;
        }
    }
    for (int i = 0; i < packs; ++i) {
        Pack h = pack(high + i * kLanes), l = pack(low + i * kLanes);
        add_exactly(h, l, sum[i]);
        pack(high + i * kLanes) = h;
        pack(low + i * kLanes) = l;
    }
}

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

template <bool far, bool near, bool exponential>
VOLILLUM_INLINE void value_at(const Row &r, int c, Pack &q) {
    if constexpr (far) {
        const Pack level = r.left * pack(r.depth + c) + r.right * pack(r.depth + c + 1);
        q = r.above * pack(r.level + c) + r.here * level;
        pack(r.level + c) = level;
    }
    if constexpr (far && near)
        q += pack(r.near + c);
    else if constexpr (near)
        q = pack(r.near + c);
    if constexpr (exponential) exp_negative(q);
    q *= r.weight;
}

template <bool far, bool near, bool exponential>
VOLILLUM_INLINE void finish(const Row &row) {
    const Row r = row;  // a copy: stores to `out` do not change it
    const int whole = r.count / kLanes * kLanes;
    Pack q;
    if (r.add)
        for (int c = 0; c < whole; c += kLanes) {
            value_at<far, near, exponential>(r, c, q);
            pack(r.out + c) += q;
        }
    else
        for (int c = 0; c < whole; c += kLanes) {
            value_at<far, near, exponential>(r, c, q);
            __builtin_prefetch(r.out + c + r.next, 1);
            pack(r.out + c) = q;
        }
    if (whole == r.count) return;
    value_at<far, near, exponential>(r, whole, q);
    emit(q, r.count - whole, r.add, r.out + whole);
}

template <bool far, bool near>
VOLILLUM_INLINE void finish(const Row &row) {
    if (row.exponential)
        finish<far, near, true>(row);
    else
        finish<far, near, false>(row);
}

}  // namespace

VOLILLUM_DISPATCH void interpolate_across(const Bilinear *samplers, int begin, int end, int row,
                                          int width, Real *across) {
    for (int t = begin; t < end; ++t) {
        const Bilinear slice = samplers[t];
        for (int v = 0; v < width; v += kLanes) {
            Pack value;
            interpolate(slice.first + row * slice.pitch + v, slice.column_fraction, value);
            pack(across + t * width + v) = value;
        }
    }
}

VOLILLUM_DISPATCH void advance(const Bilinear *samplers, int slices, int row, int width,
                               Real *across, Real *high, Real *low, Real *depth) {
    int v = 0;
    for (; v + 2 * kLanes <= width; v += 2 * kLanes)
        advance_packs<2>(samplers, slices, row, v, width, across, high, low, depth);
    if (v < width) advance_packs<1>(samplers, slices, row, v, width, across, high, low, depth);
}

VOLILLUM_DISPATCH void advance_window(const Bilinear *samplers, const Bilinear *tails,
                                      Real fraction, int slices, int row, int width, Real *high,
                                      Real *low, Real *depth) {
    const Real w_beyond = Real(0.5) * fraction * fraction;
    const Real w_last = fraction - w_beyond - Real(0.5);
    for (int v = 0; v < width; v += kLanes) {
        Pack h = pack(high + v), l = pack(low + v), s, last, beyond;
        sample(tails[0], row * tails[0].pitch + v, beyond);
        Real *to = depth + v;
        for (int t = 0; t < slices; ++t, to += width) {
            const Bilinear &head = samplers[t], &tail = tails[t + 1];
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

namespace {

template <int rows, int length>
VOLILLUM_INLINE void add_run(const Stencil::Run &run, const Real *block, std::ptrdiff_t pitch,
                             Pack *sums) {
    block += run.offset;
    for (int i = 0; i < rows + length - 1; ++i, block += pitch) {
        const Pack values = pack(block);
        for (int r = 0; r < rows; ++r)
            if (i - r >= 0 && i - r < length) sums[r] += run.coefficients[i - r] * values;
    }
}

template <int rows>
VOLILLUM_INLINE void apply_to_rows(const Stencil &stencil, const Real *block, std::ptrdiff_t pitch,
                                   int count, Real *to, std::ptrdiff_t to_pitch) {
    const Stencil::Run *const begin = stencil.runs.data(), *const end = begin + stencil.runs.size();
    for (int c = 0; c < count; c += kLanes) {
        Pack sums[rows] = {};
        for (const Stencil::Run *run = begin; run != end; ++run) switch (run->length) {
                case 1:
                    add_run<rows, 1>(*run, block + c, pitch, sums);
                    break;
                case 2:
                    add_run<rows, 2>(*run, block + c, pitch, sums);
                    break;
                case 3:
                    add_run<rows, 3>(*run, block + c, pitch, sums);
                    break;
                default:
                    add_run<rows, kLongestRun>(*run, block + c, pitch, sums);
            }
        for (int r = 0; r < rows; ++r) pack(to + r * to_pitch + c) = sums[r];
    }
}

}  // namespace

VOLILLUM_DISPATCH void apply_stencil(const Stencil &stencil, const Real *block,
                                     std::ptrdiff_t block_pitch, int rows, int count, Real *sums,
                                     std::ptrdiff_t sums_pitch) {
    if (rows == kStencilRows)
        apply_to_rows<kStencilRows>(stencil, block, block_pitch, count, sums, sums_pitch);
    else
        apply_to_rows<1>(stencil, block, block_pitch, count, sums, sums_pitch);
}

VOLILLUM_DISPATCH void level_row(const Real *depth, Real left, Real right, int count, Real *level) {
    for (int c = 0; c < count; c += kLanes)
        pack(level + c) = left * pack(depth + c) + right * pack(depth + c + 1);
}

VOLILLUM_DISPATCH void finish_row(const Row &row) {
    if (row.depth && row.near)
        finish<true, true>(row);
    else if (row.depth)
        finish<true, false>(row);
    else
        finish<false, true>(row);
}

VOLILLUM_DISPATCH void emit_constant(Real value, int count, bool add, Real *out) {
    const Pack values = Pack{} + value;
    for (int c = 0; c < count; c += kLanes) emit(values, count - c, add, out + c);
}

namespace {

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

}  // namespace volillum::sweep_detail
