// Lookups of the published algorithms: bilinear in a slice, trilinear in the volume.
#pragma once

#include <cmath>
#include <vector>

#include "volillum/published.h"

namespace volillum::published {

// A slice's buffer of one channel; `outside` beyond it.
struct Plane {
    int rows, columns;
    float outside;
    std::vector<float> values;

    Plane(int r, int c, float value)
        : rows(r), columns(c), outside(value), values(std::size_t(r) * std::size_t(c), value) {}
    float at(int row, int column) const {
        const bool inside = row >= 0 && row < rows && column >= 0 && column < columns;
        return inside ? values[std::size_t(row) * std::size_t(columns) + std::size_t(column)]
                      : outside;
    }
    float operator()(double row, double column) const {
        const double r0 = std::floor(row), c0 = std::floor(column);
        const float fr = float(row - r0), fc = float(column - c0);
        const int r = int(r0), c = int(c0);
        const float low = at(r, c) * (1 - fc) + at(r, c + 1) * fc;
        const float high = at(r + 1, c) * (1 - fc) + at(r + 1, c + 1) * fc;
        return low * (1 - fr) + high * fr;
    }
};

// Trilinear interpolant of voxel values, zero outside (falling to it over one voxel).
inline float trilinear(const float *values, const Index3 &shape, const Vec3d &q) {
    int first[3];
    float part[3];
    for (std::size_t a = 0; a < 3; ++a) {
        const double low = std::floor(q[a]);
        if (!(low >= -1.0 && low < double(shape[a]))) return 0;
        first[a] = int(low);
        part[a] = float(q[a] - low);
    }
    float total = 0;
    for (int corner = 0; corner < 8; ++corner) {
        float weight = 1;
        std::size_t place = 0;
        bool inside = true;
        for (std::size_t a = 0; a < 3; ++a) {
            const int high = (corner >> a) & 1, index = first[a] + high;
            weight *= high ? part[a] : 1 - part[a];
            inside = inside && index >= 0 && index < shape[a];
            place = place * std::size_t(shape[a]) + std::size_t(index);
        }
        if (inside) total += weight * values[place];
    }
    return total;
}

}  // namespace volillum::published
