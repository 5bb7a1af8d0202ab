// Cancelling and progress, shared between a running kernel and the thread that watches it.
#pragma once

#include <atomic>
#include <stdexcept>

namespace volillum {

struct Cancelled : std::runtime_error {
    Cancelled() : std::runtime_error("cancelled") {}
};

class Control {
public:
    void cancel() { cancelled_.store(true, std::memory_order_relaxed); }
    // A cancelled control stays cancelled: a later stage of the same work must see it.
    void restart_progress() { progress_.store(0.0, std::memory_order_relaxed); }
    bool cancelled() const { return cancelled_.load(std::memory_order_relaxed); }
    void set_progress(double fraction) { progress_.store(fraction, std::memory_order_relaxed); }
    double progress() const { return progress_.load(std::memory_order_relaxed); }

private:
    std::atomic<bool> cancelled_{false};
    std::atomic<double> progress_{0.0};
};

}  // namespace volillum
