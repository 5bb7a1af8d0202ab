#include "volillum/cone_transport.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "cone_transport_kernels.h"
#include "cone_transport_lattice.h"
#include "cone_transport_state.h"
#include "volillum/parallel.h"

namespace volillum {
namespace cone_detail {
namespace {

// Rows of a band: the unit of work on a slice. Enough bands that no thread waits for the last.
constexpr int kBandRows = 16;
// Extinction times a step of more than this is as good as opaque, and its powers stay finite.
constexpr double kOpaque = 1e8;

// Where less than this share of the light met matter, what of it is lost does not show.
constexpr Real kLeast = Real(1e-5);

// Where a row of rays is needed: beside a held point. Rays lie beyond the point of their number.
Span rays_of(const Lattice &lattice, int slice, int row) {
    const Span one = lattice.span(slice, row), two = lattice.span(slice, row + 1);
    if (one.empty() && two.empty()) return {};
    if (one.empty()) return {two.begin - 1, two.end};
    if (two.empty()) return {one.begin - 1, one.end};
    return {std::min(one.begin, two.begin) - 1, std::max(one.end, two.end)};
}

class March {
public:
    March(const ConeTransportScene &scene, const ConeTransportSettings &settings)
        : scene_(scene),
          settings_(settings),
          lattice_(scene, settings.spacing, check_directions(scene)),
          rays_(plan_rays(scene, lattice_)) {
        Real longest = 0;
        for (const Ray &ray : rays_) {
            longest = std::max(longest, ray.length);
            reach_ = std::max(
                {reach_, int(std::abs(ray.row_slope)) + 3, int(std::abs(ray.column_slope)) + 3});
        }
        largest_ = Real(kOpaque / double(longest));
        band_rows_ = std::max(kBandRows, reach_ + 2);
        bands_ = (lattice_.rows + band_rows_ - 1) / band_rows_;
        for (SlicePlanes &planes : planes_)
            for (Plane *plane : {&planes.in_scattered, &planes.sigma_t, &planes.sigma_a})
                plane->resize(-reach_ - 2, lattice_.rows + 2 * reach_ + 4, lattice_.columns,
                              reach_ + 2);
        states_.resize(rays_.size());
        for (State &state : states_)
            for (RayPlanes &planes : state.by_parity)
                planes.resize(-1, lattice_.rows + 1, lattice_.columns, 2);
        in_scattered_.resize(lattice_.points() + kLanes);
        if (scene.transmittance) seen_.resize(lattice_.points() + kLanes);
    }

    void run(Real *out) {
        const double middle =
            settings_.progress_begin + 0.95 * (settings_.progress_end - settings_.progress_begin);
        const int threads = thread_count(settings_.threads);
        spaces_.resize(std::size_t(threads));
        Progress progress(bands_);
        parallel_for(
            std::size_t(lattice_.slices) * std::size_t(bands_), threads, settings_.control,
            [&](std::size_t item, int thread) {
                const int slice = int(item / std::size_t(bands_)),
                          band = int(item % std::size_t(bands_));
                try {
                    for (int other = band - 1; other <= band + 1; ++other)
                        progress.wait(other, slice, settings_.control);
                    march(slice, band, spaces_[std::size_t(thread)]);
                    progress.finish(band, slice + 1);
                } catch (...) {
                    progress.fail();
                    throw;
                }
            },
            settings_.progress_begin, middle);
        parallel_for(
            std::size_t(scene_.shape[0]), threads, settings_.control,
            [&](std::size_t plane, int) { interpolate(int(plane), out); }, middle,
            settings_.progress_end);
    }

private:
    struct State {
        RayPlanes by_parity[2];  // of the slice
    };
    struct Workspace {
        SlicePlanes here;  // of the band and a row on both sides
        RayPlanes sums;    // over directions
        RayPlanes first;   // the row of rays before the band's own
        Reals before[3];
    };

