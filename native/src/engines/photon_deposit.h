// Flights written into voxels: how far each one goes through every voxel's box.
#pragma once

#include <limits>
#include <utility>

#include "photon_field.h"

namespace volillum {

// One thread's deposits of one pass: 32-bit integers, so that the sum over threads depends on no
// order, and a list of the rare overflows.
class Deposits {
public:
    // A voxel diagonal at weight 1 is this many units: rounding costs 1e-6 of it, and a voxel
    // overflows after some thousand deposits.
    static constexpr float unit = 0x1p20f;

    explicit Deposits(std::size_t size) : values_(size, 0) {}

    VOLILLUM_INLINE void add(std::size_t index, float value) {
        std::int32_t sum;
        if (__builtin_add_overflow(values_[index], std::int32_t(std::lrintf(value)), &sum))
            spill(index, value);
        values_[index] = sum;
    }
    std::int32_t *values() { return values_.data(); }
    std::size_t size() const { return values_.size(); }

    using Spill = std::pair<std::size_t, std::int64_t>;
    std::vector<Spill> spilled;

private:
    // The wrapped sum lacks 2^32 in the direction of what was added.
    [[gnu::noinline]] void spill(std::size_t index, float value) {
        spilled.emplace_back(index,
                             value > 0.0f ? std::int64_t(1) << 32 : -(std::int64_t(1) << 32));
    }
    std::vector<std::int32_t> values_;
};

struct Flight {
    float start[3], step[3], inverse[3];  // q, q per world unit, and its reciprocals (finite)
};

// Calls visit(voxel, length) for every box [i - 1/2, i + 1/2] that the flight crosses in [0, end];
// `end` may be infinite.
template <class Visit>
VOLILLUM_INLINE void walk_boxes(const PhotonField &field, const Flight &flight, float end,
                                Visit &&visit) {
    constexpr float never = std::numeric_limits<float>::infinity();
    float begin = 0.0f, p[3];
    for (int a = 0; a < 3; ++a) {
        p[a] = flight.start[a] - 0.5f;  // box i is [i, i + 1]
        const float s = -p[a] * flight.inverse[a],
                    t = (float(field.shape[a]) - p[a]) * flight.inverse[a];
        begin = std::max(begin, std::min(s, t));
        end = std::min(end, std::max(s, t));
    }
    if (!(begin < end)) return;
    float plane[3], next[3], side[3];
    int left[3];
    std::ptrdiff_t stride[3] = {std::ptrdiff_t(field.stride[0]), std::ptrdiff_t(field.stride[1]),
                                1};
    std::ptrdiff_t voxel = 0;
    for (int a = 0; a < 3; ++a) {
        const bool up = flight.step[a] > 0.0f;
        const int most = field.shape[a] - 1;
        const int first = std::min(std::max(int(p[a] + begin * flight.step[a]), 0), most);
        const int last = std::min(std::max(int(p[a] + end * flight.step[a]), 0), most);
        voxel += first * stride[a];
        // Crossings are counted from the ends, so that rounding cannot lead out of the grid.
        left[a] = up ? last - first : first - last;
        side[a] = up ? 1.0f : -1.0f;
        plane[a] = float(first + (up ? 1 : 0));
        next[a] = left[a] > 0 ? (plane[a] - p[a]) * flight.inverse[a] : never;
        if (!up) stride[a] = -stride[a];
    }
    float t = begin;
    for (;;) {
        const int a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
        const float reached = next[a], until = std::min(reached, end);
        if (until > t) {
            visit(std::size_t(voxel), until - t);
            t = until;
        }
        if (reached == never) return;
        voxel += stride[a];
        plane[a] += side[a];
        next[a] = --left[a] > 0 ? (plane[a] - p[a]) * flight.inverse[a] : never;
    }
}

// The kernel: a ball about a point, in voxels of any shape.
struct Ball {
    float radius2, reach[3];  // squared, world units; half extent in q
    float columns[3][3];      // world vectors of the index axes

    // Calls visit(voxel) for every voxel whose centre is in the ball about q.
    template <class Visit>
    void visit(const PhotonField &field, const float *q, Visit &&visit) const {
        int low[3], high[3];
        for (int a = 0; a < 3; ++a) {
            low[a] = std::max(int(std::ceil(q[a] - 1.0f - reach[a])), 0);
            high[a] = std::min(int(std::floor(q[a] - 1.0f + reach[a])), field.shape[a] - 1);
        }
        for (int i = low[0]; i <= high[0]; ++i)
            for (int j = low[1]; j <= high[1]; ++j)
                for (int k = low[2]; k <= high[2]; ++k) {
                    const float d[3] = {float(i) + 1.0f - q[0], float(j) + 1.0f - q[1],
                                        float(k) + 1.0f - q[2]};
                    float squared = 0.0f;
                    for (int a = 0; a < 3; ++a) {
                        const float x =
                            d[0] * columns[0][a] + d[1] * columns[1][a] + d[2] * columns[2][a];
                        squared += x * x;
                    }
                    if (squared <= radius2)
                        visit(std::size_t(i) * field.stride[0] + std::size_t(j) * field.stride[1] +
                              std::size_t(k));
                }
    }
};

}  // namespace volillum
