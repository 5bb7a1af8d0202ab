// The slice algorithms as they were published. They do not solve their models' equations: they
// exist to show by how much (docs/mathematics.md).
#pragma once

#include "volillum/control.h"
#include "volillum/real.h"

namespace volillum::published {

// What a slice's buffer holds between slices.
enum class Buffer { full, half, byte };

float stored(float value, Buffer buffer);

struct Volume {
    Index3 shape;
    const double *index_to_world;  // row-major 4 x 4
    const float *sigma_t;          // [channels][nx][ny][nz]
    const float *sigma_s;          // the same, or null: nothing is scattered on
    int channels;
};

// Slices across `toward`, a unit vector to the light or to the eye. With an eye they are seen from
// it, so that a pixel follows a ray to the eye.
struct Slices {
    Vec3d toward;
    const double *eye;  // null: parallel
    double distance;    // of slices, world units
    double pixel;       // edge of a pixel, world units (with an eye: at the volume's middle)
    double theta;       // half angle of the cone
    int taps;           // taps x taps in the square of half edge distance * tan(theta)
    Buffer buffer;
};

// Half angle slicing and (multi)directional occlusion: from slice to slice the buffer is averaged
// over the taps, then multiplied by T + albedo (1 - T), T = exp(-sigma_t distance).
// out[channels][nx][ny][nz]: the buffer's value as the voxel reads it.
void blurred_slices(const Volume &volume, const Slices &slices, int threads, Control *control,
                    float *out);

// Shadow volume propagation along the grid's own slices: colour = (1 - alpha) colour + alpha
// albedo, occlusion = (1 - alpha) occlusion + alpha, read one slice nearer to the light and
// averaged with 0, 4 or 8 neighbours. alpha = 1 - exp(-sigma_t h) of the slices' distance h: no
// correction for oblique light. out[2][channels][nx][ny][nz]: colour, then occlusion.
void propagated_shadow(const Volume &volume, const Vec3d &toward, int neighbours, Buffer buffer,
                       int threads, Control *control, float *out);

// Product of a local visibility over `steps` places x, x + offset, x + 2 offset, ...; 1 outside.
void composed_visibility(const Index3 &shape, const float *local, const Vec3d &index_offset,
                         int steps, int threads, Control *control, float *out);

}  // namespace volillum::published
