// The march of the radiance sweep. For a direction, rays through the grid points of slices across
// its major axis form a sheared lattice; radiance is carried along the lattice rays and
// interpolated once to where a voxel's own ray leaves its near field. Bands of lattice rows are
// independent.
#include "volillum/radiance_sweep.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "radiance_march.h"
#include "sweep_weights.h"
#include "volillum/pages.h"
#include "volillum/parallel.h"

namespace volillum {
namespace radiance_detail {
namespace {

constexpr int kBandRows = 16;

// What a thread keeps: a band of lattice rays, and a row of voxels.
struct Workspace {
    Reals radiance, samples;           // [row][3 or channels][width] of the lattice rays
    std::vector<unsigned char> dense;  // whether the row's last sample held anything
    Reals sample, near, far, row;      // [channels or 3][columns]
    Reals row_weights;                 // of a row of voxels
    std::vector<const Real *> rows;
    std::vector<Real> weights;
};

// One direction: what its bands share.
struct Sweep {
    const Layers &layers;
    const Direction &direction;
    const RadianceScene &scene;
    int near_slices;
    const sweep_detail::LatticeWeights *local;  // null: `weight` everywhere
    Real weight;
    Real *out;  // in the layout of the frame: columns contiguous
    std::ptrdiff_t out_slice, out_row, volume;
    int first_row, first_column, width;  // of the lattice rays

    int index(int t) const { return direction.forward ? layers.slices - 1 - t : t; }
    Real length(double slices) const { return static_cast<Real>(slices * direction.slice_length); }
};

class Band {
public:
    Band(const Sweep &sweep, int row_begin, int row_end, Workspace &space)
        : s_(sweep), begin_(row_begin), end_(row_end), w_(space), channels_(sweep.layers.channels) {
        const std::size_t rows = std::size_t(end_ - begin_);
        const std::size_t width = std::size_t(s_.width);
        w_.radiance.resize(rows * 3 * width);
        for (std::size_t row = 0; row < rows; ++row)
            for (std::size_t k = 0; k < 3; ++k)
                std::fill_n(w_.radiance.data() + (row * 3 + k) * width, width,
                            static_cast<Real>(s_.scene.hue[k]));
        w_.samples.assign(rows * std::size_t(channels_) * width, 0);
        w_.dense.assign(rows, 0);
        stride_ = round_up(s_.layers.columns + 1) + kLanes;
        for (Reals *buffer : {&w_.sample, &w_.near, &w_.far, &w_.row})
            buffer->resize(std::size_t(channels_) * std::size_t(stride_));
        w_.row_weights.assign(std::size_t(stride_), s_.weight);
        for (int k = 0; k < 3; ++k) hue_[k] = static_cast<Real>(s_.scene.hue[std::size_t(k)]);
    }

    // The first row of rays belongs to the band before, too: voxels lie between two.
    void run() {
        for (int t = 0; t < s_.layers.slices; ++t) {
            const int far = t - s_.near_slices;
            for (int u = begin_; far >= 0 && u < end_; ++u) advance(u, far);
            const Crossing crossing = s_.direction.crossing(t);
            const int first = std::max(begin_ + 1 + crossing.row, 0);
            const int last = std::min(end_ + crossing.row, s_.layers.rows);
            for (int b = first; b < last; ++b) finish(t, b, crossing);
        }
    }

private:
    Real *radiance(int u) { return w_.radiance.data() + std::ptrdiff_t(u - begin_) * 3 * s_.width; }

