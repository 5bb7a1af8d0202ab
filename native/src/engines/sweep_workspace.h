// What a thread of the sweep keeps between tiles.
#pragma once

#include "sweep_lattice.h"
#include "sweep_near.h"
#include "sweep_output.h"

namespace volillum::sweep_detail {

struct Workspace {
    Block block, tail;
    NearSums near;
    Scratch march;
    std::vector<int> active;
    Reals values, weights, result;

    // Room for the largest pieces, `batch` directions' values among them (0: none are held). malloc
    // gives back what the calling thread has taken, but not all of what others have: the one that
    // calls takes it for all, where it is to be given back.
    void reserve(const Pass &pass, const Tiling &tiling, std::size_t batch) {
        const Box box = tiling.largest_box();
        if (!tiling.in_pieces) block.reserve(tiling.reach(box, pass));
        if (batch == 0)
            result.reserve(Output::numbers(box));
        else
            values.reserve(std::min(batch, pass.directions.size()) * numbers_of_values(box));
    }
};

}  // namespace volillum::sweep_detail
