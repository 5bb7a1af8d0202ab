#include "cone_transport_plan.h"

#include <algorithm>
#include <cmath>

#include "volillum/parallel.h"

namespace volillum::cone_detail {
namespace {

// Bytes of a band's rays, all directions: half of a second-level cache.
constexpr std::size_t kBandBytes = 400'000;
constexpr int kFewestBandRows = 4, kMostBandRows = 64;
// Slices of a slab: a thread takes the rows of a band through all of them while they are in the
// cache. The more, the less passes through the third-level cache; beyond 8 nothing is gained.
constexpr int kMostSlabSlices = 8;
// Points whose solutions are held at once, in voxels, extinctions together, which bounds the slabs
// of many threads: two have whole slabs from 128^3 voxels on, four stay inside four times the input
// there.
constexpr double kHeldPoints = 0.375;

// The most rows, or columns, that rays move from slice to slice.
double steepest(const std::vector<Ray> &rays, double Ray::*slope) {
    double most = 0;
    for (const Ray &ray : rays) most = std::max(most, std::abs(ray.*slope));
    return most;
}

}  // namespace

MarchPlan::MarchPlan(const ConeTransportScene &scene, const Lattice &lattice,
                     const std::vector<Ray> &rays, int wanted_threads)
    : extinctions(std::size_t(scene.extinctions)),
      albedos(scene.extinctions == 1 ? scene.scatterings : 1),
      threads(thread_count(wanted_threads)) {
    const double row_slope = steepest(rays, &Ray::row_slope);
    skew = int(std::ceil(row_slope)) + 1;
    const double held = kHeldPoints * scene.shape[0] * scene.shape[1] * scene.shape[2] /
                        double(lattice.most_points()) / scene.extinctions;
    slab_slices = std::clamp(int((held - 1) / threads), 1, kMostSlabSlices);
    slabs = (lattice.slices + slab_slices - 1) / slab_slices;
    threads = std::min(threads, slabs);

    // Rows begin up to kLanes apart from slice to slice, and bilinear samples reach one further.
    const int reach = int(std::ceil(steepest(rays, &Ray::column_slope)));
    layout = RowLayout(lattice.width(), reach + kLanes + 1);
    const std::size_t row_bytes =
        rays.size() * std::size_t(layout.pitch) * std::size_t(1 + 2 * albedos) * sizeof(Real);
    band_rows = std::clamp(int(kBandBytes / row_bytes), kFewestBandRows, kMostBandRows);
    bands = (lattice.rows + 1 + skew * (slab_slices - 1) + band_rows - 1) / band_rows;

    // The next slab reads a whole slice of the one before; within a slab, the next slice reads a
    // band and a few rows beside it. The medium is sampled on all slices when the first comes to a
    // row.
    plane_rows = band_rows + 2 * skew + 1 + skew * (slab_slices - 1);
    // A row of memory is taken by new rays only when no slab in flight has the old ones.
    const auto drift = [&](int slices) { return int(std::ceil(row_slope * slices)) + 1; };
    ray_rows = lattice.rows + 2 + drift(slab_slices * (threads + 1));
    // Between a slab's first slice, where a band is first, and its last, one row later.
    missing_rows = band_rows + 2 + skew * slab_slices + drift(slab_slices);
}

}  // namespace volillum::cone_detail
