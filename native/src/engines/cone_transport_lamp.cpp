#include "cone_transport_lamp.h"

#include <algorithm>

namespace volillum::cone_detail {
namespace {

// The nodes about a point, with trilinear weights.
struct NodesAbout {
    std::size_t at[8];
    Real weight[8];
};

NodesAbout nodes_about(const ConeTransportScene &scene, const Vec3d &index) {
    int low[3], step[3];
    double fraction[3];
    for (int i = 0; i < 3; ++i) {
        const double place =
            std::clamp(index[i] / scene.node_spacing, 0.0, double(scene.nodes[i] - 1));
        low[i] = std::min(int(place), std::max(scene.nodes[i] - 2, 0));
        step[i] = scene.nodes[i] > 1 ? 1 : 0;
        fraction[i] = place - low[i];
    }
    NodesAbout result;
    for (int corner = 0; corner < 8; ++corner) {
        std::size_t at = 0;
        double weight = 1;
        for (int i = 0; i < 3; ++i) {
            const bool high = corner >> i & 1;
            at = at * std::size_t(scene.nodes[i]) + std::size_t(low[i] + (high ? step[i] : 0));
            weight *= high ? fraction[i] : 1 - fraction[i];
        }
        result.at[corner] = at;
        result.weight[corner] = Real(weight);
    }
    return result;
}

}  // namespace

LampCones::LampCones(const ConeTransportScene &scene, double spacing, const Lattice &lattice)
    : scene_(scene), lattice_(lattice) {
    node_columns_ = std::clamp(int(scene.node_spacing / spacing), 1, kLanes);
    for (int d = 0; d < scene.count; ++d)
        outward_.push_back(
            {scene.directions[3 * d], scene.directions[3 * d + 1], scene.directions[3 * d + 2]});
}

void LampCones::weigh(int slice, int row, const Span &span, WeightRows &weights) const {
    if (span.empty()) return;
    const int first = span.begin / node_columns_, last = (span.end - 1) / node_columns_ + 1;
    std::vector<NodesAbout> about;
    for (int node = first; node <= last; ++node)
        about.push_back(
            nodes_about(scene_, lattice_.index_of(slice, row, double(node * node_columns_))));
    const std::size_t field =
        std::size_t(scene_.nodes[0]) * std::size_t(scene_.nodes[1]) * std::size_t(scene_.nodes[2]);
    Reals nodes(about.size() + 1);
    for (std::size_t d = 0; d < outward_.size(); ++d) {
        const Real *values = scene_.local_weights + d * field;
        for (std::size_t i = 0; i < about.size(); ++i) {
            Real sum = 0;
            for (int corner = 0; corner < 8; ++corner)
                sum += about[i].weight[corner] * values[about[i].at[corner]];
            nodes[i] = sum;
        }
        expand_row(nodes.data(), node_columns_, span.begin - first * node_columns_,
                   span.end - span.begin, weights.at(row, d) + span.begin);
    }
}

void LampCones::end(int slice, int row, const Crossing &here, std::size_t direction,
                    const Span &rays, StepRow &step) const {
    // How far before the lamp's plane the rays are now, in lengths of the step: the ray (row,
    // column) crosses the slice beyond the lattice point of that number.
    const Vec3d &outward = outward_[direction];
    const double *affine = scene_.index_to_world;
    const auto before_lamp = [&](double column) {
        const Vec3d index = lattice_.index_of(slice, row + double(here.row_fraction),
                                              column + double(here.column_fraction));
        double sum = 0;
        for (int i = 0; i < 3; ++i) {
            const double place = affine[4 * i] * index[0] + affine[4 * i + 1] * index[1] +
                                 affine[4 * i + 2] * index[2] + affine[4 * i + 3];
            sum += outward[i] * (scene_.lamp[i] - place);
        }
        return sum / double(step.length);
    };
    const double start = before_lamp(0), slope = start - before_lamp(1);
    step.ends = std::min(start - rays.begin * slope, start - rays.end * slope) < 1;
    step.end_start = Real(start);
    step.end_slope = Real(slope);
}

}  // namespace volillum::cone_detail
