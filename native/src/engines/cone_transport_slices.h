// The slices of the march: what they hold, and the medium on them.
#pragma once

#include <vector>

#include "cone_transport_medium.h"
#include "cone_transport_plan.h"

namespace volillum::cone_detail {

struct Slice {
    // How a direction's rays come here.
    struct Move {
        Crossing before, here;
        RayStates::Lines lines;
    };
    // Of each extinction where the next slab reads them, else of the one whose turn it is.
    std::vector<SlicePlanes> planes;
    SumRows sums;
    WeightRows weights;
    std::vector<Move> moves;

    SlicePlanes &planes_of(std::size_t extinction) {
        return planes[planes.size() > 1 ? extinction : 0];
    }
};

// Those of the slabs in flight and of one before.
class Slices {
public:
    Slices(const ConeTransportScene &scene, const Lattice &lattice, const MarchPlan &plan,
           const std::vector<Ray> &rays);
    Slice &at(int slice) {
        return slices_[std::size_t(slice + plan_.slab_slices) % slices_.size()];
    }
    // Rows of a slice are from now on those of this one.
    void begin(int slice);
    // The medium on a row of the slices [first, last).
    void sample(std::size_t extinction, int first, int last, int row);
    void clear_beside(Real *row, int slice, const Span &span) const;

private:
    const Lattice &lattice_;
    const MarchPlan &plan_;
    LatticeMedium medium_;
    std::vector<Slice> slices_;
};

}  // namespace volillum::cone_detail
