// Slices across a direction, as a light or an eye sees them.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "volillum/published.h"

namespace volillum::published {

inline Vec3d world_of(const double *m, const Vec3d &q) {
    Vec3d w;
    for (std::size_t a = 0; a < 3; ++a) {
        const double *row = m + 4 * a;
        w[a] = row[0] * q[0] + row[1] * q[1] + row[2] * q[2] + row[3];
    }
    return w;
}

inline double dot(const Vec3d &a, const Vec3d &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Depth along -toward, and pixel rows and columns, which widen with the distance to an eye.
class Projection {
public:
    struct Place {
        double depth, row, column;
    };

    Projection(const Volume &volume, const Slices &slices)
        : pixel_(slices.pixel), perspective_(slices.eye != nullptr) {
        const Vec3d &z = slices.toward;
        std::size_t least = 0;
        for (std::size_t a = 1; a < 3; ++a)
            if (std::abs(z[a]) < std::abs(z[least])) least = a;
        for (std::size_t a = 0; a < 3; ++a) u_[a] = (a == least) - z[least] * z[a];
        const double norm = std::sqrt(dot(u_, u_));
        for (double &x : u_) x /= norm;
        v_ = {z[1] * u_[2] - z[2] * u_[1], z[2] * u_[0] - z[0] * u_[2],
              z[0] * u_[1] - z[1] * u_[0]};
        down_ = {-z[0], -z[1], -z[2]};
        Vec3d middle;
        for (std::size_t a = 0; a < 3; ++a) middle[a] = 0.5 * (volume.shape[a] - 1);
        middle = world_of(volume.index_to_world, middle);
        origin_ = perspective_ ? Vec3d{slices.eye[0], slices.eye[1], slices.eye[2]} : middle;
        reference_ = dot(from_origin(middle), down_);

        constexpr double huge = std::numeric_limits<double>::max();
        near_ = huge, far_ = -huge;
        double first_row = huge, first_column = huge, last_row = -huge, last_column = -huge;
        for (int corner = 0; corner < 8; ++corner) {
            Vec3d q;
            for (std::size_t a = 0; a < 3; ++a)
                q[a] = (corner >> a) & 1 ? double(volume.shape[a]) : -1.0;
            const Vec3d w = world_of(volume.index_to_world, q);
            const double depth = dot(from_origin(w), down_);
            if (perspective_ && !(depth > 0))
                throw std::invalid_argument(
                    "the eye is beside or inside the volume; expected one wholly in front of it "
                    "for the published slices");
            const Place place = project(w);
            near_ = std::min(near_, depth);
            far_ = std::max(far_, depth);
            first_row = std::min(first_row, place.row);
            last_row = std::max(last_row, place.row);
            first_column = std::min(first_column, place.column);
            last_column = std::max(last_column, place.column);
        }
        row0_ = std::floor(first_row) - 1;
        column0_ = std::floor(first_column) - 1;
        if (!((last_row - row0_) * (last_column - column0_) < 1e9))
            throw std::invalid_argument(
                "a slice would have more than 10^9 pixels; expected voxels less oblong");
        rows = int(std::ceil(last_row) - row0_) + 2;
        columns = int(std::ceil(last_column) - column0_) + 2;
    }

    Place project(const Vec3d &world) const {
        const Vec3d d = from_origin(world);
        const double depth = dot(d, down_), edge = pixel(depth);
        return {depth, dot(d, u_) / edge - row0_, dot(d, v_) / edge - column0_};
    }
    Vec3d world(double depth, double row, double column) const {
        const double edge = pixel(depth), a = (row + row0_) * edge, b = (column + column0_) * edge;
        Vec3d w;
        for (std::size_t c = 0; c < 3; ++c)
            w[c] = origin_[c] + depth * down_[c] + a * u_[c] + b * v_[c];
        return w;
    }
    // World length of a pixel's edge at this depth.
    double pixel(double depth) const { return pixel_ * (perspective_ ? depth / reference_ : 1.0); }
    double nearest() const { return near_; }
    double farthest() const { return far_; }

    int rows = 0, columns = 0;

private:
    Vec3d from_origin(const Vec3d &world) const {
        return {world[0] - origin_[0], world[1] - origin_[1], world[2] - origin_[2]};
    }

    double pixel_;
    bool perspective_;
    Vec3d u_, v_, down_, origin_;
    double reference_ = 1, near_ = 0, far_ = 0, row0_ = 0, column0_ = 0;
};

// Voxels in the order of the slab between two slices that they lie in.
class Slabs {
public:
    Slabs(const Volume &volume, const Projection &projection, double distance, int count)
        : first_(std::size_t(count) + 1, 0) {
        const Index3 n = volume.shape;
        const std::size_t voxels = std::size_t(n[0]) * std::size_t(n[1]) * std::size_t(n[2]);
        if (voxels > std::numeric_limits<std::uint32_t>::max())
            throw std::invalid_argument("the volume has more than 2^32 voxels");
        std::vector<std::uint32_t> slab(voxels);
        std::size_t voxel = 0;
        for (int i = 0; i < n[0]; ++i)
            for (int j = 0; j < n[1]; ++j)
                for (int k = 0; k < n[2]; ++k, ++voxel) {
                    const Vec3d w =
                        world_of(volume.index_to_world, {double(i), double(j), double(k)});
                    const double depth = projection.project(w).depth - projection.nearest();
                    slab[voxel] = std::uint32_t(std::clamp(int(depth / distance), 0, count - 1));
                    ++first_[slab[voxel] + 1];
                }
        for (std::size_t s = 1; s < first_.size(); ++s) first_[s] += first_[s - 1];
        voxels_.resize(voxels);
        std::vector<std::size_t> next = first_;
        for (std::size_t v = 0; v < voxels; ++v) voxels_[next[slab[v]]++] = std::uint32_t(v);
    }
    std::size_t begin(int slab) const { return first_[std::size_t(slab)]; }
    std::size_t end(int slab) const { return first_[std::size_t(slab) + 1]; }
    std::uint32_t voxel(std::size_t place) const { return voxels_[place]; }

private:
    std::vector<std::size_t> first_;
    std::vector<std::uint32_t> voxels_;
};

}  // namespace volillum::published
