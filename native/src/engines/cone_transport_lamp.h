// What differs from a sun where the light is a lamp: cones turn from place to place, and rays end.
#pragma once

#include <vector>

#include "cone_transport_lattice.h"
#include "cone_transport_state.h"

namespace volillum::cone_detail {

class LampCones {
public:
    LampCones(const ConeTransportScene &scene, double spacing, const Lattice &lattice);

    // Weights of all directions at the points of a row.
    void weigh(int slice, int row, const Span &span, WeightRows &weights) const;
    // What of the step to `slice` of a row of a direction's rays lies before the lamp.
    void end(int slice, int row, const Crossing &here, std::size_t direction, const Span &rays,
             StepRow &step) const;

private:
    const ConeTransportScene &scene_;
    const Lattice &lattice_;
    int node_columns_ = 1;  // columns between those whose weights are looked up
    std::vector<Vec3d> outward_;
};

}  // namespace volillum::cone_detail
