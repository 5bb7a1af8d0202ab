// Photons that fly side by side, one to a lane of vector code: delta tracking between the events
// that are told lane by lane.
#pragma once

#include "photon_field.h"

namespace volillum {

// Vectors of GCC and Clang, 8 photons wide: the compiler splits what a processor does not have.
using Floats = float __attribute__((vector_size(32)));
using Ints = std::int32_t __attribute__((vector_size(32)));
using Words = std::uint32_t __attribute__((vector_size(32)));

VOLILLUM_INLINE float to_float(std::int32_t x) {
    return float(x);
}
VOLILLUM_INLINE Floats to_float(const Ints &x) {
    return __builtin_convertvector(x, Floats);
}

// -log of a uniform in (0, 1) made of 31 random bits: an exponential variate up to 22.2, relative
// error 1e-6; of one word or of a vector. Polynomial as in Cephes' logf (S. Moshier).
template <class Float, class Int, class Word>
VOLILLUM_INLINE Float exponential_of(const Word &bits) {
    const Float u = to_float(Int(bits >> 1)) + 0.5f;  // times 2^-31
    const Int raw = std::bit_cast<Int>(u);
    // Mantissa in [sqrt(1/2), sqrt(2)).
    const Int shifted = raw - 0x3f3504f3;
    const Int exponent = shifted >> 23;
    const Float m = std::bit_cast<Float>(Int((shifted & 0x007fffff) + 0x3f3504f3)) - 1.0f;
    Float p = m * 7.0376836292e-2f - 1.1514610310e-1f;
    p = p * m + 1.1676998740e-1f;
    p = p * m - 1.2420140846e-1f;
    p = p * m + 1.4249322787e-1f;
    p = p * m - 1.6668057665e-1f;
    p = p * m + 2.0000714765e-1f;
    p = p * m - 2.4999993993e-1f;
    p = p * m + 3.3333331174e-1f;
    const Float squared = m * m;
    const Float log_m = m + squared * (m * p - 0.5f);
    const Float result = to_float(Int(31 - exponent)) * 0.693147180559945f - log_m;
    return result > 0.0f ? result : Float{};
}
VOLILLUM_INLINE float exponential(std::uint32_t bits) {
    return exponential_of<float, std::int32_t>(bits);
}
VOLILLUM_INLINE Floats exponential(const Words &bits) {
    return exponential_of<Floats, Ints>(bits);
}

// Every step of a lane draws the same random numbers whatever happens in it, so that a photon's
// fate does not depend on its neighbours.
struct Flights {
    static constexpr int width = 8;
    // What a step led to: nothing, a possible collision, the end of the grid, or a macrocell that
    // is to be walked cell by cell.
    static constexpr std::int32_t flying = 0, possible = 1, outside = 2, dense = 3;

    Floats q[3], step[3], inverse[3];  // q, per world unit, its reciprocals
    Floats travelled;                  // since the flight began, world units
    Floats depth;                      // optical depth under the majorant to the next collision
    Floats majorant, accept;
    Floats value;    // sigma_t (its first channel) at the corner
    Ints corner[3];  // the voxel that stands for the interpolated value
    Ints matter;     // -1 where there is such a voxel
    Ints cell[3], state;
    Words random[4];

    VOLILLUM_INLINE std::size_t voxel(const PhotonField &field, int lane) const {
        return std::size_t(corner[0][lane]) * field.stride[0] +
               std::size_t(corner[1][lane]) * field.stride[1] + std::size_t(corner[2][lane]);
    }
    VOLILLUM_INLINE Random random_of(int lane) const {
        return Random({random[0][lane], random[1][lane], random[2][lane], random[3][lane]});
    }
    VOLILLUM_INLINE void set_random(int lane, const Random &stream) {
        for (std::size_t i = 0; i < 4; ++i) random[i][lane] = stream.state()[i];
    }

