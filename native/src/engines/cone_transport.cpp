#include "volillum/cone_transport.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "cone_transport_lamp.h"
#include "cone_transport_plan.h"
#include "cone_transport_voxels.h"
#include "volillum/parallel.h"

namespace volillum {
namespace cone_detail {
namespace {

// Extinction times a step of more than this is as good as opaque, and its powers stay finite.
constexpr double kOpaque = 1e8;

// The march, divided as MarchPlan says.
class March {
public:
    March(const ConeTransportScene &scene, const ConeTransportSettings &settings)
        : scene_(scene),
          settings_(settings),
          lattice_(scene, settings.spacing, check_directions(scene)),
          rays_(plan_rays(scene, lattice_)),
          lamp_(scene, settings.spacing, lattice_),
          plan_(scene, lattice_, rays_, settings.threads) {
        Real longest = 0;
        for (const Ray &ray : rays_) longest = std::max(longest, ray.length);
        largest_ = Real(kOpaque / double(longest));
        slices_.resize(std::size_t(plan_.threads + 1) * std::size_t(plan_.slab_slices));
        for (std::size_t i = 0; i < slices_.size(); ++i) {
            Slice &slice = slices_[i];
            const int held = plan_.ends_slab(int(i)) ? lattice_.rows : plan_.plane_rows;
            slice.planes.resize(lattice_.rows, held, plan_.layout, plan_.albedos);
            slice.sums.resize(plan_.layout, plan_.albedos);
            slice.moves.resize(rays_.size());
            if (scene.local_weights) slice.weights.resize(plan_.layout, rays_.size());
        }
        states_.resize(rays_.size(), plan_.ray_rows, plan_.threads, plan_.missing_rows,
                       plan_.layout, plan_.albedos);
        solutions_.resize(plan_.threads, plan_.slab_slices, lattice_.most_points(), plan_.albedos,
                          scene.transmittance != nullptr);
    }

    void run(Real *out) {
        const std::ptrdiff_t voxels =
            std::ptrdiff_t(scene_.shape[0]) * scene_.shape[1] * scene_.shape[2];
        const double from = settings_.progress_begin;
        const double share = (settings_.progress_end - from) / scene_.extinctions;
        for (int run = 0; run < scene_.extinctions; ++run) {
            std::array<Reals, 1 + kMostAlbedos> copies;
            // `sample_medium` reads beyond the last of lone elements.
            const auto readable = [&](const Real *values, Reals &copy) {
                if (scene_.shape[2] > 1) return values;
                copy.assign(values, values + voxels);
                copy.push_back(0);
                return static_cast<const Real *>(copy.data());
            };
            sigma_t_ = readable(scene_.sigma_t + run * voxels, copies[kMostAlbedos]);
            for (std::size_t i = 0; i < std::size_t(plan_.albedos); ++i)
                sigma_s_[i] =
                    readable(scene_.sigma_s + (scene_.scatterings > 1 ? run + int(i) : 0) * voxels,
                             copies[i]);
            const Real *transmittance =
                scene_.transmittance ? scene_.transmittance + run * voxels : nullptr;
            solve_channel(transmittance, from + run * share, from + (run + 1) * share,
                          out + run * plan_.albedos * voxels);
        }
    }

private:
    // How a direction's rays come to a slice.
    struct Move {
        Crossing before, here;
    };
    struct Slice {
        SlicePlanes planes;
        SumRows sums;
        WeightRows weights;
        std::vector<Move> moves;
    };

    Slice &slice_at(int slice) {
        return slices_[std::size_t(slice + plan_.slab_slices) % slices_.size()];
    }

    void solve_channel(const Real *transmittance, double begin, double end, Real *out) {
        slice_at(-1).planes.begin_at(lattice_.first_column(-1));
        slice_at(-1).planes.clear();  // nothing lies before the first slice
        const VoxelWriter writer(scene_.shape, lattice_, solutions_, plan_.albedos, transmittance);
        Progress progress(plan_.slabs);
        parallel_for(
            std::size_t(plan_.slabs), plan_.threads, settings_.control,
            [&](std::size_t slab, int) {
                try {
                    march(int(slab), progress);
                    writer.write(int(slab), out);
                    progress.finish(int(slab), plan_.bands + 1);
                } catch (...) {
                    progress.fail();
                    throw;
                }
            },
            begin, end);
    }

