#include "pencils.h"

#include <pocketfft/pocketfft_hdronly.h>

#include <cstring>
#include <vector>

#include "volillum/real.h"

namespace volillum {
namespace {

namespace fft = pocketfft::detail;

template <class T, int bytes>
using Lanes [[gnu::vector_size(bytes)]] = T;
template <int bytes>
struct Bytes {};

// pocketfft passes vectors by value, and how that is done depends on the instruction set:
// everything must be inlined into the version for the machine's, with vectors of its width.
// clang-format off
#define VOLILLUM_TRANSFORM(Plan, T, Element, bytes, version)                                \
    __attribute__((flatten)) version void run(const fft::Plan<T> &plan, T *data, bool forward, \
                                              Bytes<bytes>) {                               \
        plan.exec(reinterpret_cast<Element *>(data), T(1), forward);                        \
    }
#define VOLILLUM_TRANSFORMS(T, bytes, version)                                              \
    using T##bytes = Lanes<T, bytes>;                                                       \
    VOLILLUM_TRANSFORM(rfftp, T, T##bytes, bytes, version)                                  \
    VOLILLUM_TRANSFORM(cfftp, T, fft::cmplx<T##bytes>, bytes, version)
// clang-format on
VOLILLUM_TRANSFORMS(float, 64, VOLILLUM_TARGET("arch=x86-64-v4"))
VOLILLUM_TRANSFORMS(double, 64, VOLILLUM_TARGET("arch=x86-64-v4"))
VOLILLUM_TRANSFORMS(float, 32, VOLILLUM_TARGET("arch=x86-64-v3"))
VOLILLUM_TRANSFORMS(double, 32, VOLILLUM_TARGET("arch=x86-64-v3"))
VOLILLUM_TRANSFORMS(float, 16, )
VOLILLUM_TRANSFORMS(double, 16, )

// Takes the pencils of a narrower vector out, transforms them and puts them back.
template <int bytes, class Plan, class T>
void run_parts(const Plan &plan, T *data, std::size_t numbers, bool forward) {
    constexpr std::size_t lanes = bytes / sizeof(T);
    std::vector<T, LineAllocator<T>> part(numbers * lanes);
    for (std::size_t first = 0; first < kPencils<T>; first += lanes) {
        for (std::size_t e = 0; e < numbers; ++e)
            std::memcpy(part.data() + e * lanes, data + e * kPencils<T> + first, bytes);
        run(plan, part.data(), forward, Bytes<bytes>{});
        for (std::size_t e = 0; e < numbers; ++e)
            std::memcpy(data + e * kPencils<T> + first, part.data() + e * lanes, bytes);
    }
}

template <class Plan, class T>
void transform(const Plan &plan, T *data, std::size_t numbers, bool forward) {
    switch (instruction_level()) {
        case InstructionLevel::v4:
            return run(plan, data, forward, Bytes<kPencilBytes>{});
        case InstructionLevel::v3:
            return run_parts<32>(plan, data, numbers, forward);
        default:
            return run_parts<16>(plan, data, numbers, forward);
    }
}

}  // namespace

std::size_t good_length(std::size_t length) {
    return fft::util::good_size_real(length);
}

template <class T>
struct Pencils<T>::Plans {
    explicit Plans(std::size_t length) : real(length), complex(length) {}
    fft::rfftp<T> real;
    fft::cfftp<T> complex;
};

template <class T>
Pencils<T>::Pencils(std::size_t length)
    : length_(length), plans_(std::make_unique<Plans>(length)) {}
template <class T>
Pencils<T>::~Pencils() = default;
template <class T>
Pencils<T>::Pencils(Pencils &&) noexcept = default;

template <class T>
void Pencils<T>::real_forward(T *data) const {
    transform(plans_->real, data, length_, true);
}
template <class T>
void Pencils<T>::real_backward(T *data) const {
    transform(plans_->real, data, length_, false);
}
template <class T>
void Pencils<T>::forward(T *data) const {
    transform(plans_->complex, data, 2 * length_, true);
}
template <class T>
void Pencils<T>::backward(T *data) const {
    transform(plans_->complex, data, 2 * length_, false);
}

template class Pencils<float>;
template class Pencils<double>;

}  // namespace volillum
