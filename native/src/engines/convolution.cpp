// Convolution by Fourier transforms, in three passes over memory.
//
//   planes:   each plane [n1, n2] of the field is transformed along its rows (real to complex) and
//             columns while it is in the cache; rows and columns of padding are never touched
//   pencils:  along the first axis forward, times the kernel's spectrum (real, because the kernel
//   is
//             even), and back; padded planes are never stored
//   planes:   back along columns and rows, and into the output
//
// An axis is padded to its length plus the kernel's reach: what wraps around lands in the padding.
// A vector's worth of pencils is transformed at once, so nothing depends on the number of threads.
#include "volillum/convolution.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "convolution_kernel.h"
#include "pencils.h"
#include "volillum/huge_array.h"
#include "volillum/opacity.h"
#include "volillum/parallel.h"

namespace volillum {
namespace {

// Vectors of pencils that are gathered together along the first axis: runs of 256 bytes a plane.
constexpr std::size_t kGathered = 4;

template <class T>
class Transform {
public:
    static constexpr std::size_t lanes = kPencils<T>;

    Transform(const Index3 &shape, const Index3 &reach, int threads, Control *control)
        : shape_(shape),
          first_(padded(shape[0], reach[0])),
          second_(padded(shape[1], reach[1])),
          third_(padded(shape[2], reach[2])),
          bins_(third_.length() / 2 + 1),
          pitch_((bins_ + lanes - 1) / lanes * lanes),
          plane_(round_up(second_.length() * bins_)),
          threads_(thread_count(threads)),
          control_(control),
          spectrum_(std::size_t(shape[0]) * 2 * plane_),
          work_(std::size_t(threads_)) {
        const std::size_t longest =
            std::max({first_.length() * kGathered, second_.length(), third_.length()});
        for (Work &work : work_) {
            work.plane.resize(2 * second_.length() * pitch_);
            work.pencils.resize(2 * longest * lanes);
        }
    }

    // The kernel's spectrum, scaled so that forward and backward make the identity.
    void set_kernel(const KernelWeights &kernel) {
        const auto [r0, r1, r2] = kernel.reach;
        const HugeArray<T> planes((std::size_t(r0) + 1) * 2 * plane_);
        parallel_for(
            std::size_t(r0) + 1, threads_, control_,
            [&, r1 = r1](std::size_t i, int thread) {
                plane_forward(
                    planes.data() + i * 2 * plane_, work_[std::size_t(thread)], 2 * r1 + 1,
                    [&](int j) { return wrapped(j - r1, second_.length()); },
                    [&](int j, std::size_t lane, T *pencils) {
                        const double *row = kernel.row(int(i), j - r1);
                        for (int k = -r2; k <= r2; ++k)
                            pencils[wrapped(k, third_.length()) * lanes + lane] = T(row[k + r2]);
                    });
            },
            0.1, 0.15);
        const double scale =
            1.0 / (double(first_.length()) * double(second_.length()) * double(third_.length()));
        kernel_ = HugeArray<T>(first_.length() * plane_);
        for_pencils(0.15, 0.2, [&](std::size_t at, std::size_t vectors, Work &work) {
            T *pencils = work.pencils.data();
            const std::size_t n = first_.length();
            for (std::size_t v = 0; v < vectors; ++v) {
                T *own = pencils + v * 2 * n * lanes;
                std::fill_n(own, 2 * n * lanes, T(0));
                // Plane -i is the conjugate of plane i: the kernel is even.
                for (std::size_t i = 0; i <= std::size_t(r0); ++i) {
                    const T *re = planes.data() + i * 2 * plane_ + at + v * lanes;
                    for (std::size_t l = 0; l < lanes; ++l) {
                        const T real = re[l], imaginary = re[plane_ + l];
                        own[2 * i * lanes + l] = real;
                        own[(2 * i + 1) * lanes + l] = i ? imaginary : T(0);
                        if (i) {
                            own[2 * (n - i) * lanes + l] = real;
                            own[(2 * (n - i) + 1) * lanes + l] = -imaginary;
                        }
                    }
                }
                first_.forward(own);
                T *spectrum = kernel_.data() + (at + v * lanes) * n;
                for (std::size_t k = 0; k < n; ++k)
                    for (std::size_t l = 0; l < lanes; ++l)
                        spectrum[k * lanes + l] = T(scale) * own[2 * k * lanes + l];
            }
        });
    }