    void march(int slab, Progress &progress) {
        // Its solutions, and the slice before its first, give way to this slab's.
        progress.wait(slab - plan_.threads, plan_.bands + 1, settings_.control);
        const int first = slab * plan_.slab_slices,
                  last = std::min(first + plan_.slab_slices, lattice_.slices);
        for (int slice = first; slice < last; ++slice) {
            Slice &here = slice_at(slice);
            const int column = lattice_.first_column(slice);
            here.planes.begin_at(column);
            here.sums.begin_at(column);
            if (scene_.local_weights) here.weights.begin_at(column);
            for (std::size_t d = 0; d < rays_.size(); ++d)
                here.moves[d] = {rays_[d].crossing(slice - 1), rays_[d].crossing(slice)};
        }
        // Bands of the slab before that the first slice reads beyond its own.
        const int ahead = (plan_.skew * plan_.slab_slices + plan_.band_rows - 1) / plan_.band_rows;
        for (int band = 0; band < plan_.bands; ++band) {
            if (settings_.control && settings_.control->cancelled()) throw Cancelled();
            progress.wait(slab - 1, std::min(band + ahead + 1, plan_.bands), settings_.control);
            for (int slice = first; slice < last; ++slice) {
                const int begin = band * plan_.band_rows - 1 - plan_.skew * (slice - first);
                const int end = std::min(begin + plan_.band_rows, lattice_.rows);
                for (int row = std::max(begin, -1); row < end; ++row) march_row(slice, row);
            }
            progress.finish(slab, band + 1);
        }
    }

    void march_row(int slice, int row) {
        Slice &here = slice_at(slice);
        if (row < 0) here.sums.clear();
        if (row + 1 < lattice_.rows) {
            sample(slice, row + 1, here.planes);
            if (scene_.local_weights)
                lamp_.weigh(slice, row + 1, lattice_.span(slice, row + 1), here.weights);
        }
        const Span rays = lattice_.rays(slice, row);
        if (!rays.empty()) {
            // Whole lanes, on cache lines.
            const int begin = rays.begin & ~(kLanes - 1), count = round_up(rays.end - begin);
            for (std::size_t d = 0; d < rays_.size(); ++d)
                march_rays(slice, row, d, rays, begin, count);
        }
        if (row >= 0) solve(slice, row, here);
        here.sums.clear(row);
        if (plan_.ends_slab(slice)) {
            settle(slice, row - 1);
            if (row + 1 == lattice_.rows) settle(slice, row);
        }
    }

    // Rays between two rows of points that are solved.
    void settle(int slice, int row) {
        const Span rays = lattice_.rays(slice, row);
        if (rays.empty()) return;
        const int begin = rays.begin & ~(kLanes - 1), count = round_up(rays.end - begin);
        Slice &here = slice_at(slice);
        const SliceRows rows = here.planes.rows(row, 0);
        for (std::size_t d = 0; d < rays_.size(); ++d) {
            const Crossing &crossing = here.moves[d].here;
            SettleRow settled{state_of(slice, row, d, crossing),
                              {},
                              Taps(crossing.row_fraction, crossing.column_fraction)};
            std::copy_n(rows.in_scattered, plan_.albedos, settled.in_scattered);
            settle_row(settled, plan_.albedos, begin, count);
        }
    }

    // At column 0 of the slice.
    RayRow state_of(int slice, int row, std::size_t d, const Crossing &crossing) {
        return states_.at(slice / plan_.slab_slices, d, row - crossing.row,
                          lattice_.first_column(slice));
    }

    void march_rays(int slice, int row, std::size_t d, const Span &rays, int begin, int count) {
        Slice &here = slice_at(slice);
        const Ray &ray = rays_[d];
        const Move &move = here.moves[d];
        const int row_shift = move.here.row - move.before.row;
        const int shift = move.here.column - move.before.column;
        const RayRow state = state_of(slice, row, d, move.here);
        // The same memory, by the columns of the slice before.
        const int moved = lattice_.first_column(slice) - lattice_.first_column(slice - 1);
        RayRow before = state;
        before.seen += moved;
        for (int i = 0; i < plan_.albedos; ++i) {
            before.known[i] += moved;
            before.missing[i] += moved;
        }
        const bool settled = plan_.begins_slab(slice);
        renew(before, !settled, lattice_.rays(slice - 1, row - row_shift), rays.begin - shift,
              rays.end - shift);
        StepRow step{state,
                     {},
                     shift - moved,
                     slice_at(slice - 1).planes.rows(row - row_shift, -shift),
                     here.planes.rows(row, 0),
                     Taps(move.before.row_fraction, move.before.column_fraction),
                     Taps(move.here.row_fraction, move.here.column_fraction),
                     ray.length};
        for (int i = 0; i < plan_.albedos; ++i)
            step.missing[i] =
                settled ? states_.settled(lattice_.first_column(slice)) : state.missing[i];
        if (scene_.lamp) lamp_.end(slice, row, move.here, d, rays, step);
        step_row(step, plan_.albedos, begin, count);
        AddRow add{state,      move.here.row_fraction, move.here.column_fraction,
                   ray.weight, here.sums.at(row),      here.sums.at(row + 1)};
        if (scene_.local_weights) {
            add.own_weights = here.weights.at(row, d);
            add.next_weights = here.weights.at(row + 1, d);
        }
        add_row(add, plan_.albedos, begin, count);
    }

