// From the lattice of the cone transport to the voxels.
#pragma once

#include <vector>

#include "cone_transport_lattice.h"

namespace volillum::cone_detail {

// What the march leaves at all held points of the lattice.
struct Solution {
    std::array<Reals, kMostAlbedos> in_scattered;
    Reals seen;  // empty where it is not needed
    void resize(std::size_t points, int albedos, bool with_seen) {
        for (int i = 0; i < albedos; ++i) in_scattered[i].resize(points + kLanes);
        if (with_seen) seen.resize(points + kLanes);
    }
};

// Writes L_i at the voxels, plane by plane of the first index.
class VoxelRows {
public:
    VoxelRows(const ConeTransportScene &scene, const Lattice &lattice, const Solution &solution);
    void write(int plane, Real *out) const;

private:
    const ConeTransportScene &scene_;
    const Lattice &lattice_;
    const Solution &solution_;
    std::vector<std::ptrdiff_t> starts_;  // of rows, at their column 0
};

}  // namespace volillum::cone_detail
