#include "pencils.h"

#include <pocketfft/pocketfft_hdronly.h>

#include "volillum/cpu.h"

namespace volillum {
namespace {

namespace fft = pocketfft::detail;

template <class T>
using Lanes [[gnu::vector_size(kPencilBytes)]] = T;

// pocketfft passes vectors by value, and how that is done depends on the instruction set:
// everything must be inlined into the dispatched function.
#define VOLILLUM_PENCILS __attribute__((flatten)) VOLILLUM_DISPATCH

// clang-format off
#define VOLILLUM_TRANSFORMS(T)                                                                   \
    VOLILLUM_PENCILS void run(const fft::rfftp<T> &plan, T *data, bool forward) {                \
        plan.exec(reinterpret_cast<Lanes<T> *>(data), T(1), forward);                            \
    }                                                                                            \
    VOLILLUM_PENCILS void run(const fft::cfftp<T> &plan, T *data, bool forward) {                \
        plan.exec(reinterpret_cast<fft::cmplx<Lanes<T>> *>(data), T(1), forward);                \
    }
// clang-format on
VOLILLUM_TRANSFORMS(float)
VOLILLUM_TRANSFORMS(double)

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
    run(plans_->real, data, true);
}
template <class T>
void Pencils<T>::real_backward(T *data) const {
    run(plans_->real, data, false);
}
template <class T>
void Pencils<T>::forward(T *data) const {
    run(plans_->complex, data, true);
}
template <class T>
void Pencils<T>::backward(T *data) const {
    run(plans_->complex, data, false);
}

template class Pencils<float>;
template class Pencils<double>;

}  // namespace volillum
