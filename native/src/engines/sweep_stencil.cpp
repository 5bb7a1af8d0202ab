// The near field's stencil on rows of voxels.
#include "sweep_kernels.h"
#include "volillum/pack.h"

namespace volillum::sweep_detail {
namespace {

template <int rows, int packs, int length, class Pack>
VOLILLUM_INLINE void add_run(const Stencil::Run &run, const Real *block, std::ptrdiff_t pitch,
                             Pack *sums) {
    block += run.offset;
    for (int i = 0; i < rows + length - 1; ++i, block += pitch)
        for (int p = 0; p < packs; ++p) {
            Pack values = pack<Pack>(block + p * lanes_of<Pack>);
            in_register(values);
            for (int r = 0; r < rows; ++r)
                if (i - r >= 0 && i - r < length)
                    sums[r * packs + p] += run.coefficients[i - r] * values;
        }
}

template <class Pack, int rows, int packs>
VOLILLUM_INLINE void apply_to_packs(const Stencil &stencil, const Real *block, std::ptrdiff_t pitch,
                                    Real *to, std::ptrdiff_t to_pitch) {
    const Stencil::Run *const begin = stencil.runs.data(), *const end = begin + stencil.runs.size();
    Pack sums[rows * packs] = {};
    for (const Stencil::Run *run = begin; run != end; ++run) switch (run->length) {
            case 1:
                add_run<rows, packs, 1>(*run, block, pitch, sums);
                break;
            case 2:
                add_run<rows, packs, 2>(*run, block, pitch, sums);
                break;
            case 3:
                add_run<rows, packs, 3>(*run, block, pitch, sums);
                break;
            default:
                add_run<rows, packs, kLongestRun>(*run, block, pitch, sums);
        }
    for (int r = 0; r < rows; ++r)
        for (int p = 0; p < packs; ++p)
            pack<Pack>(to + r * to_pitch + p * lanes_of<Pack>) = sums[r * packs + p];
}

template <class Pack, int rows>
VOLILLUM_INLINE void apply_to_rows(const Stencil &stencil, const Real *block, std::ptrdiff_t pitch,
                                   int count, Real *to, std::ptrdiff_t to_pitch) {
    constexpr int lanes = lanes_of<Pack>;
    int c = 0;
    for (; c + lanes < count; c += 2 * lanes)
        apply_to_packs<Pack, rows, 2>(stencil, block + c, pitch, to + c, to_pitch);
    if (c < count) apply_to_packs<Pack, rows, 1>(stencil, block + c, pitch, to + c, to_pitch);
}

}  // namespace

void apply_stencil(const Stencil &stencil, const Real *block, std::ptrdiff_t block_pitch, int rows,
                   int count, Real *sums, std::ptrdiff_t sums_pitch) {
    in_packs([=, &stencil]<class Pack>(Width<Pack>) VOLILLUM_LAMBDA {
        if (rows == kStencilRows)
            apply_to_rows<Pack, kStencilRows>(stencil, block, block_pitch, count, sums, sums_pitch);
        else
            apply_to_rows<Pack, 1>(stencil, block, block_pitch, count, sums, sums_pitch);
    });
}

}  // namespace volillum::sweep_detail
