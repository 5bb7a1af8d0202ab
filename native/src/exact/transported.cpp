// Full scattering: random walks from the point, with the lights sought at every vertex.
//
// Suns and images are sought and also met by rays that leave the medium, lamps are sought at
// collisions and also at points of the ray that are spread evenly in the angle at which the lamp
// sees them (Kulla and Fajardo 2012), which takes away the singularity at the lamp. Either pair is
// weighted by the balance heuristic (Veach 1997).
#include "estimator.h"
#include "flight.h"
#include "lights.h"

namespace volillum::exact {

namespace {

constexpr double pi = std::numbers::pi;

// Henyey and Greenstein's phase function about the direction of flight.
struct Phase {
    double g;

    // Of light that arrives from the outward direction w and leaves toward v.
    VOLILLUM_INLINE double value(const Vec3 &w, const Vec3 &v) const {
        const double base = 1.0 + g * g + 2.0 * g * dot(w, v);
        return (1.0 - g * g) / (4.0 * pi * base * std::sqrt(base));
    }
    // An outward direction with just this density.
    VOLILLUM_INLINE Vec3 sample(const Vec3 &v, double xi, double eta) const {
        // 1 - cos of the angle of deflection, inverted without cancellation for small g:
        // q = (1 - g^2) / (1 - g + 2 g xi), cos = (1 + g^2 - q^2) / (2 g).
        const double d = 1.0 - g + 2.0 * g * xi;
        const double rise = 2.0 * (1.0 - g) * (1.0 - xi) / d;  // (q - (1 - g)) / g
        const double drop = rise * (1.0 - g + 0.5 * g * rise);
        return Frame(-1.0 * v).about(std::clamp(drop, 0.0, 2.0), eta);
    }
};

struct World {
    const Body &body;
    const Equation &equation;
    std::vector<LightSource> lights;
    std::vector<std::size_t> sought;
    std::vector<double> cumulative, chance;  // of `sought`

    World(const Body &b, const Equation &e)
        : body(b), equation(e), lights(e.lights.begin(), e.lights.end()) {
        double sum = 0.0;
        for (std::size_t i = 0; i < lights.size(); ++i)
            if (lights[i].is_sought()) {
                sought.push_back(i);
                cumulative.push_back(sum += lights[i].share());
            }
        for (std::size_t k = 0; k < sought.size(); ++k) {
            cumulative[k] /= sum;
            chance.push_back(lights[sought[k]].share() / sum);
        }
    }
};

template <std::size_t Channels>
class Walk {
public:
    VOLILLUM_INLINE Walk(const World &world, std::size_t channel, Random random)
        : world_(world),
          body_(world.body),
          channel_(channel),
          random_(random),
          phase_{world.equation.g} {}

    // One estimate; adds the weight of a walk that is given up.
    VOLILLUM_INLINE Vec3 run(Vec3 point, Vec3 view, double u, double v, double w,
                             double &neglected) {
        Vec3 sum{}, weight{1.0, 1.0, 1.0};
        double target = -std::log1p(-w);
        for (std::size_t k = 0; k < world_.sought.size(); ++k)  // at the point itself, all
            sum = sum + direct(k, lamp_point(k), point, view, 1.0);
        for (int collisions = 0; collisions < most_collisions; ++collisions) {
            const Vec3 direction = phase_.sample(view, u, v);
            const double density = phase_.value(direction, view);
            view = -1.0 * direction;
            const LatticeRay ray = body_.ray(point, direction);
            // The light that the next vertex seeks.
            const std::size_t chosen = choose();
            const double chance = chosen < world_.sought.size() ? world_.chance[chosen] : 0.0;
            const Vec3 lamp = lamp_point(chosen);
            const bool spread = is_lamp(chosen);
            const Equiangular angles =
                spread ? equiangular(ray, point, direction, lamp) : Equiangular{};
            if (spread)
                sum = sum + times(weight, (1.0 / chance) * lit_on_the_way(angles, ray, point,
                                                                          direction, chosen, lamp));
            Vec3 glow{};
            const Collision collision =
                fly<Channels>(body_, ray, std::numeric_limits<double>::infinity(), target, channel_,
                              [&](const Cell &cell, double t0, double t1) {
                                  if (glows()) glow = glow + mean_emission(ray, cell, t0, t1);
                              });
            sum = sum + times(weight, glow);
            if (!collision.happened)
                return sum + times(weight, met(direction, density, collisions == 0));
            const double sigma = sigma_t_at<Channels>(body_, ray, collision, channel_);
            if (!(sigma > 0.0)) return sum;
            weight = times(weight,
                           (1.0 / sigma) * sigma_s_at<Channels>(body_, ray, collision, channel_));
            if (!(largest(weight) > 0.0)) return sum;
            point = point + collision.t * direction;
            if (chance > 0.0) {
                const double by_collision = sigma * std::exp(-collision.depth);
                const double share =
                    spread ? by_collision / (by_collision + angles.density(collision.t)) : 1.0;
                sum = sum +
                      times(weight, (share / chance) * direct(chosen, lamp, point, view, chance));
            }
            if (!survives(weight, random_)) return sum;
            u = random_.next();
            v = random_.next();
            target = random_.exponential();
        }
        neglected += largest(weight);
        return sum;
    }

private:
    // Distances along a ray, uniform in the angle about a lamp that is `height` off the ray.
    struct Equiangular {
        double nearest = 0.0, height = 1.0, low = 0.0, span = 0.0;

