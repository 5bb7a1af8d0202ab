// Values between the points of a lattice or grid: places are found once, and the values of several
// fields then looked up there.
#pragma once

#include "volillum/real.h"

namespace volillum::cone_detail {

// Of kLanes points: the elements where four pairs of neighbours along the last axis begin, what
// each pair weighs, and what the two of a pair.
struct Lookups {
    alignas(64) int at[4][kLanes];
    alignas(64) Real weight[4][kLanes], low[kLanes], high[kLanes];
};

void look_up(const Real *values, const Lookups &near, Real *out);

}  // namespace volillum::cone_detail
