// What the cone transport keeps while it marches, and how far its slabs have come.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <vector>

#include "cone_transport_kernels.h"
#include "volillum/control.h"
#include "volillum/huge_pages.h"

namespace volillum::cone_detail {

// Rows with margins on both sides; column 0 of each starts on a cache line.
struct RowLayout {
    int margin = 0, pitch = 0;
    RowLayout() = default;
    RowLayout(int columns, int reach)
        : margin(round_up(reach + kLanes)), pitch(margin + round_up(columns) + margin) {
        // Rows a power of two apart would meet in one set of the cache.
        if (pitch % (8 * kLanes) == 0) pitch += kLanes;
    }
};

// The rays of all directions. A row of memory follows its rays from slice to slice: it is the row
// of the slice less what the rays have moved since the first, modulo the number of rows. Within it
// they lie at their columns of the slice.
class RayStates {
public:
    void resize(std::size_t directions, int rows, const RowLayout &layout, int albedos) {
        rows_ = rows;
        layout_ = layout;
        plane_ = std::size_t(rows) * std::size_t(layout.pitch);
        albedos_ = albedos;
        values_.resize(directions * quantities() * plane_);
    }
    // At column 0; `row` counts from the rays' first.
    RayRow at(std::size_t direction, int row) {
        const int held = (row % rows_ + rows_) % rows_;
        Real *first = values_.data() + direction * quantities() * plane_ +
                      std::size_t(held) * std::size_t(layout_.pitch) + layout_.margin;
        RayRow result{first, {}, {}};
        for (int i = 0; i < albedos_; ++i) {
            result.known[i] = first + std::size_t(1 + 2 * i) * plane_;
            result.missing[i] = first + std::size_t(2 + 2 * i) * plane_;
        }
        return result;
    }

private:
    std::size_t quantities() const { return std::size_t(1 + 2 * albedos_); }
    int rows_ = 0, albedos_ = 0;
    RowLayout layout_;
    std::size_t plane_ = 0;
    HugeReals values_;
};

// Rows of some quantities, with margins of zeros, of which each row is one after the other.
class Rowed {
public:
    void resize(int rows, int quantities, const RowLayout &layout) {
        quantities_ = quantities;
        layout_ = layout;
        values_.assign(std::size_t(rows) * std::size_t(quantities) * std::size_t(layout.pitch), 0);
    }
    // At column 0.
    Real *at(int row, int quantity) {
        const std::ptrdiff_t line = std::ptrdiff_t(row) * quantities_ + quantity;
        return values_.data() + line * layout_.pitch + layout_.margin;
    }

    void clear(int row, int rows) {
        const std::ptrdiff_t line = std::ptrdiff_t(quantities_) * layout_.pitch;
        std::fill_n(values_.data() + row * line, rows * line, Real(0));
    }

private:
    int quantities_ = 0;
    RowLayout layout_;
    Reals values_;
};

// The medium and L_i on one slice: the last `held` of its rows, and zeros beside the lattice.
class SlicePlanes {
public:
    void resize(int rows, int held, const RowLayout &layout, int albedos) {
        albedos_ = albedos;
        rows_ = rows;
        held_ = std::min(held, rows);
        planes_.resize(held_ + 1, 1 + 2 * albedos, layout);
    }
    void clear() { planes_.clear(0, held_); }
    Real *sigma_t(int row) { return at(row, 0); }
    Real *sigma_a(int row, int i) { return at(row, 1 + i); }
    Real *in_scattered(int row, int i) { return at(row, 1 + albedos_ + i); }
    // This row and the next, at `column`.
    SliceRows rows(int row, int column) {
        const auto both = [&](int quantity) {
            return Rows{at(row, quantity) + column, at(row + 1, quantity) + column};
        };
        SliceRows result{both(0), {}, {}};
        for (int i = 0; i < albedos_; ++i) {
            result.sigma_a[i] = both(1 + i);
            result.in_scattered[i] = both(1 + albedos_ + i);
        }
        return result;
    }

private:
    Real *at(int row, int quantity) {
        return planes_.at(row < 0 || row >= rows_ ? held_ : row % held_, quantity);
    }
    int albedos_ = 1, rows_ = 0, held_ = 0;
    Rowed planes_;
};

// Sums over directions of what a RayRow holds, for two rows of points at a time.
class SumRows {
public:
    void resize(const RowLayout &layout, int albedos) {
        albedos_ = albedos;
        sums_.resize(2, 1 + 2 * albedos, layout);
    }
    void clear() { sums_.clear(0, 2); }
    void clear(int row) { sums_.clear(row & 1, 1); }
    RayRow at(int row) {
        row &= 1;
        RayRow result{sums_.at(row, 0), {}, {}};
        for (int i = 0; i < albedos_; ++i) {
            result.known[i] = sums_.at(row, 1 + 2 * i);
            result.missing[i] = sums_.at(row, 2 + 2 * i);
        }
        return result;
    }

private:
    int albedos_ = 1;
    Rowed sums_;
};

// Local weights of the directions at the points of two rows at a time.
class WeightRows {
public:
    void resize(const RowLayout &layout, std::size_t directions) {
        weights_.resize(2, int(directions), layout);
    }
    Real *at(int row, std::size_t direction) { return weights_.at(row & 1, int(direction)); }

private:
    Rowed weights_;
};

// Lets slabs wait, without spinning, for the bands of the slab before that they read.
class Progress {
public:
    explicit Progress(int slabs) : done_(std::size_t(slabs)) {}
    void wait(int slab, int bands, const Control *control) {
        if (slab < 0) return;
        std::unique_lock<std::mutex> lock(mutex_);
        while (done_[std::size_t(slab)] < bands) {
            // Looks up now and then: a thread that was cancelled or failed tells nobody.
            changed_.wait_for(lock, std::chrono::milliseconds(20));
            if ((control && control->cancelled()) || failed_) throw Cancelled();
        }
    }
    void finish(int slab, int bands) {
        const std::lock_guard<std::mutex> lock(mutex_);
        done_[std::size_t(slab)] = bands;
        changed_.notify_all();
    }
    void fail() {
        const std::lock_guard<std::mutex> lock(mutex_);
        failed_ = true;
        changed_.notify_all();
    }

private:
    std::vector<int> done_;
    bool failed_ = false;
    std::mutex mutex_;
    std::condition_variable changed_;
};

}  // namespace volillum::cone_detail