    // One step of every lane: to a possible collision or across a macrocell. Lanes without a photon
    // fly too, anywhere.
    VOLILLUM_INLINE void fly(const PhotonField &field) {
        constexpr int block = PhotonField::block;
        const Ints number = (cell[0] * field.blocks[1] + cell[1]) * field.blocks[2] + cell[2];
        const auto count = field.majorants.size();
        for (int l = 0; l < width; ++l) {
            const auto n = std::size_t(std::uint32_t(number[l]));
            majorant[l] = field.majorants[n < count ? n : 0];
        }
        Floats plane[3], exit[3];
        Ints up[3];
        for (int a = 0; a < 3; ++a) {
            up[a] = step[a] > 0.0f;  // -1 is true
            plane[a] = to_float(block * (cell[a] - up[a]));
            exit[a] = (plane[a] - q[a]) * inverse[a];
        }
        const Ints y_first = exit[1] < exit[2];
        const Floats yz = y_first ? exit[1] : exit[2];
        const Ints x_first = exit[0] < yz;
        const Floats nearest = x_first ? exit[0] : yz;
        const Floats far = nearest > 0.0f ? nearest : Floats{};
        const Floats across = majorant * far;
        const Ints held = majorant > field.dense, hit = ~held & (depth < across);
        const Ints crosses = ~(held | hit);
        const Ints along[3] = {crosses & x_first, crosses & ~x_first & y_first,
                               crosses & ~x_first & ~y_first};
        Floats way = hit ? depth / majorant : far;
        way = held ? Floats{} : way;
        travelled += way;

        const Words u = draw(), v = draw();
        constexpr std::uint32_t mask = (1u << 21) - 1;
        const Words jitter[3] = {u & mask, (u >> 21 | v << 11) & mask, v >> 11};
        Ints inside = hit, out{};
        for (int a = 0; a < 3; ++a) {
            q[a] += way * step[a];
            q[a] = along[a] ? plane[a] : q[a];
            // Inside the macrocell's corners, whatever rounding did to q: its majorant holds there.
            const Ints low = cell[a] * block, high = low + block;
            Ints c = __builtin_convertvector(q[a] + to_float(Ints(jitter[a])) * 0x1p-21f, Ints);
            c = c < low ? low : c;
            c = c > high ? high : c;
            corner[a] = c - 1;
            inside &= (c > 0) & (c <= field.shape[a]);
            cell[a] -= along[a] & (up[a] | 1);
            out |= (cell[a] < 0) | (cell[a] >= field.blocks[a]);
        }
        // The void reads voxel 0, so that no branch is to be foretold.
        matter = inside;
        for (Ints &index : corner) index &= inside;
        const Floats next = exponential(draw());
        accept = to_float(Ints(draw() >> 8)) * 0x1p-24f;
        depth = hit ? next : held ? depth : depth - across;
        state = (hit & possible) | (held & dense) | (crosses & out & outside);
        // Fetched long before they are read: memory may take its time, and nothing waits for it.
        for (int l = 0; l < width; ++l) __builtin_prefetch(field.sigma_t + voxel(field, l));
    }

    // Reads what the last step has fetched.
    VOLILLUM_INLINE void read(const PhotonField &field) {
        for (int l = 0; l < width; ++l) value[l] = field.sigma_t[voxel(field, l)];
    }

    // The lanes to which something happens, one bit each: where `decided`, null collisions are
    // nothing.
    VOLILLUM_INLINE std::uint32_t events(bool decided) const {
        Ints happens = state != flying;
        if (decided) happens &= (state != possible) | (matter & (accept * majorant < value));
        std::uint32_t bits = 0;
        for (int l = 0; l < width; ++l) bits |= std::uint32_t(happens[l] & 1) << l;
        return bits;
    }

private:
    VOLILLUM_INLINE Words draw() {
        return Random::step(random[0], random[1], random[2], random[3]);
    }
};

}  // namespace volillum
