// The march of the sweep: tiles in slabs from the border where rays leave, every direction of a
// frame in one pass, so that sigma_t and the sums are touched once per pass and not per direction.
#include "volillum/sweep.h"

#include <atomic>
#include <memory>
#include <thread>

#include "sweep_lattice.h"
#include "sweep_weights.h"
#include "volillum/parallel.h"

namespace volillum {
namespace sweep_detail {
namespace {

// What a thread keeps between tiles.
struct Workspace {
    Block block, tail;
    RaySums sums;
    Scratch scratch;
    std::vector<int> active;
    Reals values, weights, plane;
};

class Run {
public:
    Run(const SweepScene &scene, const SweepSettings &settings, const Weights &weights, Real *out)
        : scene_(scene), settings_(settings), weights_(weights), out_(out) {}

    void all_passes() {
        const std::vector<Pass> passes = plan_passes(scene_, settings_);
        for (const Pass &pass : passes)
            for (const Direction &direction : pass.directions)
                longest_step_ = std::max(longest_step_, double(direction.slice_length));
        // Keeps every optical depth, and with it every sum, finite whatever the input.
        const double steps =
            2.0 * (std::max({scene_.shape[0], scene_.shape[1], scene_.shape[2]}) + 2);
        largest_ = Real(std::min(1e30, 1e36 / (steps * std::max(1.0, longest_step_))));
        std::size_t directions_done = 0;
        workspaces_.resize(std::size_t(thread_count(settings_.threads)));
        for (const Pass &pass : passes) {
            if (pass.frame.transposed() && !transposed_) transpose_medium();
            if (!pass.frame.transposed() && transposed_) transpose_output();
            // The lattice planes of all directions at once may take as much as the grid.
            const std::size_t at_once = directions_at_once(pass.frame);
            for (std::size_t first = 0; first < pass.directions.size(); first += at_once) {
                const std::size_t end = std::min(first + at_once, pass.directions.size());
                const Pass part{pass.frame,
                                pass.near_slices,
                                {pass.directions.begin() + std::ptrdiff_t(first),
                                 pass.directions.begin() + std::ptrdiff_t(end)}};
                march_pass(part, double(directions_done) / scene_.count,
                           double(directions_done + end - first) / scene_.count);
                directions_done += end - first;
            }
        }
        if (transposed_) transpose_output();
    }

private:
    // Passes along k see all arrays with j and k exchanged: sigma_t in a copy, the output in its
    // own memory, plane by plane, exchanged back when they are done.
    void transpose_medium() {
        transposed_ = std::make_unique_for_overwrite<Real[]>(std::size_t(voxels()));
        const std::ptrdiff_t plane = voxels() / scene_.shape[0];
        parallel_for(std::size_t(scene_.shape[0]), settings_.threads, nullptr,
                     [&](std::size_t i, int) {
                         const std::ptrdiff_t offset = std::ptrdiff_t(i) * plane;
                         transpose(scene_.sigma_t + offset, scene_.shape[1], scene_.shape[2],
                                   transposed_.get() + offset);
                     });
    }
    void transpose_output() {
        const std::ptrdiff_t plane = voxels() / scene_.shape[0];
        parallel_for(std::size_t(scene_.shape[0]) * std::size_t(weights_.channels()),
                     settings_.threads, nullptr, [&](std::size_t item, int thread) {
                         Real *values = out_ + std::ptrdiff_t(item) * plane;
                         Reals &copy = workspaces_[std::size_t(thread)].plane;
                         copy.assign(values, values + plane);
                         transpose(copy.data(), scene_.shape[2], scene_.shape[1], values);
                     });
        for (Workspace &space : workspaces_) space.plane = Reals();
        transposed_.reset();
    }
    std::ptrdiff_t voxels() const {
        return std::ptrdiff_t(scene_.shape[0]) * scene_.shape[1] * scene_.shape[2];
    }
    const Real *sigma_t(const Frame &frame) const {
        return frame.transposed() ? transposed_.get() : scene_.sigma_t;
    }

    std::size_t directions_at_once(const Frame &frame) const {
        const std::size_t planes = LatticePlanes::reals(frame);
        const std::size_t grid =
            std::size_t(frame.slices) * std::size_t(frame.rows) * std::size_t(frame.columns);
        return std::max<std::size_t>(1, grid / planes);
    }

    void march_pass(const Pass &pass, double progress_begin, double progress_end) {
        const Tiling tiling(pass.frame, pass.directions.size());
        std::vector<LatticePlanes> planes(pass.directions.size());
        if (tiling.slabs > 1)
            for (LatticePlanes &plane : planes) plane.resize(pass.frame);
        const Needs needs(pass, tiling, weights_);
        const std::size_t tiles = std::size_t(tiling.row_tiles) * std::size_t(tiling.column_tiles);
        const std::size_t items = tiles * std::size_t(tiling.slabs);
        std::vector<std::atomic<int>> slabs_done(tiles);
        std::atomic<std::size_t> items_done{0};
        std::atomic<bool> aborted{false};
        parallel_for(items, settings_.threads, nullptr, [&](std::size_t item, int thread) {
            if (aborted.load()) return;
            try {
                const int slab = int(item / tiles), tile = int(item % tiles);
                const auto wait_for = [&](int other) {
                    while (slabs_done[std::size_t(other)].load(std::memory_order_acquire) < slab) {
                        if (aborted.load()) return false;
                        if (cancelled()) throw Cancelled();
                        std::this_thread::yield();
                    }
                    return true;
                };
                if (cancelled()) throw Cancelled();
                // Items are handed out slab by slab, so what we wait for is already running.
                if (slab > 0 && !tiling.all_of_sources(tile, wait_for)) return;
                march_tile(pass, tiling, needs, planes, slab, tile,
                           workspaces_[std::size_t(thread)]);
                slabs_done[std::size_t(tile)].store(slab + 1, std::memory_order_release);
                if (settings_.control)
                    settings_.control->set_progress(
                        progress_begin + (progress_end - progress_begin) *
                                             double(items_done.fetch_add(1) + 1) / double(items));
            } catch (...) {
                aborted.store(true);
                throw;
            }
        });
        written_ = true;
    }

