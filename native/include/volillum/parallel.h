// Independent work items over a few threads: no barrier inside an item, dynamic order, first
// exception wins. Results must not depend on which thread runs an item.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "volillum/control.h"

namespace volillum {

// Threads of a call that does not say how many; 0: all cores.
inline std::atomic<int> default_threads{0};

inline int thread_count(int requested) {
    if (requested > 0) return requested;
    const int limit = default_threads.load(std::memory_order_relaxed);
    if (limit > 0) return limit;
    return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

// Calls work(item, thread) for item in [0, items). Throws Cancelled when `control` says so.
// Progress runs from `progress_begin` to `progress_end`.
template <class Work>
void parallel_for(std::size_t items, int threads, Control *control, Work &&work,
                  double progress_begin = 0.0, double progress_end = 1.0) {
    std::atomic<std::size_t> next{0}, done{0};
    std::exception_ptr failure;
    std::mutex failure_mutex;
    auto run = [&](int thread) {
        try {
            for (;;) {
                const std::size_t item = next.fetch_add(1);
                if (item >= items) return;
                if (control && control->cancelled()) throw Cancelled();
                work(item, thread);
                if (control)
                    control->set_progress(progress_begin + (progress_end - progress_begin) *
                                                               double(done.fetch_add(1) + 1) /
                                                               double(items));
            }
        } catch (...) {
            next.store(items);
            const std::lock_guard<std::mutex> lock(failure_mutex);
            if (!failure) failure = std::current_exception();
        }
    };
    const int count =
        static_cast<int>(std::min<std::size_t>(std::size_t(thread_count(threads)), items));
    std::vector<std::thread> others;
    for (int thread = 1; thread < count; ++thread) others.emplace_back(run, thread);
    run(0);
    for (std::thread &other : others) other.join();
    if (failure) std::rethrow_exception(failure);
}

}  // namespace volillum
