// What a photon leaves behind on its way, as deposits that wait to be written.
#pragma once

#include "photon_lane.h"
#include "photon_write.h"

namespace volillum {

template <int Colours>
class HandOver {
public:
    using Lane = PhotonLane<Colours>;
    using Photon = typename Lane::Photon;

    VOLILLUM_INLINE HandOver(const TraceContext &context, Waiting &waiting)
        : context_(context),
          waiting_(waiting),
          scale_(context.sign * Deposits::unit / float(context.geometry->voxel_diagonal)) {}

    // The flight as far as `end`, track length times weight.
    VOLILLUM_INLINE void track(const Lane &lane, float end) const {
        const Photon &photon = lane.photon;
        if (!photon.deposits || !context_.tracks) return;
        const Flight &flight = photon.flight;
        // Boxes [i, i + 1] in p = start - 1/2; what rounding could add is clipped when it is
        // written.
        const int axis = context_.deposits->axis();
        const auto plane = [&](float way) {
            const float p = flight.start[axis] - 0.5f + way * flight.step[axis];
            return std::min(std::max(p, 0.0f), float(context_.field->shape[std::size_t(axis)] - 1));
        };
        const float one = plane(0.0f), two = plane(end);
        wait(photon, flight.start, scale_, end, int(std::min(one, two)), int(std::max(one, two)));
    }

    // A possible collision stands for the light of 1 / majorant of path. Units are whole: they are
    // dithered, as one majorant's deposits are all alike.
    VOLILLUM_INLINE void ball(Lane &lane) const {
        if (!context_.points || !lane.photon.deposits) return;
        const Photon &photon = lane.photon;
        float q[3];
        for (int a = 0; a < 3; ++a) q[a] = lane.flights.q[a][lane.at];
        const float dither = unit_of(lane.random.next()) - 0.5f;
        const int axis = context_.deposits->axis();
        const int first = context_.ball.lowest(q, axis),
                  last = context_.ball.highest(*context_.field, q, axis);
        if (first > last) return;
        const float scale = context_.sign * context_.ball_scale / lane.flights.majorant[lane.at];
        wait(photon, q, scale, context_.sign * dither, first, last);
    }

private:
    // Planes first to last across the slabs' axis are concerned.
    VOLILLUM_INLINE void wait(const Photon &photon, const float *start, float scale, float end,
                              int first, int last) const {
        Deposit some{photon.flight, end, {}, {}};
        std::copy_n(start, 3, some.flight.start);
        std::copy_n(photon.direction, 3, some.direction);
        for (int c = 0; c < Colours; ++c) some.weight[c] = scale * photon.weight[c];
        const Deposits &deposits = *context_.deposits;
        waiting_.push(some, deposits.slab_of(first), deposits.slab_of(last));
    }

    const TraceContext &context_;
    Waiting &waiting_;
    float scale_;
};

}  // namespace volillum