    // Rays that come from beside those that are held have met nothing.
    void renew(const RayRow &state, bool missing, const Span &held, int begin, int end) const {
        const auto fill = [&](int from, int to) {
            if (from >= to) return;
            std::fill(state.seen + from, state.seen + to, Real(1));
            for (int i = 0; i < plan_.albedos; ++i) {
                std::fill(state.known[i] + from, state.known[i] + to, Real(1));
                if (missing) std::fill(state.missing[i] + from, state.missing[i] + to, Real(1));
            }
        };
        if (held.empty()) return fill(begin, end);
        fill(begin, std::min(held.begin, end));
        fill(std::max(held.end, begin), end);
    }

    void sample(int slice, int row, SlicePlanes &planes) const {
        const Span span = lattice_.span(slice, row);
        clear_beside(planes.sigma_t(row), slice, span);
        MediumRow medium{sigma_t_,
                         sigma_s_,
                         plan_.albedos,
                         scene_.shape,
                         lattice_.index_of(slice, row, span.begin),
                         lattice_.index_per_column(),
                         largest_,
                         planes.sigma_t(row) + span.begin,
                         {}};
        for (int i = 0; i < plan_.albedos; ++i) {
            clear_beside(planes.sigma_a(row, i), slice, span);
            medium.absorption[i] = planes.sigma_a(row, i) + span.begin;
        }
        if (!span.empty()) sample_medium(medium, span.end - span.begin);
    }

    void solve(int slice, int row, Slice &here) {
        const Span span = lattice_.span(slice, row);
        const RayRow sums = here.sums.at(row);
        for (int i = 0; i < plan_.albedos; ++i) {
            Real *in_scattered = here.planes.in_scattered(row, i);
            clear_beside(in_scattered, slice, span);
            if (!span.empty())
                solve_row(sums.known[i], sums.missing[i], span.begin, span.end, in_scattered);
        }
        if (!span.empty()) keep(slice, row, span, here);
    }

    // For the voxels.
    void keep(int slice, int row, const Span &span, Slice &here) {
        const int offset = lattice_.offset(slice, row);
        const auto copy = [&](const Real *values, Real *solution) {
            std::copy(values + span.begin, values + span.end,
                      solution + solutions_.begin(slice) + offset);
        };
        for (int i = 0; i < plan_.albedos; ++i)
            copy(here.planes.in_scattered(row, i), solutions_.in_scattered(i));
        if (scene_.transmittance) copy(here.sums.at(row).seen, solutions_.seen());
    }

    void clear_beside(Real *row, int slice, const Span &span) const {
        const int first = lattice_.first_column(slice), end = first + lattice_.width();
        std::fill(row + first, row + (span.empty() ? end : span.begin), Real(0));
        if (!span.empty()) std::fill(row + span.end, row + end, Real(0));
    }

    const ConeTransportScene &scene_;
    const ConeTransportSettings &settings_;
    Lattice lattice_;
    std::vector<Ray> rays_;
    LampCones lamp_;
    MarchPlan plan_;
    Real largest_ = 0;
    const Real *sigma_t_ = nullptr;  // of the extinction that is solved
    AlbedoFields sigma_s_{};
    std::vector<Slice> slices_;  // of the slabs in flight and the one before
    RayStates states_;
    Solutions solutions_;
};

}  // namespace
}  // namespace cone_detail

void cone_transport(const ConeTransportScene &scene, const ConeTransportSettings &settings,
                    Real *out) {
    if (!(settings.spacing > 0))
        throw std::invalid_argument("spacing is " + std::to_string(settings.spacing) +
                                    "; expected more than 0 voxels");
    cone_detail::March(scene, settings).run(out);
}

}  // namespace volillum
