// Fourier transforms of one vector's worth of pencils at once, by pocketfft.
#pragma once

#include <cstddef>
#include <memory>

namespace volillum {

constexpr std::size_t kPencilBytes = 64;
// Pencils that are transformed together: the lanes of a 64-byte vector.
template <class T>
constexpr std::size_t kPencils = kPencilBytes / sizeof(T);

// The least length of at least `length` with factors 2, 3 and 5 only.
std::size_t good_length(std::size_t length);

// Transforms of `length` elements; element e of pencil l is at [e * kPencils + l], complex ones at
// [(2 e) * kPencils + l] and [(2 e + 1) * kPencils + l]. Not scaled.
template <class T>
class Pencils {
public:
    explicit Pencils(std::size_t length);
    ~Pencils();
    Pencils(Pencils &&) noexcept;
    std::size_t length() const { return length_; }

    // Real to half complex: r0, r1, i1, r2, i2, ... and back. `data` is aligned to 64 bytes.
    void real_forward(T *data) const;
    void real_backward(T *data) const;
    void forward(T *data) const;
    void backward(T *data) const;

private:
    struct Plans;
    std::size_t length_;
    std::unique_ptr<Plans> plans_;
};

}  // namespace volillum
