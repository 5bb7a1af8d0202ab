#include "volillum/trilinear.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace volillum {

Lattice::Lattice(const double *m) {
    for (std::size_t i = 0; i < 16; ++i)
        if (!std::isfinite(m[i]))
            throw std::invalid_argument("index_to_world holds a value that is not finite, at (" +
                                        std::to_string(i / 4) + ", " + std::to_string(i % 4) + ")");
    if (m[12] != 0.0 || m[13] != 0.0 || m[14] != 0.0 || m[15] != 1.0)
        throw std::invalid_argument(
            "the last row of index_to_world is not (0, 0, 0, 1); expected an affine map");
    // Rows of the inverse are cross products of columns over the determinant.
    const Vec3 columns[3] = {{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}};
    const auto cross = [](const Vec3 &a, const Vec3 &b) {
        return Vec3{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                    a[0] * b[1] - a[1] * b[0]};
    };
    const Vec3 first = cross(columns[1], columns[2]);
    const double determinant =
        columns[0][0] * first[0] + columns[0][1] * first[1] + columns[0][2] * first[2];
    const double scale = length(columns[0]) * length(columns[1]) * length(columns[2]);
    // Relative to the cell's edges, so that a change of unit is no matter.
    if (!(std::abs(determinant) > 1e-12 * scale))
        throw std::invalid_argument("index_to_world is singular (determinant " +
                                    std::to_string(determinant) + "); expected an invertible map");
    inverse_ = {(1.0 / determinant) * first, (1.0 / determinant) * cross(columns[2], columns[0]),
                (1.0 / determinant) * cross(columns[0], columns[1])};
    const Vec3 origin = {m[3], m[7], m[11]};
    offset_ = Vec3{1.0, 1.0, 1.0} - vector(origin);
}

Bricks::Bricks(const Size3 &shape, const std::vector<Planes> &planes)
    : shape_(shape),
      blocks_{shape[0] / block + 1, shape[1] / block + 1, shape[2] / block + 1},  // n + 1 cells
      numbers_(blocks_[0] * blocks_[1] * blocks_[2], none) {
    const std::size_t voxels = shape[0] * shape[1] * shape[2];
    // Voxel i is a corner of cells i and i + 1.
    const auto mark = [&](std::size_t i, std::size_t j, std::size_t k) {
        for (std::size_t a = i / block; a <= (i + 1) / block; ++a)
            for (std::size_t b = j / block; b <= (j + 1) / block; ++b)
                for (std::size_t c = k / block; c <= (k + 1) / block; ++c)
                    numbers_[(a * blocks_[1] + b) * blocks_[2] + c] = 0;
    };
    for (const Planes &some : planes)
        for (std::size_t n = 0; n < some.channels * voxels; ++n)
            if (some.values[n] != 0.0f)
                mark(n % voxels / (shape[1] * shape[2]), n / shape[2] % shape[1], n % shape[2]);
    std::size_t flat = 0;
    for (std::size_t a = 0; a < blocks_[0]; ++a)
        for (std::size_t b = 0; b < blocks_[1]; ++b)
            for (std::size_t c = 0; c < blocks_[2]; ++c, ++flat)
                if (numbers_[flat] != none) {
                    numbers_[flat] = std::uint32_t(places_.size());
                    places_.push_back({a, b, c});
                }
}

void Field::set(const Bricks &bricks, std::size_t channel, const float *plane) {
    if (values_.empty()) return;
    const Size3 &shape = bricks.shape();
    float *out = &values_[channel];
    for (std::size_t brick = 0; brick < bricks.count(); ++brick) {
        const Size3 &place = bricks.place(brick);
        for (std::size_t x = 0; x < Bricks::side; ++x)
            for (std::size_t y = 0; y < Bricks::side; ++y)
                for (std::size_t z = 0; z < Bricks::side; ++z, out += channels_) {
                    // Padded corner minus 1; below the grid it wraps beyond any shape.
                    const std::size_t i = place[0] * Bricks::block + x - 1,
                                      j = place[1] * Bricks::block + y - 1,
                                      k = place[2] * Bricks::block + z - 1;
                    if (i < shape[0] && j < shape[1] && k < shape[2])
                        *out = plane[(i * shape[1] + j) * shape[2] + k];
                }
    }
}

}  // namespace volillum
