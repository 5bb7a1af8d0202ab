// The image of a baked illumination: the line integral of the grids that a display shows.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "volillum/angular.h"
#include "volillum/control.h"
#include "volillum/trilinear.h"

namespace volillum {

// weight * (product of the trilinearly interpolated channels) * what the eye's direction makes of
// it.
struct ChannelProduct {
    std::vector<std::size_t> channels;   // one or two
    Vec3 weight;                         // RGB
    std::optional<std::size_t> angular;  // place in the volume's list; none: scattered to all sides
};

struct BakedVolume {
    Bricks::Planes sigma_t, sigma_s;  // 1 or 3 channels each
    Bricks::Planes emission;          // 0 or 3
    Bricks::Planes channels;
    std::vector<ChannelProduct> terms;
    std::vector<Angular> angular;
    bool clamp;  // negative in-scattered radiance is shown as 0
};

struct PixelRays {
    const Vec3 *rays;  // origin: rays[0] + u rays[1] + v rays[2]; toward rays[3] + u rays[4] + ...
    std::size_t width, height, subpixels;
};

// radiance[height][width][3] and transmittance[height][width][3], means over the pixel's regular
// subpixels x subpixels rays.
void line_integral(const Lattice &lattice, const Size3 &shape, const BakedVolume &volume,
                   const PixelRays &view, int threads, Control *control, double *radiance,
                   double *transmittance);

}  // namespace volillum
