#include "cone_transport_medium.h"

#include "cone_transport_lookups.h"
#include "volillum/no_alias.h"

namespace volillum::cone_detail {
namespace {

// Of one axis, for each point: the lower neighbour's element, the step to the upper one, and both
// weights. Beyond the support both weigh 0.
struct AxisPlaces {
    int low[kLanes], step[kLanes];
    Real low_weight[kLanes], high_weight[kLanes];
};

VOLILLUM_INLINE void place(double begin, double step, int size, int stride, AxisPlaces &places) {
    // Without a branch, also for what is stored: a masked store would not become vector code.
    const double beyond = size;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kLanes; ++c) {
        const double at = begin + c * step;
        const double above = at > -1.0 ? at : -1.0, clipped = above < beyond ? above : beyond;
        const int floor = int(clipped + 1.0) - 1;
        const Real fraction = Real(clipped - floor);
        const int low_inside = int(floor >= 0) & int(floor < size);
        const int high_inside = int(floor + 1 < size);
        places.low_weight[c] = Real(low_inside) * (1 - fraction);
        places.high_weight[c] = Real(high_inside) * fraction;
        const int low = floor < size ? floor : size - 1;
        places.low[c] = stride * (low > 0 ? low : 0);
        places.step[c] = stride * (int(floor >= 0) & high_inside);
    }
}

// Of the last axis: the element of a pair of neighbours, and their weights. A pair that would begin
// or end beyond the row is moved inside, its weights with it.
VOLILLUM_INLINE void place_pair(double begin, double step, int size, int *pair, Lookups &near) {
    const double beyond = size;
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kLanes; ++c) {
        const double at = begin + c * step;
        const double above = at > -1.0 ? at : -1.0, clipped = above < beyond ? above : beyond;
        const int floor = int(clipped + 1.0) - 1;
        const int low = floor > 0 ? floor : 0, last = size > 1 ? size - 2 : 0;
        pair[c] = low < last ? low : last;
        // The hat functions of both elements.
        const Real from = Real(clipped - pair[c]), one = 1 - from, two = 2 - from;
        const Real rising = 1 + from;
        const Real first = from < 0 ? rising : one, second = from < 1 ? from : two;
        near.low[c] = first > 0 ? first : Real(0);
        near.high[c] = second > 0 && size > 1 ? second : Real(0);
    }
}

// The points index + c * step; beyond the grid's support they weigh 0. Where the last side is 1 an
// element beyond the last is read.
VOLILLUM_DISPATCH void find(const Index3 &shape, const Vec3d &index, const Vec3d &step,
                            Lookups &near) {
    AxisPlaces x, y;
    int pair[kLanes];
    place(index[0], step[0], shape[0], shape[1] * shape[2], x);
    place(index[1], step[1], shape[1], shape[2], y);
    place_pair(index[2], step[2], shape[2], pair, near);
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kLanes; ++c) {
        const int at = x.low[c] + y.low[c] + pair[c];
        near.at[0][c] = at;
        near.at[1][c] = at + y.step[c];
        near.at[2][c] = at + x.step[c];
        near.at[3][c] = at + x.step[c] + y.step[c];
        near.weight[0][c] = x.low_weight[c] * y.low_weight[c];
        near.weight[1][c] = x.low_weight[c] * y.high_weight[c];
        near.weight[2][c] = x.high_weight[c] * y.low_weight[c];
        near.weight[3][c] = x.high_weight[c] * y.high_weight[c];
    }
}

VOLILLUM_DISPATCH void clip(Real largest, Real *sigma_t) {
    for (int c = 0; c < kLanes; ++c) sigma_t[c] = sigma_t[c] < largest ? sigma_t[c] : largest;
}

// Of sigma_s.
VOLILLUM_DISPATCH void become_absorption(const Real *sigma_t, Real *sigma_s) {
    VOLILLUM_NO_ALIAS
    for (int c = 0; c < kLanes; ++c) {
        const Real a = sigma_t[c] - sigma_s[c];
        sigma_s[c] = a > 0 ? a : Real(0);
    }
}

}  // namespace

LatticeMedium::LatticeMedium(const ConeTransportScene &scene, const Lattice &lattice, int albedos,
                             Real largest)
    : shape_(scene.shape), lattice_(lattice), albedos_(albedos), largest_(largest) {
    const std::size_t voxels =
        std::size_t(shape_[0]) * std::size_t(shape_[1]) * std::size_t(shape_[2]);
    for (int e = 0; e < scene.extinctions; ++e) {
        Fields fields{readable(scene.sigma_t + std::size_t(e) * voxels, voxels), {}};
        for (int i = 0; i < albedos; ++i) {
            const int channel = scene.scatterings > 1 ? e + i : 0;
            fields.sigma_s[std::size_t(i)] =
                readable(scene.sigma_s + std::size_t(channel) * voxels, voxels);
        }
        fields_.push_back(fields);
    }
}

// Lookups read beyond the last of lone elements.
const Real *LatticeMedium::readable(const Real *values, std::size_t voxels) {
    if (shape_[2] > 1) return values;
    copies_.emplace_back(values, values + voxels).push_back(0);
    return copies_.back().data();
}

void LatticeMedium::sample(std::size_t extinction, int slice, int row, int column,
                           SlicePlanes &planes) const {
    const Fields &fields = fields_[extinction];
    Lookups near;
    find(shape_, lattice_.index_of(slice, row, column), lattice_.index_per_column(), near);
    Real *const sigma_t = planes.medium(row, 0) + column;
    look_up(fields.sigma_t, near, sigma_t);
    clip(largest_, sigma_t);
    for (int i = 0; i < albedos_; ++i) {
        Real *const sigma_a = planes.medium(row, 1 + i) + column;
        look_up(fields.sigma_s[std::size_t(i)], near, sigma_a);
        become_absorption(sigma_t, sigma_a);
    }
}

}  // namespace volillum::cone_detail
