// The compact copy of a tile's part of sigma_t.
#include "sweep_tile.h"

namespace volillum::sweep_detail {
namespace {

Range clip(const Range &range, int size) {
    const int begin = std::clamp(range.begin, 0, size);
    return {begin, std::max(begin, std::min(range.end, size))};
}

}  // namespace

Box box_of(const Frame &frame, const Index3 &begin, const Index3 &end) {
    const auto range = [&](int axis, int size) {
        const std::size_t i = std::size_t(axis);
        return Range{begin[i], end[i]}.common({0, size});
    };
    Range slices = range(frame.axis, frame.slices);
    if (frame.forward) slices = {frame.slices - slices.end, frame.slices - slices.begin};
    return {slices, range(frame.row_axis, frame.rows), range(frame.column_axis, frame.columns)};
}

std::size_t Block::place(const Box &box) {
    box_ = box;
    // Columns lie in cache lines as those of tiles do, which begin at multiples of a line. One lane
    // beyond: kernels read whole vectors. An odd number of lines keeps the rows of a column in
    // different cache sets.
    phase_ = (box.columns.begin % kLanes + kLanes) % kLanes;
    row_pitch_ = round_up(phase_ + box.columns.size()) + kLanes;
    if (row_pitch_ / kLanes % 2 == 0) row_pitch_ += kLanes;
    slice_pitch_ = row_pitch_ * box.rows.size();
    return std::size_t(slice_pitch_) * std::size_t(box.slices.size()) + 4 * kLanes;
}

void Block::reserve(const Box &box) {
    // Columns may begin anywhere in a line.
    Box widest = box;
    widest.columns.end += kLanes;
    data_.reserve(place(widest));
}

bool Block::load(const Frame &frame, const Real *sigma_t, Real largest, const Box &box) {
    const std::size_t size = place(box);
    if (data_.size() < size) data_.resize(size);

    const Range slices = clip(box.slices, frame.slices), rows = clip(box.rows, frame.rows),
                columns = clip(box.columns, frame.columns);
    // The memory takes as long as the copies of several rows, and does not foresee the next group
    // of slices.
    const std::ptrdiff_t ahead = (frame.rows_are_inner() ? 4 : 1) * frame.row_stride;
    bool filled = false;
    box.for_rows(frame, [&](int t, int b) {
        Real *row = const_cast<Real *>(at(t, b, box.columns.begin));
        Real *row_end = row + box.columns.size();
        if (t < slices.begin || t >= slices.end || b < rows.begin || b >= rows.end ||
            columns.size() == 0) {
            std::fill(row, row_end, Real(0));
            return;
        }
        Real *inside = row + (columns.begin - box.columns.begin);
        std::fill(row, inside, Real(0));
        std::fill(inside + columns.size(), row_end, Real(0));
        if (!frame.transposed())
            filled |= copy_row(sigma_t + frame.element(t, b, columns.begin), columns.size(),
                               largest, ahead, inside);
        else if (t == slices.begin)
            filled |= transpose_in(sigma_t + frame.element(t, b, columns.begin),
                                   frame.column_stride, ahead, columns.size(), slices.size(),
                                   frame.forward, largest, inside, slice_pitch_);
    });
    return filled;
}

}  // namespace volillum::sweep_detail
