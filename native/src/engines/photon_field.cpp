#include "photon_field.h"

#include <algorithm>

namespace volillum {

namespace {

// The interpolant of eight corners at fractions f.
float trilinear(const float *corners, const float *f) {
    float z[4];
    for (int i = 0; i < 4; ++i)
        z[i] = corners[2 * i] + f[2] * (corners[2 * i + 1] - corners[2 * i]);
    const float low = z[0] + f[1] * (z[1] - z[0]), high = z[2] + f[1] * (z[3] - z[2]);
    return low + f[0] * (high - low);
}

// Parts of a cell are halved until the interpolant varies by less than this in them, or a possible
// collision is unlikely anyway.
constexpr float kVariation = 0.5f, kUnlikely = 1.0f;
// Halvings of a cell: positions have no more digits.
constexpr int kHalvings = 20;

}  // namespace

PhotonField::PhotonField(const PhotonGeometry &geometry, const PhotonMedium &medium, float least)
    : stride{geometry.shape[1] * geometry.shape[2], geometry.shape[2]},
      voxels(geometry.shape[0] * geometry.shape[1] * geometry.shape[2]),
      sigma_t(medium.sigma_t.values),
      sigma_s(medium.sigma_s.values),
      channels_t(medium.sigma_t.channels),
      channels_s(medium.sigma_s.channels),
      g(float(medium.g)),
      empty(true),
      floor(least) {
    double longest = 0.0;
    for (std::size_t a = 0; a < 3; ++a) {
        longest = std::max(longest, length(geometry.columns[a]));
        shape[a] = int(geometry.shape[a]);
        blocks[a] = shape[a] / block + 1;  // n + 1 cells
    }
    dense = many / float(block * longest);
    majorants.assign(std::size_t(blocks[0]) * std::size_t(blocks[1]) * std::size_t(blocks[2]),
                     floor);
    std::array<int, 3> low = shape, high = {-1, -1, -1};
    for (std::size_t c = 0; c < channels_t; ++c)
        for (int i = 0; i < shape[0]; ++i)
            for (int j = 0; j < shape[1]; ++j) {
                const float *row =
                    sigma_t + c * voxels + std::size_t(i) * stride[0] + std::size_t(j) * stride[1];
                for (int k = 0; k < shape[2]; ++k) {
                    if (!(row[k] > 0.0f)) continue;
                    const std::array<int, 3> at = {i, j, k};
                    for (std::size_t a = 0; a < 3; ++a) {
                        low[a] = std::min(low[a], at[a]);
                        high[a] = std::max(high[a], at[a]);
                    }
                    // Voxel i is a corner of cells i and i + 1.
                    for (int x = i / block; x <= (i + 1) / block; ++x)
                        for (int y = j / block; y <= (j + 1) / block; ++y)
                            for (int z = k / block; z <= (k + 1) / block; ++z) {
                                float &most =
                                    majorants[std::size_t((x * blocks[1] + y) * blocks[2] + z)];
                                most = std::max(most, row[k]);
                            }
                }
            }
    empty = high[0] < 0;
    for (std::size_t a = 0; a < 3; ++a) {
        box.low[a] = empty ? 0.0 : double(low[a]);
        box.high[a] = empty ? double(shape[a]) + 1.0 : double(high[a]) + 2.0;
    }
}

float PhotonField::largest(int i, int j, int k) const {
    if (i < 0 || j < 0 || k < 0 || i >= shape[0] || j >= shape[1] || k >= shape[2]) return 0.0f;
    const std::size_t voxel =
        std::size_t(i) * stride[0] + std::size_t(j) * stride[1] + std::size_t(k);
    float most = sigma_t[voxel];
    for (std::size_t c = 1; c < channels_t; ++c) most = std::max(most, sigma_t[c * voxels + voxel]);
    return most;
}

bool PhotonField::walk_dense(const float *q, const float *step, const float *inverse, float far,
                             float &depth, float &way, float &majorant) const {
    int cell[3];
    float leave[3];
    const auto plane = [&](int a) {
        return (float(cell[a] + (step[a] > 0.0f ? 1 : 0)) - q[a]) * inverse[a];
    };
    for (int a = 0; a < 3; ++a) {
        cell[a] = std::min(std::max(int(q[a]), 0), shape[a]);
        leave[a] = plane(a);
    }
    float t = 0.0f;
    while (t < far) {
        const int axis =
            leave[0] < leave[1] ? (leave[0] < leave[2] ? 0 : 2) : (leave[1] < leave[2] ? 1 : 2);
        const float end = std::max(t, std::min(leave[axis], far));
        // Cell c has the voxels c - 1 and c as corners.
        float corners[8], most = floor;
        for (int i = 0; i < 8; ++i) {
            corners[i] =
                largest(cell[0] - 1 + (i >> 2), cell[1] - 1 + (i >> 1 & 1), cell[2] - 1 + (i & 1));
            most = std::max(most, corners[i]);
        }
        while (most > 0.0f && t < end) {
            float h = end - t, high = most;
            for (int halving = 0; halving < kHalvings; ++halving) {
                // An interpolant's extremes over a box are at the box's corners.
                float low = most, f[2][3];
                high = floor;
                for (int a = 0; a < 3; ++a)
                    for (int side = 0; side < 2; ++side) {
                        const float at = q[a] + (t + float(side) * h) * step[a] - float(cell[a]);
                        f[side][a] = std::min(std::max(at, 0.0f), 1.0f);
                    }
                for (int i = 0; i < 8; ++i) {
                    const float at[3] = {f[i >> 2][0], f[i >> 1 & 1][1], f[i & 1][2]};
                    const float value = trilinear(corners, at);
                    low = std::min(low, value);
                    high = std::max(high, value);
                }
                if (low > kVariation * high || high * h < kUnlikely) break;
                h *= 0.5f;
            }
            // Rounding of the corners' values and of positions.
            high *= 1.0f + 1e-5f;
            if (depth < high * h) {
                way = t + depth / high;
                majorant = high;
                return true;
            }
            depth -= high * h;
            if (!(t + h > t)) break;
            t += h;
        }
        t = end;
        cell[axis] += step[axis] > 0.0f ? 1 : -1;
        if (cell[axis] < 0 || cell[axis] > shape[axis]) return false;
        leave[axis] = plane(axis);
    }
    return false;
}

void PhotonField::interpolate(const float *q, float *out_t, float *out_s) const {
    int cell[3];
    float f[3];
    for (int a = 0; a < 3; ++a) {
        cell[a] = std::min(std::max(int(q[a]), 0), shape[a]);
        f[a] = std::min(std::max(q[a] - float(cell[a]), 0.0f), 1.0f);
    }
    const auto evaluate = [&](const float *plane) {
        float corners[8];
        for (int n = 0; n < 8; ++n) {
            const int i = cell[0] - 1 + (n >> 2), j = cell[1] - 1 + (n >> 1 & 1),
                      k = cell[2] - 1 + (n & 1);
            const bool inside =
                i >= 0 && j >= 0 && k >= 0 && i < shape[0] && j < shape[1] && k < shape[2];
            corners[n] = inside ? plane[std::size_t(i) * stride[0] + std::size_t(j) * stride[1] +
                                        std::size_t(k)]
                                : 0.0f;
        }
        return trilinear(corners, f);
    };
    for (std::size_t c = 0; c < 3; ++c) {
        out_t[c] = c < channels_t ? evaluate(sigma_t + c * voxels) : out_t[0];
        out_s[c] = c < channels_s ? evaluate(sigma_s + c * voxels) : out_s[0];
    }
}

}  // namespace volillum