    void march(int slice, int band, Workspace &space) {
        const int begin = band * band_rows_, end = std::min(begin + band_rows_, lattice_.rows);
        const int rows = end - begin, columns = lattice_.columns;
        for (Plane *plane : {&space.here.sigma_t, &space.here.sigma_a})
            plane->resize(begin - 1, rows + 2, columns, reach_ + 2);
        space.sums.resize(begin, rows, columns, 2);
        space.first.resize(begin - 1, 1, columns, 2);
        for (int row = begin - 1; row <= end; ++row) {
            const Span span = lattice_.span(slice, row);
            if (span.empty()) continue;
            sample_medium(scene_.sigma_t, scene_.sigma_s, scene_.shape,
                          lattice_.index_of(slice, row, span.begin), lattice_.index_per_column(),
                          largest_, span.end - span.begin, space.here.sigma_t.at(row, span.begin),
                          space.here.sigma_a.at(row, span.begin));
        }
        for (std::size_t d = 0; d < rays_.size(); ++d)
            march_direction(slice, begin, end, rays_[d], states_[d], space);
        finish(slice, begin, end, space);
    }

    void march_direction(int slice, int begin, int end, const Ray &ray, State &state,
                         Workspace &space) {
        const Crossing here = ray.crossing(slice), before = ray.crossing(slice - 1);
        const int row_shift = here.row - before.row, column_shift = here.column - before.column;
        const int parity = slice & 1;
        RayPlanes &now = state.by_parity[parity];
        const SlicePlanes &old = planes_[1 - parity];
        for (int row = begin - 1; row < end; ++row) {
            const Span rays = rays_of(lattice_, slice, row);
            if (rays.empty()) continue;
            const int old_row = row - row_shift, old_column = rays.begin - column_shift;
            const int count = round_up(rays.end - rays.begin);
            const bool owned = row >= begin || row == -1;
            const StepRow step{
                rays_before(slice - 1, old_row, old_column, rays.end - column_shift, state, space),
                {old.in_scattered.rows(old_row, old_column), old.sigma_t.rows(old_row, old_column),
                 old.sigma_a.rows(old_row, old_column)},
                {{},
                 space.here.sigma_t.rows(row, rays.begin),
                 space.here.sigma_a.rows(row, rays.begin)},
                Taps(before.row_fraction, before.column_fraction),
                Taps(here.row_fraction, here.column_fraction),
                ray.length,
                (owned ? now : space.first).at(row, rays.begin)};
            step_row(step, count);
        }
        for (int row = begin; row < end; ++row) {
            const Span span = lattice_.span(slice, row);
            if (span.empty()) continue;
            const bool first = row == begin && row > 0;
            add_row((first ? space.first : now).at(row - 1, span.begin).read_only(),
                    now.at(row, span.begin).read_only(), here.row_fraction, here.column_fraction,
                    ray.weight, round_up(span.end - span.begin), space.sums.at(row, span.begin));
        }
    }

    // The state on `slice` of the rays [begin, end) of a row. Rays that no band has marched have
    // met nothing.
    RaysIn rays_before(int slice, int row, int begin, int end, const State &state,
                       Workspace &space) const {
        const Span held = rays_of(lattice_, slice, row);
        const RayPlanes &planes = state.by_parity[slice & 1];
        if (!held.empty() && held.begin <= begin && held.end >= end) return planes.at(row, begin);
        const Plane *from[3] = {&planes.known, &planes.missing, &planes.seen};
        const int low = std::max(begin, held.begin), high = std::min(end, held.end);
        for (int i = 0; i < 3; ++i) {
            space.before[i].assign(std::size_t(round_up(end - begin)), 1);
            if (low < high)
                std::copy_n(from[i]->at(row, low), high - low,
                            space.before[i].data() + (low - begin));
        }
        return {space.before[0].data(), space.before[1].data(), space.before[2].data()};
    }

