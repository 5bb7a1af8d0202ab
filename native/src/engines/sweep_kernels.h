// The leaf kernels of the sweep: rows of a tile, whole vectors, compiled for each level of the
// instruction set.
#pragma once

#include <vector>

#include "volillum/exp_negative.h"

namespace volillum::sweep_detail {

// Copies, clipped to `largest`; returns whether any number differs from 0.
// Rows are short for the hardware's prefetching: the row at source + next is fetched ahead.
bool copy_row(const Real *source, int count, Real largest, std::ptrdiff_t next, Real *target);

// The same where the slices of the target are contiguous in memory: target[t * slice_pitch + c] =
// source[c * column_stride +- t], minus if `backward`. The columns at source + next are fetched
// ahead.
bool transpose_in(const Real *source, std::ptrdiff_t column_stride, std::ptrdiff_t next,
                  int columns, int slices, bool backward, Real largest, Real *target,
                  std::ptrdiff_t slice_pitch);
// And back: target[c * column_stride +- t] = or += source[t * slice_pitch + c].
void transpose_out(const Real *source, std::ptrdiff_t slice_pitch, int slices, int columns,
                   bool backward, bool add, Real *target, std::ptrdiff_t column_stride,
                   std::ptrdiff_t next);

// target[c] = or += source[c].
void take_row(const Real *source, int count, bool add, Real *target);

// How lattice rays sample a slice: all at the same place between four voxels.
struct Bilinear {
    const Real *first;     // the upper left voxel of the first lattice row and column
    std::ptrdiff_t pitch;  // from row to row
    Real row_fraction, column_fraction;
};

// across[t * width + v]: row `row` of the voxels of slice t in [begin, end), interpolated to the
// columns of the rays.
void interpolate_across(const Bilinear *samplers, int begin, int end, int row, int width,
                        Real *across);

// Marches a row of rays through slices. depth[t * width + v]: optical depth, in slice lengths, from
// the ray's point on slice t to the border (trapezoid rule); then the slice's own sample joins the
// sum, which is high, or high + low unless that is null. `row` counts from the first lattice row.
// `across` has that row of voxels and leaves with the next.
void advance(const Bilinear *samplers, int slices, int row, int width, Real *across, Real *high,
             Real *low, Real *depth);

// The same for rays that end n + f slices away, n = Direction::tail: the sum holds the n samples
// before a slice's own, and the end lies between the samples `last` (n slices away) and `beyond`:
// half of the slice's own, minus half of the last one's that the trapezoid rule has too much, plus
// the integral of the linear interpolant over the remaining f. `tails` has `beyond` of the first
// slice, and then each slice's `last`, which is the next one's `beyond`.
void advance_window(const Bilinear *samplers, const Bilinear *tails, Real fraction, int slices,
                    int row, int width, Real *high, Real *low, Real *depth);

// A stencil on a block in runs of taps in consecutive rows of one column: the voxels under a run
// serve several rows of results.
constexpr int kLongestRun = 4, kStencilRows = 4;
struct Stencil {
    struct Run {
        std::ptrdiff_t offset;  // of the first tap
        int length;
        Real coefficients[kLongestRun];
    };
    std::vector<Run> runs;
};
// sums[r * sums_pitch + c] = sum over taps of coefficient block[r * block_pitch + c + offset], for
// c < count, and one or kStencilRows rows r.
void apply_stencil(const Stencil &stencil, const Real *block, std::ptrdiff_t block_pitch, int rows,
                   int count, Real *sums, std::ptrdiff_t sums_pitch);

// The optical depths of a row of lattice rays, interpolated to the columns of voxels:
// level[c] = left depth[c] + right depth[c + 1], for c < count.
void level_row(const Real *depth, Real left, Real right, int count, Real *level);

// A row of voxels. out[c] = or += weight Q(c), where Q is a sum, or 2^-sum: of `near` (null:
// none) and, if there is a far field (`depth` is not null), of above level[c] plus here times what
// level_row makes of `depth`, which takes the place of level[c].
struct Row {
    const Real *near, *depth;
    Real *level;
    Real left, right, above, here;
    bool exponential;
    Real weight;
    const WeightedPower *power;  // of the weight
    bool add;
    int count;
    Real *out;
    std::ptrdiff_t next;  // the row at out + next is fetched ahead
};
void finish_row(const Row &row);

// out[i] = or += value for i < count.
void emit_constant(Real value, int count, bool add, Real *out);

// Lines of the output that will be touched next, to be fetched meanwhile: one for each line that is
// written, and that for each channel.
struct Ahead {
    const Real *first;
    std::ptrdiff_t step, channel_pitch;
};

// out[channel * out_stride + i] = sum_d weights[d * kChannelGroup + channel] values[d *
// value_stride
// + i], or += it, for i < count. Channels are summed in groups, so that a value is loaded once for
// several; a group that is not full has weights of 0. Values are padded to whole lanes.
constexpr int kChannelGroup = 4;
void weigh_row(const Real *values, std::size_t value_stride, int directions, const Real *weights,
               int channels, int count, bool add, Real *out, std::ptrdiff_t out_stride,
               const Ahead &ahead);

// sums[i] += weights[i] values[i]
void multiply_add(const Real *values, const Real *weights, int count, Real *sums);

}  // namespace volillum::sweep_detail
