// Geometry of the cone transport: a lattice whose slices are perpendicular to the light's axis.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "volillum/affine.h"
#include "volillum/cone_transport.h"

namespace volillum::cone_detail {

// Columns [begin, end) of a row.
struct Span {
    int begin = 0, end = 0;
    bool empty() const { return begin >= end; }
};

// Grown to begin and end on cache lines.
inline Span whole_lanes(const Span &span) {
    if (span.empty()) return {};
    const int begin = span.begin & ~(kLanes - 1);
    return {begin, begin + round_up(span.end - begin)};
}

// Points (slice, row, column); slice 0 is nearest to the light. Only points in the support of the
// medium, grown by a cell of either lattice, are held: the spans.
class Lattice {
public:
    // `steepest`: the largest tangent between the axis and a direction.
    Lattice(const ConeTransportScene &scene, double spacing, double steepest);

    int slices, rows, columns;
    // World vectors of one step of a row, a column and a slice; a slice's step points away from
    // the light.
    Vec3d slice_step, row_step, column_step;

    Span span(int slice, int row) const {
        if (slice < 0 || slice >= slices || row < 0 || row >= rows) return {};
        return spans_[std::size_t(slice) * std::size_t(rows) + std::size_t(row)];
    }
    // Held points of the slice before those of a row; `most_points()` of any slice in all.
    int offset(int slice, int row) const {
        return offsets_[std::size_t(slice) * std::size_t(rows) + std::size_t(row)];
    }
    std::size_t most_points() const { return most_points_; }
    // The column at which memory for rows of a slice begins: a multiple of kLanes, not beyond any
    // ray's, at most kLanes from those of the slices beside it; and the columns from there.
    int first_column(int slice) const {
        return first_columns_[std::size_t(std::clamp(slice, 0, slices - 1))];
    }
    int width() const { return width_; }
    // Where a row of rays is needed: beside a held point. Rays lie beyond the point of their
    // number.
    Span rays(int slice, int row) const {
        const Span one = span(slice, row), two = span(slice, row + 1);
        if (one.empty() && two.empty()) return {};
        if (one.empty()) return {two.begin - 1, two.end};
        if (two.empty()) return {one.begin - 1, one.end};
        return {std::min(one.begin, two.begin) - 1, std::max(one.end, two.end)};
    }

    // Voxel-index position of a lattice point, and of its neighbour along the row minus that.
    Vec3d index_of(double slice, double row, double column) const;
    const Vec3d &index_per_column() const { return column_index_; }
    // Lattice position (slice, row, column) of a voxel-index position, and the change of that from
    // voxel to voxel along an index axis.
    Vec3d position_of(const Vec3d &index) const;
    Vec3d position_per_voxel(std::size_t axis) const;

private:
    void place_rows();

    Vec3d centre_index_, slice_index_, row_index_, column_index_;
    Matrix3 to_lattice_;
    Vec3d centre_;  // lattice position of the grid's middle
    std::vector<Span> spans_;
    std::vector<int> offsets_;
    std::size_t most_points_ = 0;
    std::vector<int> first_columns_;
    int width_ = 0;
};

// How the rays of a direction cross the slices: at row + row_fraction, column + column_fraction of
// the ray (0, 0). A function of the slice alone, so that every use has the same bits.
struct Crossing {
    int row, column;
    Real row_fraction, column_fraction;
};

struct Ray {
    double row_slope, column_slope;  // lattice steps per slice away from the light
    Real length;                     // world length from slice to slice
    Real weight;

    Crossing crossing(int slice) const {
        const double row = row_slope * slice, column = column_slope * slice;
        const double row_floor = std::floor(row), column_floor = std::floor(column);
        return {int(row_floor), int(column_floor), Real(row - row_floor),
                Real(column - column_floor)};
    }
};

std::vector<Ray> plan_rays(const ConeTransportScene &scene, const Lattice &lattice);

// The largest tangent between the axis and a direction. Throws std::invalid_argument for what is
// not a cone's rule.
double check_directions(const ConeTransportScene &scene);

}  // namespace volillum::cone_detail
