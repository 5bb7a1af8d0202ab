// Geometry of the radiance sweep: the medium seen along one index axis, and a direction's shear
// and near field in it.
#pragma once

#include <cstddef>
#include <vector>

#include "volillum/huge_array.h"
#include "volillum/radiance_sweep.h"

namespace volillum::radiance_detail {

// sigma_t and source along one major axis with their border of zeros: channels of a row lie side by
// side, so that a march reads a few streams. Slices and rows may be asked for as far beyond the
// grid as one likes, columns as far as a near field reaches.
class Layers {
public:
    Layers(const RadianceScene &scene, int axis, int near_slices, double longest_step, int threads);

    // The values of channel 0 from column 0 of a row on, others `pitch()` further each.
    const Real *row(int index, int b) const {
        return (inside(index, b) ? data_.data() + place(index, b) : zeros_.data()) + margin_;
    }
    // Whether the row holds anything.
    bool filled(int index, int b) const {
        return inside(index, b) && filled_[std::size_t(index) * std::size_t(rows) + std::size_t(b)];
    }
    std::ptrdiff_t pitch() const { return pitch_; }

    int axis, row_axis, column_axis;
    int slices, rows, columns, channels;

private:
    bool inside(int index, int b) const {
        return index >= 0 && index < slices && b >= 0 && b < rows;
    }
    std::size_t place(int index, int b) const {
        return (std::size_t(index) * std::size_t(rows) + std::size_t(b)) *
               std::size_t(channels * pitch_);
    }
    std::ptrdiff_t margin_, pitch_;
    HugeArray<Real> data_;
    Reals zeros_;
    std::vector<unsigned char> filled_;
};

// Where the lattice ray (u, v) = (0, 0) meets a slice: at row + row_fraction and so on.
struct Crossing {
    int row, column;
    Real row_fraction, column_fraction;
};

// A place on the ray from a voxel, as weights of voxels beside it.
struct Tap {
    int slices_outward, row, column;
    Real weight;
};
struct Node {
    double distance;  // slices outward
    std::vector<Tap> taps;
};

struct Direction {
    int index;                       // into the caller's list
    bool forward;                    // whether the ray leaves at the axis's upper end
    double row_slope, column_slope;  // voxels per slice outward, within [-1, 1]
    double slice_length;             // world length of a ray from slice to slice
    std::vector<Node> near_field;    // from the voxel outward; the first is the voxel itself

    // Slices are counted from the border where rays leave, t = 0, inward.
    Crossing crossing(int t) const;
};

// The directions by major axis. Throws std::invalid_argument for a singular affine, a direction
// that is not of unit length to 1e-6, or a negative number of near slices.
std::array<std::vector<Direction>, 3> plan_directions(const RadianceScene &scene, int near_slices);

}  // namespace volillum::radiance_detail