    // Carries the rays of lattice row u to slice t.
    void advance(int u, int t) {
        const Crossing crossing = s_.direction.crossing(t);
        const int b = u + crossing.row, index = s_.index(t);
        if (b < -1 || b >= s_.layers.rows) return;
        unsigned char &dense = w_.dense[std::size_t(u - begin_)];
        const bool filled = s_.layers.filled(index, b) || s_.layers.filled(index, b + 1);
        if (!filled && !dense) return;
        // The rays whose left column is -1 .. columns - 1.
        const int columns = s_.layers.columns + 1;
        const std::ptrdiff_t v = -1 - crossing.column - s_.first_column;
        const Real f = crossing.row_fraction, g = crossing.column_fraction;
        const Real *upper = s_.layers.row(index, b) - 1, *lower = s_.layers.row(index, b + 1) - 1;
        const Real *rows[4] = {upper, upper + 1, lower, lower + 1};
        const Real weights[4] = {(1 - f) * (1 - g), (1 - f) * g, f * (1 - g), f * g};
        take_sample({rows, weights, 4, s_.layers.pitch()}, channels_, columns, stride_,
                    w_.near.data());
        Real *last = w_.samples.data() + std::ptrdiff_t(u - begin_) * channels_ * s_.width + v;
        copy(last, s_.width, channels_, columns, w_.far.data(), stride_);
        copy(radiance(u) + v, s_.width, 3, columns, w_.row.data(), stride_);
        step({w_.near.data(), w_.far.data(), s_.scene.extinction_channels, columns, stride_,
              s_.length(1.0)},
             w_.row.data());
        copy(w_.row.data(), stride_, 3, columns, radiance(u) + v, s_.width);
        copy(w_.near.data(), stride_, channels_, columns, last, s_.width);
        dense = filled;
    }

    static void copy(const Real *from, std::ptrdiff_t from_stride, int channels, int columns,
                     Real *to, std::ptrdiff_t to_stride) {
        for (int k = 0; k < channels; ++k)
            std::copy_n(from + k * from_stride, columns, to + k * to_stride);
    }

    // The voxels of row b of slice t: lattice rays as far as the near field, then their own.
    void finish(int t, int b, const Crossing &crossing) {
        const int u = b - crossing.row, columns = s_.layers.columns;
        const std::ptrdiff_t v = -crossing.column - 1 - s_.first_column;
        unshear(radiance(u - 1) + v, radiance(u) + v, s_.width, crossing, columns, stride_,
                w_.row.data());
        const std::vector<Node> &nodes = s_.direction.near_field;
        bool far_filled = false;
        for (std::size_t node = nodes.size(); node-- > 0;) {
            const bool filled = sample_node(nodes[node], t, b);
            if (node + 1 < nodes.size() && (filled || far_filled))
                step({w_.near.data(), w_.far.data(), s_.scene.extinction_channels, columns, stride_,
                      s_.length(nodes[node + 1].distance - nodes[node].distance)},
                     w_.row.data());
            std::swap(w_.near, w_.far);
            far_filled = filled;
        }
        if (s_.local) {
            // Slices, rows and columns of the frame, as voxels.
            const Layers &layers = s_.layers;
            Index3 first{};
            first[std::size_t(layers.axis)] = s_.index(t);
            first[std::size_t(layers.row_axis)] = b;
            s_.local->row(s_.direction.index, first, layers.column_axis, columns,
                          w_.row_weights.data());
        }
        add_hue(w_.row.data(), stride_, columns, hue_, w_.row_weights.data(),
                s_.out + s_.index(t) * s_.out_slice + b * s_.out_row, s_.volume);
    }

    bool sample_node(const Node &node, int t, int b) {
        w_.rows.clear();
        w_.weights.clear();
        bool filled = false;
        for (const Tap &tap : node.taps) {
            const int slice = t - tap.slices_outward;
            const int index = s_.index(slice);
            if (!s_.layers.filled(index, b + tap.row)) continue;
            filled = true;
            w_.rows.push_back(s_.layers.row(index, b + tap.row) + tap.column);
            w_.weights.push_back(tap.weight);
        }
        take_sample({w_.rows.data(), w_.weights.data(), int(w_.rows.size()), s_.layers.pitch()},
                    channels_, s_.layers.columns, stride_, w_.near.data());
        return filled;
    }

