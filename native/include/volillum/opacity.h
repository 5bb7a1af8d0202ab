// Opacities of voxels.
#pragma once

#include "volillum/exp_negative.h"

namespace volillum {

// 1 - exp(-x) for x >= 0 with full relative precision: opacities of thin media must not drown in
// the rounding of 1 - (1 - x).
VOLILLUM_INLINE float opacity(float x) {
    if (x < 0.25f) {
        // Taylor to x^6 / 720: the next term is below 1e-8 relative.
        return x * (1 - x / 2 * (1 - x / 3 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6)))));
    }
    return 1 - exp_negative(x);
}

}  // namespace volillum
