#include "cone_transport_voxels.h"

#include <algorithm>

#include "volillum/exp_negative.h"
#include "volillum/no_alias.h"
#include "volillum/pairs.h"

namespace volillum::cone_detail {
namespace {

// Where less than this share of the light met matter, what of it is lost does not show.
constexpr Real kLeast = Real(1e-5);
constexpr int kChunk = 4 * kLanes;

// The lattice points about some voxels, with trilinear weights.
struct Neighbours {
    int at[4][kChunk];
    Real weight[4][kChunk], along[kChunk];
};

// Of `count` voxels in a row; what is found beyond is that of the last.
VOLILLUM_DISPATCH void find(const Vec3d &first, const Vec3d &step, int count, const int *starts,
                            int rows, Neighbours &near) {
    VOLILLUM_NO_ALIAS
    for (int voxel = 0; voxel < kChunk; ++voxel) {
        const int k = voxel < count ? voxel : count - 1;
        const double s = first[0] + k * step[0], r = first[1] + k * step[1],
                     c = first[2] + k * step[2];
        // Positions that should be whole are off by rounding, to either side.
        const int slice = int(s + 1e-9), row = int(r + 1e-9), column = int(c + 1e-9);
        const auto fraction = [](double position, int low) {
            const double above = position - low;
            return Real(above > 0.0 ? above : 0.0);
        };
        const Real f = fraction(s, slice), g = fraction(r, row);
        const int at = slice * rows + row;
        near.at[0][voxel] = starts[at] + column;
        near.at[1][voxel] = starts[at + 1] + column;
        near.at[2][voxel] = starts[at + rows] + column;
        near.at[3][voxel] = starts[at + rows + 1] + column;
        near.weight[0][voxel] = (1 - f) * (1 - g);
        near.weight[1][voxel] = (1 - f) * g;
        near.weight[2][voxel] = f * (1 - g);
        near.weight[3][voxel] = f * g;
        near.along[voxel] = fraction(c, column);
    }
}

VOLILLUM_DISPATCH void mean(const Real *values, const Neighbours &near, Real *out) {
    Pair pairs[4][kChunk];
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < kChunk; ++k) pairs[i][k] = pair_at(values + near.at[i][k]);
    VOLILLUM_NO_ALIAS
    for (int k = 0; k < kChunk; ++k) {
        Real low = 0, high = 0;
        for (int i = 0; i < 4; ++i) {
            low += near.weight[i][k] * pairs[i][k].first;
            high += near.weight[i][k] * pairs[i][k].second;
        }
        out[k] = (1 - near.along[k]) * low + near.along[k] * high;
    }
}

// -ln x of x in (0, 1], to 1e-7 of it; of less than 1e-30 and more than 1 that of those.
template <class Pack>
VOLILLUM_INLINE void depth_of(const Pack &x, Pack &depth) {
    Pack clipped = x > Real(1e-30) ? x : Pack{} + Real(1e-30);
    clipped = clipped < 1 ? clipped : Pack{} + 1;
    if constexpr (sizeof(Real) == sizeof(float)) {
        // x = (1 + f) 2^n with 1 + f from sqrt(1/2) on, and the polynomial of Cephes' logf.
        using Bits [[gnu::vector_size(sizeof(Pack))]] = std::int32_t;
        constexpr std::int32_t root_half = 0x3f3504f3;
        const Bits shifted = (Bits)clipped - root_half;
        const Bits exponent = shifted >> 23;
        const Bits mantissa = (shifted & 0x007fffff) + root_half;
        const Pack n = __builtin_convertvector(exponent, Pack);
        const Pack f = (Pack)mantissa - 1;
        Pack p = f * Real(7.0376836292e-2) + Real(-1.1514610310e-1);
        p = p * f + Real(1.1676998740e-1);
        p = p * f + Real(-1.2420140846e-1);
        p = p * f + Real(1.4249322787e-1);
        p = p * f + Real(-1.6668057665e-1);
        p = p * f + Real(2.0000714765e-1);
        p = p * f + Real(-2.4999993993e-1);
        p = p * f + Real(3.3333331174e-1);
        const Pack square = f * f;
        depth = Real(0.5) * square - square * f * p - f - n * Real(0.693147180559945);
    } else {
        Pack value{};
        for (int lane = 0; lane < lanes_of<Pack>; ++lane) value[lane] = -std::log(clipped[lane]);
        depth = value;
    }
    depth = depth > 0 ? depth : Pack{};
}

// L_i with a better transmittance t than the lattice's own, s, to which its solution l belongs.
// What is lost of the light that met matter, (1 - l) / (1 - s), varies slowly where part of the
// light is blocked; how much deeper t is than l, ln l / ln s, where all of it has passed the same.
// Both are exact without absorption and without scattering. The mean of the two.
void follow(const Real *exact, const Real *seen, Real *solved) {
    in_packs([=]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        for (int v = 0; v < kChunk; v += lanes_of<Pack>) {
            const Pack t = pack<Pack>(exact + v), s = pack<Pack>(seen + v),
                       l = pack<Pack>(solved + v);
            const Pack met = 1 - s > kLeast ? 1 - s : Pack{} + kLeast;
            Pack lost = (1 - l) / met;
            lost = lost > 0 ? lost : Pack{};
            lost = lost < 1 ? lost : Pack{} + 1;
            Pack depth_t, depth_s, depth_l;
            depth_of(t, depth_t);
            depth_of(s, depth_s);
            depth_of(l, depth_l);
            depth_s = depth_s > kLeast ? depth_s : Pack{} + kLeast;
            const Pack share = depth_l < depth_s ? depth_l / depth_s : Pack{} + 1;
            Pack through = depth_t * share;
            exp_negative(through);
            pack<Pack>(solved + v) = Real(0.5) * (through + (1 - (1 - t) * lost));
        }
    });
}

}  // namespace

VoxelRows::VoxelRows(const Index3 &shape, const Lattice &lattice, const Solution &solution,
                     const Real *transmittance)
    : shape_(shape), transmittance_(transmittance), lattice_(lattice), solution_(solution) {
    starts_.reserve(std::size_t(lattice.slices) * std::size_t(lattice.rows));
    for (int slice = 0; slice < lattice.slices; ++slice)
        for (int row = 0; row < lattice.rows; ++row)
            starts_.push_back(int(lattice.offset(slice, row)) - lattice.span(slice, row).begin);
}

void VoxelRows::write(int plane, int albedos, Real *out) const {
    const std::ptrdiff_t voxels = std::ptrdiff_t(shape_[0]) * shape_[1] * shape_[2];
    const Vec3d step = lattice_.position_per_voxel();
    Neighbours near;
    alignas(64) Real solved[kChunk], seen[kChunk], exact[kChunk] = {};
    for (int j = 0; j < shape_[1]; ++j) {
        const std::ptrdiff_t row = (std::ptrdiff_t(plane) * shape_[1] + j) * shape_[2];
        for (int k = 0; k < shape_[2]; k += kChunk) {
            const int count = std::min(kChunk, shape_[2] - k);
            find(lattice_.position_of({double(plane), double(j), double(k)}), step, count,
                 starts_.data(), lattice_.rows, near);
            if (transmittance_) {
                mean(solution_.seen.data(), near, seen);
                std::copy_n(transmittance_ + row + k, count, exact);
            }
            for (int i = 0; i < albedos; ++i) {
                mean(solution_.in_scattered[i].data(), near, solved);
                if (transmittance_) follow(exact, seen, solved);
                std::copy_n(solved, count, out + i * voxels + row + k);
            }
        }
    }
}

}  // namespace volillum::cone_detail
