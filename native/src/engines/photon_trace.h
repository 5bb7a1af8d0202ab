// One photon's life: delta tracking, scattering, roulette.
#pragma once

#include "photon_deposit.h"

namespace volillum {

struct TraceContext {
    const PhotonField *field;
    const PhotonGeometry *geometry;
    const PhotonEmitter *emitter;
    std::uint64_t key;    // of this pass's random streams
    bool unscattered;     // also the first flight is deposited
    float inverse[3][3];  // world to index, linear part
};

struct TraceResult {
    Deposits *deposits;
    PhotonTally tally;
};

// Below this share of its first weight a photon plays roulette for that share. 1 is analogue: a
// photon keeps its weight and is absorbed with probability 1 - albedo, which has the shortest
// paths.
constexpr float kRouletteShare = 1.0f;

// Photons in flight at a time: while one waits for its voxel the others go on.
constexpr int kFlights = 8;

constexpr double kTallyUnit = 0x1p32;

template <int Colours, bool Chromatic, int Moments>
class Tracer {
public:
    VOLILLUM_INLINE Tracer(const TraceContext &context, TraceResult &result)
        : context_(context), field_(*context.field), result_(result) {
        scale_ = Deposits::unit / float(context.geometry->voxel_diagonal);
    }

    // Photons [first, last) of the pass.
    VOLILLUM_INLINE void trace(std::uint64_t first, std::uint64_t last) {
        Lane lanes[kFlights];
        int alive = 0;
        for (int k = 0; k < kFlights; ++k) {
            lanes[alive].alive = start(lanes[alive], first, last);
            if (lanes[alive].alive) ++alive;
        }
        while (alive > 0)
            for (int k = 0; k < alive;) {
                Lane &lane = lanes[k];
                if ((collide(lane) && advance(lane)) || start(lane, first, last))
                    ++k;
                else
                    lane = lanes[--alive];
            }
    }

private:
    struct Lane {
        Random random;
        Flight flight;
        float q[3], direction[3];
        float travelled;  // since flight.start, world units
        float majorant, accept;
        float weight[Colours], density[3];  // density: path densities of the channels, mean 1
        float full;                         // what roulette restores
        std::size_t corner;
        int cell[3];
        int hero;
        bool outside, interpolated, deposits, alive;
    };

    // The next photon that meets a macrocell with matter; false when none is left.
    VOLILLUM_INLINE bool start(Lane &lane, std::uint64_t &first, std::uint64_t last) {
        while (first < last) {
            lane.random = Random(context_.key, first++);
            Birth birth;
            const bool enters = context_.emitter->emit(lane.random, birth);
            float full = 0.0f;
            for (int c = 0; c < Colours; ++c) {
                lane.weight[c] = birth.weight[c];
                full = std::max(full, birth.weight[c]);
                result_.tally.emitted[c] += fixed(birth.weight[c]);
                if (!enters) result_.tally.missed[c] += fixed(birth.weight[c]);
            }
            if (!enters) continue;
            lane.full = full;
            lane.deposits = context_.unscattered;
            if constexpr (Chromatic) {
                lane.hero = std::min(int(3.0f * high_unit(lane.random.next())), 2);
                for (float &density : lane.density) density = 1.0f;
            }
            for (int a = 0; a < 3; ++a) {
                lane.q[a] = float(birth.position[a]);
                lane.direction[a] = birth.direction[a];
                lane.cell[a] = std::min(std::max(int(lane.q[a]) / PhotonField::block, 0),
                                        field_.blocks[a] - 1);
            }
            take_off(lane);
            if (advance(lane)) return true;
        }
        return false;
    }

    // A flight begins at q.
    VOLILLUM_INLINE void take_off(Lane &lane) {
        float largest = 0.0f;
        for (int a = 0; a < 3; ++a) {
            const float *row = context_.inverse[a];
            const float step = row[0] * lane.direction[0] + row[1] * lane.direction[1] +
                               row[2] * lane.direction[2];
            lane.flight.step[a] = step;
            largest = std::max(largest, std::abs(step));
        }
        // A flight is never quite parallel to a plane: it would need cases of its own.
        const float least = 1e-8f * largest;
        for (int a = 0; a < 3; ++a) {
            float &step = lane.flight.step[a];
            if (std::abs(step) < least) step = step < 0.0f ? -least : least;
            lane.flight.inverse[a] = 1.0f / step;
            lane.flight.start[a] = lane.q[a];
        }
        lane.travelled = 0.0f;
    }

