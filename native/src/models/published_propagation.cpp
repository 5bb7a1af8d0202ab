#include <algorithm>

#include "published_buffers.h"
#include "volillum/affine.h"
#include "volillum/parallel.h"

namespace volillum::published {

namespace {

// The grid's own slices across the axis that is nearest to the light.
struct Slicing {
    Index3 shape;
    std::size_t axis, row_axis, column_axis;

    Slicing(const Index3 &n, const Vec3d &step) : shape(n), axis(0) {
        for (std::size_t a = 1; a < 3; ++a)
            if (std::abs(step[a]) > std::abs(step[axis])) axis = a;
        row_axis = axis == 0 ? 1 : 0;
        column_axis = axis == 2 ? 1 : 2;
    }
    std::size_t voxel(int slice, int row, int column) const {
        Index3 index;
        index[axis] = slice;
        index[row_axis] = row;
        index[column_axis] = column;
        return (std::size_t(index[0]) * std::size_t(shape[1]) + std::size_t(index[1])) *
                   std::size_t(shape[2]) +
               std::size_t(index[2]);
    }
};

// Mean of a lookup and its 4 or 8 neighbours (0: none).
float averaged(const Plane &plane, double row, double column, int neighbours) {
    float sum = plane(row, column);
    if (neighbours == 0) return sum;
    for (int a = -1; a <= 1; ++a)
        for (int b = -1; b <= 1; ++b)
            if ((a || b) && (neighbours == 8 || !a || !b)) sum += plane(row + a, column + b);
    return sum / float(neighbours + 1);
}

}  // namespace

void propagated_shadow(const Volume &volume, const Vec3d &toward, int neighbours, Buffer buffer,
                       int threads, Control *control, float *out) {
    const Vec3d step = multiply(inverse_linear(volume.index_to_world), toward.data());
    const Slicing slicing(volume.shape, step);
    const double *m = volume.index_to_world;
    const float height =
        float(std::hypot(m[slicing.axis], m[4 + slicing.axis], m[8 + slicing.axis]));
    const double down = std::abs(step[slicing.axis]);
    const double row_shift = step[slicing.row_axis] / down,
                 column_shift = step[slicing.column_axis] / down;
    const int slices = volume.shape[slicing.axis], rows = volume.shape[slicing.row_axis],
              columns = volume.shape[slicing.column_axis];
    const std::size_t voxels = std::size_t(slices) * std::size_t(rows) * std::size_t(columns);
    const std::size_t channels = std::size_t(volume.channels);

    // Of the slice one nearer to the light: colour and occlusion, sigma_t and sigma_s.
    std::vector<Plane> light(2 * channels, Plane(rows, columns, 0.0f));
    std::vector<Plane> next = light, matter = light;
    const auto propagate = [&](std::size_t row) {
        for (int column = 0; column < columns; ++column) {
            const double r = double(row) + row_shift, c = column + column_shift;
            const std::size_t here = row * std::size_t(columns) + std::size_t(column);
            for (std::size_t channel = 0; channel < channels; ++channel) {
                const float sigma_t = matter[channel](r, c);
                const float alpha = 1 - std::exp(-sigma_t * height);
                const float albedo =
                    sigma_t > 0 ? std::min(matter[channels + channel](r, c) / sigma_t, 1.0f) : 0.0f;
                const float colour = averaged(light[channel], r, c, neighbours);
                const float occlusion = averaged(light[channels + channel], r, c, neighbours);
                next[channel].values[here] = stored((1 - alpha) * colour + alpha * albedo, buffer);
                next[channels + channel].values[here] =
                    stored((1 - alpha) * occlusion + alpha, buffer);
            }
        }
    };
    for (int k = 0; k < slices; ++k) {
        const int slice = step[slicing.axis] > 0 ? slices - 1 - k : k;
        parallel_for(
            std::size_t(rows), threads, control, [&](std::size_t row, int) { propagate(row); },
            double(k) / slices, double(k + 1) / slices);
        std::swap(light, next);
        for (std::size_t channel = 0; channel < channels; ++channel)
            for (int row = 0; row < rows; ++row)
                for (int column = 0; column < columns; ++column) {
                    const std::size_t here =
                        std::size_t(row) * std::size_t(columns) + std::size_t(column);
                    const std::size_t voxel = slicing.voxel(slice, row, column);
                    matter[channel].values[here] = volume.sigma_t[channel * voxels + voxel];
                    matter[channels + channel].values[here] =
                        volume.sigma_s ? volume.sigma_s[channel * voxels + voxel] : 0.0f;
                    out[channel * voxels + voxel] = light[channel].values[here];
                    out[(channels + channel) * voxels + voxel] =
                        light[channels + channel].values[here];
                }
    }
}

void composed_visibility(const Index3 &shape, const float *local, const Vec3d &index_offset,
                         int steps, int threads, Control *control, float *out) {
    const std::size_t plane = std::size_t(shape[1]) * std::size_t(shape[2]);
    // Interpolated as what is hidden, so that the outside, where nothing is, hides nothing.
    std::vector<float> hidden(plane * std::size_t(shape[0]), 0.0f);
    for (std::size_t voxel = 0; voxel < hidden.size(); ++voxel)
        hidden[voxel] = 1 - std::clamp(local[voxel], 0.0f, 1.0f);
    parallel_for(std::size_t(shape[0]), threads, control, [&](std::size_t i, int) {
        std::size_t voxel = i * plane;
        for (int j = 0; j < shape[1]; ++j)
            for (int k = 0; k < shape[2]; ++k, ++voxel) {
                float product = 1 - hidden[voxel];
                for (int s = 1; s < steps && product > 0; ++s)
                    product *= 1 - trilinear(hidden.data(), shape,
                                             {double(i) + s * index_offset[0],
                                              j + s * index_offset[1], k + s * index_offset[2]});
                out[voxel] = product;
            }
    });
}

}  // namespace volillum::published
