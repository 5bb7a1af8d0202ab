// What the cone transport keeps of a slice, and how far its bands have come.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <vector>

#include "cone_transport_kernels.h"
#include "volillum/control.h"

namespace volillum::cone_detail {

// Zero-padded rows of a slice.
class Plane {
public:
    void resize(int first_row, int rows, int columns, int margin) {
        first_row_ = first_row;
        margin_ = margin;
        pitch_ = round_up(margin) + round_up(columns + margin + 2 * kLanes);
        values_.assign(std::size_t(rows) * std::size_t(pitch_), 0);
    }
    Real *at(int row, int column) {
        return values_.data() + std::ptrdiff_t(row - first_row_) * pitch_ + round_up(margin_) +
               column;
    }
    const Real *at(int row, int column) const { return const_cast<Plane *>(this)->at(row, column); }
    Rows rows(int row, int column) const { return {at(row, column), at(row + 1, column)}; }

private:
    int first_row_ = 0, margin_ = 0;
    std::ptrdiff_t pitch_ = 0;
    Reals values_;
};

// The same of the three values of rays.
struct RayPlanes {
    Plane known, missing, seen;
    void resize(int first_row, int rows, int columns, int margin) {
        for (Plane *plane : {&known, &missing, &seen})
            plane->resize(first_row, rows, columns, margin);
    }
    RaysOut at(int row, int column) {
        return {known.at(row, column), missing.at(row, column), seen.at(row, column)};
    }
    RaysIn at(int row, int column) const {
        return {known.at(row, column), missing.at(row, column), seen.at(row, column)};
    }
};

// L_i and the medium on one slice.
struct SlicePlanes {
    Plane in_scattered, sigma_t, sigma_a;
};

// Lets bands of a slice wait, without spinning, for the bands of the slice before that they read.
class Progress {
public:
    explicit Progress(int bands) : done_(std::size_t(bands)) {}
    void wait(int band, int slices, const Control *control) {
        if (band < 0 || band >= int(done_.size()) || reached(band, slices)) return;
        std::unique_lock<std::mutex> lock(mutex_);
        while (!reached(band, slices)) {
            // Looks up now and then: a thread that was cancelled or failed tells nobody.
            changed_.wait_for(lock, std::chrono::milliseconds(20));
            if ((control && control->cancelled()) || failed_) throw Cancelled();
        }
    }
    void finish(int band, int slices) {
        done_[std::size_t(band)].store(slices, std::memory_order_release);
        const std::lock_guard<std::mutex> lock(mutex_);
        changed_.notify_all();
    }
    void fail() { failed_ = true; }

private:
    bool reached(int band, int slices) const {
        return done_[std::size_t(band)].load(std::memory_order_acquire) >= slices;
    }
    std::vector<std::atomic<int>> done_;
    std::atomic<bool> failed_{false};
    std::mutex mutex_;
    std::condition_variable changed_;
};

}  // namespace volillum::cone_detail
