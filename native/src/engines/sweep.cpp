// The march of the sweep: tiles in slabs from the border where rays leave, every direction of a
// frame in one pass, so that sigma_t and the sums are touched once per pass and not per direction.
#include "volillum/sweep.h"

#include <atomic>
#include <thread>

#include "sweep_workspace.h"
#include "volillum/pages.h"
#include "volillum/parallel.h"

namespace volillum {
namespace sweep_detail {
namespace {

// Measured on 256^3: 34 directions' planes in the third-level cache, and where touching the output
// once more costs more than planes that are not.
constexpr std::size_t kCachedPlanes = std::size_t(18) << 20, kDirectionsPerChannel = 4;

class Run {
public:
    Run(const SweepScene &scene, const SweepSettings &settings, const Weights &weights, Real *out)
        : scene_(scene),
          settings_(settings),
          weights_(weights),
          out_(out, settings.channel_pitch ? settings.channel_pitch : voxels()),
          written_(settings.add) {}

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
            const std::size_t at_once = directions_at_once(pass);
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
    }

    bool many() const { return std::size_t(scene_.count) > kFewDirections; }

private:
    std::ptrdiff_t voxels() const {
        return std::ptrdiff_t(scene_.shape[0]) * scene_.shape[1] * scene_.shape[2];
    }

    // The lattice planes of the directions at once should stay in the cache, unless what each part
    // of the directions does once more takes longer than that saves: touching all channels of the
    // output, or transposing tiles. They may take as much as the grid. Parts are equal.
    std::size_t directions_at_once(const Pass &pass) const {
        const std::size_t count = pass.directions.size();
        const std::size_t reals = LatticePlanes::reals(pass.frame, pass.any_finite());
        const std::size_t best =
            pass.frame.transposed()
                ? count
                : std::max(kCachedPlanes / (reals * sizeof(Real)),
                           kDirectionsPerChannel * std::size_t(weights_.channels()));
        const std::size_t most =
            std::max<std::size_t>(1, std::min(best, std::size_t(voxels()) / reals));
        const std::size_t parts = (count + most - 1) / most;
        return (count + parts - 1) / parts;
    }

