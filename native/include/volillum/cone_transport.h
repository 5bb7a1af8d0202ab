// Light that is scattered again and again into one cone about the direction to the light:
//
//   L_i(x) = sum_d w_d [ T(x, infinity) + integral_0^inf T(x, x + s omega_d) sigma_s L_i ds ]
//
// Light moves only away from its source, so one march through a lattice in the light's frame, from
// the lit side on, solves it. See "half angle" in docs/mathematics.md.
#pragma once

#include "volillum/control.h"
#include "volillum/real.h"

namespace volillum {

// The medium, its lattice, and the cone: outward unit vectors in world space. The cones of a lamp
// differ from place to place: directions that serve all of them, weighed locally.
struct ConeTransportScene {
    const Real *sigma_t;           // [extinctions, n0, n1, n2], C-contiguous
    const Real *sigma_s;           // [scatterings, n0, n1, n2], at most sigma_t
    int extinctions, scatterings;  // 1 or 3 each; one counts for all
    Index3 shape;
    const double *index_to_world;  // row-major 4 x 4
    Vec3d axis;                    // unit vector toward the light
    const double *directions;      // [count, 3], each with a positive component along the axis
    const double *weights;         // [count], sum 1; not read where there are local ones
    int count;
    // Null, or weights that vary: of each direction at nodes every `node_spacing` voxels, from the
    // first voxel on, [count, m0, m1, m2]; linear between them, sum 1 at each node.
    const Real *local_weights = nullptr;
    Index3 nodes{};
    int node_spacing = 1;
    // Null, or a lamp's place [3]: rays end where they are nearest to it, those of one direction on
    // the plane through it across that direction.
    const double *lamp = nullptr;
    // Null, or the mean transmittance sum_d w_d T at the voxels, [extinctions, n0, n1, n2], from a
    // source that is more exact than the light's lattice: the solution then follows it at hard
    // surfaces.
    const Real *transmittance = nullptr;
};

struct ConeTransportSettings {
    double spacing = 1.0;  // of the light's lattice, in voxels
    int threads = 0;       // 0: all cores
    Control *control = nullptr;
    double progress_begin = 0.0, progress_end = 1.0;
};

// L_i / L_l at the voxels; out is [the larger of both, n0, n1, n2]. Throws std::invalid_argument
// for directions or weights that do not fit the description, or a singular affine.
void cone_transport(const ConeTransportScene &scene, const ConeTransportSettings &settings,
                    Real *out);

}  // namespace volillum
