// One photon's life: birth, collisions, scattering, roulette.
#pragma once

#include "photon_hand_over.h"
#include "photon_write.h"

namespace volillum {

// Below this share of its first weight a photon plays roulette for that share. 1 is analogue: a
// photon keeps its weight and is absorbed with probability 1 - albedo, which has the shortest
// paths.
constexpr float kRouletteShare = 1.0f;

// Vectors of photons in flight at a time: while one waits for its voxels the others go on.
constexpr int kVectors = 4;

constexpr double kTallyUnit = 0x1p32;

template <int Colours, bool Chromatic, int Moments>
class Tracer {
public:
    VOLILLUM_INLINE Tracer(const TraceContext &context, TraceResult &result)
        : context_(context),
          field_(*context.field),
          result_(result),
          hand_over_(context, result.waiting) {}

    // Photons [first, last) of the pass.
    VOLILLUM_INLINE void trace(std::uint64_t first, std::uint64_t last) {
        Vector vectors[kVectors];
        for (Vector &some : vectors)
            for (int l = 0; l < Flights::width; ++l)
                some.live |= std::uint32_t(start(some, l, first, last)) << l;
        bool alive = true;
        while (alive) {
            alive = false;
            // Albedos are asked for before any is needed.
            std::uint32_t events[kVectors];
            for (int v = 0; v < kVectors; ++v) {
                Vector &some = vectors[v];
                some.flights.read(field_);
                events[v] = some.flights.events(!Chromatic && !context_.points) & some.live;
                for (std::uint32_t bits = events[v]; bits; bits &= bits - 1)
                    __builtin_prefetch(field_.sigma_s +
                                       some.flights.voxel(field_, std::countr_zero(bits)));
            }
            for (int v = 0; v < kVectors; ++v) {
                Vector &some = vectors[v];
                for (std::uint32_t bits = events[v]; bits; bits &= bits - 1) {
                    const int l = std::countr_zero(bits);
                    if (!go_on(some, l) && !start(some, l, first, last)) some.live &= ~(1u << l);
                }
                if (!some.live) continue;
                some.flights.fly(field_);
                alive = true;
            }
            if (result_.waiting.deposits.size() >= kMostWaiting || !alive)
                write_deposits<Colours, Moments>(context_, result_);
        }
    }

private:
    using Vector = PhotonVector<Colours>;
    using Lane = PhotonLane<Colours>;
    using Photon = typename Lane::Photon;

    // The next photon that meets the grid; false when none is left.
    VOLILLUM_INLINE bool start(Vector &vector, int at, std::uint64_t &first, std::uint64_t last) {
        while (first < last) {
            Lane lane(vector, at, Random(context_.key, first++));
            Photon &photon = lane.photon;
            Birth birth;
            const bool enters = context_.emitter->emit(lane.random, birth);
            float full = 0.0f;
            for (int c = 0; c < Colours; ++c) {
                photon.weight[c] = birth.weight[c];
                full = std::max(full, birth.weight[c]);
                result_.tally.emitted[c] += fixed(birth.weight[c]);
                if (!enters) result_.tally.missed[c] += fixed(birth.weight[c]);
            }
            if (!enters) continue;
            photon.full = full;
            photon.scatterings = 0;
            photon.deposits = context_.unscattered;
            if constexpr (Chromatic) {
                photon.hero = std::min(int(3.0f * unit_of(lane.random.next())), 2);
                for (float &density : photon.density) density = 1.0f;
            }
            for (int a = 0; a < 3; ++a) {
                const float q = float(birth.position[a]);
                lane.flights.q[a][at] = q;
                lane.flights.cell[a][at] =
                    std::min(std::max(int(q) / PhotonField::block, 0), field_.blocks[a] - 1);
                photon.direction[a] = birth.direction[a];
            }
            lane.flights.depth[at] = exponential(lane.random.next());
            lane.flights.state[at] = Flights::flying;
            take_off(lane);
            return true;
        }
        return false;
    }

    // A flight begins at q.
    VOLILLUM_INLINE void take_off(Lane &lane) {
        Photon &photon = lane.photon;
        float largest = 0.0f;
        for (int a = 0; a < 3; ++a) {
            const float *row = context_.inverse[a];
            const float step = row[0] * photon.direction[0] + row[1] * photon.direction[1] +
                               row[2] * photon.direction[2];
            photon.flight.step[a] = step;
            largest = std::max(largest, std::abs(step));
        }
        // A flight is never quite parallel to a plane: it would need cases of its own.
        const float least = 1e-8f * largest;
        for (int a = 0; a < 3; ++a) {
            float &step = photon.flight.step[a];
            if (std::abs(step) < least) step = step < 0.0f ? -least : least;
            photon.flight.inverse[a] = 1.0f / step;
            lane.flights.step[a][lane.at] = step;
            lane.flights.inverse[a][lane.at] = photon.flight.inverse[a];
        }
        begin_here(lane);
    }

