// Light that gathers the medium's colour and glow on its way: Q = B T + int T (colour sigma_s B +
// emission) ds, complete for each direction, and its split into the luminance of the axis and the
// hue of the lobe.
#include "estimator.h"

namespace volillum::exact {

namespace {

// Rec. 709, linear light.
constexpr Vec3 luminance_weights = {0.2126, 0.7152, 0.0722};
// Where less than this share of the light's luminance arrives, its hue is the light's.
constexpr double darkest_hue = 1e-6;

VOLILLUM_INLINE double luminance(const Vec3 &rgb) {
    return dot(luminance_weights, rgb);
}

struct Arrival {
    Vec3 gathered{};  // int T (colour sigma_s B + emission) ds
    Vec3 transmittance{};
};

// Piece by piece of at most one unit of optical depth, in every channel that is not opaque yet;
// four Gauss points are good to 1e-9 of a piece.
template <std::size_t Channels>
class Gathering {
public:
    VOLILLUM_INLINE Gathering(const Body &body, const Equation &equation, const Vec3 &brightness,
                              const LatticeRay &ray)
        : body_(body), equation_(equation), brightness_(brightness), ray_(ray) {}

    VOLILLUM_INLINE bool pass(const Cell &cell, double t0, double t1) {
        double begin = t0, step = t1 - t0;
        while (begin < t1 && !is_opaque<Channels>(depth_)) {
            step = std::min(step, t1 - begin);
            Depth<Channels> after = deeper(cell, begin, begin + step);
            // A piece below the rounding of its place is opaque: its own light is all that is seen.
            while (thickest(after) > 1.0 && step > 1e-14 * t1) {
                step *= 0.5;
                after = deeper(cell, begin, begin + step);
            }
            gather(cell, begin, begin + step);
            depth_ = after;
            begin += step;
            step *= 2.0;
        }
        return !is_opaque<Channels>(depth_);
    }
    VOLILLUM_INLINE Arrival arrival() const {
        Arrival result{gathered_, {}};
        for (std::size_t c = 0; c < 3; ++c)
            result.transmittance[c] = std::exp(-depth_[channel_of<Channels>(c)]);
        return result;
    }

private:
    VOLILLUM_INLINE Depth<Channels> deeper(const Cell &cell, double t0, double t1) const {
        Depth<Channels> result;
        for (std::size_t c = 0; c < Channels; ++c)
            result[c] = depth_[c] + cell_depth<Channels>(body_.sigma_t, ray_, cell, t0, t1, c);
        return result;
    }
    VOLILLUM_INLINE double thickest(const Depth<Channels> &after) const {
        double gain = 0.0;
        for (std::size_t c = 0; c < Channels; ++c)
            if (depth_[c] <= opaque_depth) gain = std::max(gain, after[c] - depth_[c]);
        return gain;
    }
    VOLILLUM_INLINE void gather(const Cell &cell, double t0, double t1) {
        constexpr std::array node = {0.33998104358485626, 0.86113631159405258};
        constexpr std::array weight = {0.65214515486254614, 0.34785484513745386};
        const double middle = 0.5 * (t0 + t1), half = 0.5 * (t1 - t0);
        for (std::size_t i = 0; i < 2; ++i)
            for (const double t : {middle - node[i] * half, middle + node[i] * half}) {
                const Vec3 q = ray_.at(t);
                Vec3 source{};
                if (equation_.colour != 0.0) {
                    source = equation_.colour * colour_at(*body_.sigma_s, cell, q);
                    for (std::size_t c = 0; c < 3; ++c) source[c] *= brightness_[c];
                }
                if (equation_.gathers_emission && body_.emission)
                    source = source + colour_at(*body_.emission, cell, q);
                const Depth<Channels> here = deeper(cell, t0, t);
                for (std::size_t c = 0; c < 3; ++c)
                    gathered_[c] +=
                        half * weight[i] * source[c] * std::exp(-here[channel_of<Channels>(c)]);
            }
    }

