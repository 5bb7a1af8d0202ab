// Leaf kernels of the cone transport, over rows of `count` points (a whole number of lanes).
#pragma once

#include "volillum/real.h"

namespace volillum::cone_detail {

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
};

// What a row of rays meets on one slice.
struct SliceRows {
    Rows in_scattered, sigma_t, sigma_a;
};

// What is kept of a row of rays. The radiance of a ray on a slice is known + (1 - missing) L_i, for
// L_i is not known when a ray arrives; `seen` is its transmittance from the light.
template <class Value>
struct RayRow {
    Value *known, *missing, *seen;
    RayRow<const Value> read_only() const { return {known, missing, seen}; }
};
using RaysIn = RayRow<const Real>;
using RaysOut = RayRow<Real>;

struct StepRow {
    RaysIn rays;             // on the slice before
    SliceRows before, here;  // here.in_scattered is not read
    Taps taps_before, taps_here;
    Real length;
    RaysOut rays_here;
};

// sigma_t and sigma_t - sigma_s of the trilinear medium at index + c * step, c in [0, count).
// sigma_t is clipped to `largest`.
void sample_medium(const Real *sigma_t, const Real *sigma_s, const Index3 &shape,
                   const Vec3d &index, const Vec3d &step, Real largest, int count, Real *extinction,
                   Real *absorption);

// Takes a row of rays from slice to slice.
void step_row(const StepRow &row, int count);

// sums[c] += weight * (rays interpolated at lattice points). `above` are the rays of the row
// before; both point at the ray of the same number as c = 0.
void add_row(const RaysIn &above, const RaysIn &here, Real row_fraction, Real column_fraction,
             Real weight, int count, const RaysOut &sums);

// L_i = known / missing, in place of known.
void solve_row(const RaysOut &sums, int count);

}  // namespace volillum::cone_detail
