#include "volillum/photons.h"

#include <algorithm>
#include <stdexcept>

#include "photon_trace.h"
#include "volillum/affine.h"
#include "volillum/pages.h"
#include "volillum/parallel.h"

namespace volillum {

namespace {

// Photons of one work item, and voxels of one when passes are added up.
constexpr std::size_t kBatch = 2048, kChunk = 1 << 16;

using TraceFunction = void (*)(const TraceContext &, TraceResult &, std::uint64_t, std::uint64_t);

[[gnu::flatten]] VOLILLUM_DISPATCH void trace_grey(const TraceContext &context, TraceResult &result,
                                                   std::uint64_t first, std::uint64_t last) {
    Tracer<1, false, 1>(context, result).trace(first, last);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void trace_coloured(const TraceContext &context,
                                                       TraceResult &result, std::uint64_t first,
                                                       std::uint64_t last) {
    Tracer<3, false, 1>(context, result).trace(first, last);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void trace_chromatic(const TraceContext &context,
                                                        TraceResult &result, std::uint64_t first,
                                                        std::uint64_t last) {
    Tracer<3, true, 1>(context, result).trace(first, last);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void trace_grey_moments(const TraceContext &context,
                                                           TraceResult &result, std::uint64_t first,
                                                           std::uint64_t last) {
    Tracer<1, false, 9>(context, result).trace(first, last);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void trace_coloured_moments(const TraceContext &context,
                                                               TraceResult &result,
                                                               std::uint64_t first,
                                                               std::uint64_t last) {
    Tracer<3, false, 9>(context, result).trace(first, last);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void trace_chromatic_moments(const TraceContext &context,
                                                                TraceResult &result,
                                                                std::uint64_t first,
                                                                std::uint64_t last) {
    Tracer<3, true, 9>(context, result).trace(first, last);
}

void add(PhotonTally::Each &to, const PhotonTally::Each &from) {
    for (std::size_t c = 0; c < to.size(); ++c) to[c] += from[c];
}

void add(PhotonTally &to, const PhotonTally &from) {
    add(to.emitted, from.emitted);
    add(to.missed, from.missed);
    add(to.absorbed, from.absorbed);
    add(to.roulette, from.roulette);
    add(to.given_up, from.given_up);
    for (std::size_t face = 0; face < 6; ++face) add(to.escaped[face], from.escaped[face]);
    to.scatterings += from.scatterings;
    to.endless += from.endless;
}

// Adds the deposits of a pass to the sums, which hold `passes` already, and empties them. Not
// cancelled half way. Squared deviations from the mean are updated as by Welford (1962): they lose
// nothing to cancellation, so that float32 is enough, as it is for sums of up to a million passes,
// each of which is an exact integer first. The higher moments are there already, but for their
// overflows.
void fold(Deposits &deposits, std::size_t size, std::uint64_t passes, int threads,
          const PhotonSums &result) {
    const double before = double(passes), share = before / (before + 1.0);
    std::vector<Deposits::Spill> spilled;
    for (std::size_t i = 0; i < deposits.slab_count(); ++i) {
        const Deposits::Slab &slab = deposits.slab(i);
        spilled.insert(spilled.end(), slab.spilled.begin(), slab.spilled.end());
        for (const auto &[index, wraps] : slab.higher_spilled) result.wraps[index] += wraps;
    }
    deposits.forget_spills();
    std::sort(spilled.begin(), spilled.end());
    const auto chunks = (size + kChunk - 1) / kChunk;
    parallel_for(chunks, threads, nullptr, [&](std::size_t chunk, int) {
        const std::size_t from = chunk * kChunk, to = std::min(from + kChunk, size);
        auto carry =
            std::lower_bound(spilled.begin(), spilled.end(), Deposits::Spill(from, INT32_MIN));
        for (std::size_t i = from; i < to; ++i) {
            std::int64_t sum = deposits.values()[i];
            deposits.values()[i] = 0;
            for (; carry != spilled.end() && carry->first == i; ++carry)
                sum += std::int64_t(carry->second) * (std::int64_t(1) << 32);
            float &total = result.sums[i];
            if (sum == 0 && total == 0.0f) continue;
            if (passes > 0) {
                const double off = double(sum) - double(total) / before;
                result.deviations[i] += float(off * off * share);
            }
            total = float(double(total) + double(sum));
        }
    });
}

}  // namespace

struct PhotonTracer::Impl {
    PhotonGeometry geometry;
    PhotonField field;
    float inverse[3][3];
    Deposits deposits;  // zeros between passes

    Impl(const double *index_to_world, const Size3 &shape, const PhotonMedium &medium, double floor)
        : geometry(index_to_world, shape), field(geometry, medium, float(floor)) {
        const Matrix3 linear = inverse_linear(index_to_world);
        for (std::size_t row = 0; row < 3; ++row)
            for (std::size_t column = 0; column < 3; ++column)
                inverse[row][column] = float(linear[row][column]);
    }

    void set_kernel(double radius, TraceContext &context) const {
        const double volume = 4.0 / 3.0 * M_PI * radius * radius * radius;
        context.ball_scale = float(double(Deposits::unit) / geometry.voxel_diagonal *
                                   geometry.voxel_volume / volume);
        Ball &ball = context.ball;
        ball.radius2 = float(radius * radius);
        for (std::size_t a = 0; a < 3; ++a) {
            ball.reach[a] = float(radius) * std::hypot(inverse[a][0], inverse[a][1], inverse[a][2]);
            for (std::size_t c = 0; c < 3; ++c) ball.columns[a][c] = float(geometry.columns[a][c]);
        }
    }

    // Light that is deposited before it meets matter must cross the whole lattice.
    Box box(bool unscattered) const {
        Box whole;
        for (std::size_t a = 0; a < 3; ++a) {
            whole.low[a] = 0.0;
            whole.high[a] = double(geometry.shape[a]) + 1.0;
        }
        return unscattered || field.empty ? whole : field.box;
    }

    TraceFunction function(std::size_t colours, std::size_t moments) const {
        const bool chromatic = field.channels_t == 3, many = moments > 1;
        if (chromatic) return many ? trace_chromatic_moments : trace_chromatic;
        if (colours == 3) return many ? trace_coloured_moments : trace_coloured;
        return many ? trace_grey_moments : trace_grey;
    }
};

PhotonTracer::PhotonTracer(const double *index_to_world, const Size3 &shape,
                           const PhotonMedium &medium, double least_majorant)
    : impl_(std::make_unique<Impl>(index_to_world, shape, medium, least_majorant)) {}
PhotonTracer::~PhotonTracer() {
    impl_.reset();
    trim_malloc();
}

std::size_t PhotonTracer::colours(const PhotonSource &source) const {
    const PhotonField &field = impl_->field;
    return field.channels_t == 3 || field.channels_s == 3 || source.coloured() ? 3 : 1;
}

double PhotonTracer::power_unit(const PhotonSource &source, bool unscattered) const {
    return PhotonEmitter(source, impl_->geometry, impl_->box(unscattered)).power / kTallyUnit;
}

double PhotonTracer::deposit_unit(const PhotonSource &source, bool unscattered) const {
    const PhotonGeometry &geometry = impl_->geometry;
    return PhotonEmitter(source, geometry, impl_->box(unscattered)).power *
           geometry.voxel_diagonal / (double(Deposits::unit) * 4.0 * M_PI * geometry.voxel_volume);
}

PhotonTally PhotonTracer::run(const PhotonSource &source, const PhotonRun &run,
                              const PhotonSums &result) {
    if (run.pass == 0) trim_malloc();  // of the sweeps of unscattered light
    const PhotonField &field = impl_->field;
    const PhotonEmitter emitter(source, impl_->geometry, impl_->box(run.unscattered));
    const std::size_t each = colours(source);
    const std::size_t batches = (run.photons + kBatch - 1) / kBatch;
    const TraceFunction trace = impl_->function(each, result.higher ? 9 : 1);
    const std::size_t workers =
        std::min<std::size_t>(std::size_t(thread_count(run.threads)), batches);

    Deposits &deposits = impl_->deposits;
    deposits.begin(field.shape, field.voxels * each, result.higher);
    TraceContext context{&field,
                         &impl_->geometry,
                         &emitter,
                         Random::mix(Random::mix(run.seed) + run.pass),
                         run.unscattered,
                         {},
                         run.deposits && run.radius == 0.0,
                         run.deposits && run.radius > 0.0,
                         {},
                         0.0f,
                         &deposits,
                         1.0f};
    std::copy_n(&impl_->inverse[0][0], 9, &context.inverse[0][0]);
    if (context.points) impl_->set_kernel(run.radius, context);
    std::vector<TraceResult> results(workers);
    for (std::size_t w = 0; w < workers; ++w) {
        results[w].first_slab = w * deposits.slab_count() / workers;
        results[w].waiting.of_slab.resize(deposits.slab_count());
    }
    std::vector<char> done(batches);
    const auto trace_batch = [&](std::size_t batch, int worker) {
        trace(context, results[std::size_t(worker)], batch * kBatch,
              std::min((batch + 1) * kBatch, run.photons));
        done[batch] = true;
    };
    try {
        parallel_for(batches, int(workers), run.control, trace_batch);
    } catch (...) {
        if (result.higher) {
            // Photons are the same again, and integers know no order.
            context.sign = -1.0f;
            const std::vector<char> traced = done;
            parallel_for(batches, int(workers), nullptr, [&](std::size_t batch, int worker) {
                if (traced[batch]) trace_batch(batch, worker);
            });
        }
        deposits.forget();
        throw;
    }
    fold(deposits, field.voxels * each, run.pass, int(workers), result);
    PhotonTally tally;
    for (const TraceResult &some : results) add(tally, some.tally);
    return tally;
}

}  // namespace volillum
