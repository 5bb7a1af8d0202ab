// The number type of the kernels. One alias, so that a build in double precision
// (-DVOLILLUM_REAL=double) can tell rounding from discretisation.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

#include "volillum/cpu.h"

#ifndef VOLILLUM_REAL
#define VOLILLUM_REAL float
#endif

namespace volillum {

using Real = VOLILLUM_REAL;
using Index3 = std::array<int, 3>;
using Vec3d = std::array<double, 3>;

// Lengths of rows that kernels loop over are rounded up to this many numbers, so that every loop
// is whole vectors (16 float lanes of AVX-512) and no remainder is computed in another order.
constexpr int kLanes = 16;
constexpr int round_up(int count) {
    return (count + kLanes - 1) / kLanes * kLanes;
}

// Buffers of kernels start on a cache line: vectors that straddle lines take twice the time.
template <class T>
struct LineAllocator {
    using value_type = T;
    static constexpr std::align_val_t line{64};
    LineAllocator() = default;
    template <class U>
    LineAllocator(const LineAllocator<U> &) {}
    T *allocate(std::size_t count) {
        return static_cast<T *>(::operator new(count * sizeof(T), line));
    }
    void deallocate(T *pointer, std::size_t) { ::operator delete(pointer, line); }
    friend bool operator==(const LineAllocator &, const LineAllocator &) { return true; }
};
using Reals = std::vector<Real, LineAllocator<Real>>;

// kLanes numbers in vector registers, and the same at any address. Only as local variables and
// through references: how they are passed by value depends on the instruction set.
using Pack [[gnu::vector_size(kLanes * sizeof(Real))]] = Real;
using LoosePack
    [[gnu::vector_size(kLanes * sizeof(Real)), gnu::aligned(alignof(Real)), gnu::may_alias]] = Real;
VOLILLUM_INLINE const LoosePack &pack(const Real *p) {
    return *reinterpret_cast<const LoosePack *>(p);
}
VOLILLUM_INLINE LoosePack &pack(Real *p) {
    return *reinterpret_cast<LoosePack *>(p);
}

}  // namespace volillum
