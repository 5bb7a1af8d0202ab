// Leaf kernels of the radiance sweep: rows of rays, a vector at a time.
#pragma once

#include "radiance_plan.h"

namespace volillum::radiance_detail {

// One row of the medium as a march samples it: weighted sums of rows, `columns` numbers a channel.
// `rows[i]` is where column 0 of the result takes its values from.
struct RowSample {
    const Real *const *rows;
    const Real *weights;
    int count;
    std::ptrdiff_t pitch;  // from channel to channel of a row
};

// Channels of a sample (and of radiance) lie `stride` numbers apart.
void take_sample(const RowSample &sample, int channels, int columns, std::ptrdiff_t stride,
                 Real *result);

// One step of `columns` rays toward the voxels, radiance [3][stride]: attenuated and added to by
// the medium between the samples `near` and `far`, `length` world units apart.
struct Step {
    const Real *near, *far;  // [extinction_channels + 3][stride]
    int extinction_channels, columns;
    std::ptrdiff_t stride;
    Real length;
};
void step(const Step &rays, Real *radiance);

// radiance [3][stride] at voxels between four lattice rays: (u - 1, v - 1), (u - 1, v) from `above`
// and (u, v - 1), (u, v) from `here`, channels `lattice_stride` apart.
void unshear(const Real *above, const Real *here, std::ptrdiff_t lattice_stride,
             const Crossing &crossing, int columns, std::ptrdiff_t stride, Real *radiance);

// out[c] += weights * gamma_c(radiance), channels `out_stride` apart.
void add_hue(const Real *radiance, std::ptrdiff_t stride, int columns, const Real *hue,
             const Real *weights, Real *out, std::ptrdiff_t out_stride);

}  // namespace volillum::radiance_detail
