// Flights written into voxels: how far each one goes through every voxel's box.
#pragma once

#include <cstring>
#include <limits>
#include <mutex>
#include <utility>

#include "photon_flights.h"
#include "volillum/huge_array.h"

namespace volillum {

struct Flight {
    float start[3], step[3], inverse[3];  // q, q per world unit, and its reciprocals (finite)
};

// What is to be written into voxels: a flight of length `end` or, for the kernel estimate, a ball
// about its start, `end` the dither of its units. One cache line.
struct Deposit {
    Flight flight;
    float end, direction[3], weight[3];
};

// The deposits of one pass in 32-bit integers, so that they depend on no order: the zeroth moments,
// and the others of all passes. Overflows are rare and listed. All threads write here, one at a
// time in a slab of planes across the longest index axis.
class Deposits {
public:
    // A voxel diagonal at weight 1 is this many units: rounding costs 1e-6 of it, and a voxel
    // overflows after some thousand deposits. The higher moments go on from pass to pass, in
    // coarser units: some ten thousand deposits to an overflow, a rounding of 1e-5.
    static constexpr float unit = 0x1p20f, higher_unit = unit / float(kHigherUnit);
    static constexpr int higher = 8;  // moments beside the zeroth

    // Wrapped sums lack the power of two of their width, in the direction of what was added.
    using Spill = std::pair<std::size_t, std::int32_t>;
    struct Slab {
        int low, high;  // planes [low, high)
        std::mutex busy;
        std::vector<Spill> spilled, higher_spilled;
    };

    // `higher_sums` [voxels][8][colours], or null.
    void begin(const std::array<int, 3> &shape, std::size_t size, std::int32_t *higher_sums);
    int axis() const { return axis_; }
    int slab_of(int plane) const { return plane / planes_per_slab; }
    std::size_t slab_count() const { return slabs_.size(); }
    Slab &slab(std::size_t number) { return slabs_[number]; }
    std::int32_t *values() { return values_.data(); }
    std::int32_t *higher_sums() { return higher_sums_; }
    // The pass, but for the higher moments.
    void forget() {
        std::fill_n(values_.data(), size_, 0);
        forget_spills();
    }
    void forget_spills() {
        for (Slab &slab : slabs_) {
            slab.spilled.clear();
            slab.higher_spilled.clear();
        }
    }

    VOLILLUM_INLINE static void add(std::int32_t *values, Slab &slab, std::size_t index,
                                    float value) {
        std::int32_t sum;
        const std::int32_t added = std::int32_t(std::lrintf(value));
        if (__builtin_add_overflow(values[index], added, &sum)) [[unlikely]]
            spill(slab.spilled, index, added);
        values[index] = sum;
    }

    // values[8 * colours], times `scale` plus `dither`, to a voxel's row of as many.
    template <int Colours>
    VOLILLUM_INLINE static void add_higher(std::int32_t *row, Slab &slab, std::size_t index,
                                           const Floats *values, float scale, float dither) {
        for (int part = 0; part < Colours; ++part) {
            Ints held;
            std::memcpy(&held, row + higher * part, sizeof held);
            const Floats exact = values[part] * scale + dither;
            const Ints added =
                __builtin_convertvector(exact < 0.0f ? exact - 0.5f : exact + 0.5f, Ints);
            const Ints sum = Ints(Words(held) + Words(added));
            std::memcpy(row + higher * part, &sum, sizeof sum);
            const Ints over = (held ^ sum) & (added ^ sum);
            const auto signs = std::bit_cast<std::array<std::uint64_t, 4>>(over);
            if ((signs[0] | signs[1] | signs[2] | signs[3]) & 0x8000000080000000u) [[unlikely]]
                for (int l = 0; l < higher; ++l)
                    if (over[l] < 0)
                        spill(slab.higher_spilled, index + std::size_t(higher * part + l),
                              added[l]);
        }
    }

private:
    static constexpr int planes_per_slab = 16;

