#include "body.h"
#include "volillum/parallel.h"

namespace volillum::exact {

namespace {

template <std::size_t Channels>
VOLILLUM_INLINE void depth_of(const Body &body, const double *origin, const double *direction,
                              double radius, double *out) {
    const Vec3 along = {direction[0], direction[1], direction[2]};
    const LatticeRay ray =
        body.ray({origin[0], origin[1], origin[2]}, (1.0 / length(along)) * along);
    const Depth<Channels> depth =
        body.depth<Channels>(ray, radius, std::numeric_limits<double>::infinity());
    for (std::size_t c = 0; c < Channels; ++c) out[c] = depth[c];
}

[[gnu::flatten]] VOLILLUM_DISPATCH void depth_grey(const Body &body, const double *origin,
                                                   const double *direction, double radius,
                                                   double *out) {
    depth_of<1>(body, origin, direction, radius, out);
}

[[gnu::flatten]] VOLILLUM_DISPATCH void depth_rgb(const Body &body, const double *origin,
                                                  const double *direction, double radius,
                                                  double *out) {
    depth_of<3>(body, origin, direction, radius, out);
}

}  // namespace

void optical_depth(const Medium &medium, const double *origins, const double *directions,
                   std::size_t count, double radius, int threads, Control *control, double *depth) {
    const Body body(medium);
    const std::size_t channels = medium.sigma_t.channels;
    const auto evaluate = channels == 1 ? depth_grey : depth_rgb;
    constexpr std::size_t batch = 64;  // rays per work item, so that hand-out costs nothing
    parallel_for((count + batch - 1) / batch, threads, control, [&](std::size_t item, int) {
        for (std::size_t n = item * batch; n < std::min(count, (item + 1) * batch); ++n)
            evaluate(body, origins + 3 * n, directions + 3 * n, radius, depth + channels * n);
    });
}

}  // namespace volillum::exact
