#include "cone_transport_voxels.h"

#include <algorithm>
#include <array>
#include <limits>
#include <stdexcept>
#include <string>

#include "cone_transport_lookups.h"
#include "volillum/exp_negative.h"
#include "volillum/no_alias.h"

namespace volillum::cone_detail {
namespace {

// Where less than this share of the light met matter, what of it is lost does not show.
constexpr Real kLeast = Real(1e-5);

// Voxels that are written together: while one pack waits for its logarithms others go on. And room
// for a whole pack behind the last.
constexpr int kBatch = 4 * kLanes, kMostVoxels = kBatch + kLanes;
// Rows of voxels whose memory is fetched ahead of those that are written.
constexpr int kRowsAhead = 8;

std::ptrdiff_t voxels_of(const ConeTransportScene &scene) {
    return std::ptrdiff_t(scene.shape[0]) * scene.shape[1] * scene.shape[2];
}

// The lower neighbour. Positions that should be whole are off by rounding, to either side.
VOLILLUM_INLINE int whole(double position) {
    return int(position + 1e-9);
}

// The lattice points about voxels. `positions` in the lattice, their slices counted from the first
// of `starts`; `starts` are those of rows, at column 0.
VOLILLUM_DISPATCH void find(const double (*positions)[kMostVoxels], int first, const int *starts,
                            int rows, Lookups &near) {
    VOLILLUM_NO_ALIAS
    for (int voxel = 0; voxel < kLanes; ++voxel) {
        const double s = positions[0][first + voxel], r = positions[1][first + voxel],
                     c = positions[2][first + voxel];
        const int slice = whole(s), row = whole(r), column = whole(c);
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
        near.high[voxel] = fraction(c, column);
        near.low[voxel] = 1 - near.high[voxel];
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
        for (int v = 0; v < kBatch; v += lanes_of<Pack>) {
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

void Solutions::resize(const MarchPlan &plan, std::size_t most_points, bool with_seen) {
    slabs_ = plan.threads;
    slab_slices_ = plan.slab_slices;
    albedos_ = plan.albedos;
    quantities_ = std::size_t(albedos_ + (with_seen ? 1 : 0));
    // Points are counted in int where voxels look them up.
    const std::size_t slices = std::size_t(slabs_ * slab_slices_ + 1),
                      most = std::numeric_limits<int>::max() / slices - kLanes;
    if (most_points > most)
        throw std::invalid_argument("a slice of the light's lattice has " +
                                    std::to_string(most_points) + " points; expected at most " +
                                    std::to_string(most) + ": a larger spacing, or fewer threads");
    // Lookups read a point beyond the last, whose weight is 0.
    pitch_ = round_up(int(most_points) + 1);
    size_ = slices * std::size_t(pitch_);
    const std::size_t count = plan.extinctions * quantities_ * size_;
    values_ = HugeArray<Real>(count);
    std::fill_n(values_.data(), count, Real(0));
}

// Voxels whose values are looked up together.
struct VoxelWriter::Batch {
    int count = 0;
    std::vector<int> starts;
    std::ptrdiff_t voxels[kMostVoxels];
    double positions[3][kMostVoxels];

    // Some of a row's voxels, from k on, at most kLanes; `row` and `start` are at k = 0. Where a
    // voxel lies depends on its k alone, so that it has the same bits in every batch.
    VOLILLUM_INLINE void append(std::ptrdiff_t row, const Vec3d &start, const Vec3d &step,
                                double first, int k, int some) {
        // All lanes, of which the next voxels take the place.
        VOLILLUM_NO_ALIAS
        for (int v = 0; v < kLanes; ++v) {
            voxels[count + v] = row + k + v;
            positions[0][count + v] = start[0] + (k + v) * step[0] - first;
            positions[1][count + v] = start[1] + (k + v) * step[1];
            positions[2][count + v] = start[2] + (k + v) * step[2];
        }
        count += some;
    }
};

void VoxelWriter::write(int slab, Real *out) const {
    const Index3 &shape = scene_.shape;
    const int slices = solutions_.slab_slices();
    const int first = slab * slices - 1;  // held from the slab before
    const int last = std::min(first + slices, lattice_.slices - 1);
    Batch batch{0, {}, {}, {}};
    batch.starts.reserve(std::size_t(last - first + 1) * std::size_t(lattice_.rows));
    for (int slice = first; slice <= last; ++slice)
        for (int row = 0; row < lattice_.rows; ++row)
            batch.starts.push_back(slice < 0
                                       ? 0
                                       : solutions_.begin(slice) + lattice_.offset(slice, row) -
                                             lattice_.span(slice, row).begin);
    const Vec3d step = lattice_.position_per_voxel(2), beside = lattice_.position_per_voxel(1);
    // Along a row of voxels slices rise, fall or stay.
    const bool stays = std::abs(step[0]) * shape[2] < 1e-6;
    const double per_slice = stays ? 0.0 : 1.0 / step[0];
    for (int i = 0; i < shape[0]; ++i) {
        const Vec3d begin_of_plane = lattice_.position_of({double(i), 0.0, 0.0});
        for (int j = 0; j < shape[1]; ++j) {
            Vec3d start;
            for (int a = 0; a < 3; ++a) start[a] = begin_of_plane[a] + j * beside[a];
            const auto is_here = [&](int k) {
                const int below = whole(start[0] + k * step[0]);
                return below >= first && below < last;
            };
            int begin = 0, end = shape[2];
            if (!stays) {
                // With one more on each side for the rounding.
                const double one = (first - start[0]) * per_slice,
                             two = (last - start[0]) * per_slice;
                begin = int(std::clamp(std::min(one, two) - 1, 0.0, double(shape[2])));
                end = int(std::clamp(std::max(one, two) + 2, 0.0, double(shape[2])));
            } else if (start[0] < first - 1 || start[0] > last + 1) {
                continue;
            }
            while (begin < end && !is_here(begin)) ++begin;
            while (begin < end && !is_here(end - 1)) --end;
            const std::ptrdiff_t row = (std::ptrdiff_t(i) * shape[1] + j) * shape[2];
            if (begin < end) fetch(row + kRowsAhead * shape[2] + begin, out);
            for (int k = begin; k < end;) {
                const int some = std::min({end - k, kLanes, kBatch - batch.count});
                batch.append(row, start, step, first, k, some);
                k += some;
                if (batch.count == kBatch) write(batch, out);
            }
        }
    }
    if (batch.count > 0) write(batch, out);
}

// Where slices are passed along a row of voxels only a few of it lie between two.
void VoxelWriter::fetch(std::ptrdiff_t voxel, const Real *out) const {
    const std::ptrdiff_t voxels = voxels_of(scene_);
    const int channels = scene_.extinctions * solutions_.albedos();
    for (int i = 0; i < channels; ++i) __builtin_prefetch(out + i * voxels + voxel, 1);
    if (scene_.transmittance)
        for (int e = 0; e < scene_.extinctions; ++e)
            __builtin_prefetch(scene_.transmittance + e * voxels + voxel);
}

void VoxelWriter::write(Batch &batch, Real *out) const {
    const std::ptrdiff_t voxels = voxels_of(scene_);
    const int count = batch.count;
    for (auto &positions : batch.positions)
        std::fill(positions + count, positions + kBatch, positions[count - 1]);
    std::array<Lookups, kBatch / kLanes> near;
    for (std::size_t p = 0; p < near.size(); ++p)
        find(batch.positions, int(p) * kLanes, batch.starts.data(), lattice_.rows, near[p]);
    const auto mean = [&](const Real *solutions, Real *values) {
        for (std::size_t p = 0; p < near.size(); ++p)
            look_up(solutions, near[p], values + p * kLanes);
    };
    alignas(64) Real solved[kBatch], seen[kBatch], exact[kBatch] = {};
    for (std::size_t e = 0; e < std::size_t(scene_.extinctions); ++e) {
        if (scene_.transmittance) {
            mean(solutions_.seen(e), seen);
            const Real *const transmittance = scene_.transmittance + std::ptrdiff_t(e) * voxels;
            for (int v = 0; v < count; ++v) exact[v] = transmittance[batch.voxels[v]];
        }
        for (int i = 0; i < solutions_.albedos(); ++i, out += voxels) {
            mean(solutions_.in_scattered(e, i), solved);
            if (scene_.transmittance) follow(exact, seen, solved);
            for (int v = 0; v < count; ++v) out[batch.voxels[v]] = solved[v];
        }
    }
    batch.count = 0;
}

}  // namespace volillum::cone_detail
