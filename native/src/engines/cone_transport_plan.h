// How the cone transport's march is divided: bands of rows, slabs of slices, and what is held of
// each.
#pragma once

#include <vector>

#include "cone_transport_lattice.h"
#include "cone_transport_state.h"

namespace volillum::cone_detail {

// Rows of points and rays are taken band by band, each band through all slices of a slab, a few
// rows lower (`skew`) on each than on the slice before: so what a row reads of the slice before is
// done, by this band or the one before. A row of rays stays in its place in memory; the band in
// which it is next taken is never an earlier one.
// Rays move by at most kSteepest rows from slice to slice.
constexpr int kMostSkew = 1 + 2;

struct MarchPlan {
    MarchPlan(const ConeTransportScene &scene, const Lattice &lattice, const std::vector<Ray> &rays,
              int threads);

    std::size_t extinctions;
    int albedos;  // of one extinction
    int threads, skew, slab_slices, slabs, band_rows, bands;
    RowLayout layout;
    int plane_rows;    // of the medium and L_i on a slice that does not end its slab
    int ray_rows;      // of a direction's rays in all
    int missing_rows;  // of them in a slab

    // Numbers that rays, slices and solutions take.
    std::size_t numbers(const ConeTransportScene &scene, const Lattice &lattice) const;

    bool begins_slab(int slice) const { return slice % slab_slices == 0; }
    bool ends_slab(int slice) const { return slice % slab_slices == slab_slices - 1; }

private:
    // In slabs of so many slices.
    void divide(const Lattice &lattice, double row_slope, int slices, int wanted_threads);
};

}  // namespace volillum::cone_detail
