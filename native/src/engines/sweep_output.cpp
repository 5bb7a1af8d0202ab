#include "sweep_output.h"

namespace volillum::sweep_detail {

namespace {

// Slices and directions a little apart: many rows at a distance of 2^n would evict each other from
// the cache.
std::ptrdiff_t slice_pitch_of_values(const Box &tile) {
    return std::ptrdiff_t(round_up(tile.columns.size())) * tile.rows.size() + kLanes;
}

}  // namespace

std::size_t numbers_of_values(const Box &tile) {
    return std::size_t(slice_pitch_of_values(tile) * tile.slices.size() +
                       round_up(tile.columns.size()));
}

Rows rows_of_values(const Box &tile, std::size_t directions, Reals &values) {
    const std::size_t numbers = numbers_of_values(tile);
    values.resize(directions * numbers);
    return {.first = values.data(),
            .first_slice = tile.slices.begin,
            .first_row = tile.rows.begin,
            .slice_pitch = slice_pitch_of_values(tile),
            .row_pitch = round_up(tile.columns.size()),
            .channel_pitch = std::ptrdiff_t(numbers),
            .add = false};
}

std::size_t Output::numbers(const Box &box) {
    return std::size_t(slice_pitch(box)) * std::size_t(box.slices.size());
}

Rows Output::rows(const Frame &frame, const Box &box, const Range &channels, bool add, bool apart,
                  Reals &result) const {
    Real *to = at(frame, box, channels);
    if (!frame.transposed() && !apart)
        return {.first = to,
                .first_slice = box.slices.begin,
                .first_row = box.rows.begin,
                .slice_pitch = frame.slice_stride,
                .row_pitch = frame.row_stride,
                .channel_pitch = channel_pitch_,
                .add = add,
                .next = frame.rows_are_inner() ? frame.row_stride : frame.slice_stride};
    result.resize(numbers(box) * std::size_t(channels.size()));
    return {.first = result.data(),
            .first_slice = box.slices.begin,
            .first_row = box.rows.begin,
            .slice_pitch = slice_pitch(box),
            .row_pitch = row_pitch(box),
            .channel_pitch = std::ptrdiff_t(numbers(box)),
            .add = false,
            .columns = to,
            .column_pitch = frame.column_stride,
            .columns_channel_pitch = channel_pitch_};
}

void Output::deliver(const Frame &frame, const Box &box, const Range &channels, bool add,
                     const Rows &rows) const {
    Real *to = at(frame, box, channels);
    if (rows.first == to || box.empty()) return;  // it is there already
    Rows from = rows;
    for (int channel = channels.begin; channel < channels.end; ++channel) {
        if (frame.transposed())
            for (int b = box.rows.begin; b < box.rows.end; ++b)
                transpose_out(from.at(box.slices.begin, b), from.slice_pitch, box.slices.size(),
                              box.columns.size(), frame.forward, add,
                              to + (b - box.rows.begin) * frame.row_stride, frame.column_stride,
                              frame.row_stride);
        else
            box.for_rows(frame, [&](int t, int b) {
                take_row(from.at(t, b), box.columns.size(), add,
                         to + (t - box.slices.begin) * frame.slice_stride +
                             (b - box.rows.begin) * frame.row_stride);
            });
        from.first += from.channel_pitch;
        to += channel_pitch_;
    }
}

}  // namespace volillum::sweep_detail
