// Scratch memory of the size of a grid.
#pragma once

#include <cstdlib>
#include <memory>
#include <new>
#if defined(__linux__)
#include <sys/mman.h>
#endif

#include "volillum/real.h"

namespace volillum {

// Numbers without initial values on huge pages where the system has them: to give out small pages
// takes it as long as the kernels take to fill them.
class HugeReals {
public:
    void resize(std::size_t count) {
        constexpr std::size_t page = std::size_t(1) << 21;
        const std::size_t bytes = (count * sizeof(Real) + page - 1) / page * page;
        data_.reset(static_cast<Real *>(::operator new(bytes, std::align_val_t(page))));
#if defined(__linux__)
        madvise(data_.get(), bytes, MADV_HUGEPAGE);  // only advice: failure changes nothing
#endif
    }
    bool empty() const { return !data_; }
    Real *data() { return data_.get(); }
    const Real *data() const { return data_.get(); }

private:
    struct Free {
        void operator()(Real *data) const {
            ::operator delete(data, std::align_val_t(std::size_t(1) << 21));
        }
    };
    std::unique_ptr<Real, Free> data_;
};

}  // namespace volillum
