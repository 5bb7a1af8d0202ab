// The nearest voxels' shares of a half ball, as polynomials in its direction.
#pragma once

#include <array>

#include "volillum/convolution.h"

namespace volillum {

// Of the 26 voxels around one, those whose opposites are the others, and for each the share of its
// weight on the side of a direction n, of length 1 by index, minus the share on the other side:
//     sum over m of terms[m][pair] n_i^a n_j^b n_k^c, a + b + c = kDegree,
// m counting a, then b, from 0.
struct NearShares {
    static constexpr int kPairs = 13, kDegree = 7;
    static constexpr int kTerms = (kDegree + 1) * (kDegree + 2) / 2;

    std::array<Index3, kPairs> offsets;
    Real terms[kTerms][kPairs];

    NearShares(const double *index_to_world, const Neighbourhood &neighbourhood);
};

}  // namespace volillum
