#include "radiance_march.h"

#include <algorithm>
#include <cmath>

#include "volillum/pack.h"

namespace volillum::radiance_detail {
namespace {

// What a step adds, int q(t) exp(-od(t)) dt with linear q and sigma_t, is integrated by Gauss's
// four points up to where od reaches kOpaque: e^-8 = 3e-4 of what an opaque step adds is left out,
// and a hard surface shows the medium's colour where the ray meets it and not the step's mean.
constexpr Real kOpaque = 8;
constexpr int kPoints = 4;
constexpr Real kNodes[kPoints] = {Real(0.0694318442029737), Real(0.3300094782075719),
                                  Real(0.6699905217924281), Real(0.9305681557970263)};
constexpr Real kWeights[kPoints] = {Real(0.1739274225687269), Real(0.3260725774312731),
                                    Real(0.3260725774312731), Real(0.1739274225687269)};
// Rec. 709, linear light.
constexpr Real kRed = Real(0.2126), kGreen = Real(0.7152), kBlue = Real(0.0722);
// A direction whose luminance is below this share of the light's has no hue of its own.
constexpr Real kDark = Real(1e-6);

// How much of the far radiance, the near and the far source arrives through a step.
struct Shares {
    Real radiance, near, far;
};

VOLILLUM_INLINE Shares shares(Real near, Real far, Real length) {
    const Real linear = length * near, bend = Real(0.5) * length * (far - near);
    const Real depth = linear + bend;
    const Real root = std::sqrt(std::max(Real(0), linear * linear + 4 * kOpaque * bend));
    const Real opaque = 2 * kOpaque / std::max(linear + root, Real(1e-6));
    const Real reach = depth > kOpaque ? std::min(opaque, Real(1)) : Real(1);
    Real all = 0, beyond = 0;
    for (int i = 0; i < kPoints; ++i) {
        const Real t = reach * kNodes[i];
        const Real weight = reach * kWeights[i] * exp_negative(t * (linear + t * bend));
        all += weight;
        beyond += weight * t;
    }
    return {exp_negative(depth), length * (all - beyond), length * beyond};
}

// One extinction for three colours: the shares of a vector of rays first, in arrays of their own.
// Next to three stores to the radiance, which may overlap for all that is known of their distance,
// they would not be vector code.
void step_grey(const Step &rays, Real *radiance) {
    in_packs([r = rays, radiance]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        alignas(64) Real through[kLanes], near[kLanes], far[kLanes];
        for (int c = 0; c < r.columns; c += kLanes) {
            for (int i = 0; i < kLanes; ++i) {
                const Shares share = shares(r.near[c + i], r.far[c + i], r.length);
                through[i] = share.radiance;
                near[i] = share.near;
                far[i] = share.far;
            }
            for (int colour = 0; colour < 3; ++colour)
                for (int i = 0; i < kLanes; i += lanes_of<Pack>) {
                    const std::ptrdiff_t source = (1 + colour) * r.stride + c + i;
                    auto &light = pack<Pack>(radiance + colour * r.stride + c + i);
                    light = light * pack<Pack>(through + i) +
                            pack<Pack>(near + i) * pack<Pack>(r.near + source) +
                            pack<Pack>(far + i) * pack<Pack>(r.far + source);
                }
        }
    });
}

VOLILLUM_DISPATCH void step_colour(const Step &rays, Real *radiance) {
    const std::ptrdiff_t stride = rays.stride;
    const Real *__restrict near = rays.near;
    const Real *__restrict far = rays.far;
    Real *__restrict light = radiance;
    const Real length = rays.length;
    const int columns = round_up(rays.columns);
    for (int k = 0; k < 3; ++k)
        for (int c = 0; c < columns; ++c) {
            const std::ptrdiff_t here = k * stride + c, source = here + 3 * stride;
            const Shares share = shares(near[here], far[here], length);
            light[here] =
                light[here] * share.radiance + share.near * near[source] + share.far * far[source];
        }
}

}  // namespace

void take_sample(const RowSample &sample, int channels, int columns, std::ptrdiff_t stride,
                 Real *result) {
    in_packs([=, &sample]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int k = 0; k < channels; ++k)
            for (int c = 0; c < columns; c += lanes_of<Pack>) {
                Pack sum{};
                for (int i = 0; i < sample.count; ++i)
                    sum += sample.weights[i] * pack<Pack>(sample.rows[i] + k * sample.pitch + c);
                pack<Pack>(result + k * stride + c) = sum;
            }
    });
}

void step(const Step &rays, Real *radiance) {
    if (rays.extinction_channels == 1)
        step_grey(rays, radiance);
    else
        step_colour(rays, radiance);
}

void unshear(const Real *above, const Real *here, std::ptrdiff_t lattice_stride,
             const Crossing &crossing, int columns, std::ptrdiff_t stride, Real *radiance) {
    const Real f = crossing.row_fraction, g = crossing.column_fraction;
    const Real w00 = f * g, w01 = f * (1 - g), w10 = (1 - f) * g, w11 = (1 - f) * (1 - g);
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int k = 0; k < 3; ++k)
            for (int c = 0; c < columns; c += lanes_of<Pack>) {
                const Real *p = above + k * lattice_stride + c, *q = here + k * lattice_stride + c;
                pack<Pack>(radiance + k * stride + c) =
                    w00 * pack<Pack>(p) + w01 * pack<Pack>(p + 1) + w10 * pack<Pack>(q) +
                    w11 * pack<Pack>(q + 1);
            }
    });
}

VOLILLUM_DISPATCH void add_hue(const Real *radiance, std::ptrdiff_t stride, int columns,
                               const Real *hue, const Real *weights, Real *out,
                               std::ptrdiff_t out_stride) {
    const Real *__restrict red = radiance;
    const Real *__restrict green = radiance + stride;
    const Real *__restrict blue = radiance + 2 * stride;
    Real *__restrict out_red = out;
    Real *__restrict out_green = out + out_stride;
    Real *__restrict out_blue = out + 2 * out_stride;
    const Real *__restrict weight = weights;
    const Real hue_red = hue[0], hue_green = hue[1], hue_blue = hue[2];
    for (int c = 0; c < columns; ++c) {
        const Real luminance = kRed * red[c] + kGreen * green[c] + kBlue * blue[c];
        const bool dark = !(luminance >= kDark);
        const Real scale = weight[c] / (dark ? Real(1) : luminance);
        out_red[c] += scale * (dark ? hue_red : red[c]);
        out_green[c] += scale * (dark ? hue_green : green[c]);
        out_blue[c] += scale * (dark ? hue_blue : blue[c]);
    }
}

}  // namespace volillum::radiance_detail
