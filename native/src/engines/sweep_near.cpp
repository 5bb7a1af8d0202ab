#include "sweep_near.h"

#include <algorithm>

namespace volillum::sweep_detail {
namespace {

// What lies under the taps of some voxels.
Box reach(const Tap *begin, const Tap *end, const Box &voxels) {
    Range rows{0, 0}, columns{0, 0};
    for (const Tap *tap = begin; tap != end; ++tap) {
        if (tap == begin) rows = {tap->row, tap->row}, columns = {tap->column, tap->column};
        rows = {std::min(rows.begin, tap->row), std::max(rows.end, tap->row)};
        columns = {std::min(columns.begin, tap->column), std::max(columns.end, tap->column)};
    }
    // Taps are in the order of slices.
    return {
        {voxels.slices.begin - end[-1].slices_outward, voxels.slices.end - begin->slices_outward},
        {voxels.rows.begin + rows.begin, voxels.rows.end + rows.end},
        {voxels.columns.begin + columns.begin, voxels.columns.end + columns.end}};
}

}  // namespace

void set_runs(const Tap *begin, const Tap *end, const Block &block, Real unit, Stencil &stencil) {
    std::vector<Stencil::Run> &runs = stencil.runs;
    runs.clear();
    const Tap *last = nullptr;
    for (const Tap *tap = begin; tap != end; last = tap++) {
        const bool goes_on = last && tap->slices_outward == last->slices_outward &&
                             tap->column == last->column && tap->row == last->row + 1 &&
                             runs.back().length < kLongestRun;
        if (!goes_on)
            runs.push_back({-tap->slices_outward * block.slice_pitch() +
                                tap->row * block.row_pitch() + tap->column,
                            0,
                            {}});
        runs.back().coefficients[runs.back().length++] = tap->coefficient * unit;
    }
}

bool NearSums::sum(const Frame &frame, const Real *sigma_t, Real largest,
                   const Direction &direction, Real unit, const Box &voxels) {
    voxels_ = voxels;
    sums_.assign(place(voxels.slices.end, voxels.rows.begin), 0);
    piece_.resize(std::size_t(kStencilRows * lanes()));
    bool filled = false;
    const Tap *const end = direction.near_field.data() + direction.near_field.size();
    for (const Tap *begin = direction.near_field.data(); begin != end;) {
        const Tap *const next = std::find_if(begin, end, [begin](const Tap &tap) {
            return tap.slices_outward >= begin->slices_outward + kPieceSlices;
        });
        if (block_.load(frame, sigma_t, largest, reach(begin, next, voxels))) {
            set_runs(begin, next, block_, unit, stencil_);
            add_piece();
            filled = true;
        }
        begin = next;
    }
    return filled;
}

void NearSums::add_piece() {
    const Range &rows = voxels_.rows;
    for (int t = voxels_.slices.begin; t < voxels_.slices.end; ++t)
        for (int b = rows.begin; b < rows.end;) {
            const int together = rows.end - b >= kStencilRows ? kStencilRows : 1;
            apply_stencil(stencil_, block_.at(t, b, voxels_.columns.begin), block_.row_pitch(),
                          together, voxels_.columns.size(), piece_.data(), lanes());
            take_row(piece_.data(), together * lanes(), true, sums_.data() + place(t, b));
            b += together;
        }
}

}  // namespace volillum::sweep_detail