    VOLILLUM_INLINE void begin_here(Lane &lane) {
        for (int a = 0; a < 3; ++a) lane.photon.flight.start[a] = lane.flights.q[a][lane.at];
        lane.flights.travelled[lane.at] = 0.0f;
    }

    // What happened to a lane; false when the photon ends there.
    VOLILLUM_INLINE bool go_on(Vector &vector, int at) {
        Lane lane(vector, at);
        switch (lane.flights.state[at]) {
            case Flights::possible:
                return arrive(lane);
            case Flights::outside:
                escape(lane);
                return false;
            default:
                return walk(lane);
        }
    }

    VOLILLUM_INLINE void escape(const Lane &lane) {
        for (int a = 0; a < 3; ++a) {
            const int cell = lane.flights.cell[a][lane.at];
            if (cell >= 0 && cell < field_.blocks[a]) continue;
            const auto face = std::size_t(2 * a + (cell < 0 ? 0 : 1));
            for (int c = 0; c < Colours; ++c)
                result_.tally.escaped[face][c] += fixed(lane.photon.weight[c]);
        }
        hand_over_.track(lane, std::numeric_limits<float>::infinity());
    }

    // A possible collision: the medium there is the voxel that stands for it.
    VOLILLUM_INLINE bool arrive(Lane &lane) {
        const int at = lane.at;
        float sigma_t[3] = {0.0f, 0.0f, 0.0f}, sigma_s[3] = {0.0f, 0.0f, 0.0f};
        if (lane.flights.matter[at]) {
            sigma_t[0] = lane.flights.value[at];
            const std::size_t voxel = lane.flights.voxel(field_, at);
            for (std::size_t c = 1; c < (Chromatic ? 3u : 1u); ++c)
                sigma_t[c] = field_.sigma_t[c * field_.voxels + voxel];
            for (std::size_t c = 0; c < Colours; ++c)
                sigma_s[c] =
                    field_.sigma_s[(field_.channels_s == 3 ? c * field_.voxels : 0) + voxel];
        }
        hand_over_.ball(lane);
        return collide(lane, sigma_t, sigma_s);
    }

    // Through macrocells where the medium is so dense and uneven that cells are walked one by one.
    [[gnu::noinline]] bool walk(Lane &lane) {
        Flights &flights = lane.flights;
        const int at = lane.at;
        constexpr int block = PhotonField::block;
        flights.state[at] = Flights::flying;
        for (;;) {
            int cell[3];
            float q[3], plane[3], exit[3];
            const float *step = lane.photon.flight.step, *inverse = lane.photon.flight.inverse;
            for (int a = 0; a < 3; ++a) {
                cell[a] = flights.cell[a][at];
                q[a] = flights.q[a][at];
                plane[a] = float(block * (cell[a] + (step[a] > 0.0f ? 1 : 0)));
                exit[a] = (plane[a] - q[a]) * inverse[a];
            }
            if (!field_.is_dense(field_.majorants[std::size_t(
                    (cell[0] * field_.blocks[1] + cell[1]) * field_.blocks[2] + cell[2])]))
                return true;
            const int axis =
                exit[0] < exit[1] ? (exit[0] < exit[2] ? 0 : 2) : (exit[1] < exit[2] ? 1 : 2);
            const float far = std::max(exit[axis], 0.0f);
            float way = far;
            float depth = flights.depth[at], majorant = 0.0f;
            const bool possible = field_.walk_dense(q, step, inverse, far, depth, way, majorant);
            flights.depth[at] = depth;
            flights.majorant[at] = majorant;
            flights.travelled[at] += way;
            for (int a = 0; a < 3; ++a) flights.q[a][at] += way * step[a];
            if (possible) {
                float sigma_t[3], sigma_s[3];
                for (int a = 0; a < 3; ++a) q[a] = flights.q[a][at];
                field_.interpolate(q, sigma_t, sigma_s);
                flights.accept[at] = unit_of(lane.random.next());
                flights.depth[at] = exponential(lane.random.next());
                hand_over_.ball(lane);
                if (!collide(lane, sigma_t, sigma_s)) return false;
                continue;
            }
            flights.q[axis][at] = plane[axis];
            const int next = cell[axis] + (step[axis] > 0.0f ? 1 : -1);
            flights.cell[axis][at] = next;
            if (next < 0 || next >= field_.blocks[axis]) {
                escape(lane);
                return false;
            }
        }
    }

