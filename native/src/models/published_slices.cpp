#include "published_buffers.h"
#include "published_projection.h"
#include "volillum/affine.h"
#include "volillum/parallel.h"

namespace volillum::published {

float stored(float value, Buffer buffer) {
    if (buffer == Buffer::full) return value;
    if (buffer == Buffer::byte) return std::nearbyint(std::min(value, 1.0f) * 255.0f) / 255.0f;
    // Half precision: 11 significant bits down to 2^-14, multiples of 2^-24 below.
    int exponent = 0;
    std::frexp(value, &exponent);
    const float unit = std::ldexp(1.0f, std::max(exponent - 11, -24));
    return std::nearbyint(value / unit) * unit;
}

namespace {

// Rows of a slice, or voxels, that one thread takes at a time.
constexpr std::size_t row_band = 16, voxel_band = 4096;

class Sweep {
public:
    Sweep(const Volume &volume, const Slices &slices, float *out)
        : volume_(volume),
          slices_(slices),
          out_(out),
          projection_(volume, slices),
          inverse_(inverse_linear(volume.index_to_world)),
          voxels_(std::size_t(volume.shape[0]) * std::size_t(volume.shape[1]) *
                  std::size_t(volume.shape[2])),
          before_(std::size_t(volume.channels), Plane(projection_.rows, projection_.columns, 1.0f)),
          after_(before_) {
        const double deep = (projection_.farthest() - projection_.nearest()) / slices.distance;
        if (!(deep < 1e6))
            throw std::invalid_argument("the slices' distance is " +
                                        std::to_string(slices.distance) +
                                        "; expected at least a millionth of the volume's depth");
        count_ = int(deep) + 1;
    }

    void run(int threads, Control *control) {
        const Slabs slabs(volume_, projection_, slices_.distance, count_);
        const std::size_t rows = std::size_t(projection_.rows);
        for (int slice = 0; slice < count_; ++slice) {
            parallel_for((rows + row_band - 1) / row_band, threads, control,
                         [&](std::size_t band, int) {
                             const std::size_t last = std::min(rows, (band + 1) * row_band);
                             for (std::size_t row = band * row_band; row < last; ++row)
                                 advance(slice, int(row));
                         },
                         double(slice) / count_, double(slice + 1) / count_);
            const std::size_t begin = slabs.begin(slice), end = slabs.end(slice);
            parallel_for((end - begin + voxel_band - 1) / voxel_band, threads, nullptr,
                         [&](std::size_t band, int) {
                             const std::size_t first = begin + band * voxel_band;
                             const std::size_t last = std::min(end, first + voxel_band);
                             for (std::size_t place = first; place < last; ++place)
                                 read(slice, slabs.voxel(place));
                         });
            std::swap(before_, after_);
        }
    }

private:
    double depth(int slice) const { return projection_.nearest() + slice * slices_.distance; }

    // One row of the buffer behind `slice`.
    void advance(int slice, int row) {
        const double *m = volume_.index_to_world;
        const double reach =
            slices_.distance * std::tan(slices_.theta) / projection_.pixel(depth(slice));
        const int taps = slices_.taps;
        for (int column = 0; column < projection_.columns; ++column) {
            const Vec3d w = projection_.world(depth(slice), row, column);
            const double from_corner[3] = {w[0] - m[3], w[1] - m[7], w[2] - m[11]};
            const Vec3d q = multiply(inverse_, from_corner);
            for (std::size_t c = 0; c < before_.size(); ++c) {
                float mean = 0;
                for (int a = 0; a < taps; ++a)
                    for (int b = 0; b < taps; ++b)
                        mean += before_[c](row + reach * (2 * a + 1 - taps) / taps,
                                           column + reach * (2 * b + 1 - taps) / taps);
                mean /= float(taps * taps);
                after_[c].values[std::size_t(row) * std::size_t(projection_.columns) +
                                 std::size_t(column)] = stored(mean * kept(c, q), slices_.buffer);
            }
        }
    }

    // Share of the light that goes on behind a slice.
    float kept(std::size_t channel, const Vec3d &q) const {
        const std::size_t plane = channel * voxels_;
        const float sigma_t = trilinear(volume_.sigma_t + plane, volume_.shape, q);
        if (!(sigma_t > 0)) return 1;
        const float transmittance = std::exp(-sigma_t * float(slices_.distance));
        if (!volume_.sigma_s) return transmittance;
        const float sigma_s = trilinear(volume_.sigma_s + plane, volume_.shape, q);
        return transmittance + std::min(sigma_s / sigma_t, 1.0f) * (1 - transmittance);
    }

    // A voxel reads between the buffers in front of and behind `slice`.
    void read(int slice, std::uint32_t voxel) {
        const std::uint32_t n1 = std::uint32_t(volume_.shape[1]),
                            n2 = std::uint32_t(volume_.shape[2]);
        const Vec3d index = {double(voxel / n2 / n1), double(voxel / n2 % n1), double(voxel % n2)};
        const Projection::Place at = projection_.project(world_of(volume_.index_to_world, index));
        const float part = float((at.depth - depth(slice)) / slices_.distance);
        for (std::size_t c = 0; c < before_.size(); ++c)
            out_[c * voxels_ + voxel] =
                before_[c](at.row, at.column) * (1 - part) + after_[c](at.row, at.column) * part;
    }

    const Volume &volume_;
    const Slices &slices_;
    float *out_;
    Projection projection_;
    Matrix3 inverse_;
    std::size_t voxels_;
    int count_ = 0;
    std::vector<Plane> before_, after_;
};

}  // namespace

void blurred_slices(const Volume &volume, const Slices &slices, int threads, Control *control,
                    float *out) {
    Sweep(volume, slices, out).run(threads, control);
}

}  // namespace volillum::published