    void march_pass(const Pass &pass, double progress_begin, double progress_end) {
        const Tiling tiling(pass, weights_.single(0) ? 0 : int(workspaces_.size()));
        if (many())
            for (Workspace &space : workspaces_)
                space.reserve(pass, tiling, weights_.single(0) ? 0 : kBatch);
        std::vector<LatticePlanes> planes(pass.directions.size());
        if (tiling.slabs > 1)
            for (std::size_t d = 0; d < planes.size(); ++d)
                planes[d].resize(tiling, pass.directions[d].finite);
        const Box wanted = box_of(pass.frame, settings_.wanted_begin, settings_.wanted_end);
        const Needs needs(pass, tiling, weights_, wanted);
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
                march_tile(pass, tiling, needs, wanted, planes, slab, tile,
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

    // One tile of a pass, and what a thread needs to march through it.
    struct Tile {
        const Pass &pass;
        const Tiling &tiling;
        const Needs &needs;
        std::vector<LatticePlanes> &planes;
        int slab, index;
        Box box, wanted;
        bool filled;  // whether sigma_t differs from 0 anywhere in its reach
        Workspace &space;
        Need need(std::size_t direction) const { return needs.of(slab, index, direction); }
    };

    void march_tile(const Pass &pass, const Tiling &tiling, const Needs &needs, const Box &wanted,
                    std::vector<LatticePlanes> &planes, int slab, int index, Workspace &space) {
        const Box box = tiling.box(slab, index), own = box.common(wanted);
        const bool filled =
            !tiling.in_pieces && needs.any(slab, index) &&
            space.block.load(pass.frame, scene_.sigma_t, largest_, tiling.reach(box, pass));
        const Tile tile{pass, tiling, needs, planes, slab, index, box, own, filled, space};
        if (weights_.single(0))
            sum_at_once(tile);
        else
            sum_batches(tile);
    }

    // One weight a direction: each adds itself to the output.
    void sum_at_once(const Tile &tile) {
        const Frame &frame = tile.pass.frame;
        const bool apart = tile.pass.directions.size() > kFewDirections;
        Rows rows = out_.rows(frame, tile.wanted, {0, 1}, written_, apart, tile.space.result);
        double in_the_clear = 0;  // the sum over directions along which there is nothing
        for (std::size_t d = 0; d < tile.pass.directions.size(); ++d) {
            if (tile.need(d) == Need::nothing) continue;
            Rows of_direction = rows;
            if (tile.need(d) == Need::sums) of_direction.first = nullptr;
            const Real weight = *weights_.single(tile.pass.directions[d].index);
            const bool marched = march_direction(tile, d, weight, of_direction);
            if (!of_direction.first) continue;
            if (marched)
                rows.add = true;
            else
                in_the_clear += weight * empty_value();
        }
        if (in_the_clear == 0 && !rows.add && written_) return;  // there is nothing to add
        if (in_the_clear != 0 || !rows.add) fill(tile.wanted, Real(in_the_clear), rows);
        out_.deliver(frame, tile.wanted, {0, 1}, written_, rows);
    }

    // Some directions' values first, and then their weighted sums: each number of the output is
    // touched once a batch, and each value serves all channels.
    void sum_batches(const Tile &tile) {
        const std::vector<Direction> &directions = tile.pass.directions;
        const std::size_t batch = std::min<std::size_t>(kBatch, directions.size());
        const Box &box = tile.wanted;
        const Rows values = rows_of_values(box, batch, tile.space.values);
        const Frame &frame = tile.pass.frame;
        bool add = written_;
        const auto write = [&](const auto &sums) {
            Output::for_parts(
                frame, box, weights_.channels(), [&](const Box &part, const Range &channels) {
                    const Rows rows =
                        out_.rows(frame, part, channels, add, false, tile.space.result);
                    sums(part, channels, rows);
                    out_.deliver(frame, part, channels, add, rows);
                });
            add = true;
        };
        for (std::size_t first = 0; first < directions.size(); first += batch) {
            std::vector<int> &active = tile.space.active;
            active.clear();
            for (std::size_t d = first; d < std::min(first + batch, directions.size()); ++d) {
                if (tile.need(d) == Need::nothing) continue;
                Rows of_direction = values;
                of_direction.first += values.channel_pitch * std::ptrdiff_t(active.size());
                if (tile.need(d) == Need::sums) of_direction.first = nullptr;
                const bool marched = march_direction(tile, d, 1, of_direction);
                if (!of_direction.first) continue;
                if (!marched) fill(box, empty_value(), of_direction);
                active.push_back(directions[d].index);
            }
            if (!active.empty())
                write([&](const Box &part, const Range &channels, const Rows &rows) {
                    weights_.sum({frame, part, active, values}, channels, tile.space.weights, rows);
                });
        }
        if (!add)
            write([](const Box &part, const Range &channels, Rows rows) {
                for (int channel = channels.begin; channel < channels.end; ++channel) {
                    fill(part, 0, rows);
                    rows.first += rows.channel_pitch;
                }
            });
    }

    // What the quantity is where there is nothing.
    Real empty_value() const { return settings_.quantity == Quantity::transmittance ? 1 : 0; }

    static void fill(const Box &box, Real value, const Rows &rows) {
        for (int t = box.slices.begin; t < box.slices.end; ++t)
            for (int b = box.rows.begin; b < box.rows.end; ++b)
                emit_constant(value, box.columns.size(), rows.add, rows.at(t, b));
    }

    // Returns false, with nothing written, where there is nothing along the direction.
    bool march_direction(const Tile &tile, std::size_t d, Real weight, const Rows &rows) {
        const Pass &pass = tile.pass;
        const Direction &direction = pass.directions[d];
        const RayRanges rays = rays_of(direction, tile.box);
        LatticePlanes *planes =
            tile.tiling.slabs > 1 && direction.has_far_field ? &tile.planes[d] : nullptr;
        const bool lit =
            planes && tile.slab > 0 &&
            planes->any(tile.slab, direction.crossing(tile.box.slices.begin - 1), rays);
        const auto load = [&](Block &block, int distance) {
            return block.load(pass.frame, scene_.sigma_t, largest_,
                              reach_outward(direction, tile.box, distance, rays));
        };
        Workspace &space = tile.space;
        bool filled = tile.filled;
        if (tile.tiling.in_pieces) {
            if (rows.first)
                filled = space.near.sum(pass.frame, scene_.sigma_t, largest_, direction,
                                        unit_of(settings_.quantity), tile.wanted);
            if (direction.has_far_field) filled |= load(space.block, pass.near_slices);
        }
        const Block *tail = nullptr;
        if (direction.has_far_field && direction.finite) {
            const int distance = pass.near_slices + direction.tail;
            if (tile.box.slices.end - 1 - distance >= 0) {
                load(space.tail, distance);
                tail = &space.tail;
            }
        }
        if (!filled && !lit && !tail) {
            if (planes) planes->clear(tile.slab, tile.box);
            return false;
        }
        march({direction, rays, tile.box, tile.wanted, tile.slab, planes, space.block,
               tile.tiling.in_pieces ? &space.near : nullptr, tail, pass.near_slices,
               settings_.quantity, weight, rows, space.march});
        return true;
    }

    const SweepScene &scene_;
    const SweepSettings &settings_;
    const Weights &weights_;
    const Output out_;
    Real largest_ = 0;
    double longest_step_ = 0.0;
    bool written_;  // whether the whole output holds what is to be added to
    std::vector<Workspace> workspaces_;
};

}  // namespace

void sweep_with(const SweepScene &scene, const Weights &weights, const SweepSettings &settings,
                Real *out) {
    Run run(scene, settings, weights, out);
    if (run.many()) trim_malloc();  // of what the caller has left behind, too
    run.all_passes();
    if (run.many()) trim_malloc();
}

}  // namespace sweep_detail

void sweep(const SweepScene &scene, const Real *weights, int channels,
           const SweepSettings &settings, Real *out) {
    sweep_detail::sweep_with(scene, sweep_detail::ConstantWeights(weights, channels), settings,
                             out);
}

void sweep_weighted(const SweepScene &scene, const Real *weights, int spacing,
                    const SweepSettings &settings, Real *out) {
    sweep_detail::sweep_with(scene, sweep_detail::LatticeWeights(weights, scene.shape, spacing),
                             settings, out);
}

}  // namespace volillum
