// Light that arrives unscattered: exact depths along rays of the lobes.
#include "estimator.h"

namespace volillum::exact {

namespace {

template <std::size_t Channels>
VOLILLUM_INLINE Vec3 gather_lobe(const Body &body, const Lobe &lobe, double radius,
                                 const Vec3 &point, std::size_t first, std::size_t count,
                                 std::uint64_t key) {
    LatticeRay ray{body.lattice.point(point), {}};
    const RotatedLattice lattice(key);
    const LobeAt at = lobe.at(point);
    const std::size_t samples = lobe.samples(count);
    Vec3 mean{};
    for (std::size_t i = first; i < first + samples; ++i) {
        const Vec3 direction = lobe.direction(at, lattice.u(i), lattice.v(i));
        ray.direction = body.lattice.vector(direction);
        const Depth<Channels> depth =
            body.depth<Channels>(ray, std::min(radius, lobe.reach(at, direction)), opaque_depth);
        const Vec3 radiance = lobe.radiance(direction);
        Depth<Channels> transmittance;
        for (std::size_t c = 0; c < Channels; ++c) transmittance[c] = std::exp(-depth[c]);
        for (std::size_t c = 0; c < 3; ++c)
            mean[c] += radiance[c] * transmittance[channel_of<Channels>(c)];
    }
    return (lobe.falloff(at) / double(samples)) * mean;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 gather_grey(const Body &body, const Lobe &lobe,
                                                    double radius, const Vec3 &point,
                                                    std::size_t first, std::size_t count,
                                                    std::uint64_t key) {
    return gather_lobe<1>(body, lobe, radius, point, first, count, key);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 gather_rgb(const Body &body, const Lobe &lobe,
                                                   double radius, const Vec3 &point,
                                                   std::size_t first, std::size_t count,
                                                   std::uint64_t key) {
    return gather_lobe<3>(body, lobe, radius, point, first, count, key);
}

class Gather final : public Estimator {
public:
    Gather(const Body &body, const Equation &equation)
        : body_(body),
          lobes_(equation.terms.begin(), equation.terms.end()),
          radius_(equation.radius),
          gather_(body.sigma_t.channels() == 1 ? gather_grey : gather_rgb) {}

    Sample estimate(const Vec3 &point, const Vec3 & /*view*/, std::size_t first, std::size_t count,
                    std::uint64_t key) const override {
        Sample sample;
        for (std::size_t term = 0; term < lobes_.size(); ++term)
            sample.radiance = sample.radiance + gather_(body_, lobes_[term], radius_, point, first,
                                                        count, hash(key, term));
        return sample;
    }

private:
    const Body &body_;
    std::vector<Lobe> lobes_;
    double radius_;
    decltype(&gather_grey) gather_;
};

}  // namespace

std::unique_ptr<Estimator> gather(const Body &body, const Equation &equation) {
    return std::make_unique<Gather>(body, equation);
}

}  // namespace volillum::exact
