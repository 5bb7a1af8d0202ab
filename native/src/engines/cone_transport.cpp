#include "volillum/cone_transport.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include "cone_transport_lamp.h"
#include "cone_transport_lattice.h"
#include "cone_transport_state.h"
#include "cone_transport_voxels.h"
#include "volillum/parallel.h"

namespace volillum {
namespace cone_detail {
namespace {

// Bytes of a band's rays, all directions: half of a second-level cache.
constexpr std::size_t kBandBytes = 400'000;
constexpr int kFewestBandRows = 4, kMostBandRows = 64;
// Extinction times a step of more than this is as good as opaque, and its powers stay finite.
constexpr double kOpaque = 1e8;

// The most rows, or columns, that rays move from slice to slice.
double steepest(const std::vector<Ray> &rays, double Ray::*slope) {
    double most = 0;
    for (const Ray &ray : rays) most = std::max(most, std::abs(ray.*slope));
    return most;
}

// Rows of points and rays are taken band by band, each band through all slices of a slab, a few
// rows lower (`skew`) on each than on the slice before: so what a row reads of the slice before is
// done, by this band or the one before. A row of rays stays in its place in memory; the band in
// which it is next taken is never an earlier one.
class March {
public:
    March(const ConeTransportScene &scene, const ConeTransportSettings &settings)
        : scene_(scene),
          settings_(settings),
          lattice_(scene, settings.spacing, check_directions(scene)),
          rays_(plan_rays(scene, lattice_)),
          lamp_(scene, settings.spacing, lattice_),
          threads_(thread_count(settings.threads)),
          skew_(int(std::ceil(steepest(rays_, &Ray::row_slope))) + 1),
          albedos_(scene.extinctions == 1 ? scene.scatterings : 1) {
        Real longest = 0;
        for (const Ray &ray : rays_) longest = std::max(longest, ray.length);
        largest_ = Real(kOpaque / double(longest));
        const int reach = int(std::ceil(steepest(rays_, &Ray::column_slope)));
        const RowLayout layout(lattice_.columns, reach + 3);
        slabs_ = (lattice_.slices + kSlabSlices - 1) / kSlabSlices;
        threads_ = std::min(threads_, slabs_);
        const std::size_t row_bytes =
            rays_.size() * std::size_t(layout.pitch) * std::size_t(1 + 2 * albedos_) * sizeof(Real);
        band_rows_ = std::clamp(int(kBandBytes / row_bytes), kFewestBandRows, kMostBandRows);
        bands_ = (lattice_.rows + 1 + skew_ * (kSlabSlices - 1) + band_rows_ - 1) / band_rows_;
        slices_.resize(std::size_t(threads_ + 1) * kSlabSlices);
        // The next slab reads a whole slice of the one before; within a slab, the next slice reads
        // a band and a few rows beside it.
        const int few = band_rows_ + 2 * skew_ + 1;
        for (std::size_t i = 0; i < slices_.size(); ++i) {
            Slice &slice = slices_[i];
            const bool ends_slab = i % kSlabSlices == kSlabSlices - 1;
            slice.planes.resize(lattice_.rows, ends_slab ? lattice_.rows : few, layout, albedos_);
            slice.sums.resize(layout, albedos_);
            slice.moves.resize(rays_.size());
            if (scene.local_weights) slice.weights.resize(layout, rays_.size());
        }
        // A row of memory is taken by new rays only when no slab in flight has the old ones.
        const int in_flight = kSlabSlices * (threads_ + 1);
        const int spare = int(std::ceil(steepest(rays_, &Ray::row_slope) * in_flight)) + 1;
        states_.resize(rays_.size(), lattice_.rows + 2 + spare, layout, albedos_);
        solutions_.resize(threads_, lattice_.most_points(), albedos_,
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
            for (std::size_t i = 0; i < std::size_t(albedos_); ++i)
                sigma_s_[i] =
                    readable(scene_.sigma_s + (scene_.scatterings > 1 ? run + int(i) : 0) * voxels,
                             copies[i]);
            const Real *transmittance =
                scene_.transmittance ? scene_.transmittance + run * voxels : nullptr;
            solve_channel(transmittance, from + run * share, from + (run + 1) * share,
                          out + run * albedos_ * voxels);
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
        return slices_[std::size_t(slice + kSlabSlices) % slices_.size()];
    }

    void solve_channel(const Real *transmittance, double begin, double end, Real *out) {
        slice_at(-1).planes.clear();  // nothing lies before the first slice
        const VoxelWriter writer(scene_.shape, lattice_, solutions_, albedos_, transmittance);
        Progress progress(slabs_);
        parallel_for(
            std::size_t(slabs_), threads_, settings_.control,
            [&](std::size_t slab, int) {
                try {
                    march(int(slab), progress);
                    writer.write(int(slab), out);
                    progress.finish(int(slab), bands_ + 1);
                } catch (...) {
                    progress.fail();
                    throw;
                }
            },
            begin, end);
    }

    void march(int slab, Progress &progress) {
        const int first = slab * kSlabSlices, last = std::min(first + kSlabSlices, lattice_.slices);
        for (int slice = first; slice < last; ++slice)
            for (std::size_t d = 0; d < rays_.size(); ++d)
                slice_at(slice).moves[d] = {rays_[d].crossing(slice - 1), rays_[d].crossing(slice)};
        // Its solutions give way to this slab's.
        progress.wait(slab - threads_, bands_ + 1, settings_.control);
        // Bands of the slab before that the first slice reads beyond its own.
        const int ahead = (skew_ * kSlabSlices + band_rows_ - 1) / band_rows_;
        for (int band = 0; band < bands_; ++band) {
            if (settings_.control && settings_.control->cancelled()) throw Cancelled();
            progress.wait(slab - 1, std::min(band + ahead + 1, bands_), settings_.control);
            for (int slice = first; slice < last; ++slice) {
                const int begin = band * band_rows_ - 1 - skew_ * (slice - first);
                const int end = std::min(begin + band_rows_, lattice_.rows);
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
    }

    void march_rays(int slice, int row, std::size_t d, const Span &rays, int begin, int count) {
        Slice &here = slice_at(slice);
        const Ray &ray = rays_[d];
        const Move &move = here.moves[d];
        const int row_shift = move.here.row - move.before.row;
        const int shift = move.here.column - move.before.column;
        const RayRow state = states_.at(d, row - move.here.row);
        renew(state, lattice_.rays(slice - 1, row - row_shift), rays.begin - shift,
              rays.end - shift);
        StepRow step{state,
                     shift,
                     slice_at(slice - 1).planes.rows(row - row_shift, -shift),
                     here.planes.rows(row, 0),
                     Taps(move.before.row_fraction, move.before.column_fraction),
                     Taps(move.here.row_fraction, move.here.column_fraction),
                     ray.length};
        if (scene_.lamp) lamp_.end(slice, row, move.here, d, rays, step);
        step_row(step, albedos_, begin, count);
        AddRow add{state,      move.here.row_fraction, move.here.column_fraction,
                   ray.weight, here.sums.at(row),      here.sums.at(row + 1)};
        if (scene_.local_weights) {
            add.own_weights = here.weights.at(row, d);
            add.next_weights = here.weights.at(row + 1, d);
        }
        add_row(add, albedos_, begin, count);
    }

    // Rays that come from beside those that are held have met nothing.
    void renew(const RayRow &state, const Span &held, int begin, int end) const {
        const auto fill = [&](int from, int to) {
            if (from >= to) return;
            std::fill(state.seen + from, state.seen + to, Real(1));
            for (int i = 0; i < albedos_; ++i) {
                std::fill(state.known[i] + from, state.known[i] + to, Real(1));
                std::fill(state.missing[i] + from, state.missing[i] + to, Real(1));
            }
        };
        if (held.empty()) return fill(begin, end);
        fill(begin, std::min(held.begin, end));
        fill(std::max(held.end, begin), end);
    }

    void sample(int slice, int row, SlicePlanes &planes) const {
        const Span span = lattice_.span(slice, row);
        clear_beside(planes.sigma_t(row), span);
        MediumRow medium{sigma_t_,
                         sigma_s_,
                         albedos_,
                         scene_.shape,
                         lattice_.index_of(slice, row, span.begin),
                         lattice_.index_per_column(),
                         largest_,
                         planes.sigma_t(row) + span.begin,
                         {}};
        for (int i = 0; i < albedos_; ++i) {
            clear_beside(planes.sigma_a(row, i), span);
            medium.absorption[i] = planes.sigma_a(row, i) + span.begin;
        }
        if (!span.empty()) sample_medium(medium, span.end - span.begin);
    }

    void solve(int slice, int row, Slice &here) {
        const Span span = lattice_.span(slice, row);
        const RayRow sums = here.sums.at(row);
        for (int i = 0; i < albedos_; ++i) {
            Real *in_scattered = here.planes.in_scattered(row, i);
            clear_beside(in_scattered, span);
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
        for (int i = 0; i < albedos_; ++i)
            copy(here.planes.in_scattered(row, i), solutions_.in_scattered(i));
        if (scene_.transmittance) copy(here.sums.at(row).seen, solutions_.seen());
    }

    void clear_beside(Real *row, const Span &span) const {
        const int begin = span.empty() ? lattice_.columns : span.begin;
        std::fill(row, row + begin, Real(0));
        if (!span.empty()) std::fill(row + span.end, row + lattice_.columns, Real(0));
    }

    const ConeTransportScene &scene_;
    const ConeTransportSettings &settings_;
    Lattice lattice_;
    std::vector<Ray> rays_;
    LampCones lamp_;
    int threads_, skew_, albedos_, slabs_ = 0, band_rows_ = 0, bands_ = 0;
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
