#include "volillum/cone_transport.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "cone_transport_lamp.h"
#include "cone_transport_plan.h"
#include "cone_transport_slices.h"
#include "cone_transport_voxels.h"
#include "volillum/parallel.h"

namespace volillum {
namespace cone_detail {
namespace {

// The march, divided as MarchPlan says. Extinctions take turns in each slab, so that the rays of
// one have the cache for themselves.
class March {
public:
    March(const ConeTransportScene &scene, const ConeTransportSettings &settings)
        : scene_(scene),
          settings_(settings),
          lattice_(scene, settings.spacing, check_directions(scene)),
          rays_(plan_rays(scene, lattice_)),
          lamp_(scene, settings.spacing, lattice_),
          plan_(scene, lattice_, rays_, settings.threads),
          slices_(scene, lattice_, plan_, rays_),
          states_(plan_.extinctions) {
        for (RayStates &states : states_)
            states.resize(rays_.size(), plan_.ray_rows, plan_.threads, plan_.missing_rows,
                          plan_.layout, plan_.albedos);
        solutions_.resize(plan_, lattice_.most_points(), scene.transmittance != nullptr);
    }

    void run(Real *out) {
        const VoxelWriter writer(scene_, lattice_, solutions_);
        Progress progress(plan_.slabs);
        parallel_for(
            std::size_t(plan_.slabs), plan_.threads, settings_.control,
            [&](std::size_t slab, int) {
                try {
                    march(int(slab), progress);
                    writer.write(int(slab), out);
                    progress.finish(int(slab), written());
                } catch (...) {
                    progress.fail();
                    throw;
                }
            },
            settings_.progress_begin, settings_.progress_end);
    }

private:
    // A row of a slice, of one extinction.
    struct Place {
        std::size_t extinction;
        int slice, row;
    };

    // What a slab has done when its voxels are written: the bands of all extinctions, and that.
    int written() const { return int(plan_.extinctions) * plan_.bands + 1; }

    void march(int slab, Progress &progress) {
        // Its solutions, and the slice before its first, give way to this slab's.
        progress.wait(slab - plan_.threads, written(), settings_.control);
        const int first = slab * plan_.slab_slices,
                  last = std::min(first + plan_.slab_slices, lattice_.slices);
        for (int slice = first; slice < last; ++slice) begin(slice);
        // Bands of the slab before that the first slice reads beyond its own.
        const int ahead = (plan_.skew * plan_.slab_slices + plan_.band_rows - 1) / plan_.band_rows;
        for (std::size_t extinction = 0; extinction < plan_.extinctions; ++extinction) {
            const int done = int(extinction) * plan_.bands;
            for (int band = 0; band < plan_.bands; ++band) {
                if (settings_.control && settings_.control->cancelled()) throw Cancelled();
                progress.wait(slab - 1, done + std::min(band + ahead + 1, plan_.bands),
                              settings_.control);
                march_band(extinction, first, last, band * plan_.band_rows - 1);
                progress.finish(slab, done + band + 1);
            }
        }
    }

    void march_band(std::size_t extinction, int first, int last, int top) {
        for (int row = top; row < std::min(top + plan_.band_rows, lattice_.rows - 1); ++row)
            slices_.sample(extinction, first, last, row + 1);
        for (int slice = first; slice < last; ++slice) {
            const int begin = top - plan_.skew * (slice - first);
            const int end = std::min(begin + plan_.band_rows, lattice_.rows);
            for (int row = std::max(begin, -1); row < end; ++row)
                march_row({extinction, slice, row});
        }
    }

    void begin(int slice) {
        slices_.begin(slice);
        Slice &here = slices_.at(slice);
        for (std::size_t d = 0; d < rays_.size(); ++d) {
            const Crossing crossing = rays_[d].crossing(slice);
            here.moves[d] = {rays_[d].crossing(slice - 1), crossing,
                             states_[0].lines(-crossing.row)};
        }
    }

    void march_row(const Place &place) {
        const auto [extinction, slice, row] = place;
        Slice &here = slices_.at(slice);
        SumRows &sums = here.sums;
        if (row < 0) sums.clear();
        if (scene_.local_weights && row + 1 < lattice_.rows)
            lamp_.weigh(slice, row + 1, lattice_.span(slice, row + 1), here.weights);
        const Span rays = lattice_.rays(slice, row);
        if (!rays.empty()) march_rays(place, rays);
        if (row >= 0) solve(place);
        sums.clear(row);
        if (plan_.ends_slab(slice)) {
            settle({extinction, slice, row - 1});
            if (row + 1 == lattice_.rows) settle(place);
        }
    }

    // Rays between two rows of points that are solved.
    void settle(const Place &place) {
        const auto [extinction, slice, row] = place;
        const Span rays = lattice_.rays(slice, row);
        if (rays.empty()) return;
        const Span lanes = whole_lanes(rays);
        Slice &here = slices_.at(slice);
        const SliceRows rows = here.planes_of(extinction).rows(row);
        const RayStates::Lines lines = states_[extinction].lines(row);
        for (std::size_t d = 0; d < rays_.size(); ++d) {
            const Crossing &crossing = here.moves[d].here;
            settle_row({state_of(place, d, lines), rows,
                        Taps(crossing.row_fraction, crossing.column_fraction)},
                       plan_.albedos, lanes.begin, lanes.end - lanes.begin);
        }
    }

