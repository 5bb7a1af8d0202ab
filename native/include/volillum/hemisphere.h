// Sums of a voxel field over the half ball that lies outside of a surface.
#pragma once

#include "volillum/convolution.h"

namespace volillum {

// What tells outside from inside at a voxel: the direction in which `values`, the mean of
// `channels` of [n0, n1, n2], falls most steeply.
struct Guide {
    const float *values;
    int channels;
};

// As `convolve`, over y with y . grad(guide) < 0 alone and normalised to the half ball; over the
// whole ball where the guide has no gradient.
void hemisphere_sums(const float *field, int channels, const Guide &guide, const Index3 &shape,
                     const double *index_to_world, const ConvolutionSettings &settings, float *out);

}  // namespace volillum
