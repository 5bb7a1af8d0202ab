#include "sweep_weights.h"

namespace volillum::sweep_detail {

bool ConstantWeights::any(int direction, const Frame &, const Box &) const {
    const Real *row = weights_ + std::ptrdiff_t(direction) * channels_;
    return std::any_of(row, row + channels_, [](Real weight) { return weight != 0; });
}

const Real *ConstantWeights::single(int direction) const {
    return channels_ == 1 ? weights_ + direction : nullptr;
}

void ConstantWeights::sum(const Batch &batch, const Range &channels, Reals &scratch,
                          const Rows &out) const {
    const std::size_t directions = batch.directions.size();
    // [group][direction][channel of the group], padded with zeros
    const std::size_t group_size = directions * kChannelGroup;
    scratch.assign(std::size_t(round_up(channels.size())) * directions, 0);
    for (int channel = 0; channel < channels.size(); ++channel)
        for (std::size_t d = 0; d < directions; ++d)
            scratch[std::size_t(channel / kChannelGroup) * group_size + d * kChannelGroup +
                    std::size_t(channel % kChannelGroup)] =
                weights_[std::ptrdiff_t(batch.directions[d]) * channels_ + channels.begin +
                         channel];
    batch.tile.for_rows(batch.frame, [&](int t, int b) {
        Ahead ahead = out.ahead(t, b);
        for (int first = 0; first < channels.size(); first += kChannelGroup) {
            weigh_row(batch.values.at(t, b), std::size_t(batch.values.channel_pitch),
                      int(directions),
                      scratch.data() + std::size_t(first / kChannelGroup) * group_size,
                      std::min(kChannelGroup, channels.size() - first), batch.tile.columns.size(),
                      out.add, out.at(t, b) + first * out.channel_pitch, out.channel_pitch, ahead);
            ahead.first += kChannelGroup * ahead.channel_pitch;
        }
    });
}

LatticeWeights::LatticeWeights(const Real *weights, const Index3 &shape, int spacing)
    : weights_(weights), spacing_(spacing) {
    for (int axis = 0; axis < 3; ++axis) nodes_[axis] = weight_nodes(shape[axis], spacing);
    strides_[2] = 1;
    strides_[1] = nodes_[2];
    strides_[0] = std::ptrdiff_t(nodes_[1]) * nodes_[2];
    direction_stride_ = nodes_[0] * strides_[0];
}

bool LatticeWeights::any(int direction, const Frame &frame, const Box &box) const {
    const auto nodes = [&](int axis, int low, int high) {
        return Range{low / spacing_,
                     std::min((high + spacing_ - 1) / spacing_, nodes_[axis] - 1) + 1};
    };
    const int end = frame.index_along_axis(box.slices.begin);
    const int other_end = frame.index_along_axis(box.slices.end - 1);
    const Range a = nodes(frame.axis, std::min(end, other_end), std::max(end, other_end));
    const Range b = nodes(frame.row_axis, box.rows.begin, box.rows.end - 1);
    const Range c = nodes(frame.column_axis, box.columns.begin, box.columns.end - 1);
    for (int i = a.begin; i < a.end; ++i)
        for (int j = b.begin; j < b.end; ++j)
            for (int k = c.begin; k < c.end; ++k)
                if (weights_[direction * direction_stride_ + i * strides_[frame.axis] +
                             j * strides_[frame.row_axis] + k * strides_[frame.column_axis]] != 0)
                    return true;
    return false;
}

const Real *LatticeWeights::single(int) const {
    return nullptr;
}

void LatticeWeights::sum(const Batch &batch, const Range &, Reals &scratch, const Rows &out) const {
    const int count = batch.tile.columns.size(), lanes = round_up(count);
    scratch.assign(2 * std::size_t(lanes), 0);
    Real *sums = scratch.data(), *row_weights = sums + lanes;
    batch.tile.for_rows(batch.frame, [&](int t, int b) {
        Real *row = out.at(t, b);
        if (out.add)
            std::copy(row, row + count, sums);
        else
            std::fill(sums, sums + count, Real(0));
        sum_row(batch, t, b, row_weights, sums);
        std::copy(sums, sums + count, row);
    });
}

void LatticeWeights::row(int direction, const Index3 &first, int axis, int count,
                         Real *row_weights) const {
    // The nodes on both sides of an index along an axis, and the fraction between them.
    struct Between {
        std::ptrdiff_t lower, upper;
        Real fraction;
    };
    const auto between = [&](int along, int index) {
        const int node = index / spacing_;
        return Between{node * strides_[along],
                       std::min(node + 1, nodes_[along] - 1) * strides_[along],
                       Real(index - node * spacing_) / Real(spacing_)};
    };
    const int one = axis == 0 ? 1 : 0, two = axis == 2 ? 1 : 2;
    const Between a = between(one, first[one]), b = between(two, first[two]);
    const Real w00 = (1 - a.fraction) * (1 - b.fraction), w01 = (1 - a.fraction) * b.fraction;
    const Real w10 = a.fraction * (1 - b.fraction), w11 = a.fraction * b.fraction;
    const Real *nodes = weights_ + direction * direction_stride_;
    const auto node_weight = [&](std::ptrdiff_t column) {
        return w00 * nodes[a.lower + b.lower + column] + w01 * nodes[a.lower + b.upper + column] +
               w10 * nodes[a.upper + b.lower + column] + w11 * nodes[a.upper + b.upper + column];
    };
    const int begin = first[axis];
    for (int c = begin; c < begin + count;) {  // one interval between nodes at a time
        const Between column = between(axis, c);
        const int interval = c / spacing_ * spacing_;
        const int end = std::min(begin + count, interval + spacing_);
        const Real low = node_weight(column.lower);
        const Real slope = (node_weight(column.upper) - low) / Real(spacing_);
        for (; c < end; ++c) row_weights[c - begin] = low + slope * Real(c - interval);
    }
}

void LatticeWeights::sum_row(const Batch &batch, int t, int b, Real *row_weights,
                             Real *sums) const {
    const Frame &frame = batch.frame;
    const Range &columns = batch.tile.columns;
    Index3 first;
    first[std::size_t(frame.axis)] = frame.index_along_axis(t);
    first[std::size_t(frame.row_axis)] = b;
    first[std::size_t(frame.column_axis)] = columns.begin;
    for (std::size_t d = 0; d < batch.directions.size(); ++d) {
        row(batch.directions[d], first, frame.column_axis, columns.size(), row_weights);
        multiply_add(batch.values.at(t, b) + std::ptrdiff_t(d) * batch.values.channel_pitch,
                     row_weights, columns.size(), sums);
    }
}

}  // namespace volillum::sweep_detail
