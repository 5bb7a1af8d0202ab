#include "cone_transport_slices.h"

#include <algorithm>

namespace volillum::cone_detail {
namespace {

// Extinction times a step of more than this is as good as opaque, and its powers stay finite.
constexpr double kOpaque = 1e8;

Real largest_extinction(const std::vector<Ray> &rays) {
    Real longest = 0;
    for (const Ray &ray : rays) longest = std::max(longest, ray.length);
    return Real(kOpaque / double(longest));
}

}  // namespace

Slices::Slices(const ConeTransportScene &scene, const Lattice &lattice, const MarchPlan &plan,
               const std::vector<Ray> &rays)
    : lattice_(lattice),
      plan_(plan),
      medium_(scene, lattice, plan.albedos, largest_extinction(rays)),
      slices_(std::size_t(plan.threads + 1) * std::size_t(plan.slab_slices)) {
    for (std::size_t i = 0; i < slices_.size(); ++i) {
        Slice &slice = slices_[i];
        const bool ends_slab = plan.ends_slab(int(i));
        slice.planes.resize(ends_slab ? plan.extinctions : 1);
        for (SlicePlanes &planes : slice.planes)
            planes.resize(lattice.rows, ends_slab ? lattice.rows : plan.plane_rows, plan.layout,
                          plan.albedos);
        slice.sums.resize(plan.layout, plan.albedos);
        slice.moves.resize(rays.size());
        if (scene.local_weights) slice.weights.resize(plan.layout, rays.size());
    }
    // Nothing lies before the first.
    for (SlicePlanes &planes : at(-1).planes) {
        planes.begin_at(lattice.first_column(-1));
        planes.clear();
    }
}

void Slices::begin(int slice) {
    Slice &here = at(slice);
    const int column = lattice_.first_column(slice);
    for (SlicePlanes &planes : here.planes) planes.begin_at(column);
    here.sums.begin_at(column);
    here.weights.begin_at(column);
}

void Slices::sample(std::size_t extinction, int first, int last, int row) {
    Span all{lattice_.columns, 0};
    for (int slice = first; slice < last; ++slice) {
        const Span span = whole_lanes(lattice_.span(slice, row));
        for (int i = 0; i < 1 + plan_.albedos; ++i)
            clear_beside(at(slice).planes_of(extinction).medium(row, i), slice, span);
        if (!span.empty()) all = {std::min(all.begin, span.begin), std::max(all.end, span.end)};
    }
    // A few columns of all slices one after the other: they lie in the same cache lines of the grid
    // where slices follow its last axis.
    for (int column = all.begin; column < all.end; column += kLanes)
        for (int slice = first; slice < last; ++slice) {
            const Span span = whole_lanes(lattice_.span(slice, row));
            if (span.begin <= column && column < span.end)
                medium_.sample(extinction, slice, row, column, at(slice).planes_of(extinction));
        }
}

void Slices::clear_beside(Real *row, int slice, const Span &span) const {
    const int first = lattice_.first_column(slice), end = first + lattice_.width();
    std::fill(row + first, row + (span.empty() ? end : span.begin), Real(0));
    if (!span.empty() && span.end < end) std::fill(row + span.end, row + end, Real(0));
}

}  // namespace volillum::cone_detail
