// The linear part of an index-to-world affine.
#pragma once

#include <cmath>
#include <stdexcept>

#include "volillum/real.h"

namespace volillum {

using Matrix3 = std::array<Vec3d, 3>;  // rows

// Inverse of the linear part of a row-major 4 x 4 affine. Throws std::invalid_argument where it is
// singular: |det| below 1e-12 of the product of the column lengths (1 for orthogonal axes).
inline Matrix3 inverse_linear(const double *affine) {
    Matrix3 m;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) m[row][column] = affine[4 * row + column];
    Matrix3 cofactor;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            cofactor[i][j] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
        }
    const double det =
        m[0][0] * cofactor[0][0] + m[0][1] * cofactor[0][1] + m[0][2] * cofactor[0][2];
    double scale = 1.0;
    for (int j = 0; j < 3; ++j) scale *= std::hypot(m[0][j], m[1][j], m[2][j]);
    if (!std::isfinite(det) || !(std::abs(det) > 1e-12 * scale))
        throw std::invalid_argument("index_to_world has determinant " + std::to_string(det) +
                                    "; expected an invertible affine");
    Matrix3 inverse;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) inverse[i][j] = cofactor[j][i] / det;
    return inverse;
}

inline Vec3d multiply(const Matrix3 &m, const double *v) {
    Vec3d result;
    for (int i = 0; i < 3; ++i) result[i] = m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2];
    return result;
}

}  // namespace volillum