    // Flies to the next possible collision; false when the photon has left.
    VOLILLUM_INLINE bool advance(Lane &lane) {
        const std::uint64_t word = lane.random.next();
        float depth = exponential(std::uint32_t(word >> 32));
        lane.accept = low_unit(word);
        constexpr float block = float(PhotonField::block);
        for (;;) {
            const float majorant = field_.majorants[std::size_t(
                (lane.cell[0] * field_.blocks[1] + lane.cell[1]) * field_.blocks[2] +
                lane.cell[2])];
            float plane[3], exit[3];
            for (int a = 0; a < 3; ++a) {
                const bool up = lane.flight.step[a] > 0.0f;
                plane[a] = block * float(lane.cell[a] + (up ? 1 : 0));
                exit[a] = (plane[a] - lane.q[a]) * lane.flight.inverse[a];
            }
            const int axis =
                exit[0] < exit[1] ? (exit[0] < exit[2] ? 0 : 2) : (exit[1] < exit[2] ? 1 : 2);
            const float far = std::max(exit[axis], 0.0f);
            lane.interpolated = field_.is_dense(majorant);
            if (lane.interpolated) {
                float way;
                if (field_.walk_dense(lane.q, lane.flight.step, lane.flight.inverse, far, depth,
                                      way, lane.majorant)) {
                    lane.travelled += way;
                    for (int a = 0; a < 3; ++a) lane.q[a] += way * lane.flight.step[a];
                    return true;
                }
            } else if (depth < majorant * far) {
                const float way = depth / majorant;
                lane.travelled += way;
                for (int a = 0; a < 3; ++a) lane.q[a] += way * lane.flight.step[a];
                lane.majorant = majorant;
                look_ahead(lane);
                return true;
            }
            if (!lane.interpolated) depth -= majorant * far;
            lane.travelled += far;
            for (int a = 0; a < 3; ++a) lane.q[a] += far * lane.flight.step[a];
            lane.q[axis] = plane[axis];
            const bool up = lane.flight.step[axis] > 0.0f;
            lane.cell[axis] += up ? 1 : -1;
            if (lane.cell[axis] < 0 || lane.cell[axis] >= field_.blocks[axis]) {
                for (int c = 0; c < Colours; ++c)
                    result_.tally.escaped[std::size_t(2 * axis + (up ? 1 : 0))][c] +=
                        fixed(lane.weight[c]);
                deposit(lane, std::numeric_limits<float>::infinity());
                return false;
            }
        }
    }

    // Chooses the corner whose value stands for the interpolated one, and asks for its memory.
    VOLILLUM_INLINE void look_ahead(Lane &lane) {
        const std::uint64_t word = lane.random.next();
        constexpr std::uint64_t mask = (1u << 21) - 1;
        lane.corner = 0;
        lane.outside = false;
        for (int a = 0; a < 3; ++a) {
            const float jitter = float((word >> (21 * a)) & mask) * 0x1p-21f;
            // Inside the macrocell's corners, whatever rounding did to q: its majorant holds there.
            const int low = lane.cell[a] * PhotonField::block;
            const int corner =
                std::min(std::max(int(lane.q[a] + jitter), low), low + PhotonField::block) - 1;
            lane.outside = lane.outside || corner < 0 || corner >= field_.shape[a];
            lane.corner += std::size_t(corner) * (a == 0   ? field_.stride[0]
                                                  : a == 1 ? field_.stride[1]
                                                           : 1);
        }
        if (!lane.outside) __builtin_prefetch(field_.sigma_t + lane.corner);
    }

    // The medium at the possible collision: the corner that stands for it, or where cells were
    // walked the interpolated value.
    VOLILLUM_INLINE void look_up(const Lane &lane, float *sigma_t, float *sigma_s) const {
        if (lane.interpolated) {
            field_.interpolate(lane.q, sigma_t, sigma_s);
            return;
        }
        constexpr std::size_t colours_t = Chromatic ? 3 : 1;
        if (lane.outside) {
            for (std::size_t c = 0; c < 3; ++c) sigma_t[c] = sigma_s[c] = 0.0f;
            return;
        }
        for (std::size_t c = 0; c < colours_t; ++c)
            sigma_t[c] = field_.sigma_t[c * field_.voxels + lane.corner];
        // Not looked up where the collision turns out null anyway.
        if (!Chromatic && !(lane.accept * lane.majorant < sigma_t[0])) return;
        for (std::size_t c = 0; c < Colours; ++c)
            sigma_s[c] =
                field_.sigma_s[(field_.channels_s == 3 ? c * field_.voxels : 0) + lane.corner];
    }

    // What happens at the possible collision; false when the photon ends there.
    VOLILLUM_INLINE bool collide(Lane &lane) {
        float sigma_t[3], sigma_s[3];
        look_up(lane, sigma_t, sigma_s);
        if constexpr (Chromatic) return collide_chromatic(lane, sigma_t, sigma_s);
        if (!(lane.accept * lane.majorant < sigma_t[0])) return true;
        deposit(lane, lane.travelled);
        float before[Colours];
        for (int c = 0; c < Colours; ++c) {
            before[c] = lane.weight[c];
            lane.weight[c] *= std::min(sigma_s[c] / sigma_t[0], 1.0f);
            result_.tally.absorbed[c] += fixed(before[c]) - fixed(lane.weight[c]);
        }
        return scatter(lane);
    }