    const Body &body_;
    const Equation &equation_;
    const Vec3 brightness_;
    const LatticeRay &ray_;
    Depth<Channels> depth_{};
    Vec3 gathered_{};
};

template <std::size_t Channels>
VOLILLUM_INLINE Vec3 radiance_along(const Body &body, const Equation &equation,
                                    const Vec3 &brightness, const Vec3 &point,
                                    const Vec3 &direction, double reach) {
    const LatticeRay ray = body.ray(point, direction);
    Gathering<Channels> gathering(body, equation, brightness, ray);
    walk_cells(
        body.bricks, ray, std::min(equation.radius, reach),
        [&](const Cell &cell, double t0, double t1) { return gathering.pass(cell, t0, t1); });
    const Arrival arrival = gathering.arrival();
    Vec3 result = arrival.gathered;
    for (std::size_t c = 0; c < 3; ++c) result[c] += brightness[c] * arrival.transmittance[c];
    return result;
}

template <std::size_t Channels>
VOLILLUM_INLINE Vec3 coloured_lobe(const Body &body, const Equation &equation, const Lobe &lobe,
                                   const Vec3 &point, std::size_t first, std::size_t count,
                                   std::uint64_t key) {
    const RotatedLattice lattice(key);
    const LobeAt at = lobe.at(point);
    const Vec3 brightness = lobe.falloff(at) * lobe.radiance(at.frame.z);
    const double bright = luminance(brightness);
    if (equation.split && !(bright > 0.0)) return {};
    const std::size_t samples = lobe.samples(count);
    Vec3 mean{};
    for (std::size_t i = first; i < first + samples; ++i) {
        const Vec3 direction = lobe.direction(at, lattice.u(i), lattice.v(i), equation.beta);
        Vec3 q = radiance_along<Channels>(body, equation, brightness, point, direction,
                                          lobe.reach(at, direction));
        if (equation.split) {
            const double total = luminance(q);
            q = total < darkest_hue * bright ? (1.0 / bright) * brightness : (1.0 / total) * q;
        }
        mean = mean + q;
    }
    mean = (1.0 / double(samples)) * mean;
    if (!equation.split) return mean;
    const Vec3 &axis = at.frame.z;
    const Depth<Channels> depth = body.depth<Channels>(
        body.ray(point, axis), std::min(equation.radius, lobe.reach(at, axis)), opaque_depth);
    Vec3 direct;
    for (std::size_t c = 0; c < 3; ++c)
        direct[c] = brightness[c] * std::exp(-depth[channel_of<Channels>(c)]);
    return luminance(direct) * mean;
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 coloured_grey(const Body &body, const Equation &equation,
                                                      const Lobe &lobe, const Vec3 &point,
                                                      std::size_t first, std::size_t count,
                                                      std::uint64_t key) {
    return coloured_lobe<1>(body, equation, lobe, point, first, count, key);
}

[[gnu::flatten]] VOLILLUM_DISPATCH Vec3 coloured_rgb(const Body &body, const Equation &equation,
                                                     const Lobe &lobe, const Vec3 &point,
                                                     std::size_t first, std::size_t count,
                                                     std::uint64_t key) {
    return coloured_lobe<3>(body, equation, lobe, point, first, count, key);
}

class Coloured final : public Estimator {
public:
    Coloured(const Body &body, const Equation &equation)
        : body_(body),
          equation_(equation),
          lobes_(equation.terms.begin(), equation.terms.end()),
          coloured_(body.sigma_t.channels() == 1 ? coloured_grey : coloured_rgb) {}

    Sample estimate(const Vec3 &point, const Vec3 & /*view*/, std::size_t first, std::size_t count,
                    std::uint64_t key) const override {
        Sample sum;
        for (std::size_t term = 0; term < lobes_.size(); ++term)
            sum.radiance = sum.radiance + coloured_(body_, equation_, lobes_[term], point, first,
                                                    count, hash(key, term));
        return sum;
    }

private:
    const Body &body_;
    const Equation &equation_;
    std::vector<Lobe> lobes_;
    decltype(&coloured_grey) coloured_;
};

}  // namespace

std::unique_ptr<Estimator> coloured(const Body &body, const Equation &equation) {
    return std::make_unique<Coloured>(body, equation);
}

}  // namespace volillum::exact