    // At column 0 of the slice.
    RayRow state_of(const Place &place, std::size_t d, const RayStates::Lines &lines) {
        const int slice = place.slice;
        return states_[place.extinction].at(slice / plan_.slab_slices, d, lines,
                                            slices_.at(slice).moves[d].lines,
                                            lattice_.first_column(slice));
    }

    void march_rays(const Place &place, const Span &rays) {
        const auto [extinction, slice, row] = place;
        Slice &here = slices_.at(slice);
        RayStates &states = states_[extinction];
        const RayStates::Lines lines = states.lines(row), lines_below = states.lines(row + 1);
        const RayRow own = here.sums.at(row), next = here.sums.at(row + 1);
        const SliceRows rows = here.planes_of(extinction).rows(row);
        // Where rays come from on the slice before: `skew` says how many rows they move at most.
        struct Origin {
            SliceRows rows;
            Span rays;
        };
        std::array<Origin, 2 * kMostSkew - 1> origins;
        SlicePlanes &planes_before = slices_.at(slice - 1).planes_of(extinction);
        for (int shift = 1 - plan_.skew; shift < plan_.skew; ++shift)
            origins[std::size_t(shift + plan_.skew - 1)] = {planes_before.rows(row - shift),
                                                            lattice_.rays(slice - 1, row - shift)};
        const int first_column = lattice_.first_column(slice);
        // The same memory, by the columns of the slice before.
        const int moved = first_column - lattice_.first_column(slice - 1);
        const bool settled = plan_.begins_slab(slice);
        const Span lanes = whole_lanes(rays);
        std::array<AddRow, kAdded> stepped;
        std::size_t added = 0;
        RayRow state = state_of(place, 0, lines);
        for (std::size_t d = 0; d < rays_.size(); ++d) {
            const Slice::Move &move = here.moves[d];
            const Origin &origin =
                origins[std::size_t(move.here.row - move.before.row + plan_.skew - 1)];
            const int shift = move.here.column - move.before.column;
            renew(state, moved, !settled, origin.rays, {rays.begin - shift, rays.end - shift});
            const RayRow soon = d + 1 < rays_.size() ? state_of(place, d + 1, lines)
                                                     : state_of(place, 0, lines_below);
            StepRow step{state,
                         {},
                         shift - moved,
                         shift,
                         origin.rows,
                         rows,
                         Taps(move.before.row_fraction, move.before.column_fraction),
                         Taps(move.here.row_fraction, move.here.column_fraction),
                         rays_[d].length,
                         soon};
            for (int i = 0; i < plan_.albedos; ++i)
                step.missing[i] = settled ? states.settled(first_column) : state.missing[i];
            if (scene_.lamp) lamp_.end(slice, row, move.here, d, rays, step);
            step_row(step, plan_.albedos, lanes.begin, lanes.end - lanes.begin);
            AddRow &add = stepped[added++];
            add = {state, move.here.row_fraction, move.here.column_fraction, rays_[d].weight};
            if (scene_.local_weights) {
                add.own_weights = here.weights.at(row, d);
                add.next_weights = here.weights.at(row + 1, d);
            }
            if (added == kAdded || d + 1 == rays_.size()) {
                add_rows(stepped.data(), int(added), own, next, plan_.albedos, lanes.begin,
                         lanes.end - lanes.begin);
                added = 0;
            }
            state = soon;
        }
    }

    // Rays of these columns of the slice before that come from beside those that are held have met
    // nothing. They lie `moved` elements behind their columns.
    void renew(const RayRow &state, int moved, bool missing, const Span &held,
               const Span &rays) const {
        const auto fill = [&](int begin, int end) {
            for (int c = begin + moved; c < end + moved; ++c) {
                state.seen[c] = 1;
                for (int i = 0; i < plan_.albedos; ++i) {
                    state.known[i][c] = 1;
                    if (missing) state.missing[i][c] = 1;
                }
            }
        };
        if (held.empty()) return fill(rays.begin, rays.end);
        fill(rays.begin, std::min(held.begin, rays.end));
        fill(std::max(held.end, rays.begin), rays.end);
    }

    void solve(const Place &place) {
        const auto [extinction, slice, row] = place;
        Slice &here = slices_.at(slice);
        const Span span = lattice_.span(slice, row);
        const RayRow sums = here.sums.at(row);
        for (int i = 0; i < plan_.albedos; ++i) {
            Real *in_scattered = here.planes_of(extinction).in_scattered(row, i);
            slices_.clear_beside(in_scattered, slice, span);
            if (!span.empty())
                solve_row(sums.known[i], sums.missing[i], span.begin, span.end, in_scattered);
        }
        if (!span.empty()) keep(place, span);
    }

    // For the voxels.
    void keep(const Place &place, const Span &span) {
        const auto [extinction, slice, row] = place;
        Slice &here = slices_.at(slice);
        const int place_of_row = solutions_.begin(slice) + lattice_.offset(slice, row);
        const auto copy = [&](const Real *values, Real *solution) {
            std::copy(values + span.begin, values + span.end, solution + place_of_row);
        };
        for (int i = 0; i < plan_.albedos; ++i)
            copy(here.planes_of(extinction).in_scattered(row, i),
                 solutions_.in_scattered(extinction, i));
        if (scene_.transmittance) copy(here.sums.at(row).seen, solutions_.seen(extinction));
    }

    const ConeTransportScene &scene_;
    const ConeTransportSettings &settings_;
    Lattice lattice_;
    std::vector<Ray> rays_;
    LampCones lamp_;
    MarchPlan plan_;
    Slices slices_;
    std::vector<RayStates> states_;  // of each extinction
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
