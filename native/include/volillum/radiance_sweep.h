// Radiance along a lobe of directions at all voxels, attenuated and gathered on the way, and the
// mean of its hue: what shadow volume propagation needs beside a hard shadow.
#pragma once

#include <algorithm>
#include <cstddef>

#include "volillum/control.h"
#include "volillum/real.h"
#include "volillum/sweep.h"

namespace volillum {

// Radiance per world unit: a field times a colour.
struct Source {
    const Real *values = nullptr;  // null, or [channels, n0, n1, n2]
    int channels = 0;              // 1 or 3
    Vec3d colour{1.0, 1.0, 1.0};

    // At a voxel of a field of `volume` voxels.
    Real at(std::ptrdiff_t voxel, std::ptrdiff_t volume, int channel) const {
        if (!values) return 0;
        return Real(colour[std::size_t(channel)]) *
               values[std::min(channel, channels - 1) * volume + voxel];
    }
};

// The medium, the light and the directions: outward unit vectors in world space.
struct RadianceScene {
    const Real *sigma_t;        // [extinction_channels, n0, n1, n2], C-contiguous
    int extinction_channels;    // 1 or 3
    Source scattered, emitted;  // what is gathered; their sum, in units of the light's luminance
    Index3 shape;
    const double *index_to_world;  // row-major 4 x 4; only the linear part matters
    const double *directions;
    int count;
    Vec3d hue;  // the light's RGB radiance over its luminance (1, 1, 1 for a white one)
};

struct RadianceSettings {
    int near_slices = 4;  // slices from each voxel along the direction's own ray
    int threads = 0;      // 0: all cores
    Control *control = nullptr;
};

// out[c] = sum_d weights[d] gamma_c(L(x, directions[d])), [3, n0, n1, n2], with
//     L_c = hue_c T_c + int T_c source_c ds,    gamma(L) = L / luminance(L),
// and the light's hue for gamma where the luminance of L is below 1e-6 of the light's.
// `node_spacing` 0: weights [d]. Otherwise they vary, [d, a, b, c] at nodes every so many voxels
// (volillum::weight_nodes), linear between them.
void mean_hue(const RadianceScene &scene, const Real *weights, int node_spacing,
              const RadianceSettings &settings, Real *out);

// A medium of one colour: its extinctions are `extinction` times the scene's sigma_t, and its
// source function, what it gathers over its extinction, is the same everywhere.
struct UniformColour {
    Vec3d hue;              // as in RadianceScene
    Vec3d extinction;       // not negative
    Vec3d source_function;  // in units of the light's luminance
};

// The same mean of hues in such a medium. There optical depth is all that a direction needs:
//     L_c = hue_c T_c + source_function_c (1 - T_c),    T_c = exp(-extinction_c od),
// which the optical-depth sweep gives, many times as fast. Of the settings the quantity is ignored.
void mean_hue_uniform(const SweepScene &scene, const UniformColour &colour, const Real *weights,
                      const SweepSettings &settings, Real *out);

}  // namespace volillum