    const Sweep &s_;
    int begin_, end_;
    Workspace &w_;
    int channels_;
    std::ptrdiff_t stride_ = 0;
    Real hue_[3] = {};
};

// Lattice rows and columns of which a voxel or its neighbour lies on some slice.
void span(const Direction &direction, int slices, int rows, int columns, Sweep &sweep,
          int &row_count) {
    const Crossing near = direction.crossing(0), far = direction.crossing(slices - 1);
    const auto [row_low, row_high] = std::minmax(near.row, far.row);
    const auto [column_low, column_high] = std::minmax(near.column, far.column);
    sweep.first_row = -1 - row_high;
    row_count = rows - row_low - sweep.first_row;
    sweep.first_column = -1 - column_high;
    sweep.width = round_up(columns - column_low - sweep.first_column) + 2 * kLanes;
}

// Exchanges the last two axes of volumes [planes][rows][columns], in place.
void transpose_planes(Real *data, std::ptrdiff_t planes, int rows, int columns, int threads) {
    const std::ptrdiff_t size = std::ptrdiff_t(rows) * columns;
    parallel_for(std::size_t(planes), threads, nullptr, [&](std::size_t plane, int) {
        Real *values = data + std::ptrdiff_t(plane) * size;
        const Reals copy(values, values + size);
        for (int row = 0; row < rows; ++row)
            for (int column = 0; column < columns; ++column)
                values[column * rows + row] = copy[std::size_t(row * columns + column)];
    });
}

}  // namespace
}  // namespace radiance_detail

void mean_hue(const RadianceScene &scene, const Real *weights, int node_spacing,
              const RadianceSettings &settings, Real *out) {
    using namespace radiance_detail;
    const auto plan = plan_directions(scene, settings.near_slices);
    trim_malloc();  // a shadow's sweep comes before, of one direction
    const Index3 &shape = scene.shape;
    const std::ptrdiff_t volume = std::ptrdiff_t(shape[0]) * shape[1] * shape[2];
    std::fill_n(out, 3 * volume, Real(0));
    std::vector<Workspace> workspaces(std::size_t(thread_count(settings.threads)));
    std::optional<sweep_detail::LatticeWeights> local;
    if (node_spacing > 0) local.emplace(weights, shape, node_spacing);
    int done = 0;
    // Passes along k write with j and k exchanged; they come first, onto zeros.
    for (const int axis : {2, 0, 1}) {
        if (plan[std::size_t(axis)].empty()) continue;
        double longest = 0.0;
        for (const Direction &direction : plan[std::size_t(axis)])
            longest = std::max(longest, direction.slice_length);
        const int near_slices = std::min(settings.near_slices, shape[std::size_t(axis)]);
        const Layers layers(scene, axis, near_slices, longest, settings.threads);
        for (const Direction &direction : plan[std::size_t(axis)]) {
            Sweep sweep{layers,
                        direction,
                        scene,
                        near_slices,
                        local ? &*local : nullptr,
                        local ? Real(1) : weights[direction.index],
                        out,
                        0,
                        0,
                        volume,
                        0,
                        0,
                        0};
            const std::ptrdiff_t plane = std::ptrdiff_t(shape[1]) * shape[2];
            sweep.out_slice = axis == 0 ? plane : layers.columns;
            sweep.out_row = axis == 0 ? layers.columns : plane;
            int rows = 0;
            span(direction, layers.slices, layers.rows, layers.columns, sweep, rows);
            const int bands = (rows - 1 + kBandRows - 1) / kBandRows;
            parallel_for(
                std::size_t(bands), settings.threads, settings.control,
                [&](std::size_t band, int thread) {
                    const int begin = sweep.first_row + int(band) * kBandRows;
                    const int end = std::min(begin + kBandRows + 1, sweep.first_row + rows);
                    Band(sweep, begin, end, workspaces[std::size_t(thread)]).run();
                },
                double(done) / scene.count, double(done + 1) / scene.count);
            ++done;
        }
        if (axis == 2) transpose_planes(out, 3 * shape[0], shape[2], shape[1], settings.threads);
    }
}

}  // namespace volillum