    // Solves for L_i and hands the band's rows to the next slice.
    void finish(int slice, int begin, int end, Workspace &space) {
        SlicePlanes &planes = planes_[slice & 1];
        for (int row = begin; row < end; ++row) {
            const Span span = lattice_.span(slice, row);
            const int count = span.end - span.begin;
            for (Plane *plane : {&planes.in_scattered, &planes.sigma_t, &planes.sigma_a})
                std::fill_n(plane->at(row, 0), lattice_.columns, Real(0));
            if (span.empty()) continue;
            const RaysOut sums = space.sums.at(row, span.begin);
            solve_row(sums, count);
            std::copy_n(sums.known, count, planes.in_scattered.at(row, span.begin));
            std::copy_n(space.here.sigma_t.at(row, span.begin), count,
                        planes.sigma_t.at(row, span.begin));
            std::copy_n(space.here.sigma_a.at(row, span.begin), count,
                        planes.sigma_a.at(row, span.begin));
            const std::size_t at = lattice_.offset(slice, row);
            std::copy_n(sums.known, count, in_scattered_.data() + at);
            if (scene_.transmittance) std::copy_n(sums.seen, count, seen_.data() + at);
        }
    }

    void interpolate(int plane, Real *out) const {
        const Vec3d step = lattice_.position_per_voxel();
        for (int j = 0; j < scene_.shape[1]; ++j) {
            const Vec3d first = lattice_.position_of({double(plane), double(j), 0.0});
            const std::ptrdiff_t row =
                (std::ptrdiff_t(plane) * scene_.shape[1] + j) * scene_.shape[2];
            for (int k = 0; k < scene_.shape[2]; ++k) {
                const Vec3d position{first[0] + k * step[0], first[1] + k * step[1],
                                     first[2] + k * step[2]};
                const Neighbours near(lattice_, position);
                const Real in_scattered = near.mean(in_scattered_);
                if (!scene_.transmittance) {
                    out[row + k] = in_scattered;
                    continue;
                }
                // What is lost of the light that met matter varies slowly even at hard surfaces,
                // where how much met matter does not.
                const Real met = std::max(1 - near.mean(seen_), kLeast);
                const Real lost = std::clamp((1 - in_scattered) / met, Real(0), Real(1));
                out[row + k] = 1 - (1 - scene_.transmittance[row + k]) * lost;
            }
        }
    }

    // The lattice points about a position, with trilinear weights.
    struct Neighbours {
        std::size_t at[4];
        Real weight[4], along;
        Neighbours(const Lattice &lattice, const Vec3d &position) {
            int low[3];
            Real fraction[3];
            for (int i = 0; i < 3; ++i) {
                // Positions that should be whole are off by rounding, to either side.
                low[i] = int(position[i] + 1e-9);
                fraction[i] = Real(std::max(0.0, position[i] - low[i]));
            }
            for (int i = 0; i < 4; ++i) {
                const int slice = low[0] + i / 2, row = low[1] + i % 2;
                at[i] = lattice.offset(slice, row) +
                        std::size_t(low[2] - lattice.span(slice, row).begin);
                weight[i] = (i / 2 ? fraction[0] : 1 - fraction[0]) *
                            (i % 2 ? fraction[1] : 1 - fraction[1]);
            }
            along = fraction[2];
        }
        Real mean(const Reals &values) const {
            Real near = 0, far = 0;
            for (int i = 0; i < 4; ++i) {
                near += weight[i] * values[at[i]];
                far += weight[i] * values[at[i] + 1];
            }
            return (1 - along) * near + along * far;
        }
    };

    const ConeTransportScene &scene_;
    const ConeTransportSettings &settings_;
    Lattice lattice_;
    std::vector<Ray> rays_;
    Real largest_ = 0;
    int reach_ = 0, band_rows_ = 0, bands_ = 0;
    SlicePlanes planes_[2];  // by the parity of the slice
    std::vector<State> states_;
    Reals in_scattered_, seen_;  // at all held points of the lattice
    std::vector<Workspace> spaces_;
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
