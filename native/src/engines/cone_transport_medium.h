// The medium at the points of the lattice.
#pragma once

#include <vector>

#include "cone_transport_lattice.h"
#include "cone_transport_state.h"

namespace volillum::cone_detail {

class LatticeMedium {
public:
    // sigma_t is clipped to `largest`.
    LatticeMedium(const ConeTransportScene &scene, const Lattice &lattice, int albedos,
                  Real largest);
    // An extinction and its albedos on a row of a slice, on kLanes columns.
    void sample(std::size_t extinction, int slice, int row, int column, SlicePlanes &planes) const;

private:
    struct Fields {
        const Real *sigma_t;
        AlbedoFields sigma_s;
    };
    const Real *readable(const Real *values, std::size_t voxels);

    const Index3 shape_;
    const Lattice &lattice_;
    int albedos_;
    Real largest_;
    std::vector<Fields> fields_;
    std::vector<Reals> copies_;
};

}  // namespace volillum::cone_detail
