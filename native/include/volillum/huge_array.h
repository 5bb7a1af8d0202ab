// A large array without initial values, in large pages where the system has them.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <new>

#include "volillum/pages.h"

namespace volillum {

template <class T>
class HugeArray {
public:
    HugeArray() = default;
    explicit HugeArray(std::size_t count) {
        if (count > std::numeric_limits<std::size_t>::max() / 2 / sizeof(T)) throw std::bad_alloc();
        if (count == 0) return;
        data_ = {static_cast<T *>(take_huge_pages(count * sizeof(T))), Free{count * sizeof(T)}};
    }
    T *data() const { return data_.get(); }

private:
    struct Free {
        std::size_t bytes = 0;
        void operator()(T *data) const { give_pages(data, bytes); }
    };
    std::unique_ptr<T, Free> data_;
};

}  // namespace volillum