    // Reads rows with read(i, j, values[n2]) and gives sums with write(i, j, values[n2]).
    template <class Read, class Write>
    void convolve(double begin, double end, Read &&read, Write &&write) {
        const double third = (end - begin) / 3;
        const std::size_t n2 = std::size_t(shape_[2]);
        parallel_for(
            std::size_t(shape_[0]), threads_, control_,
            [&](std::size_t i, int thread) {
                Work &work = work_[std::size_t(thread)];
                work.row.resize(n2);
                plane_forward(
                    spectrum_.data() + i * 2 * plane_, work, shape_[1],
                    [](int j) { return std::size_t(j); },
                    [&](int j, std::size_t lane, T *pencils) {
                        read(int(i), j, work.row.data());
                        for (std::size_t k = 0; k < n2; ++k)
                            pencils[k * lanes + lane] = work.row[k];
                    });
            },
            begin, begin + third);
        for_pencils(begin + third, begin + 2 * third,
                    [&](std::size_t at, std::size_t vectors, Work &work) {
                        multiply(at, vectors, work.pencils.data());
                    });
        parallel_for(
            std::size_t(shape_[0]), threads_, control_,
            [&](std::size_t i, int thread) {
                plane_backward(i, work_[std::size_t(thread)], write);
            },
            begin + 2 * third, end);
    }

private:
    using Buffer = std::vector<T, LineAllocator<T>>;
    struct Work {
        Buffer plane, pencils, row;
    };

    static std::size_t padded(int length, int reach) {
        return good_length(std::size_t(length) + std::size_t(reach));
    }
    static std::size_t round_up(std::size_t count) {
        // An odd number of vectors of planes: powers of two would share a cache set.
        const std::size_t whole = (count + lanes * kGathered - 1) / (lanes * kGathered);
        return (whole | 1) * lanes * kGathered;
    }
    static std::size_t wrapped(int position, std::size_t length) {
        return position < 0 ? length - std::size_t(-position) : std::size_t(position);
    }

    template <class Body>
    void for_pencils(double begin, double end, Body &&body) {
        const std::size_t chunk = lanes * kGathered, used = second_.length() * bins_;
        parallel_for((used + chunk - 1) / chunk, threads_, control_,
                     [&](std::size_t item, int thread) {
                         body(item * chunk, kGathered, work_[std::size_t(thread)]);
                     },
                     begin, end);
    }

