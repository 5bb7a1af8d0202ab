// From the lattice of the cone transport to the voxels.
#pragma once

#include <algorithm>
#include <vector>

#include "cone_transport_kernels.h"
#include "cone_transport_lattice.h"
#include "cone_transport_plan.h"
#include "volillum/huge_array.h"

namespace volillum::cone_detail {

// What the march leaves at the held points of some slabs in flight, and of the last slice of one
// slab more: the voxels of a slab lie between it and its own. Beyond the points of a slice lie
// finite numbers.
class Solutions {
public:
    void resize(const MarchPlan &plan, std::size_t most_points, bool with_seen);
    int slab_slices() const { return slab_slices_; }
    int albedos() const { return albedos_; }
    // Of all slices; `begin` is where one begins.
    Real *in_scattered(std::size_t extinction, int i) {
        return values_.data() + (extinction * quantities_ + std::size_t(i)) * size_;
    }
    Real *seen(std::size_t extinction) { return in_scattered(extinction, albedos_); }
    int begin(int slice) const {
        const int slab = slice / slab_slices_, within = slice % slab_slices_;
        if (within == slab_slices_ - 1) return pitch_ * (slab % (slabs_ + 1));
        return pitch_ * (slabs_ + 1 + (slab % slabs_) * (slab_slices_ - 1) + within);
    }

private:
    int slabs_ = 0, slab_slices_ = 1, pitch_ = 0, albedos_ = 0;
    std::size_t quantities_ = 0, size_ = 0;  // of an extinction, of a quantity
    HugeArray<Real> values_;
};

// Writes L_i at the voxels that lie between the slices of a slab or before its first.
class VoxelWriter {
public:
    VoxelWriter(const ConeTransportScene &scene, const Lattice &lattice, Solutions &solutions)
        : scene_(scene), lattice_(lattice), solutions_(solutions) {}
    // `out` as in `cone_transport`. Every voxel belongs to one slab.
    void write(int slab, Real *out) const;

private:
    struct Batch;
    void write(Batch &batch, Real *out) const;
    void fetch(std::ptrdiff_t voxel, const Real *out) const;

    const ConeTransportScene &scene_;
    const Lattice &lattice_;
    Solutions &solutions_;
};

}  // namespace volillum::cone_detail
