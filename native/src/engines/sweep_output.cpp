#include "sweep_output.h"

namespace volillum::sweep_detail {

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
    // An odd number of lines apart: rows at a distance of 2^n would evict each other from the
    // cache.
    const std::ptrdiff_t row_pitch = round_up(box.columns.size()) + kLanes;
    const std::ptrdiff_t slice_pitch = row_pitch * box.rows.size() + kLanes;
    const std::ptrdiff_t channel_pitch = slice_pitch * box.slices.size();
    result.resize(std::size_t(channel_pitch) * std::size_t(channels.size()));
    return {.first = result.data(),
            .first_slice = box.slices.begin,
            .first_row = box.rows.begin,
            .slice_pitch = slice_pitch,
            .row_pitch = row_pitch,
            .channel_pitch = channel_pitch,
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
