// Occlusion of first order: sums of the medium along rays, weighted by a power of the distance.
// L_i = L [1 - scale mean_lobe int_0^R s^(2 - p) m ds dw], every ray exact but for rounding.
#include "estimator.h"

namespace volillum::exact {

namespace {

// int_0^T s^a f(s) ds of a cubic f, exactly: Gauss's two points for the weight s^a on [0, 1].
struct OriginRule {
    double power;
    std::array<double, 2> node, weight;

    explicit OriginRule(double a) : power(a) {
        // The monic polynomial x^2 + b x + c that is orthogonal to 1 and x; moments of s^a.
        const double m0 = 1.0 / (a + 1.0), m1 = 1.0 / (a + 2.0), m2 = 1.0 / (a + 3.0),
                     m3 = 1.0 / (a + 4.0);
        const double determinant = m1 * m1 - m0 * m2;
        const double b = (m0 * m3 - m1 * m2) / determinant, c = (m2 * m2 - m1 * m3) / determinant;
        const double middle = -0.5 * b, apart = std::sqrt(middle * middle - c);
        node = {middle - apart, middle + apart};
        weight[1] = (m1 - node[0] * m0) / (node[1] - node[0]);
        weight[0] = m0 - weight[1];
    }
    VOLILLUM_INLINE double of(double s) const {
        if (power == 1.0) return s;
        if (power == 0.0) return 1.0;
        return std::pow(s, power);
    }
};

// int_t0^t1 s^a m(s) ds over a piece inside `cell`, added to `sum`.
VOLILLUM_INLINE void add_piece(const Field &occluder, const OriginRule &rule, const LatticeRay &ray,
                               const Cell &cell, double t0, double t1, Vec3 &sum) {
    const auto add = [&](double t, double weight) {
        sum = sum + weight * colour_at(occluder, cell, ray.at(t));
    };
    if (t0 < 2.0 * (t1 - t0)) {
        // Near the origin, where the weight is not smooth: the difference of two integrals from it
        // of the cell's own cubic, which is at most two pieces away.
        for (const double end : {t1, t0}) {
            const double scale = (end == t1 ? 1.0 : -1.0) * end * rule.of(end);
            for (std::size_t i = 0; i < 2 && end > 0.0; ++i)
                add(rule.node[i] * end, scale * rule.weight[i]);
        }
        return;
    }
    // Gauss-Legendre, four points: exact for whole p, otherwise to 9.9^-8, because the singularity
    // is five half lengths from the middle or more.
    constexpr std::array node = {0.33998104358485626, 0.86113631159405258};
    constexpr std::array weight = {0.65214515486254614, 0.34785484513745386};
    const double middle = 0.5 * (t0 + t1), half = 0.5 * (t1 - t0);
    for (std::size_t i = 0; i < 2; ++i)
        for (const double t : {middle - node[i] * half, middle + node[i] * half})
            add(t, half * weight[i] * rule.of(t));
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 mean_occlusion(const Body &body, const OriginRule &rule,
                                                       double radius, const Vec3 &point,
                                                       std::size_t first, std::size_t count,
                                                       std::uint64_t key) {
    const RotatedLattice lattice(key);
    LatticeRay ray{body.lattice.point(point), {}};
    Frame frame(Vec3{0.0, 0.0, 1.0});
    double cos_theta = -1.0;
    if (body.outward) {
        Vec3 outward{};
        double steepest = 0.0;
        // The cell at the point: the first one of any ray from it.
        ray.direction = body.lattice.vector({1.0, 0.0, 0.0});
        walk_cells(body.bricks, ray, radius, [&](const Cell &cell, double t0, double) {
            if (t0 != 0.0) return false;
            outward = colour_at(*body.outward, cell, ray.origin);
            for (std::size_t c = 0; c < 8; ++c) {
                const Vec3 corner = {double(c & 1), double(c >> 1 & 1), double(c >> 2)};
                steepest = std::max(steepest,
                                    length(colour_at(*body.outward, cell, cell.corner + corner)));
            }
            return false;
        });
        const double norm = length(outward);
        // A voxel's centre is where rounding has put it: what it takes from the others is nothing.
        if (norm > 1e-9 * steepest) {
            frame = Frame((1.0 / norm) * outward);
            cos_theta = 0.0;
        }
    }
    Vec3 sum{};
    for (std::size_t i = first; i < first + count; ++i) {
        ray.direction = body.lattice.vector(frame.cone(cos_theta, lattice.u(i), lattice.v(i)));
        walk_cells(body.bricks, ray, radius, [&](const Cell &cell, double t0, double t1) {
            add_piece(*body.occluder, rule, ray, cell, t0, t1, sum);
            return true;
        });
    }
    return (1.0 / double(count)) * sum;
}

class Occluded final : public Estimator {
public:
    Occluded(const Body &body, const Equation &equation)
        : body_(body),
          lobes_(equation.terms.begin(), equation.terms.end()),
          rule_(2.0 - equation.weight_p),
          radius_(equation.radius),
          scale_(equation.scale) {}

    Sample estimate(const Vec3 &point, const Vec3 & /*view*/, std::size_t first, std::size_t count,
                    std::uint64_t key) const override {
        const Vec3 occlusion = mean_occlusion(body_, rule_, radius_, point, first, count, key);
        Sample sample;
        for (const Lobe &lobe : lobes_) {
            const Vec3 light = lobe.radiance(lobe.at(point).frame.z);
            for (std::size_t c = 0; c < 3; ++c)
                sample.radiance[c] += light[c] * (1.0 - scale_ * occlusion[c]);
        }
        return sample;
    }

private:
    const Body &body_;
    std::vector<Lobe> lobes_;
    OriginRule rule_;
    double radius_, scale_;
};

}  // namespace

std::unique_ptr<Estimator> occluded(const Body &body, const Equation &equation) {
    return std::make_unique<Occluded>(body, equation);
}

}  // namespace volillum::exact
