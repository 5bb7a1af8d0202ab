// The weights with which the directions of a sweep are summed at each voxel.
#pragma once

#include "sweep_tile.h"

namespace volillum::sweep_detail {

// A batch of directions' results in one tile: value of direction d at slice t, row b, padded column
// c is values.at(t, b)[d * values.channel_pitch + c].
struct Batch {
    const Frame &frame;
    const Box &tile;
    const std::vector<int> &directions;  // indices into the caller's list
    const Rows &values;
};

class Weights {
public:
    virtual ~Weights() = default;
    virtual int channels() const = 0;
    // Whether a direction counts for any voxel of a box of a frame.
    virtual bool any(int direction, const Frame &frame, const Box &box) const = 0;
    // Where there is one channel: a direction's weight, null if it varies from voxel to voxel.
    virtual const Real *single(int direction) const = 0;
    // Adds a batch's weighted sums to the output's rows: those of the channels of a range, of which
    // the first one's rows are given. A range is a group of kChannelGroup, or all.
    virtual void sum(const Batch &batch, const Range &channels, Reals &scratch,
                     const Rows &out) const = 0;
};

// The same weights [d, c] at every voxel.
class ConstantWeights : public Weights {
public:
    ConstantWeights(const Real *weights, int channels) : weights_(weights), channels_(channels) {}
    int channels() const override { return channels_; }
    bool any(int direction, const Frame &, const Box &) const override;
    const Real *single(int direction) const override;
    void sum(const Batch &batch, const Range &channels, Reals &scratch,
             const Rows &out) const override;

private:
    const Real *weights_;
    int channels_;
};

// Trilinear between nodes [d, a, b, c] at the voxels (a, b, c) * spacing.
class LatticeWeights : public Weights {
public:
    LatticeWeights(const Real *weights, const Index3 &shape, int spacing);
    int channels() const override { return 1; }
    bool any(int direction, const Frame &frame, const Box &box) const override;
    const Real *single(int direction) const override;
    void sum(const Batch &batch, const Range &channels, Reals &scratch,
             const Rows &out) const override;
    // A direction's weights at the `count` voxels from `first` on along an axis.
    void row(int direction, const Index3 &first, int axis, int count, Real *row_weights) const;

private:
    void sum_row(const Batch &batch, int t, int b, Real *row_weights, Real *sums) const;
    const Real *weights_;
    int spacing_;
    Index3 nodes_;
    std::ptrdiff_t strides_[3], direction_stride_;
};

// The sweep with any weights: out is [weights.channels(), n0, n1, n2].
void sweep_with(const SweepScene &scene, const Weights &weights, const SweepSettings &settings,
                Real *out);

}  // namespace volillum::sweep_detail
