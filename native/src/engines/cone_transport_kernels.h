// Leaf kernels of the cone transport, over rows of lattice points or rays.
#pragma once

#include <array>

#include "volillum/real.h"

namespace volillum::cone_detail {

// Albedos that are solved together where they share the extinction.
constexpr int kMostAlbedos = 3;
using AlbedoFields = std::array<const Real *, kMostAlbedos>;

// Bilinear samples along a row: weights of (row, column), (row, column + 1), (row + 1, ...).
struct Taps {
    Real w00, w01, w10, w11;
    Taps(Real row_fraction, Real column_fraction)
        : w00((1 - row_fraction) * (1 - column_fraction)),
          w01((1 - row_fraction) * column_fraction),
          w10(row_fraction * (1 - column_fraction)),
          w11(row_fraction * column_fraction) {}
};

// Two neighbouring rows of a slice.
struct Rows {
    const Real *upper, *lower;
    void move(int columns) {
        upper += columns;
        lower += columns;
    }
};

// What a row of rays meets on one slice.
struct SliceRows {
    Rows sigma_t, sigma_a[kMostAlbedos], in_scattered[kMostAlbedos];
};

// What is kept of a row of rays. The radiance of a ray on a slice is known + (1 - missing) L_i, for
// L_i is not known when a ray arrives; `seen` is its transmittance from the light.
struct RayRow {
    Real *seen, *known[kMostAlbedos], *missing[kMostAlbedos];
};

struct StepRow {
    const RayRow &rays;
    const Real *missing[kMostAlbedos];  // on the slice before, placed as `rays`
    int shift;            // elements that rays move by: what is to be at c was at c - shift
    int shift_of_before;  // and columns
    const SliceRows &before, &here;  // at column 0; here.in_scattered is not read
    Taps taps_before, taps_here;
    Real length;
    const RayRow &soon;  // rays whose turn is next: they are fetched meanwhile
    // Rays end at a lamp: the share of the step that lies before it is start - c * slope, from 0
    // to 1.
    bool ends = false;
    Real end_start = 0, end_slope = 0;
};

// L_i is known now: `known` becomes the radiance.
struct SettleRow {
    const RayRow &rays;  // at column 0, as `here`, of which L_i is read
    const SliceRows &here;
    Taps taps;
};

// A direction's part in the sums over directions at the lattice points of two neighbouring rows.
struct AddRow {
    RayRow rays;
    Real row_fraction, column_fraction, weight;
    // Null, or weights of the two rows' points, beside `weight`.
    const Real *own_weights = nullptr, *next_weights = nullptr;
};
// Directions that are added together: the sums are read and written once for all of them.
constexpr int kAdded = 4;

// Takes the rays of the columns [begin, begin + count), whole lanes, from slice to slice, in place.
void step_row(const StepRow &row, int albedos, int begin, int count);

void settle_row(const SettleRow &row, int albedos, int begin, int count);

// Adds weight * (rays interpolated at lattice points) of at most kAdded directions, one after the
// other. Lattice points lie before the rays of their own column and row, so a row of rays counts
// for its own row of points and the next.
void add_rows(const AddRow *rows, int directions, const RayRow &own, const RayRow &next,
              int albedos, int begin, int count);

// Values that are linear between nodes every `spacing` columns, from column 0 on, for the columns
// [begin, begin + count).
void expand_row(const Real *nodes, int spacing, int begin, int count, Real *values);

// L_i = known / missing, to `in_scattered`.
void solve_row(const Real *known, const Real *missing, int begin, int end, Real *in_scattered);

}  // namespace volillum::cone_detail
