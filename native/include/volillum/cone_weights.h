// Weights of a fixed lattice of directions for cones about many axes.
#pragma once

#include <cstddef>
#include <cstdint>

#include "volillum/control.h"

namespace volillum {

// A square lattice of directions in Lambert's equal-area map of the sphere about +z: node (a, b)
// sits at (first_u + a, first_v + b) * spacing.
struct AngularLattice {
    double spacing;
    std::int64_t first_u, first_v, size_u, size_v;
};

// Spreads each cone's sub-directions over the lattice by Catmull-Rom cubics: the exact integral
// over the cone of the lattice's cubic interpolant, up to the rule of sub-directions.
//   axes [axis_count, 3]: unit vectors in the map's frame; must stay off the map's antipole
//   local [count, 3], local_weights [count]: a rule for the cone about +z
//   weights [size_u * size_v, axis_count]: written; each column sums to the rule's own sum
void cone_weights(const AngularLattice &lattice, const double *axes, std::size_t axis_count,
                  const double *local, const double *local_weights, std::size_t count, int threads,
                  Control *control, float *weights);

}  // namespace volillum
