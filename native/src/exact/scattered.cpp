// Light scattered any number of times into one lobe that stays where it is: random walks toward
// the light. V(x) = (1 / Omega) int_lobe [T + int T sigma_s V ds] dw, L_i = B V.
#include "estimator.h"
#include "flight.h"

namespace volillum::exact {

namespace {

// Sample `i` of V by its colours, of extinction channel `channel`.
template <std::size_t Channels>
VOLILLUM_INLINE Vec3 walk(const Body &body, const Lobe &lobe, Vec3 point, std::size_t channel,
                          const RotatedLattice &lattice, std::size_t i, Random random,
                          double &neglected) {
    Vec3 weight{1.0, 1.0, 1.0};
    double u = lattice.u(i), v = lattice.v(i), target = -std::log1p(-lattice.w(i));
    for (int collisions = 0; collisions < most_collisions; ++collisions) {
        const LobeAt at = lobe.at(point);
        const Vec3 direction = lobe.direction(at, u, v);
        const LatticeRay ray = body.ray(point, direction);
        const Collision collision = fly<Channels>(body, ray, lobe.reach(at, direction), target,
                                                  channel, [](const Cell &, double, double) {});
        if (!collision.happened) return weight;
        const Vec3 albedo = albedo_at<Channels>(body, ray, collision, channel);
        for (std::size_t c = 0; c < 3; ++c) weight[c] *= albedo[c];
        if (!survives(weight, random)) return {};
        point = point + collision.t * direction;
        u = random.next();
        v = random.next();
        target = random.exponential();
    }
    neglected += largest(weight);
    return {};
}

template <std::size_t Channels>
VOLILLUM_INLINE Sample scatter_lobe(const Body &body, const Lobe &lobe, const Vec3 &point,
                                    std::size_t first, std::size_t count, std::uint64_t key) {
    const RotatedLattice lattice(hash(key, 0));
    Sample sample;
    for (std::size_t i = first; i < first + count; ++i) {
        // Where colours differ in extinction each walks by itself.
        for (std::size_t channel = 0; channel < Channels; ++channel) {
            const Vec3 weight =
                walk<Channels>(body, lobe, point, channel, lattice, i,
                               Random{hash(key, 1 + 3 * i + channel)}, sample.neglected);
            for (std::size_t c = 0; c < 3; ++c)
                if (channel_of<Channels>(c) == channel) sample.radiance[c] += weight[c];
        }
    }
    const LobeAt at = lobe.at(point);
    const Vec3 brightness = (lobe.falloff(at) / double(count)) * lobe.radiance(at.frame.z);
    for (std::size_t c = 0; c < 3; ++c) sample.radiance[c] *= brightness[c];
    sample.neglected /= double(count * Channels);
    return sample;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Sample scatter_grey(const Body &body, const Lobe &lobe,
                                                       const Vec3 &point, std::size_t first,
                                                       std::size_t count, std::uint64_t key) {
    return scatter_lobe<1>(body, lobe, point, first, count, key);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Sample scatter_rgb(const Body &body, const Lobe &lobe,
                                                      const Vec3 &point, std::size_t first,
                                                      std::size_t count, std::uint64_t key) {
    return scatter_lobe<3>(body, lobe, point, first, count, key);
}

class Scattered final : public Estimator {
public:
    Scattered(const Body &body, const Equation &equation)
        : body_(body),
          lobes_(equation.terms.begin(), equation.terms.end()),
          scatter_(body.sigma_t.channels() == 1 ? scatter_grey : scatter_rgb) {}

    Sample estimate(const Vec3 &point, const Vec3 & /*view*/, std::size_t first, std::size_t count,
                    std::uint64_t key) const override {
        Sample sum;
        for (std::size_t term = 0; term < lobes_.size(); ++term) {
            const Sample one = scatter_(body_, lobes_[term], point, first, count, hash(key, term));
            sum.radiance = sum.radiance + one.radiance;
            sum.neglected = std::max(sum.neglected, one.neglected);
        }
        return sum;
    }

private:
    const Body &body_;
    std::vector<Lobe> lobes_;
    decltype(&scatter_grey) scatter_;
};

}  // namespace

std::unique_ptr<Estimator> scattered(const Body &body, const Equation &equation) {
    return std::make_unique<Scattered>(body, equation);
}

}  // namespace volillum::exact
