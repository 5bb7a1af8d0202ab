// The judge: the models' own equations by brute force in double precision, written independently
// of the engines that it judges. Only the trilinear lookup is shared, and that is tested by itself.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "volillum/control.h"
#include "volillum/trilinear.h"

namespace volillum::exact {

using Planes = Bricks::Planes;

// Voxel planes on one lattice. sigma_s and emission (sigma_a L_e) may have no channels: not needed.
struct Medium {
    Lattice lattice;
    Size3 shape;
    Planes sigma_t, sigma_s, emission;
};

// One lobe of directions and the radiance from outside that arrives through it. The lobe is
// uniform over the cone of half angle acos(cos_theta) about the axis, L(w) is given by its real
// orthonormal spherical harmonics over outward world directions.
struct Term {
    // What `axis` is: a unit direction; a world point that the axis at x points to; or a lamp at
    // that point, whose light also falls off with the squared distance.
    enum class Toward { direction, point, lamp };
    Vec3 axis;
    Toward toward;
    double cos_theta;            // -1: the whole sphere; 1: the axis alone
    std::vector<Vec3> radiance;  // 1, 4, 9 or 16 coefficients, RGB; of a lamp, at distance 1
};

// A light of full scattering.
struct Light {
    // A sun with its disc; a lamp, whose intensity may be shaped; the same radiance from
    // everywhere; a latitude-longitude image, constant over each pixel, first row up.
    enum class Kind { distant, lamp, constant, image };
    Kind kind;
    Vec3 colour;             // a sun's fluence, a lamp's intensity on its axis, a radiance
    double share;            // of the effort, more than 0
    Vec3 position{};         // of a lamp
    Vec3 direction{};        // toward a sun; in which a shaped lamp shines
    double cos_angle = 1.0;  // half angle of a sun's disc; edge of a spot
    // A lamp's intensity over the cosine c with its direction: the same everywhere; smoothstep of
    // (c - cos_angle) / blend; c of a flat one, which may have the two half extents below.
    enum class Shape { point, spot, flat } shape = Shape::point;
    double blend = 0.0;
    std::array<Vec3, 2> half_extent{};
    bool ellipse = false;
    const double *image = nullptr;  // [height][width][3]
    std::size_t height = 0, width = 0;
    std::array<Vec3, 3> rotation{};  // rows: from world directions to the image's
};

// What is solved, beside the terms:
struct Equation {
    enum class Kind {
        // L_i = sum_terms (1 / Omega) int_lobe L(w) exp(-od(x, x + radius w)) dw
        gather,
        // L_i = sum_terms B V, V(x) = (1 / Omega) int_lobe [T + int T sigma_s V ds] dw: the same
        // lobe at every scattering, of a lamp about the direction to it, up to its nearest point
        scattered,
        // L_i = L [1 - scale mean_lobe int_0^radius s^(2 - p) m(x + s w) ds dw]: nothing on the way
        // attenuates. The lobe is the sphere, or the half space about `outward` where that is not 0
        occluded,
        // L_i = sum_terms mean_lobe Q(x, w), Q = B T + int T (colour sigma_s B + emission) ds, or
        // with `split` lambda(B T(x, axis)) mean_lobe gamma(Q): luminance of the axis, hue of the
        // lobe, which has the weight cos^beta
        coloured,
        // L_i(x, v) = int p(w, v) L(x, w) dw, L = L_lights T + int T (sigma_s L_i + emission) ds
        // with
        // Henyey and Greenstein's phase function: every order of scattering, without terms
        transported,
    };
    Kind kind = Kind::gather;
    std::vector<Term> terms;
    double radius;  // visibility is cut at this distance, world units; may be infinite
    // occluded:
    Planes occluder{}, outward{};  // m: 1 or 3 channels; a world vector, or no channels
    double weight_p = 2.0, scale = 1.0;
    // coloured:
    double beta = 0.0, colour = 1.0;
    bool gathers_emission = false, split = false;
    // transported:
    std::vector<Light> lights{};
    double g = 0.0;
};

struct Sampling {
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

// Where results go: value[n][3], error[n][3], and per n the share of the light's paths that was
// given up because it went on scattering.
struct Results {
    double *value, *error, *neglected;
};

// depth[n][channels]: optical depth from each origin to the border or to `radius`.
void optical_depth(const Medium &medium, const double *origins, const double *directions,
                   std::size_t count, double radius, int threads, Control *control, double *depth);

// Results at points [count][3], seen from directions [count][3] where that matters; here
// `directions` counts all replicates together.
void in_scattered(const Medium &medium, const Equation &equation, const double *points,
                  const double *views, std::size_t count, const Sampling &sampling,
                  const Results &results);

// value, error[count][harmonics][channels] of V_lm = int T Y_lm dw, T over `radius`, for the first
// 1, 4, 9 or 16 real harmonics; `directions` counts all replicates together.
void visibility_harmonics(const Medium &medium, double radius, std::size_t harmonics,
                          const double *points, std::size_t count, const Sampling &sampling,
                          double *value, double *error);

// Results at pixels [height][width]; here `directions` counts per point of the ray and `points`
// per replicate. sigma_s must vanish where sigma_t does; `emits`: the emission is in the image.
void image(const Medium &medium, const Equation &equation, bool emits, const Image &view,
           std::size_t points, const Sampling &sampling, const Results &results);

}  // namespace volillum::exact
