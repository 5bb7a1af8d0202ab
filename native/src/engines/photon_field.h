// The medium as photons meet it: majorants of macrocells, and values of single voxels.
#pragma once

#include "photon_source.h"

namespace volillum {

// Delta tracking asks only whether a collision at q is real, with probability sigma(q) / majorant.
// The trilinear sigma(q) is the mean of the corner floor(q + xi) over uniform xi, so the value of
// that one corner decides with exactly the same probability, and costs one memory access, not
// eight.
struct PhotonField {
    // Cells along a side of a macrocell.
    static constexpr int block = 4;

    // Possible collisions across a macrocell beyond which it is walked cell by cell.
    static constexpr float many = 32.0f;

    // `floor`: majorants are at least this, also in the void, so that possible collisions tell of
    // the light there too.
    PhotonField(const PhotonGeometry &geometry, const PhotonMedium &medium, float floor = 0.0f);

    // Where most possible collisions in void or thin parts beside opaque voxels would be null.
    VOLILLUM_INLINE bool is_dense(float majorant) const { return majorant > dense; }

    // Flies from q through [0, far] of one macrocell until the optical depth `depth` (lowered by
    // what was flown) under majorants of single cells, or of parts of them where the interpolant
    // runs from thin to opaque, so that few collisions are null. True at a possible collision:
    // `way` is its distance and `majorant` bounds the trilinear value there.
    bool walk_dense(const float *q, const float *step, const float *inverse, float far,
                    float &depth, float &way, float &majorant) const;
    // Trilinear sigma_t and sigma_s [3] at q, one channel repeated.
    void interpolate(const float *q, float *sigma_t, float *sigma_s) const;

    std::array<int, 3> shape, blocks;
    std::array<std::size_t, 2> stride;  // voxels a step along i, j
    std::size_t voxels;
    const float *sigma_t, *sigma_s;  // [channels][voxels]
    std::size_t channels_t, channels_s;
    float g;
    std::vector<float> majorants;  // [blocks], over all channels
    Box box;                       // what holds all extinction
    bool empty;                    // there is none
    float dense, floor;

private:
    float largest(int i, int j, int k) const;
};

}  // namespace volillum
