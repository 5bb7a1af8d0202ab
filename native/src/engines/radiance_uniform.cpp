// The mean hue in a medium of one colour: the optical-depth sweep, whose sums are of hues.
#include "sweep_weights.h"
#include "volillum/exp_negative.h"
#include "volillum/radiance_sweep.h"

namespace volillum {
namespace sweep_detail {
namespace {

// Rec. 709, linear light; and where the light's hue stands for a direction's own, as in mean_hue.
constexpr Real kLuminance[3] = {Real(0.2126), Real(0.7152), Real(0.0722)};
constexpr Real kDark = Real(1e-6);

struct Colour {
    Real hue[3], extinction[3], source[3], contrast[3];  // contrast: hue - source
    bool grey;                                           // one extinction for all colours
};

// The optical depths of some directions along a row of voxels.
struct Depths {
    const Real *values;
    std::ptrdiff_t stride;  // from direction to direction
    const int *directions;
    int count;
};

// sums[c] = sum_d weights[d] gamma_c(L) at a pack of voxels.
template <bool grey, class Pack>
VOLILLUM_INLINE void mean_of_hues(const Depths &depths, int at, const Colour &colour,
                                  const Real *weights, Pack *sums) {
    for (int c = 0; c < 3; ++c) sums[c] = Pack{};
    for (int d = 0; d < depths.count; ++d) {
        const Pack depth = pack<Pack>(depths.values + d * depths.stride + at);
        const Real weight = weights[depths.directions[d]];
        Pack light[3], through, luminance{};
        for (int c = 0; c < 3; ++c) {
            if (c == 0 || !grey) {
                through = colour.extinction[c] * depth;
                exp_negative(through);
            }
            light[c] = colour.source[c] + colour.contrast[c] * through;
            luminance += kLuminance[c] * light[c];
        }
        const Pack scale = weight / (luminance >= kDark ? luminance : Pack{} + 1);
        for (int c = 0; c < 3; ++c)
            sums[c] += luminance >= kDark ? scale * light[c] : Pack{} + weight * colour.hue[c];
    }
}

template <bool grey>
void add_row(const Depths &depths, const Colour &colour, const Real *weights, int count, bool add,
             Real *out, std::ptrdiff_t out_stride) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int i = 0; i < count; i += lanes_of<Pack>) {
            Pack sums[3];
            mean_of_hues<grey>(depths, i, colour, weights, sums);
            for (int c = 0; c < 3; ++c) {
                Real *to = out + c * out_stride + i;
                if (count - i >= lanes_of<Pack>) {
                    if (add) sums[c] += pack<Pack>(to);
                    pack<Pack>(to) = sums[c];
                } else {
                    for (int k = 0; k < count - i; ++k)
                        to[k] = add ? to[k] + sums[c][k] : sums[c][k];
                }
            }
        }
    });
}

// Not linear in a direction's value, but a sum over directions all the same.
class HueWeights : public Weights {
public:
    HueWeights(const Real *weights, const UniformColour &colour) : weights_(weights) {
        for (std::size_t c = 0; c < 3; ++c) {
            colour_.hue[c] = Real(colour.hue[c]);
            colour_.extinction[c] = Real(colour.extinction[c]);
            colour_.source[c] = Real(colour.source_function[c]);
            // Of the rounded ones: hue T + source (1 - T) is then nowhere negative.
            colour_.contrast[c] = colour_.hue[c] - colour_.source[c];
        }
        colour_.grey = colour_.extinction[1] == colour_.extinction[0] &&
                       colour_.extinction[2] == colour_.extinction[0];
    }
    int channels() const override { return 3; }
    bool any(int direction, const Frame &, const Box &) const override {
        return weights_[direction] != 0;
    }
    const Real *single(int) const override { return nullptr; }
    void sum(const Batch &batch, const Range &, Reals &, const Rows &out) const override {
        const auto add = colour_.grey ? add_row<true> : add_row<false>;
        batch.tile.for_rows(batch.frame, [&](int t, int b) {
            add({batch.values.at(t, b), batch.values.channel_pitch, batch.directions.data(),
                 int(batch.directions.size())},
                colour_, weights_, batch.tile.columns.size(), out.add, out.at(t, b),
                out.channel_pitch);
        });
    }

private:
    const Real *weights_;
    Colour colour_;
};

}  // namespace
}  // namespace sweep_detail

void mean_hue_uniform(const SweepScene &scene, const UniformColour &colour, const Real *weights,
                      const SweepSettings &settings, Real *out) {
    SweepSettings depths = settings;
    depths.quantity = Quantity::optical_depth;
    sweep_detail::sweep_with(scene, sweep_detail::HueWeights(weights, colour), depths, out);
}

}  // namespace volillum
