// From the lattice of the cone transport to the voxels.
#pragma once

#include <algorithm>
#include <vector>

#include "cone_transport_kernels.h"
#include "cone_transport_lattice.h"
#include "volillum/huge_pages.h"

namespace volillum::cone_detail {

// What the march leaves at all held points of the lattice.
struct Solution {
    std::array<HugeReals, kMostAlbedos> in_scattered;
    HugeReals seen;  // empty where it is not needed
    void resize(std::size_t points, int albedos, bool with_seen) {
        // Lookups read a point beyond the last, whose weight is 0.
        const auto allocate = [&](HugeReals &values) {
            values.resize(points + kLanes);
            std::fill_n(values.data() + points, kLanes, Real(0));
        };
        for (int i = 0; i < albedos; ++i) allocate(in_scattered[std::size_t(i)]);
        if (with_seen) allocate(seen);
    }
};

// Writes L_i at the voxels, plane by plane of the first index.
class VoxelRows {
public:
    // `transmittance` at the voxels or null, as in the scene, of one extinction.
    VoxelRows(const Index3 &shape, const Lattice &lattice, const Solution &solution,
              const Real *transmittance);
    // out[i] for each albedo.
    void write(int plane, int albedos, Real *out) const;

private:
    Index3 shape_;
    const Real *transmittance_;
    const Lattice &lattice_;
    const Solution &solution_;
    std::vector<int> starts_;  // of rows, at their column 0
};

}  // namespace volillum::cone_detail