    [[gnu::noinline]] static void spill(std::vector<Spill> &spilled, std::size_t index,
                                        std::int32_t added) {
        spilled.emplace_back(index, added > 0 ? 1 : -1);
    }

    int axis_ = 0;
    std::vector<Slab> slabs_;
    HugeArray<std::int32_t> values_;
    std::size_t size_ = 0;
    std::int32_t *higher_sums_ = nullptr;
};

inline void Deposits::begin(const std::array<int, 3> &shape, std::size_t size,
                            std::int32_t *higher_sums) {
    axis_ = int(std::max_element(shape.begin(), shape.end()) - shape.begin());
    const int planes = shape[std::size_t(axis_)];
    const std::size_t count = std::size_t((planes - 1) / planes_per_slab + 1);
    if (slabs_.size() != count) {
        slabs_ = std::vector<Slab>(count);
        for (std::size_t i = 0; i < count; ++i) {
            slabs_[i].low = int(i) * planes_per_slab;
            slabs_[i].high = std::min(slabs_[i].low + planes_per_slab, planes);
        }
    }
    if (size_ != size) {
        values_ = HugeArray<std::int32_t>(size);
        size_ = size;
        std::fill_n(values_.data(), size, 0);
    }
    higher_sums_ = higher_sums;
}

// What one thread has to write, until it is much.
struct Waiting {
    std::vector<Deposit> deposits;
    std::vector<std::vector<std::uint32_t>> of_slab;

    void push(const Deposit &deposit, int first_slab, int last_slab) {
        for (int slab = first_slab; slab <= last_slab; ++slab)
            of_slab[std::size_t(slab)].push_back(std::uint32_t(deposits.size()));
        deposits.push_back(deposit);
    }
};

// The voxels of a slab, [low, high) along each index axis.
struct SlabBox {
    int low[3] = {0, 0, 0}, high[3];
    SlabBox(const std::array<int, 3> &shape, int axis, const Deposits::Slab &slab)
        : high{shape[0], shape[1], shape[2]} {
        low[axis] = slab.low;
        high[axis] = slab.high;
    }
};

// Calls visit(voxel, length) for every box [i - 1/2, i + 1/2] of `bounds` that the flight crosses
// in [0, end]; `end` may be infinite.
template <class Visit>
VOLILLUM_INLINE void walk_boxes(const PhotonField &field, const SlabBox &bounds,
                                const Flight &flight, float end, Visit &&visit) {
    constexpr float never = std::numeric_limits<float>::infinity();
    const int *const lows = bounds.low, *const highs = bounds.high;
    float begin = 0.0f, p[3];
    for (int a = 0; a < 3; ++a) {
        p[a] = flight.start[a] - 0.5f;  // box i is [i, i + 1]
        const float s = (float(lows[a]) - p[a]) * flight.inverse[a],
                    t = (float(highs[a]) - p[a]) * flight.inverse[a];
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
        const int most = highs[a] - 1;
        const int first = std::min(std::max(int(p[a] + begin * flight.step[a]), lows[a]), most);
        const int last = std::min(std::max(int(p[a] + end * flight.step[a]), lows[a]), most);
        voxel += first * stride[a];
        // Crossings are counted from the ends, so that rounding cannot lead out of the slab.
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

    int lowest(const float *q, int a) const {
        return std::max(int(std::ceil(q[a] - 1.0f - reach[a])), 0);
    }
    int highest(const PhotonField &field, const float *q, int a) const {
        return std::min(int(std::floor(q[a] - 1.0f + reach[a])), field.shape[a] - 1);
    }

    // Calls visit(voxel) for every voxel of `bounds` whose centre is in the ball about q.
    template <class Visit>
    void visit(const PhotonField &field, const SlabBox &bounds, const float *q,
               Visit &&visit) const {
        int low[3], high[3];
        for (int a = 0; a < 3; ++a) {
            low[a] = std::max(lowest(q, a), bounds.low[a]);
            high[a] = std::min(highest(field, q, a), bounds.high[a] - 1);
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
