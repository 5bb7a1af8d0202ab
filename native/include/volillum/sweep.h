// The directional optical-depth sweep: transmittance or optical depth from every voxel along a
// list of directions, summed with weights. See MODELS section 8 of the documentation for why it
// sums optical depth along a sheared lattice of rays and interpolates once.
#pragma once

#include <climits>
#include <cstddef>
#include <limits>

#include "volillum/control.h"
#include "volillum/real.h"

namespace volillum {

enum class Quantity { transmittance, optical_depth };

struct SweepSettings {
    double radius = std::numeric_limits<double>::infinity();  // world units
    int near_slices = 4;  // slices from each voxel that are integrated exactly
    Quantity quantity = Quantity::transmittance;
    // The voxels [begin, end) whose sums are wanted; what the output holds elsewhere stays.
    Index3 wanted_begin{0, 0, 0}, wanted_end{INT_MAX, INT_MAX, INT_MAX};
    int threads = 0;  // 0: all cores
    Control *control = nullptr;
    bool add = false;                  // to what the output holds
    std::ptrdiff_t channel_pitch = 0;  // from channel to channel of the output; 0: its voxels
};

// The medium and the directions: outward unit vectors in world space, `count` of them, row-major.
struct SweepScene {
    const Real *sigma_t;  // [n0, n1, n2], C-contiguous
    Index3 shape;
    const double *index_to_world;  // row-major 4 x 4; only the linear part matters
    const double *directions;
    int count;
};

// out[c] = sum_d weights[d, c] Q(x, directions[d]); out is [channels, n0, n1, n2].
void sweep(const SweepScene &scene, const Real *weights, int channels,
           const SweepSettings &settings, Real *out);

// Nodes of the weight lattice of sweep_weighted along an axis of `size` voxels.
constexpr int weight_nodes(int size, int spacing) {
    return (size - 2 + spacing) / spacing + 1;
}

// out = sum_d w_d(x) Q(x, directions[d]); w_d is the trilinear interpolant of weights[d, a, b, c],
// given at the voxels (a, b, c) * spacing. out is [n0, n1, n2].
void sweep_weighted(const SweepScene &scene, const Real *weights, int spacing,
                    const SweepSettings &settings, Real *out);

}  // namespace volillum
