// side_d(n) = integral of w_d(y) sign(y . n) dV / integral of w_d(y) dV, w_d(y) = |y|^-p hat_d(y)
// in the ball, is an integral over directions,
//
//     side_d(n) = integral of A_d(omega) sign(omega . n) d omega,
//     A_d(omega) = |omega|^-p integral of r^(2-p) hat_d(r omega) dr, normalised,
//
// omega of length 1 by index, |omega| its length in the world. With sign(t) replaced by its best
// odd polynomial, the sum of its Legendre terms up to degree 7, it is a polynomial in n, and what
// is lost are the bands above 7 of A_d, weakened by those of sign: of voxels this near it is wide.
#include "hemisphere_near.h"

#include <algorithm>
#include <cmath>

#include "gauss.h"

namespace volillum {
namespace {

constexpr int kDegree = NearShares::kDegree, kPairs = NearShares::kPairs,
              kTerms = NearShares::kTerms;
// sign(t) is the sum over odd l of (2 l + 1) P_l(t) times the integral of P_l from 0 to 1: up to
// l = 7 the factors of t, t^3, t^5 and t^7.
constexpr double kSign[] = {11025.0 / 2048, -40425.0 / 2048, 63063.0 / 2048, -32175.0 / 2048};
// The hats of the nearest voxels end here.
constexpr double kEnd = 2.0;

// A polynomial in (x, y, z) whose terms are all of one degree: factor(a, b) of x^a y^b z^(rest).
struct Form {
    int degree = 0;
    std::array<double, kTerms> factors{};

    double &factor(int a, int b) {
        return factors[std::size_t(a * (degree + 1) - a * (a - 1) / 2 + b)];
    }
    // Times x^e u + y^e v + z^e w.
    Form times(const Vec3d &by, int exponent) {
        Form product{degree + exponent, {}};
        for (int a = 0; a <= degree; ++a)
            for (int b = 0; a + b <= degree; ++b) {
                product.factor(a + exponent, b) += by[0] * factor(a, b);
                product.factor(a, b + exponent) += by[1] * factor(a, b);
                product.factor(a, b) += by[2] * factor(a, b);
            }
        return product;
    }
};

// sign(omega . n) up to degree 7 as a form in n, whose length is 1.
Form sign_about(const Vec3d &omega) {
    Form sign{0, {kSign[3]}}, length{0, {1.0}};
    for (int k = 2; k >= 0; --k) {
        sign = sign.times(omega, 1).times(omega, 1);
        length = length.times({1, 1, 1}, 2);
        for (std::size_t m = 0; m < kTerms; ++m) sign.factors[m] += kSign[k] * length.factors[m];
    }
    return sign.times(omega, 1);
}

double hat(double x) {
    return std::max(0.0, 1 - std::abs(x));
}

}  // namespace

NearShares::NearShares(const double *index_to_world, const Neighbourhood &neighbourhood) {
    std::size_t count = 0;
    for (int i = 0; i <= 1; ++i)
        for (int j = i ? -1 : 0; j <= 1; ++j)
            for (int k = i || j ? -1 : 1; k <= 1; ++k) offsets[count++] = {i, j, k};

    const int p = neighbourhood.weight_p;
    const Rule across = gauss(6), along = gauss(3);
    std::array<std::array<double, kPairs>, kTerms> sums{};
    std::array<double, kPairs> totals{};
    // One ray y = u e, in a pyramid from the origin whose volume is u^2 du times `share`.
    const auto add_ray = [&](const Vec3d &e, double share) {
        double world = 0, length = 0;
        for (int row = 0; row < 3; ++row) {
            const double *m = index_to_world + 4 * row;
            const double y = m[0] * e[0] + m[1] * e[1] + m[2] * e[2];
            world += y * y;
            length += e[std::size_t(row)] * e[std::size_t(row)];
        }
        const double end = std::min(kEnd, neighbourhood.radius / std::sqrt(world));
        // Between these the hats are polynomials.
        std::array<double, 5> kinks{0, 0, 0, 0, end};
        for (std::size_t a = 0; a < 3; ++a)
            kinks[a + 1] = std::min(end, 1 / std::max(std::abs(e[a]), 0.1));
        std::sort(kinks.begin(), kinks.end());
        std::array<double, kPairs> density{};
        for (std::size_t part = 0; part + 1 < kinks.size(); ++part)
            for (int node = 0; node < along.count; ++node) {
                const double size = kinks[part + 1] - kinks[part];
                const double u = kinks[part] + size * along.x[node];
                const double weight = size * along.w[node] * std::pow(u, 2 - p);
                for (std::size_t n = 0; n < kPairs; ++n)
                    density[n] += weight * hat(u * e[0] - offsets[n][0]) *
                                  hat(u * e[1] - offsets[n][1]) * hat(u * e[2] - offsets[n][2]);
            }
        const double r = std::sqrt(length), scale = share * std::pow(world, -0.5 * p);
        const Form sign = sign_about({e[0] / r, e[1] / r, e[2] / r});
        for (std::size_t n = 0; n < kPairs; ++n) {
            totals[n] += scale * density[n];
            for (std::size_t m = 0; m < kTerms; ++m)
                sums[m][n] += scale * density[n] * sign.factors[m];
        }
    };
    // Rays through quarters of the far faces of the cells at the origin.
    for (std::size_t axis = 0; axis < 3; ++axis)
        for (int octant = 0; octant < 8; ++octant)
            for (int i = 0; i < 2 * across.count; ++i)
                for (int j = 0; j < 2 * across.count; ++j) {
                    const int a = i % across.count, b = j % across.count;
                    Vec3d e;
                    e[axis] = 1;
                    e[(axis + 1) % 3] = (i / across.count + across.x[a]) / 2;
                    e[(axis + 2) % 3] = (j / across.count + across.x[b]) / 2;
                    for (std::size_t row = 0; row < 3; ++row)
                        if (octant >> row & 1) e[row] = -e[row];
                    add_ray(e, across.w[a] * across.w[b] / 4);
                }
    for (std::size_t m = 0; m < kTerms; ++m)
        for (std::size_t n = 0; n < kPairs; ++n)
            terms[m][n] = totals[n] > 0 ? Real(sums[m][n] / totals[n]) : Real(0);
}

}  // namespace volillum
