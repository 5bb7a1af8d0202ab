// A thread's deposits on their way into the voxels that all threads share.
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
    bool tracks, points;  // what is deposited: track lengths, or possible collisions in balls
    Ball ball;
    float ball_scale;  // a deposit's units of weight 1 at majorant 1
    Deposits *deposits;
    float sign;  // -1 takes back
};

// Deposits that a thread collects: 128 kB.
constexpr std::size_t kMostWaiting = 2048;

struct TraceResult {
    Waiting waiting;
    PhotonTally tally;
    std::size_t first_slab;  // threads begin to write at different slabs
};

// What a deposit brings to each higher moment and colour, [8][colours].
template <int Colours>
VOLILLUM_INLINE void weigh_higher(const Deposit &some, Floats *higher) {
    float basis[1 + Deposits::higher], values[Deposits::higher * Colours];
    // Toward the source: against the flight.
    harmonics(-some.direction[0], -some.direction[1], -some.direction[2], basis);
    for (int m = 0; m < Deposits::higher; ++m)
        for (int c = 0; c < Colours; ++c)
            values[m * Colours + c] =
                basis[1 + m] * (some.weight[c] * (Deposits::higher_unit / Deposits::unit));
    std::memcpy(higher, values, sizeof values);
}

// Writes what of a deposit lies in a slab.
template <int Colours, int Moments>
VOLILLUM_INLINE void write_deposit(const TraceContext &context, const Deposit &some,
                                   Deposits::Slab &slab) {
    [[maybe_unused]] Floats higher[Colours];
    if constexpr (Moments > 1) weigh_higher<Colours>(some, higher);
    std::int32_t *const values = context.deposits->values(), *const higher_sums =
                                                                 context.deposits->higher_sums();
    float weight[Colours];
    std::copy_n(some.weight, Colours, weight);
    const auto add = [&](std::size_t voxel, float scale, float dither) {
        for (int c = 0; c < Colours; ++c)
            Deposits::add(values, slab, voxel * Colours + std::size_t(c),
                          weight[c] * scale + dither);
        if constexpr (Moments > 1) {
            const std::size_t row = voxel * std::size_t(Deposits::higher * Colours);
            Deposits::add_higher<Colours>(higher_sums + row, slab, row, higher, scale, dither);
        }
    };
    const SlabBox bounds(context.field->shape, context.deposits->axis(), slab);
    if (context.points)
        context.ball.visit(*context.field, bounds, some.flight.start,
                           [&](std::size_t voxel) { add(voxel, 1.0f, some.end); });
    else
        walk_boxes(*context.field, bounds, some.flight, some.end,
                   [&](std::size_t voxel, float length) { add(voxel, length, 0.0f); });
}

// Writes what waits, slab by slab.
template <int Colours, int Moments>
VOLILLUM_INLINE void write_deposits(const TraceContext &context, TraceResult &result) {
    Waiting &waiting = result.waiting;
    const std::size_t slabs = waiting.of_slab.size();
    for (std::size_t n = 0; n < slabs; ++n) {
        const std::size_t number = (result.first_slab + n) % slabs;
        if (waiting.of_slab[number].empty()) continue;
        Deposits::Slab &slab = context.deposits->slab(number);
        const std::lock_guard<std::mutex> lock(slab.busy);
        for (const std::uint32_t which : waiting.of_slab[number])
            write_deposit<Colours, Moments>(context, waiting.deposits[which], slab);
        waiting.of_slab[number].clear();
    }
    waiting.deposits.clear();
}

}  // namespace volillum
