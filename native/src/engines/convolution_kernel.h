// The truncated kernel |y|^-p integrated against the hat functions of the trilinear medium.
#pragma once

#include <cstdlib>
#include <vector>

#include "volillum/convolution.h"

namespace volillum {

// Weights of the voxels at offsets d with |d[a]| <= reach[a]. The kernel is even, so only d[0] >= 0
// is stored: weight(d) at ((d[0] * (2 reach[1] + 1) + d[1] + reach[1]) * (2 reach[2] + 1)
// + d[2] + reach[2]).
struct KernelWeights {
    Index3 reach{};
    std::vector<double> values;

    std::size_t rows() const { return 2 * std::size_t(reach[1]) + 1; }
    std::size_t columns() const { return 2 * std::size_t(reach[2]) + 1; }
    const double *row(int i, int j) const {
        return values.data() + (std::size_t(i) * rows() + std::size_t(j + reach[1])) * columns();
    }
    // Of an offset with d[0] >= 0; 0 beyond the reach.
    double weight(const Index3 &d) const {
        const bool within =
            d[0] <= reach[0] && std::abs(d[1]) <= reach[1] && std::abs(d[2]) <= reach[2];
        return within ? row(d[0], d[1])[d[2] + reach[2]] : 0.0;
    }
};

// No offset beyond `largest` is needed. Throws std::invalid_argument for a singular affine.
KernelWeights kernel_weights(const double *index_to_world, const Neighbourhood &neighbourhood,
                             const Index3 &largest, int threads, Control *control);

}  // namespace volillum