    // Spectral multiple importance sampling: one channel, the hero, decides; the weight of each is
    // its own path's measure over the mean density of all three channels. Majorants are shared, so
    // flights between possible collisions have one density, and a weight never passes 3.
    VOLILLUM_INLINE bool collide_chromatic(Lane &lane, const float *sigma_t, const float *sigma_s) {
        const float over = 1.0f / lane.majorant;
        float chance[3];
        for (std::size_t c = 0; c < 3; ++c) chance[c] = std::min(sigma_t[c] * over, 1.0f);
        const bool real = lane.accept < chance[lane.hero];
        // The weights of the flight so far end here, also where the collision is null.
        deposit(lane, lane.travelled);
        float mean = 0.0f, measure[3];
        for (std::size_t c = 0; c < 3; ++c) {
            const float null = 1.0f - chance[c];
            measure[c] = null;
            if (real) measure[c] = std::min(sigma_s[c] * over, chance[c]);
            lane.density[c] *= real ? chance[c] : null;
            mean += lane.density[c] * (1.0f / 3.0f);
        }
        for (std::size_t c = 0; c < 3; ++c) {
            const float before = lane.weight[c], density = lane.density[c] / mean;
            const float weight = before * (measure[c] / mean);
            // Real collisions absorb; the rest is the exchange between channels.
            const float share = real && chance[c] > 0.0f ? measure[c] / chance[c] : 1.0f;
            const float arrived = share > 0.0f ? weight / share : before;
            lane.density[c] = density;
            lane.weight[c] = weight;
            result_.tally.absorbed[c] += fixed(arrived) - fixed(weight);
            result_.tally.roulette[c] += fixed(before) - fixed(arrived);
        }
        if (real) return scatter(lane);
        for (int a = 0; a < 3; ++a) lane.flight.start[a] = lane.q[a];
        lane.travelled = 0.0f;
        return true;
    }

    VOLILLUM_INLINE bool scatter(Lane &lane) {
        ++result_.tally.scatterings;
        float most = 0.0f;
        for (int c = 0; c < Colours; ++c) most = std::max(most, lane.weight[c]);
        const float level = kRouletteShare * lane.full;
        if (most < level) {
            const bool dies = !(high_unit(lane.random.next()) * level < most);
            const float gain = dies ? 0.0f : level / most;
            for (int c = 0; c < Colours; ++c) {
                const float before = lane.weight[c];
                lane.weight[c] *= gain;
                result_.tally.roulette[c] += fixed(before) - fixed(lane.weight[c]);
            }
            if (dies) return false;
        }
        const std::uint64_t word = lane.random.next();
        if (field_.g == 0.0f)
            uniform_direction(lane.direction, high_unit(word), low_unit(word));
        else
            turn_direction(lane.direction, henyey_greenstein_cosine(field_.g, high_unit(word)),
                           low_unit(word));
        take_off(lane);
        lane.deposits = true;
        return true;
    }

    VOLILLUM_INLINE void deposit(const Lane &lane, float end) {
        if (!lane.deposits) return;
        float values[Moments * Colours];
        for (int c = 0; c < Colours; ++c) values[c] = scale_ * lane.weight[c];
        if constexpr (Moments > 1) {
            float basis[Moments];
            // Toward the source: against the flight.
            harmonics(-lane.direction[0], -lane.direction[1], -lane.direction[2], basis);
            for (int m = Moments - 1; m >= 0; --m)
                for (int c = 0; c < Colours; ++c)
                    values[m * Colours + c] = basis[m] * (scale_ * lane.weight[c]);
        }
        Deposits &deposits = *result_.deposits;
        walk_boxes(field_, lane.flight, end, [&](std::size_t voxel, float length) {
            const std::size_t index = voxel * (Moments * Colours);
            for (std::size_t i = 0; i < Moments * Colours; ++i)
                deposits.add(index + i, values[i] * length);
        });
    }

    // sqrt(4 pi) Y_lm for l <= 2, in the order and signs of core/harmonics.py: the first is 1.
    static VOLILLUM_INLINE void harmonics(float x, float y, float z, float *out) {
        constexpr float a = 1.7320508075688772f, b = 3.872983346207417f, c = 1.118033988749895f;
        out[0] = 1.0f;
        out[1] = a * y;
        out[2] = a * z;
        out[3] = a * x;
        out[4] = b * x * y;
        out[5] = b * y * z;
        out[6] = c * (3.0f * z * z - 1.0f);
        out[7] = b * x * z;
        out[8] = 0.5f * b * (x * x - y * y);
    }

    static VOLILLUM_INLINE std::int64_t fixed(float weight) {
        return std::int64_t(double(weight) * kTallyUnit);
    }

    const TraceContext &context_;
    const PhotonField &field_;
    TraceResult &result_;
    float scale_;
};

}  // namespace volillum