    // What happens at the possible collision; false when the photon ends there.
    VOLILLUM_INLINE bool collide(Lane &lane, const float *sigma_t, const float *sigma_s) {
        if constexpr (Chromatic) return collide_chromatic(lane, sigma_t, sigma_s);
        const int at = lane.at;
        if (!(lane.flights.accept[at] * lane.flights.majorant[at] < sigma_t[0])) return true;
        hand_over_.track(lane, lane.flights.travelled[at]);
        Photon &photon = lane.photon;
        float before[Colours];
        for (int c = 0; c < Colours; ++c) {
            before[c] = photon.weight[c];
            photon.weight[c] *= std::min(sigma_s[c] / sigma_t[0], 1.0f);
            result_.tally.absorbed[c] += fixed(before[c]) - fixed(photon.weight[c]);
        }
        return scatter(lane);
    }

    // Spectral multiple importance sampling: one channel, the hero, decides; the weight of each is
    // its own path's measure over the mean density of all three channels. Majorants are shared, so
    // flights between possible collisions have one density, and a weight never passes 3.
    VOLILLUM_INLINE bool collide_chromatic(Lane &lane, const float *sigma_t, const float *sigma_s) {
        Photon &photon = lane.photon;
        const float over = 1.0f / lane.flights.majorant[lane.at];
        float chance[3];
        for (std::size_t c = 0; c < 3; ++c) chance[c] = std::min(sigma_t[c] * over, 1.0f);
        const bool real = lane.flights.accept[lane.at] < chance[photon.hero];
        // The weights of the flight so far end here, also where the collision is null.
        hand_over_.track(lane, lane.flights.travelled[lane.at]);
        float mean = 0.0f, measure[3];
        for (std::size_t c = 0; c < 3; ++c) {
            const float null = 1.0f - chance[c];
            measure[c] = null;
            if (real) measure[c] = std::min(sigma_s[c] * over, chance[c]);
            photon.density[c] *= real ? chance[c] : null;
            mean += photon.density[c] * (1.0f / 3.0f);
        }
        for (std::size_t c = 0; c < 3; ++c) {
            const float before = photon.weight[c], density = photon.density[c] / mean;
            const float weight = before * (measure[c] / mean);
            // Real collisions absorb; the rest is the exchange between channels.
            const float share = real && chance[c] > 0.0f ? measure[c] / chance[c] : 1.0f;
            const float arrived = share > 0.0f ? weight / share : before;
            photon.density[c] = density;
            photon.weight[c] = weight;
            result_.tally.absorbed[c] += fixed(arrived) - fixed(weight);
            result_.tally.roulette[c] += fixed(before) - fixed(arrived);
        }
        if (real) return scatter(lane);
        begin_here(lane);
        return true;
    }

    VOLILLUM_INLINE bool scatter(Lane &lane) {
        ++result_.tally.scatterings;
        Photon &photon = lane.photon;
        if (++photon.scatterings > kMostScatterings) {
            for (int c = 0; c < Colours; ++c) result_.tally.given_up[c] += fixed(photon.weight[c]);
            ++result_.tally.endless;
            return false;
        }
        float most = 0.0f;
        for (int c = 0; c < Colours; ++c) most = std::max(most, photon.weight[c]);
        const float level = kRouletteShare * photon.full;
        if (most < level) {
            const bool dies = !(unit_of(lane.random.next()) * level < most);
            const float gain = dies ? 0.0f : level / most;
            for (int c = 0; c < Colours; ++c) {
                const float before = photon.weight[c];
                photon.weight[c] *= gain;
                result_.tally.roulette[c] += fixed(before) - fixed(photon.weight[c]);
            }
            if (dies) return false;
        }
        const float first = unit_of(lane.random.next()), second = unit_of(lane.random.next());
        if (field_.g == 0.0f)
            uniform_direction(photon.direction, first, second);
        else
            turn_direction(photon.direction, henyey_greenstein_cosine(field_.g, first), second);
        take_off(lane);
        photon.deposits = true;
        return true;
    }

    static VOLILLUM_INLINE std::int64_t fixed(float weight) {
        return std::int64_t(double(weight) * kTallyUnit);
    }

    const TraceContext &context_;
    const PhotonField &field_;
    TraceResult &result_;
    HandOver<Colours> hand_over_;
};

}  // namespace volillum
