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
// Rays, slices and solutions may take so many times what the medium takes: with the medium itself,
// its trimmed copy and the outputs that is four times the input. Thinner slabs take less, the more
// so the more threads there are.
constexpr double kShare = 1.4;

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
    // Rows begin up to kLanes apart from slice to slice, and bilinear samples reach one further.
    const int reach = int(std::ceil(steepest(rays, &Ray::column_slope)));
    layout = RowLayout(lattice.width(), reach + kLanes + 1);
    const std::size_t row_bytes =
        rays.size() * std::size_t(layout.pitch) * std::size_t(1 + 2 * albedos) * sizeof(Real);
    band_rows = std::clamp(int(kBandBytes / row_bytes), kFewestBandRows, kMostBandRows);
    const double voxels = double(scene.shape[0]) * scene.shape[1] * scene.shape[2];
    const double most = kShare * (scene.extinctions + scene.scatterings) * voxels;
    for (int slices = kMostSlabSlices; slices > 0; --slices) {
        divide(lattice, row_slope, slices, thread_count(wanted_threads));
        if (double(numbers(scene, lattice)) <= most) break;
    }
}

void MarchPlan::divide(const Lattice &lattice, double row_slope, int slices, int wanted_threads) {
    slab_slices = slices;
    slabs = (lattice.slices + slab_slices - 1) / slab_slices;
    threads = std::min(wanted_threads, slabs);
    bands = (lattice.rows + 1 + skew * (slab_slices - 1) + band_rows - 1) / band_rows;

    // The next slab reads a whole slice of the one before; within a slab, the next slice reads a
    // band and a few rows beside it. The medium is sampled on all slices when the first comes to a
    // row.
    plane_rows = std::min(band_rows + 2 * skew + 1 + skew * (slab_slices - 1), lattice.rows);
    // A row of memory is taken by new rays only when no slab in flight has the old ones.
    const auto drift = [&](int count) { return int(std::ceil(row_slope * count)) + 1; };
    ray_rows = lattice.rows + 2 + drift(slab_slices * (threads + 1));
    // Between a slab's first slice, where a band is first, and its last, one row later.
    missing_rows = band_rows + 2 + skew * slab_slices + drift(slab_slices);
}

std::size_t MarchPlan::numbers(const ConeTransportScene &scene, const Lattice &lattice) const {
    const std::size_t count = std::size_t(scene.count), each = std::size_t(albedos),
                      at_once = std::size_t(threads), slices = std::size_t(slab_slices),
                      quantities = 1 + 2 * each;
    const std::size_t ray_lines =
        count * ((1 + each) * std::size_t(ray_rows) + at_once * each * std::size_t(missing_rows));
    const std::size_t whole = std::size_t(lattice.rows) * extinctions,
                      parts = (slices - 1) * std::size_t(plane_rows);
    const std::size_t slice_lines = (at_once + 1) * quantities * (whole + parts);
    const std::size_t solutions = each + (scene.transmittance ? 1 : 0);
    return (extinctions * ray_lines + slice_lines) * std::size_t(layout.pitch) +
           extinctions * solutions * (at_once * slices + 1) * lattice.most_points();
}

}  // namespace volillum::cone_detail