    bool cancelled() const { return settings_.control && settings_.control->cancelled(); }

    void march_tile(const Pass &pass, const Tiling &tiling, const Needs &needs,
                    std::vector<LatticePlanes> &planes, int slab, int tile, Workspace &space) {
        const Box box = tiling.box(slab, tile);
        if (!needs.any(slab, tile)) {
            if (!written_) clear(pass.frame, box);
            return;
        }
        const bool filled =
            space.block.load(pass.frame, sigma_t(pass.frame), largest_, tiling.reach(box, pass));
        const int lanes = round_up(box.columns.size());
        const std::size_t tile_voxels = std::size_t(box.slices.size() * box.rows.size() * lanes);
        space.values.resize(tile_voxels *
                            std::min(std::size_t(tiling.batch), pass.directions.size()));
        bool add = written_;
        for (std::size_t first = 0; first < pass.directions.size();
             first += std::size_t(tiling.batch)) {
            const std::size_t end =
                std::min(first + std::size_t(tiling.batch), pass.directions.size());
            space.active.clear();
            for (std::size_t d = first; d < end; ++d) {
                const Need need = needs.of(slab, tile, d);
                if (need == Need::nothing) continue;
                Real *values = nullptr;
                if (need == Need::values) {
                    values = space.values.data() + tile_voxels * space.active.size();
                    space.active.push_back(pass.directions[d].index);
                }
                march_direction(pass, d, box, tiling, filled, slab, planes[d], values, space);
            }
            if (space.active.empty()) continue;
            weights_.sum({pass.frame, box, space.active, space.values.data(), tile_voxels, lanes},
                         add, space.weights, out_, voxels());
            add = true;
        }
        if (!add) clear(pass.frame, box);
    }

    // The first pass writes every voxel, also those that no direction counts for.
    void clear(const Frame &frame, const Box &box) {
        for (int channel = 0; channel < weights_.channels(); ++channel)
            for (int t = box.slices.begin; t < box.slices.end; ++t)
                for (int b = box.rows.begin; b < box.rows.end; ++b)
                    std::fill_n(out_ + channel * voxels() + frame.element(t, b, box.columns.begin),
                                box.columns.size(), Real(0));
    }

    void march_direction(const Pass &pass, std::size_t d, const Box &box, const Tiling &tiling,
                         bool filled, int slab, LatticePlanes &planes, Real *values,
                         Workspace &space) {
        const Direction &direction = pass.directions[d];
        space.sums.reset(rays_of(direction, box));
        const bool lit = slab > 0 && direction.has_far_field &&
                         planes.load(slab, direction.crossing(box.slices.begin - 1), space.sums);
        const Block *tail = nullptr;
        if (direction.has_far_field && direction.finite) {
            const int last = box.slices.end - 1 - pass.near_slices - direction.tail;
            if (last >= 0) {
                space.tail.load(pass.frame, sigma_t(pass.frame), largest_,
                                tail_reach(direction, box, pass, space.sums));
                tail = &space.tail;
            }
        }
        const bool empty = !filled && !lit && !tail;
        if (!empty)
            march({direction, box, space.block, tail, pass.near_slices, settings_.quantity,
                   space.sums, space.scratch, values});
        else if (values)
            std::fill_n(
                values,
                std::size_t(box.slices.size() * box.rows.size() * round_up(box.columns.size())),
                settings_.quantity == Quantity::transmittance ? Real(1) : Real(0));
        if (slab + 1 < tiling.slabs && direction.has_far_field)
            planes.store(slab, direction.crossing(box.slices.end - 1), box, space.sums);
    }

    const SweepScene &scene_;
    const SweepSettings &settings_;
    const Weights &weights_;
    Real *out_;
    std::unique_ptr<Real[]> transposed_;
    Real largest_ = 0;
    double longest_step_ = 0.0;
    bool written_ = false;  // whether an earlier pass has written the whole output
    std::vector<Workspace> workspaces_;
};

}  // namespace
}  // namespace sweep_detail

void sweep(const SweepScene &scene, const Real *weights, int channels,
           const SweepSettings &settings, Real *out) {
    const sweep_detail::ConstantWeights constant(weights, channels);
    sweep_detail::Run(scene, settings, constant, out).all_passes();
}

void sweep_weighted(const SweepScene &scene, const Real *weights, int spacing,
                    const SweepSettings &settings, Real *out) {
    const sweep_detail::LatticeWeights lattice(weights, scene.shape, spacing);
    sweep_detail::Run(scene, settings, lattice, out).all_passes();
}

}  // namespace volillum
