// The medium as every exact integral sees it: voxel values on an affine lattice, interpolated
// trilinearly, zero outside, so that the support reaches one voxel beyond the border voxels.
//
// Values are stored with one layer of zeros around the grid. In these padded coordinates
// q = index + 1, cell (a, b, c) spans [a, a+1] x [b, b+1] x [c, c+1], a = 0 .. n, and every cell
// has all of its eight corners: no bounds are checked inside.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "volillum/cpu.h"

namespace volillum {

using Vec3 = std::array<double, 3>;
using Size3 = std::array<std::size_t, 3>;

VOLILLUM_INLINE Vec3 operator+(const Vec3 &a, const Vec3 &b) {
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
VOLILLUM_INLINE Vec3 operator-(const Vec3 &a, const Vec3 &b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
VOLILLUM_INLINE Vec3 operator*(double s, const Vec3 &a) {
    return {s * a[0], s * a[1], s * a[2]};
}
VOLILLUM_INLINE double dot(const Vec3 &a, const Vec3 &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
VOLILLUM_INLINE double length(const Vec3 &a) {
    return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

// World space to padded voxel coordinates q.
class Lattice {
public:
    // `index_to_world` is a row-major 4 x 4 affine. Throws std::invalid_argument when it is not
    // finite, not affine or singular.
    explicit Lattice(const double *index_to_world);

    VOLILLUM_INLINE Vec3 point(const Vec3 &world) const { return vector(world) + offset_; }
    VOLILLUM_INLINE Vec3 vector(const Vec3 &world) const {
        Vec3 result;
        for (std::size_t a = 0; a < 3; ++a)
            result[a] =
                inverse_[a][0] * world[0] + inverse_[a][1] * world[1] + inverse_[a][2] * world[2];
        return result;
    }

private:
    std::array<Vec3, 3> inverse_;
    Vec3 offset_;
};

// Which blocks hold anything, and the number of each one's brick.
class Bricks {
public:
    static constexpr std::size_t block = 8, side = block + 1, corners = side * side * side;
    static constexpr std::uint32_t none = ~std::uint32_t(0);

    // One set of C-contiguous planes [channels][nx][ny][nz].
    struct Planes {
        const float *values = nullptr;
        std::size_t channels = 0;
    };
    // A block has a brick when any corner of its cells differs from 0 in any of the planes.
    Bricks(const Size3 &shape, const std::vector<Planes> &planes);

    VOLILLUM_INLINE std::uint32_t at(std::size_t a, std::size_t b, std::size_t c) const {
        return numbers_[(a * blocks_[1] + b) * blocks_[2] + c];
    }
    const Size3 &blocks() const { return blocks_; }
    const Size3 &shape() const { return shape_; }
    std::size_t count() const { return places_.size(); }
    const Size3 &place(std::size_t brick) const { return places_[brick]; }

private:
    Size3 shape_, blocks_;
    std::vector<std::uint32_t> numbers_;
    std::vector<Size3> places_;
};

// One cell: its lowest corner in padded coordinates and that corner's place in a Field.
struct Cell {
    Vec3 corner;
    std::size_t voxel;
};

// Voxel values, `channels` of them interleaved, where the bricks are.
class Field {
public:
    static constexpr std::size_t step_x = Bricks::side * Bricks::side, step_y = Bricks::side;

    Field(const Bricks &bricks, std::size_t channels)
        : channels_(channels), values_(bricks.count() * Bricks::corners * channels, 0.0f) {}

    // Copies a C-contiguous [nx, ny, nz] plane into one channel.
    void set(const Bricks &bricks, std::size_t channel, const float *plane);

    std::size_t channels() const { return channels_; }

    // Values at padded coordinate q inside `cell`, all channels.
    VOLILLUM_INLINE void interpolate(const Cell &cell, const Vec3 &q, double *out) const {
        const Vec3 f = q - cell.corner;
        const float *corner = &values_[cell.voxel * channels_];
        for (std::size_t c = 0; c < channels_; ++c) out[c] = 0.0;
        for (std::size_t a = 0; a < 2; ++a)
            for (std::size_t b = 0; b < 2; ++b) {
                const double w = (a ? f[0] : 1.0 - f[0]) * (b ? f[1] : 1.0 - f[1]);
                const double low = w * (1.0 - f[2]), high = w * f[2];
                const float *p = corner + (a * step_x + b * step_y) * channels_;
                for (std::size_t c = 0; c < channels_; ++c)
                    out[c] += low * double(p[c]) + high * double(p[channels_ + c]);
            }
    }

    // Exact mean of one channel over the straight segment centre -/+ half inside `cell`.
    // Along a segment the interpolant P is a cubic, whose mean 2-point Gauss quadrature gives
    // exactly: (P(m + e) + P(m - e)) / 2 with e = half / sqrt(3). P is linear in each coordinate,
    // so this is P(m) + e_x e_y P_xy + e_x e_z P_xz + e_y e_z P_yz: one interpolation for two.
    template <std::size_t Channels>
    VOLILLUM_INLINE double segment_mean(const Cell &cell, const Vec3 &centre, const Vec3 &half,
                                        std::size_t channel) const {
        const double fx = centre[0] - cell.corner[0], fy = centre[1] - cell.corner[1],
                     fz = centre[2] - cell.corner[2];
        const float *p = &values_[cell.voxel * Channels + channel];
        constexpr std::size_t x = step_x * Channels, y = step_y * Channels, z = Channels;
        const double v000 = p[0], v001 = p[z], v010 = p[y], v011 = p[y + z];
        const double v100 = p[x], v101 = p[x + z], v110 = p[x + y], v111 = p[x + y + z];
        // Slopes along z, and values, at the four edges; then along y; then x.
        const double z00 = v001 - v000, z01 = v011 - v010, z10 = v101 - v100, z11 = v111 - v110;
        const double e00 = v000 + fz * z00, e01 = v010 + fz * z01;
        const double e10 = v100 + fz * z10, e11 = v110 + fz * z11;
        const double y0 = e01 - e00, y1 = e11 - e10, yz0 = z01 - z00, yz1 = z11 - z10;
        const double v0 = e00 + fy * y0, v1 = e10 + fy * y1;
        const double z0 = z00 + fy * yz0, z1 = z10 + fy * yz1;
        const double value = v0 + fx * (v1 - v0), yz = yz0 + fx * (yz1 - yz0);
        const double bend =
            half[0] * (half[1] * (y1 - y0) + half[2] * (z1 - z0)) + half[1] * half[2] * yz;
        return value + bend * (1.0 / 3.0);
    }

private:
    std::size_t channels_;
    std::vector<float> values_;
};

}  // namespace volillum
