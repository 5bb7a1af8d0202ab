// A large uninitialised array in large pages, where the system has them: its first touch costs
// less.
#pragma once

#include <cstddef>
#include <memory>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace volillum {

template <class T>
class HugeArray {
public:
    HugeArray() = default;
    explicit HugeArray(std::size_t count)
        : data_(static_cast<T *>(::operator new(count * sizeof(T), page))) {
#if defined(__linux__) && defined(MADV_HUGEPAGE)
        // Only advice: where it is refused, pages are small.
        if (count * sizeof(T) >= std::size_t(page))
            (void)madvise(data_.get(), count * sizeof(T), MADV_HUGEPAGE);
#endif
    }
    T *data() const { return data_.get(); }

private:
    static constexpr std::align_val_t page{std::size_t(2) << 20};
    struct Free {
        void operator()(T *data) const { ::operator delete(data, page); }
    };
    std::unique_ptr<T, Free> data_;
};

}  // namespace volillum