    // Rows by `load(row, lane, pencils)` at `position(row)` of the columns, into re and im planes.
    template <class Position, class Load>
    void plane_forward(T *out, Work &work, int rows, Position &&position, Load &&load) {
        const std::size_t n1 = second_.length(), n2 = third_.length();
        T *re = work.plane.data(), *im = re + n1 * pitch_, *pencils = work.pencils.data();
        for (int j0 = 0; j0 < rows; j0 += int(lanes)) {
            std::fill_n(pencils, n2 * lanes, T(0));
            const std::size_t count = std::size_t(std::min(rows - j0, int(lanes)));
            for (std::size_t l = 0; l < count; ++l) load(j0 + int(l), l, pencils);
            third_.real_forward(pencils);
            for (std::size_t l = 0; l < count; ++l) {
                T *row_re = re + position(j0 + int(l)) * pitch_, *row_im = row_re + (im - re);
                const T *from = pencils + l;
                row_re[0] = from[0];
                row_im[0] = T(0);
                for (std::size_t h = 1; 2 * h < n2; ++h) {
                    row_re[h] = from[(2 * h - 1) * lanes];
                    row_im[h] = from[2 * h * lanes];
                }
                if (n2 % 2 == 0 && n2 > 1) {
                    row_re[n2 / 2] = from[(n2 - 1) * lanes];
                    row_im[n2 / 2] = T(0);
                }
                for (std::size_t h = bins_; h < pitch_; ++h) row_re[h] = row_im[h] = T(0);
            }
        }
        for (std::size_t h = 0; h < bins_; h += lanes) {
            std::fill_n(pencils, 2 * n1 * lanes, T(0));
            for (int j = 0; j < rows; ++j) {
                const std::size_t p = position(j);
                std::memcpy(pencils + 2 * p * lanes, re + p * pitch_ + h, kPencilBytes);
                std::memcpy(pencils + (2 * p + 1) * lanes, im + p * pitch_ + h, kPencilBytes);
            }
            second_.forward(pencils);
            const std::size_t bytes = std::min(lanes, bins_ - h) * sizeof(T);
            for (std::size_t j = 0; j < n1; ++j) {
                std::memcpy(out + j * bins_ + h, pencils + 2 * j * lanes, bytes);
                std::memcpy(out + plane_ + j * bins_ + h, pencils + (2 * j + 1) * lanes, bytes);
            }
        }
        // The last vector of pencils may reach beyond the plane.
        std::fill(out + n1 * bins_, out + plane_, T(0));
        std::fill(out + plane_ + n1 * bins_, out + 2 * plane_, T(0));
    }

    void multiply(std::size_t at, std::size_t vectors, T *pencils) {
        const std::size_t n = first_.length(), planes = std::size_t(shape_[0]);
        for (std::size_t i = 0; i < planes; ++i) {
            const T *re = spectrum_.data() + i * 2 * plane_ + at;
            for (std::size_t v = 0; v < vectors; ++v) {
                T *own = pencils + (v * n + i) * 2 * lanes;
                std::memcpy(own, re + v * lanes, kPencilBytes);
                std::memcpy(own + lanes, re + plane_ + v * lanes, kPencilBytes);
            }
        }
        for (std::size_t v = 0; v < vectors; ++v) {
            T *own = pencils + v * n * 2 * lanes;
            std::fill(own + planes * 2 * lanes, own + n * 2 * lanes, T(0));
            first_.forward(own);
            const T *spectrum = kernel_.data() + (at + v * lanes) * n;
            for (std::size_t k = 0; k < n; ++k)
                for (std::size_t l = 0; l < lanes; ++l) {
                    own[2 * k * lanes + l] *= spectrum[k * lanes + l];
                    own[(2 * k + 1) * lanes + l] *= spectrum[k * lanes + l];
                }
            first_.backward(own);
        }
        for (std::size_t i = 0; i < planes; ++i) {
            T *re = spectrum_.data() + i * 2 * plane_ + at;
            for (std::size_t v = 0; v < vectors; ++v) {
                const T *own = pencils + (v * n + i) * 2 * lanes;
                std::memcpy(re + v * lanes, own, kPencilBytes);
                std::memcpy(re + plane_ + v * lanes, own + lanes, kPencilBytes);
            }
        }
    }

