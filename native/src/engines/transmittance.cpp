// Transmittance to a point: one exact ray for each voxel.
#include <cmath>

#include "volillum/cell_walk.h"
#include "volillum/parallel.h"
#include "volillum/photons.h"

namespace volillum {

namespace {

struct Extinction {
    Bricks bricks;
    Field field;
    Extinction(const Size3 &shape, const Bricks::Planes &sigma_t)
        : bricks(shape, {sigma_t}), field(bricks, sigma_t.channels) {
        const std::size_t voxels = shape[0] * shape[1] * shape[2];
        for (std::size_t c = 0; c < sigma_t.channels; ++c)
            field.set(bricks, c, sigma_t.values + c * voxels);
    }
};

template <std::size_t Channels>
VOLILLUM_INLINE void trace_row(const Extinction &extinction, const Vec3 &first, const Vec3 &point,
                               const Vec3 &voxel_z, const Vec3 &to_point, std::size_t count,
                               std::size_t stride, float *out) {
    for (std::size_t k = 0; k < count; ++k) {
        const Vec3 away = to_point - double(k) * voxel_z;
        const double distance = length(away);
        Vec3 origin = first;
        origin[2] += double(k);
        double depth[Channels] = {};
        if (distance > 0.0) {
            const LatticeRay ray{origin, (1.0 / distance) * (point - origin)};
            walk_cells(
                extinction.bricks, ray, distance, [&](const Cell &cell, double t0, double t1) {
                    for (std::size_t c = 0; c < Channels; ++c)
                        depth[c] += cell_depth<Channels>(extinction.field, ray, cell, t0, t1, c);
                    return true;
                });
        }
        for (std::size_t c = 0; c < Channels; ++c) out[c * stride + k] = float(std::exp(-depth[c]));
    }
}

[[gnu::flatten]] VOLILLUM_DISPATCH void row_grey(const Extinction &extinction, const Vec3 &first,
                                                 const Vec3 &point, const Vec3 &voxel_z,
                                                 const Vec3 &to_point, std::size_t count,
                                                 std::size_t stride, float *out) {
    trace_row<1>(extinction, first, point, voxel_z, to_point, count, stride, out);
}
[[gnu::flatten]] VOLILLUM_DISPATCH void row_colour(const Extinction &extinction, const Vec3 &first,
                                                   const Vec3 &point, const Vec3 &voxel_z,
                                                   const Vec3 &to_point, std::size_t count,
                                                   std::size_t stride, float *out) {
    trace_row<3>(extinction, first, point, voxel_z, to_point, count, stride, out);
}

}  // namespace

void transmittance_to(const Lattice &lattice, const double *m, const Size3 &shape,
                      const Bricks::Planes &sigma_t, const Vec3 &point, int threads,
                      Control *control, float *out) {
    const Extinction extinction(shape, sigma_t);
    const Vec3 q = lattice.point(point), voxel_z{m[2], m[6], m[10]};
    const std::size_t stride = shape[0] * shape[1] * shape[2];
    const auto row = sigma_t.channels == 3 ? row_colour : row_grey;
    parallel_for(shape[0], threads, control, [&](std::size_t i, int) {
        for (std::size_t j = 0; j < shape[1]; ++j) {
            const double a = double(i), b = double(j);
            const Vec3 to_point{point[0] - (m[0] * a + m[1] * b + m[3]),
                                point[1] - (m[4] * a + m[5] * b + m[7]),
                                point[2] - (m[8] * a + m[9] * b + m[11])};
            row(extinction, {a + 1.0, b + 1.0, 1.0}, q, voxel_z, to_point, shape[2], stride,
                out + (i * shape[1] + j) * shape[2]);
        }
    });
}

}  // namespace volillum
