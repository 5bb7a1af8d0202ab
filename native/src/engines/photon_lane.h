// Photons side by side: what of each the vector code does not need, and one of them at a time.
#pragma once

#include "photon_deposit.h"
#include "photon_flights.h"

namespace volillum {

template <int Colours>
struct PhotonVector {
    struct Photon {
        Flight flight;
        float direction[3];
        float weight[Colours], density[3];  // density: path densities of the channels, mean 1
        float full;                         // what roulette restores
        int hero, scatterings;
        bool deposits;
    };

    Flights flights{};
    Photon photons[Flights::width];
    std::uint32_t live = 0;
};

template <int Colours>
struct PhotonLane {
    using Vector = PhotonVector<Colours>;
    using Photon = typename Vector::Photon;

    Flights &flights;
    Photon &photon;
    int at;
    Random random;  // written back at the end

    VOLILLUM_INLINE PhotonLane(Vector &vector, int lane, const Random &stream)
        : flights(vector.flights), photon(vector.photons[lane]), at(lane), random(stream) {}
    VOLILLUM_INLINE PhotonLane(Vector &vector, int lane)
        : PhotonLane(vector, lane, vector.flights.random_of(lane)) {}
    VOLILLUM_INLINE ~PhotonLane() { flights.set_random(at, random); }
};

}  // namespace volillum