    template <class Write>
    void plane_backward(std::size_t i, Work &work, Write &&write) {
        const std::size_t n1 = second_.length(), n2 = third_.length();
        const std::size_t rows = std::size_t(shape_[1]);
        const T *in = spectrum_.data() + i * 2 * plane_;
        T *re = work.plane.data(), *im = re + n1 * pitch_, *pencils = work.pencils.data();
        for (std::size_t h = 0; h < bins_; h += lanes) {
            const std::size_t bytes = std::min(lanes, bins_ - h) * sizeof(T);
            for (std::size_t j = 0; j < n1; ++j) {
                std::memcpy(pencils + 2 * j * lanes, in + j * bins_ + h, bytes);
                std::memcpy(pencils + (2 * j + 1) * lanes, in + plane_ + j * bins_ + h, bytes);
            }
            second_.backward(pencils);
            for (std::size_t j = 0; j < rows; ++j) {
                std::memcpy(re + j * pitch_ + h, pencils + 2 * j * lanes, kPencilBytes);
                std::memcpy(im + j * pitch_ + h, pencils + (2 * j + 1) * lanes, kPencilBytes);
            }
        }
        work.row.resize(std::size_t(shape_[2]));
        for (std::size_t j0 = 0; j0 < rows; j0 += lanes) {
            const std::size_t count = std::min(rows - j0, lanes);
            for (std::size_t l = 0; l < count; ++l) {
                const T *row_re = re + (j0 + l) * pitch_, *row_im = im + (j0 + l) * pitch_;
                T *to = pencils + l;
                to[0] = row_re[0];
                for (std::size_t h = 1; 2 * h < n2; ++h) {
                    to[(2 * h - 1) * lanes] = row_re[h];
                    to[2 * h * lanes] = row_im[h];
                }
                if (n2 % 2 == 0 && n2 > 1) to[(n2 - 1) * lanes] = row_re[n2 / 2];
            }
            third_.real_backward(pencils);
            for (std::size_t l = 0; l < count; ++l) {
                for (std::size_t k = 0; k < work.row.size(); ++k)
                    work.row[k] = pencils[k * lanes + l];
                write(int(i), int(j0 + l), work.row.data());
            }
        }
    }

    Index3 shape_;
    Pencils<T> first_, second_, third_;
    std::size_t bins_, pitch_, plane_;
    int threads_;
    Control *control_;
    HugeArray<T> spectrum_, kernel_;
    std::vector<Work> work_;
};

template <class T>
void convolve_as(const float *field, int channels, const Index3 &shape, const KernelWeights &kernel,
                 const ConvolutionSettings &settings, float *out) {
    Transform<T> transform(shape, kernel.reach, settings.threads, settings.control);
    transform.set_kernel(kernel);
    const std::size_t n1 = std::size_t(shape[1]), n2 = std::size_t(shape[2]);
    const std::size_t voxels = std::size_t(shape[0]) * n1 * n2;
    const float length = float(settings.opacity_length);
    const T upper = T(std::min(settings.upper, double(std::numeric_limits<float>::max())));
    for (int c = 0; c < channels; ++c) {
        const float *from = field + std::size_t(c) * voxels;
        float *to = out + std::size_t(c) * voxels;
        transform.convolve(
            0.2 + 0.8 * c / channels, 0.2 + 0.8 * (c + 1) / channels,
            [&](int i, int j, T *row) {
                const float *values = from + (std::size_t(i) * n1 + std::size_t(j)) * n2;
                if (length > 0)
                    for (std::size_t k = 0; k < n2; ++k) row[k] = opacity(values[k] * length);
                else
                    for (std::size_t k = 0; k < n2; ++k) row[k] = values[k];
            },
            [&](int i, int j, const T *row) {
                float *values = to + (std::size_t(i) * n1 + std::size_t(j)) * n2;
                for (std::size_t k = 0; k < n2; ++k) {
                    const T sum = std::clamp(row[k], T(0), upper);
                    values[k] = float(settings.complement ? 1 - sum : sum);
                }
            });
    }
}

}  // namespace

void convolve(const float *field, int channels, const Index3 &shape, const double *index_to_world,
              const ConvolutionSettings &settings, float *out) {
    const Index3 largest{shape[0] - 1, shape[1] - 1, shape[2] - 1};
    const KernelWeights kernel = kernel_weights(index_to_world, settings.neighbourhood, largest,
                                                settings.threads, settings.control);
    if (settings.double_precision)
        convolve_as<double>(field, channels, shape, kernel, settings, out);
    else
        convolve_as<float>(field, channels, shape, kernel, settings, out);
}

}  // namespace volillum
