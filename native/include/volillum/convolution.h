// Convolution of a voxel field with the truncated kernel |y|^-p (neighbourhood sums).
#pragma once

#include <limits>

#include "volillum/control.h"
#include "volillum/real.h"

namespace volillum {

// Which neighbourhood: all |y| < radius in world space, weighted by |y|^-weight_p (0, 1 or 2) and
// normalised so that a homogeneous field of value 1 gives `total` everywhere.
struct Neighbourhood {
    double radius = 1.0;
    int weight_p = 1;
    double total = 1.0;
};

struct ConvolutionSettings {
    Neighbourhood neighbourhood;
    // More than 0: the field is sigma_t, and opacities 1 - exp(-sigma_t opacity_length) of the
    // voxels are summed.
    double opacity_length = 0.0;
    // Sums lie between 0 and this: what rounding puts outside is cut.
    double upper = std::numeric_limits<double>::infinity();
    // 1 - sum instead of the sum.
    bool complement = false;
    // Transforms in double precision: rounding in single is 1e-7 of the largest sums, everywhere.
    bool double_precision = false;
    int threads = 0;
    Control *control = nullptr;
};

// out[c] = sums of field[c] (`channels` of [n0, n1, n2]) over the neighbourhood of every voxel. The
// field is the trilinear interpolant of its voxels, zero outside; the kernel is integrated against
// it.
void convolve(const float *field, int channels, const Index3 &shape, const double *index_to_world,
              const ConvolutionSettings &settings, float *out);

}  // namespace volillum
