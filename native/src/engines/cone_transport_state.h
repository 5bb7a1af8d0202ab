// What the cone transport keeps while it marches, and how far its slabs have come.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <vector>

#include "cone_transport_kernels.h"
#include "volillum/control.h"
#include "volillum/huge_array.h"

namespace volillum::cone_detail {

// Rows with margins on both sides, each of which serves two neighbours: all that is ever written
// there is the one number that stands beside the lattice. The first column of each row starts on a
// cache line.
struct RowLayout {
    int margin = 0, pitch = 0;
    RowLayout() = default;
    // `reach`: what is touched beside the columns, on each side.
    RowLayout(int columns, int reach)
        : margin(round_up(reach)), pitch(round_up(columns) + round_up(reach)) {
        // Rows a power of two apart would meet in one set of the cache.
        if (pitch % (8 * kLanes) == 0) pitch += kLanes;
    }
    // With the first one's margin, and room for a pack behind the last one's.
    std::size_t size(std::size_t lines) const {
        return lines * std::size_t(pitch) + std::size_t(margin) + kLanes;
    }
    // Of a line, for rows whose first column has that number: at column 0.
    std::ptrdiff_t column_0(std::size_t line, int first_column) const {
        return std::ptrdiff_t(line) * pitch + margin - first_column;
    }
};

// Lines of a quantity of all directions' rays. A line follows its rays from slice to slice: it is
// the row of the slice less what the rays have moved since the first, modulo the number of lines.
// Within it they lie at their columns of the slice.
class RayLines {
public:
    void resize(std::size_t quantities, int rows, const RowLayout &layout) {
        rows_ = rows;
        layout_ = layout;
        values_ = HugeArray<Real>(quantities * per_quantity() + kLanes);
    }
    // What is in place of a row that counts from the rays' first. A row is found as the sum of two
    // such lines, of which one serves many rows and the other many directions.
    int line(int row) const { return (row % rows_ + rows_) % rows_; }
    // Of quantity 0 at column 0.
    Real *at(int one, int two, int first_column) {
        const int sum = one + two;
        return values_.data() +
               layout_.column_0(std::size_t(sum < rows_ ? sum : sum - rows_), first_column);
    }
    // Several threads may be at lines of different quantities: these share no margin.
    std::size_t per_quantity() const { return layout_.size(std::size_t(rows_)) - kLanes; }

private:
    int rows_ = 0;
    RowLayout layout_;
    HugeArray<Real> values_;
};

// The rays of all directions: of each row what the next slice needs. `missing` is needed only until
// L_i is known, so it is kept for the rows of each slab in flight that lie between its first slice
// and its last, where it is added to `known`.
class RayStates {
public:
    void resize(std::size_t directions, int rows, int slabs, int slab_rows, const RowLayout &layout,
                int albedos) {
        directions_ = directions;
        albedos_ = std::size_t(albedos);
        slabs_ = slabs;
        kept_.resize(directions * (1 + albedos_), rows, layout);
        missing_.resize(std::size_t(slabs) * directions * albedos_, slab_rows, layout);
        none_missing_.assign(layout.size(1), Real(1));
        layout_ = layout;
    }
    struct Lines {
        int kept, missing;
    };
    // At column 0, of the row that is the sum of those of two lines.
    Lines lines(int row) const { return {kept_.line(row), missing_.line(row)}; }
    RayRow at(int slab, std::size_t direction, const Lines &one, const Lines &two,
              int first_column) {
        const std::size_t kept = kept_.per_quantity(), missing = missing_.per_quantity();
        RayRow result;
        result.seen =
            kept_.at(one.kept, two.kept, first_column) + direction * (1 + albedos_) * kept;
        const std::size_t place = std::size_t(slab % slabs_) * directions_ + direction;
        Real *const first_missing =
            missing_.at(one.missing, two.missing, first_column) + place * albedos_ * missing;
        for (std::size_t i = 0; i < albedos_; ++i) {
            result.known[i] = result.seen + (1 + i) * kept;
            result.missing[i] = first_missing + i * missing;
        }
        return result;
    }
    // A line of ones.
    const Real *settled(int first_column) const {
        return none_missing_.data() + layout_.column_0(0, first_column);
    }

private:
    std::size_t directions_ = 0, albedos_ = 1;
    int slabs_ = 1;
    RayLines kept_, missing_;
    Reals none_missing_;
    RowLayout layout_;
};

// Rows of some quantities, with margins of zeros, of which each row is one after the other.
class Rowed {
public:
    void resize(int rows, int quantities, const RowLayout &layout) {
        quantities_ = quantities;
        layout_ = layout;
        values_.assign(layout.size(std::size_t(rows) * std::size_t(quantities)), 0);
    }
    // For rows of another slice.
    void begin_at(int first_column) { first_column_ = first_column; }
    // At column 0.
    Real *at(int row, int quantity) {
        const std::size_t line =
            std::size_t(row) * std::size_t(quantities_) + std::size_t(quantity);
        return values_.data() + layout_.column_0(line, first_column_);
    }
    // From a quantity to the next.
    int pitch() const { return layout_.pitch; }

    void clear(int row, int rows) {
        const std::ptrdiff_t line = std::ptrdiff_t(quantities_) * layout_.pitch;
        std::fill_n(values_.data() + row * line, rows * line, Real(0));
    }

private:
    int quantities_ = 0, first_column_ = 0;
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
    void begin_at(int first_column) { planes_.begin_at(first_column); }
    // 0: sigma_t, from 1 on: the sigma_a.
    Real *medium(int row, int quantity) { return at(row, quantity); }
    Real *in_scattered(int row, int i) { return at(row, 1 + albedos_ + i); }
    // This row and the next, at column 0.
    SliceRows rows(int row) {
        const Real *const upper = at(row, 0), *const lower = at(row + 1, 0);
        const auto both = [&](int quantity) {
            const std::ptrdiff_t offset = std::ptrdiff_t(quantity) * planes_.pitch();
            return Rows{upper + offset, lower + offset};
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
    void begin_at(int first_column) { sums_.begin_at(first_column); }
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
    void begin_at(int first_column) { weights_.begin_at(first_column); }
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
