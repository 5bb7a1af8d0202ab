// Large pieces of memory straight from the system, to which they go back at once, and what makes
// malloc give back the others. It keeps what is freed, for each thread apart, up to twice as much
// as the largest piece that was ever freed: several times the input. Whoever comes again soon is
// faster for that: new pages take the system as long as kernels take to fill them.
#pragma once

#include <cstddef>
#include <new>

#if defined(__linux__)
#include <malloc.h>
#include <sys/mman.h>
#endif

namespace volillum {

// A page of the large kind, where the system has them.
constexpr std::size_t kHugePage = std::size_t(1) << 21;

inline void trim_malloc() {
#if defined(__GLIBC__)
    malloc_trim(0);
#endif
}

// Sanitizers watch what comes from malloc.
#if defined(__linux__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

constexpr std::size_t kPage = 4096;

inline void *take_huge_pages(std::size_t bytes) {
    // With room to begin at a page of the large kind.
    const std::size_t spare = kHugePage - kPage;
    bytes = (bytes + kPage - 1) / kPage * kPage;
    void *const taken =
        mmap(nullptr, bytes + spare, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (taken == MAP_FAILED) throw std::bad_alloc();
    char *const begin = static_cast<char *>(taken);
    const std::size_t before = (kHugePage - std::size_t(begin) % kHugePage) % kHugePage;
    if (before > 0) munmap(begin, before);
    if (spare > before) munmap(begin + before + bytes, spare - before);
    (void)madvise(begin + before, bytes, MADV_HUGEPAGE);  // only advice: failure changes nothing
    return begin + before;
}

inline void give_pages(void *begin, std::size_t bytes) {
    munmap(begin, (bytes + kPage - 1) / kPage * kPage);
}

#else

inline void *take_huge_pages(std::size_t bytes) {
    return ::operator new(bytes, std::align_val_t(kHugePage));
}
inline void give_pages(void *begin, std::size_t) {
    ::operator delete(begin, std::align_val_t(kHugePage));
}

#endif

}  // namespace volillum