        VOLILLUM_INLINE double at(double xi) const {
            return nearest + height * std::tan(low + xi * span);
        }
        VOLILLUM_INLINE double density(double t) const {
            const double off = t - nearest;
            return span > 0.0 ? height / (span * (height * height + off * off)) : 0.0;
        }
    };

    VOLILLUM_INLINE bool glows() const {
        return world_.equation.gathers_emission && body_.emission.has_value();
    }
    VOLILLUM_INLINE std::size_t choose() {
        const auto &cumulative = world_.cumulative;
        if (cumulative.size() < 2) return 0;
        const double xi = random_.next();
        std::size_t k = 0;
        while (k + 1 < cumulative.size() && cumulative[k] <= xi) ++k;
        return k;
    }
    VOLILLUM_INLINE bool is_lamp(std::size_t k) const {
        return k < world_.sought.size() && world_.lights[world_.sought[k]].is_lamp();
    }
    VOLILLUM_INLINE Vec3 lamp_point(std::size_t k) {
        return is_lamp(k) ? world_.lights[world_.sought[k]].lamp_point(random_) : Vec3{};
    }
    // Emission along the piece, times its length.
    VOLILLUM_INLINE Vec3 mean_emission(const LatticeRay &ray, const Cell &cell, double t0,
                                       double t1) const {
        const Field &emission = *body_.emission;
        if (emission.channels() == 3) {
            Vec3 rgb;
            for (std::size_t c = 0; c < 3; ++c)
                rgb[c] = cell_depth<3>(emission, ray, cell, t0, t1, c);
            return rgb;
        }
        const double grey = cell_depth<1>(emission, ray, cell, t0, t1, 0);
        return {grey, grey, grey};
    }
    VOLILLUM_INLINE double transmittance(const Vec3 &point, const Vec3 &direction,
                                         double distance) const {
        const Collision end =
            fly<Channels>(body_, body_.ray(point, direction), distance, opaque_depth, channel_,
                          [](const Cell &, double, double) {});
        return end.happened ? 0.0 : std::exp(-end.depth);
    }
    // Light of the k-th sought light that scatters once at `point` toward `view`; `chance` is how
    // often it is sought.
    VOLILLUM_INLINE Vec3 direct(std::size_t k, const Vec3 &lamp, const Vec3 &point,
                                const Vec3 &view, double chance) {
        const LightSource &light = world_.lights[world_.sought[k]];
        const LightSample sample =
            light.is_lamp() ? light.lamp(point, lamp) : light.sample_distant(random_);
        if (!(largest(sample.fluence) > 0.0)) return {};
        const double phase = phase_.value(sample.direction, view);
        const double share = sample.density > 0.0
                                 ? chance * sample.density / (chance * sample.density + phase)
                                 : 1.0;
        return (phase * share * transmittance(point, sample.direction, sample.distance)) *
               sample.fluence;
    }
    // Light that a ray meets outside; all lights were sought at the first point.
    VOLILLUM_INLINE Vec3 met(const Vec3 &direction, double phase, bool first) const {
        Vec3 sum{};
        for (std::size_t i = 0, k = 0; i < world_.lights.size(); ++i) {
            double density = 0.0;
            const Vec3 radiance = world_.lights[i].radiance(direction, density);
            const bool sought = k < world_.sought.size() && world_.sought[k] == i;
            const double other = sought ? (first ? 1.0 : world_.chance[k]) * density : 0.0;
            sum = sum + (phase / (phase + other)) * radiance;
            if (sought) ++k;
        }
        return sum;
    }
    VOLILLUM_INLINE Equiangular equiangular(const LatticeRay &ray, const Vec3 &point,
                                            const Vec3 &direction, const Vec3 &lamp) const {
        double begin = 0.0, end = std::numeric_limits<double>::infinity();
        for (std::size_t a = 0; a < 3; ++a) {
            const double extent = double(body_.bricks.shape()[a] + 1);
            if (ray.direction[a] == 0.0) {
                if (!(ray.origin[a] > 0.0 && ray.origin[a] < extent)) return {};
                continue;
            }
            const double low = -ray.origin[a] / ray.direction[a],
                         high = (extent - ray.origin[a]) / ray.direction[a];
            begin = std::max(begin, std::min(low, high));
            end = std::min(end, std::max(low, high));
        }
        if (!(begin < end)) return {};
        Equiangular result;
        const Vec3 toward = lamp - point;
        result.nearest = dot(toward, direction);
        // A ray through the lamp itself has no angle; as near as rounding it is as good as any.
        result.height = std::max(length(toward - result.nearest * direction), 1e-9 * (end - begin));
        result.low = std::atan((begin - result.nearest) / result.height);
        result.span = std::atan((end - result.nearest) / result.height) - result.low;
        return result;
    }
    // A lamp's light that scatters once on the ray, at a point chosen by angle.
    VOLILLUM_INLINE Vec3 lit_on_the_way(const Equiangular &angles, const LatticeRay &ray,
                                        const Vec3 &point, const Vec3 &direction,
                                        std::size_t chosen, const Vec3 &lamp) {
        if (!(angles.span > 0.0)) return {};
        const double t = angles.at(random_.next());
        const Collision here = fly<Channels>(body_, ray, t, opaque_depth, channel_,
                                             [](const Cell &, double, double) {});
        // Void at the point, or nothing of it is seen.
        if (here.happened || !(here.t >= t)) return {};
        const double through = std::exp(-here.depth);
        const double by_collision = through * sigma_t_at<Channels>(body_, ray, here, channel_);
        const Vec3 scattering = sigma_s_at<Channels>(body_, ray, here, channel_);
        if (!(largest(scattering) > 0.0)) return {};
        return times((through / (by_collision + angles.density(t))) * scattering,
                     direct(chosen, lamp, point + t * direction, -1.0 * direction, 1.0));
    }

