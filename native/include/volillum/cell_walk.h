// Walks a straight ray through the cells of a trilinear lattice, in order.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "volillum/trilinear.h"

namespace volillum {

// A ray in padded voxel coordinates; t is the length in world units.
struct LatticeRay {
    Vec3 origin;     // padded coordinates at t = 0
    Vec3 direction;  // padded coordinates per world unit

    VOLILLUM_INLINE Vec3 at(double t) const { return origin + t * direction; }
};

// Where a ray crosses the planes of integer coordinates. Each crossing is computed from the ray's
// own origin, never accumulated, so that no error grows along the ray.
struct PlaneCrossings {
    Vec3 constant, slope, ahead, sign;

    VOLILLUM_INLINE PlaneCrossings(const LatticeRay &ray, const Vec3 &inverse_direction,
                                   double size) {
        for (std::size_t a = 0; a < 3; ++a) {
            // A ray parallel to the planes (inverse 0) never crosses one.
            const bool parallel = ray.direction[a] == 0.0;
            constant[a] = parallel ? std::numeric_limits<double>::infinity()
                                   : -ray.origin[a] * inverse_direction[a];
            slope[a] = size * inverse_direction[a];
            ahead[a] = ray.direction[a] > 0.0 ? 1.0 : 0.0;
            sign[a] = ray.direction[a] > 0.0 ? 1.0 : -1.0;
        }
    }
    VOLILLUM_INLINE double leave(std::size_t a, double cell) const {
        return constant[a] + slope[a] * (cell + ahead[a]);
    }
};

// Calls visit(cell, t0, t1) for the pieces t0 < t1 of [0, t_max] inside every cell that the ray
// crosses, in order along the ray, blocks without a brick left out; ends early when visit returns
// false.
template <class Visit>
VOLILLUM_INLINE void walk_cells(const Bricks &bricks, LatticeRay ray, double t_max, Visit &&visit) {
    constexpr double block = double(Bricks::block);
    double t = 0.0, t_end = t_max;
    Vec3 inverse{};
    for (std::size_t a = 0; a < 3; ++a) {
        const double extent = double(bricks.shape()[a] + 1);
        // A slope whose reciprocal would overflow is parallel to the planes.
        if (std::abs(ray.direction[a]) < 1e-200) ray.direction[a] = 0.0;
        if (ray.direction[a] == 0.0) {
            if (!(ray.origin[a] > 0.0 && ray.origin[a] < extent)) return;
            continue;
        }
        inverse[a] = 1.0 / ray.direction[a];
        const double low = -ray.origin[a] * inverse[a],
                     high = (extent - ray.origin[a]) * inverse[a];
        t = std::max(t, std::min(low, high));
        t_end = std::min(t_end, std::max(low, high));
    }
    if (!(t < t_end)) return;

    const PlaneCrossings outer(ray, inverse, block), inner(ray, inverse, 1.0);
    // A cell's place in its block, three fields in one word; stepping out of the block either way
    // sets the bit of 8 in a field.
    constexpr std::int64_t outside = 0x080808;
    std::array<std::int64_t, 3> place_step = {1, 1 << 8, 1 << 16};
    std::array<std::int64_t, 3> voxel_step = {Field::step_x, Field::step_y, 1};
    for (std::size_t a = 0; a < 3; ++a)
        if (ray.direction[a] <= 0.0) {
            place_step[a] = -place_step[a];
            voxel_step[a] = -voxel_step[a];
        }

    Vec3 at_block, block_leave;
    for (std::size_t a = 0; a < 3; ++a) {
        at_block[a] = std::clamp(double(std::int64_t(ray.at(t)[a] / block)), 0.0,
                                 double(bricks.blocks()[a] - 1));
        block_leave[a] = outer.leave(a, at_block[a]);
    }
    while (t < t_end) {
        const double next_block =
            std::min(block_leave[0], std::min(block_leave[1], block_leave[2]));
        const double t_leave = std::min(next_block, t_end);
        const std::uint32_t brick =
            bricks.at(std::size_t(at_block[0]), std::size_t(at_block[1]), std::size_t(at_block[2]));
        if (t < t_leave && brick != Bricks::none) {
            const Vec3 q = ray.at(t);
            Cell cell;
            Vec3 leave;
            std::int64_t place = 0, voxel = std::int64_t(brick) * std::int64_t(Bricks::corners);
            for (std::size_t a = 0; a < 3; ++a) {
                const double first = at_block[a] * block;
                const std::int64_t local =
                    std::clamp<std::int64_t>(std::int64_t(q[a] - first), 0, Bricks::block - 1);
                cell.corner[a] = first + double(local);
                leave[a] = inner.leave(a, cell.corner[a]);
                place += local << (8 * a);
                voxel += local * std::abs(voxel_step[a]);
            }
            do {
                const double t1 =
                    std::min(std::min(leave[0], leave[1]), std::min(leave[2], t_leave));
                if (t < t1) {
                    cell.voxel = std::size_t(voxel);
                    if (!visit(cell, t, t1)) return;
                    t = t1;
                }
                if (t1 >= t_leave) break;
                // Every axis whose plane was reached steps; chosen without branches, which would
                // be mispredicted at half of the cells.
                for (std::size_t a = 0; a < 3; ++a) {
                    const bool step = leave[a] <= t1;
                    cell.corner[a] += step ? inner.sign[a] : 0.0;
                    voxel += step ? voxel_step[a] : 0;
                    place += step ? place_step[a] : 0;
                    leave[a] = inner.leave(a, cell.corner[a]);
                }
            } while ((place & outside) == 0);
        }
        t = std::max(t, t_leave);
        for (std::size_t a = 0; a < 3; ++a) {
            if (block_leave[a] > next_block) continue;
            at_block[a] += outer.sign[a];
            if (at_block[a] < 0.0 || at_block[a] >= double(bricks.blocks()[a])) return;
            block_leave[a] = outer.leave(a, at_block[a]);
        }
    }
}

// Optical depth of one channel over the piece [t0, t1] of the ray inside `cell`.
template <std::size_t Channels>
VOLILLUM_INLINE double cell_depth(const Field &sigma_t, const LatticeRay &ray, const Cell &cell,
                                  double t0, double t1, std::size_t channel) {
    const Vec3 centre = ray.at(0.5 * (t0 + t1)), half = (0.5 * (t1 - t0)) * ray.direction;
    return (t1 - t0) * sigma_t.segment_mean<Channels>(cell, centre, half, channel);
}

}  // namespace volillum
