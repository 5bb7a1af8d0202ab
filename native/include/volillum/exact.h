// The judge: the models' own equations by brute force in double precision, written independently
// of the engines that it judges. Only the trilinear lookup is shared, and that is tested by itself.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "volillum/control.h"
#include "volillum/trilinear.h"

namespace volillum::exact {

using Planes = Bricks::Planes;

// One summand of the in-scattered radiance,
//     (1 / Omega) int_lobe L(w) exp(-od(x, w)) dw,
// uniform over the cone of half angle acos(cos_theta) about the axis; L(w) by its real orthonormal
// spherical harmonics over outward world directions.
struct Term {
    Vec3 axis;                   // unit direction, or a world point when `local`
    bool local;                  // the axis at x is the direction from x to `axis`
    double cos_theta;            // -1: the whole sphere; 1: the axis alone
    std::vector<Vec3> radiance;  // 1, 4, 9 or 16 coefficients, RGB
};

struct Sampling {
    double radius;           // visibility is cut at this distance, world units; may be infinite
    std::size_t directions;  // per term
    std::size_t replicates;  // independent randomisations, >= 2
    std::uint64_t seed;
    bool clamp;  // negative in-scattered radiance is set to 0
    int threads;
    Control *control;
};

// Ray through image position (u, v): from rays[0] + u rays[1] + v rays[2] toward
// rays[3] + u rays[4] + v rays[5].
struct Image {
    const Vec3 *rays;
    std::size_t width, height;
};

// depth[n][channels]: optical depth from each origin to the border or to `radius`.
void optical_depth(const Lattice &lattice, const Size3 &shape, const Planes &sigma_t,
                   const double *origins, const double *directions, std::size_t count,
                   double radius, int threads, Control *control, double *depth);

// value[n][3], error[n][3]; here `directions` counts all replicates together.
void in_scattered(const Lattice &lattice, const Size3 &shape, const Planes &sigma_t,
                  const std::vector<Term> &terms, const double *points, std::size_t count,
                  const Sampling &sampling, double *value, double *error);

// radiance[height][width][3] and its standard error; here `directions` counts per point of the ray
// and `points` per replicate. sigma_s must vanish where sigma_t does.
void image(const Lattice &lattice, const Size3 &shape, const Planes &sigma_t, const Planes &sigma_s,
           const Planes &emission, const std::vector<Term> &terms, const Image &view,
           std::size_t points, const Sampling &sampling, double *radiance, double *error);

}  // namespace volillum::exact
