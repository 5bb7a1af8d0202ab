// Photon tracing: fluence of multiply scattered light in a trilinear medium, all orders.
//
// Photons fly by delta tracking against the majorants of macrocells. Every flight deposits its
// length times its weight into the boxes [i - 1/2, i + 1/2] of the voxels that it crosses, in
// integers, so that sums depend on no order. With radiance R and fluence 4 pi J,
//     J = (1 / 4 pi) sum of power * length / volume.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "volillum/control.h"
#include "volillum/trilinear.h"

namespace volillum {

// Draws an index in proportion to given weights, in constant time (Walker 1974, Vose 1991).
class AliasTable {
public:
    AliasTable() = default;
    // Throws std::invalid_argument unless some weight is positive.
    explicit AliasTable(const std::vector<double> &weights);
    // `u` uniform in [0, 1).
    std::size_t draw(double u) const {
        const double scaled = u * double(entries_.size());
        std::size_t i = std::size_t(scaled);
        i = i < entries_.size() ? i : entries_.size() - 1;
        return scaled - double(i) < double(entries_[i].share) ? i : entries_[i].other;
    }
    double total() const { return total_; }

private:
    struct Entry {
        float share;
        std::uint32_t other;
    };
    std::vector<Entry> entries_;
    double total_ = 0.0;
};

// Where photons come from. Directions are world space; `direction` points where the light shines.
struct PhotonSource {
    enum class Kind { distant, environment, image, point, spot, area, emission };
    Kind kind = Kind::environment;
    Vec3 position{}, direction{};
    double cos_half_angle = 1.0;      // of the sun's disc, or of the spot's cone
    double blend = 0.0;               // of the spot
    std::array<Vec3, 2> half_axes{};  // of the area light: position +- half axes
    bool ellipse = false;
    std::size_t width = 0, height = 0;  // of the image
    std::vector<float> colours;         // [n][3]: radiance of a pixel over its own mean
    Bricks::Planes emission{};          // of the voxels, if any; the caller's
    AliasTable table;                   // of pixels (mean times solid angle) or of voxels
    std::array<Vec3, 3> rotation{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // world to image

    bool coloured() const { return !colours.empty() || emission.channels == 3; }
};

struct PhotonMedium {
    Bricks::Planes sigma_t, sigma_s;  // 1 or 3 channels each
    double g = 0.0;
};

// What became of the power of the photons, in units of PhotonResult::power_unit, exact integers:
// emitted = missed + absorbed + escaped + roulette + given_up, for each colour.
// A photon that would scatter more often is given up, and counted: the work is bounded in white
// media of any depth.
constexpr int kMostScatterings = 1 << 14;

struct PhotonTally {
    static constexpr std::size_t colours = 3;
    using Each = std::array<std::int64_t, colours>;
    Each emitted{}, missed{}, absorbed{}, roulette{}, given_up{};
    std::array<Each, 6> escaped{};              // through the low and high face of each index axis
    std::int64_t scatterings = 0, endless = 0;  // endless: photons that were given up
};

// Sums over passes, owned by the caller, all starting at 0.
struct PhotonSums {
    // [voxels][colours]: fluence, and squared deviations of the passes' from their mean.
    float *sums, *deviations;
    // Null, or [voxels][8][colours]: also its directional moments, sqrt(4 pi) Y_lm of the
    // directions to the source, 1 <= l <= 2, in units of `kHigherUnit` of the sums', and how often
    // these have passed 2^32. The second stays 0, pages that nobody has touched, in all but long
    // runs.
    std::int32_t *higher = nullptr, *wraps = nullptr;
};
constexpr double kHigherUnit = 16.0;

// One pass.
struct PhotonRun {
    // Both choose the random numbers; `pass` is also how many passes the sums hold already.
    std::uint64_t seed = 0, pass = 0;
    std::size_t photons = 0;
    bool unscattered = false;  // whether light that comes straight from the source counts too
    // 0: track lengths in voxels. Otherwise the kernel estimate: possible collisions, real or null,
    // within this distance (world units) of a voxel's centre, each over the majorant there.
    double radius = 0.0;
    bool deposits = true;  // false: only traces, to be timed
    int threads = 0;
    Control *control = nullptr;
};

class PhotonTracer {
public:
    // `medium`'s planes stay the caller's and must outlive the tracer.
    // `least_majorant`: how many possible collisions a unit of length there are everywhere, also in
    // the void; the kernel estimate needs some.
    PhotonTracer(const double *index_to_world, const Size3 &shape, const PhotonMedium &medium,
                 double least_majorant = 0.0);
    ~PhotonTracer();

    // Colours of the deposits: 1, or 3 where extinction, albedo or the source need them.
    std::size_t colours(const PhotonSource &source) const;

    // Traces one pass and adds it to `result`, whole or (when cancelled) not at all.
    PhotonTally run(const PhotonSource &source, const PhotonRun &run, const PhotonSums &result);

    // In-scattered radiance J of one unit of a deposit, times the number of photons, and power of
    // one unit of a tally, likewise, for a source of strength 1: distant light, fluence 1;
    // environment, radiance 1; point, spot and area, intensity 1 (on the axis); image and
    // emission, what their table was made of.
    double deposit_unit(const PhotonSource &source, bool unscattered) const;
    double power_unit(const PhotonSource &source, bool unscattered) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Transmittance [channels][nx][ny][nz] between every voxel centre and a world point.
void transmittance_to(const Lattice &lattice, const double *index_to_world, const Size3 &shape,
                      const Bricks::Planes &sigma_t, const Vec3 &point, int threads,
                      Control *control, float *out);

}  // namespace volillum