    const World &world_;
    const Body &body_;
    std::size_t channel_;
    Random random_;
    Phase phase_;
};

template <std::size_t Channels>
VOLILLUM_INLINE Sample transport(const World &world, const Vec3 &point, const Vec3 &view,
                                 std::size_t first, std::size_t count, std::uint64_t key) {
    const RotatedLattice lattice(hash(key, 0));
    Sample sample;
    for (std::size_t i = first; i < first + count; ++i)
        // Where colours differ in extinction each walks by itself.
        for (std::size_t channel = 0; channel < Channels; ++channel) {
            Walk<Channels> walk(world, channel, Random{hash(key, 1 + 3 * i + channel)});
            const Vec3 found =
                walk.run(point, view, lattice.u(i), lattice.v(i), lattice.w(i), sample.neglected);
            for (std::size_t c = 0; c < 3; ++c)
                if (channel_of<Channels>(c) == channel) sample.radiance[c] += found[c];
        }
    sample.radiance = (1.0 / double(count)) * sample.radiance;
    sample.neglected /= double(count * Channels);
    return sample;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Sample transport_grey(const World &world, const Vec3 &point,
                                                         const Vec3 &view, std::size_t first,
                                                         std::size_t count, std::uint64_t key) {
    return transport<1>(world, point, view, first, count, key);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Sample transport_rgb(const World &world, const Vec3 &point,
                                                        const Vec3 &view, std::size_t first,
                                                        std::size_t count, std::uint64_t key) {
    return transport<3>(world, point, view, first, count, key);
}

class Transported final : public Estimator {
public:
    Transported(const Body &body, const Equation &equation)
        : world_(body, equation),
          transport_(body.sigma_t.channels() == 1 ? transport_grey : transport_rgb) {}

    Sample estimate(const Vec3 &point, const Vec3 &view, std::size_t first, std::size_t count,
                    std::uint64_t key) const override {
        return transport_(world_, point, view, first, count, key);
    }

private:
    World world_;
    decltype(&transport_grey) transport_;
};

}  // namespace

std::unique_ptr<Estimator> transported(const Body &body, const Equation &equation) {
    return std::make_unique<Transported>(body, equation);
}

}  // namespace volillum::exact
