// Vectors as wide as the machine's registers, and the choice between the versions of a kernel.
#pragma once

#include <utility>

#include "volillum/real.h"

namespace volillum {

// A vector of some numbers, and the same at any address. A vector that is wider than a register is
// not split into several but lives in memory, at a quarter of the speed, so kernels are written for
// a Pack of any width. Only as local variables and through references: how vectors are passed by
// value depends on the instruction set.
template <int bytes>
struct PackOf {
    using type [[gnu::vector_size(bytes)]] = Real;
};
template <class Pack>
constexpr int lanes_of = int(sizeof(Pack) / sizeof(Real));

template <class Pack>
struct Loose {
    using type [[gnu::vector_size(sizeof(Pack)), gnu::aligned(alignof(Real)), gnu::may_alias]] =
        Real;
};
template <class Pack>
VOLILLUM_INLINE const typename Loose<Pack>::type &pack(const Real *p) {
    return *reinterpret_cast<const typename Loose<Pack>::type *>(p);
}
template <class Pack>
VOLILLUM_INLINE typename Loose<Pack>::type &pack(Real *p) {
    return *reinterpret_cast<typename Loose<Pack>::type *>(p);
}

// Keeps what was loaded in a register. GCC otherwise loads again wherever an operation can take its
// operand from memory, as if that were free; across cache lines it takes twice as long as the
// operation. Only in versions for an instruction set, where a Pack is a register.
template <class Pack>
VOLILLUM_INLINE void in_register([[maybe_unused]] Pack &loaded) {
#if defined(VOLILLUM_HAS_TARGETS)
    asm("" : "+v"(loaded));
#endif
}

// Tells a lambda which type of Pack.
template <class Pack>
struct Width {
    static_assert(kLanes % lanes_of<Pack> == 0, "rows are padded to whole packs of any width");
};

namespace pack_detail {

// By value: the body's captures then live in registers, whatever the kernel stores.
template <class Body>
VOLILLUM_TARGET("arch=x86-64-v4")
auto run_v4(Body body) {
    return body(Width<typename PackOf<64>::type>{});
}
template <class Body>
VOLILLUM_TARGET("arch=x86-64-v3")
auto run_v3(Body body) {
    return body(Width<typename PackOf<32>::type>{});
}
template <class Body>
auto run_baseline(Body body) {
    return body(Width<typename PackOf<16>::type>{});
}

}  // namespace pack_detail

// Calls body(Width<Pack>{}) in code for this machine's instruction set, where a Pack is a register:
//     in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA { ... });
// Captured by value, what the body reads does not change by what it stores. All it calls is
// inlined.
template <class Body>
auto in_packs(Body body) {
    switch (instruction_level()) {
        case InstructionLevel::v4:
            return pack_detail::run_v4(std::move(body));
        case InstructionLevel::v3:
            return pack_detail::run_v3(std::move(body));
        default:
            return pack_detail::run_baseline(std::move(body));
    }
}

}  // namespace volillum
