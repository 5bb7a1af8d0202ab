#include "cone_transport_lattice.h"

#include <algorithm>
#include <complex>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>

namespace volillum::cone_detail {
namespace {

// A ray moves sideways by at most this many lattice steps from slice to slice; slices are as close
// as that needs. Wider steps would pass over voxels unseen.
constexpr double kSteepest = 1.5;
// Directions this close to the plane of the slices would need endless slices.
constexpr double kSmallestCosine = 1e-3;
constexpr double kUnit = 1e-6;
// The lattice of compact voxels has some 20 points a voxel at the usual spacing, of tiny grids up
// to some 1000. Oblong voxels or grids askew to the light would need endless ones.
constexpr double kMostPerVoxel = 1000.0, kAlways = 1e7;

double dot(const Vec3d &a, const Vec3d &b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
double length(const Vec3d &a) {
    return std::sqrt(dot(a, a));
}
Vec3d scaled(const Vec3d &a, double factor) {
    return {a[0] * factor, a[1] * factor, a[2] * factor};
}
Vec3d plus(const Vec3d &a, const Vec3d &b, double factor) {
    return {a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]};
}
Vec3d cross(const Vec3d &a, const Vec3d &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Columns run along a grid axis as far as that is perpendicular to the light, and never jump when
// the light turns. Turned by a quarter they make the same lattice. So they have one of the four
// directions of the sum of the fourth powers, as complex numbers, of the grid axes' parts
// perpendicular to the light: of the four, the nearest to the largest part. The sum vanishes, and
// columns turn fast, at one direction beside each of the grid's diagonals: not on them, where light
// is often set, because the axes have different weights.
Vec3d column_direction(const double *affine, const Vec3d &axis) {
    constexpr double kWeights[] = {1.0, 0.9, 0.8};
    Vec3d across[3];
    for (int i = 0; i < 3; ++i) {
        const Vec3d edge{affine[i], affine[4 + i], affine[8 + i]};
        across[i] = scaled(plus(edge, axis, -dot(edge, axis)), 1 / length(edge));
    }
    const Vec3d &largest = *std::max_element(
        across, across + 3, [](const Vec3d &a, const Vec3d &b) { return length(a) < length(b); });
    const Vec3d one = scaled(largest, 1 / length(largest)), other = cross(axis, one);
    std::complex<double> sum = 0;
    for (int i = 0; i < 3; ++i)
        sum += kWeights[i] * std::pow(std::complex(dot(across[i], one), dot(across[i], other)), 4);
    const double turn = std::arg(sum) / 4;
    return plus(scaled(one, std::cos(turn)), other, std::sin(turn));
}

}  // namespace

double check_directions(const ConeTransportScene &scene) {
    if (std::abs(length(scene.axis) - 1) > kUnit)
        throw std::invalid_argument("axis has length " + std::to_string(length(scene.axis)) +
                                    "; expected a unit vector");
    double steepest = 0.0, sum = 0.0;
    for (int d = 0; d < scene.count; ++d) {
        const Vec3d direction{scene.directions[3 * d], scene.directions[3 * d + 1],
                              scene.directions[3 * d + 2]};
        const double cosine = dot(direction, scene.axis), size = length(direction);
        const std::string label = "direction " + std::to_string(d);
        if (!(std::abs(size - 1) <= kUnit))
            throw std::invalid_argument(label + " has length " + std::to_string(size) +
                                        "; expected a unit vector");
        if (!(cosine >= kSmallestCosine))
            throw std::invalid_argument(label + " has the cosine " + std::to_string(cosine) +
                                        " to the axis; expected at least 0.001");
        if (scene.local_weights) {
            steepest = std::max(steepest, std::sqrt(std::max(0.0, 1 - cosine * cosine)) / cosine);
            continue;
        }
        if (!(scene.weights[d] >= 0))
            throw std::invalid_argument("weight " + std::to_string(d) + " is " +
                                        std::to_string(scene.weights[d]) + "; expected 0 or more");
        sum += scene.weights[d];
        steepest = std::max(steepest, std::sqrt(std::max(0.0, 1 - cosine * cosine)) / cosine);
    }
    if (!scene.local_weights && !(std::abs(sum - 1) <= kUnit))
        throw std::invalid_argument("weights sum to " + std::to_string(sum) + "; expected 1");
    return steepest;
}

Lattice::Lattice(const ConeTransportScene &scene, double spacing, double steepest) {
    const double *affine = scene.index_to_world;
    const Matrix3 inverse = inverse_linear(affine);
    const Vec3d column = column_direction(affine, scene.axis), row = cross(scene.axis, column);
    // Along each of the three, the length of one voxel-index step.
    const auto step_along = [&](const Vec3d &direction) {
        return spacing / length(multiply(inverse, direction.data()));
    };
    const Vec3d away = scaled(scene.axis, -1);
    double slice_length = step_along(away);
    const double row_length = step_along(row), column_length = step_along(column);
    slice_length =
        std::min(slice_length, kSteepest * std::min(row_length, column_length) / steepest);
    slice_step = scaled(away, slice_length);
    row_step = scaled(row, row_length);
    column_step = scaled(column, column_length);
    slice_index_ = multiply(inverse, slice_step.data());
    row_index_ = multiply(inverse, row_step.data());
    column_index_ = multiply(inverse, column_step.data());
    // One lattice point is a voxel's centre. So all are where the spacing is 1 and the grid has an
    // axis along the light. The middle of the grid is half a voxel before that if its voxels are
    // even in number.
    Vec3d middle;
    for (int i = 0; i < 3; ++i) {
        centre_index_[i] = scene.shape[i] / 2;
        middle[i] = 0.5 * (scene.shape[i] - 1) - centre_index_[i];
    }

    // Orthogonal steps: the lattice position of a world offset is a projection on each.
    const Vec3d *steps[3] = {&slice_step, &row_step, &column_step};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double sum = 0;
            for (int k = 0; k < 3; ++k) sum += (*steps[i])[k] * affine[4 * k + j];
            to_lattice_[i][j] = sum / dot(*steps[i], *steps[i]);
        }
    // The support, from index -1 to n, grown by what a ray that is beside it reads: the neighbours
    // of its point on the slice before.
    const double aside_rows = 2 + steepest * slice_length / row_length;
    const double aside_columns = 2 + steepest * slice_length / column_length;
    Vec3d grown;
    for (int i = 0; i < 3; ++i)
        grown[i] = 0.5 * (scene.shape[i] + 1) + 1e-3 + std::abs(slice_index_[i]) +
                   aside_rows * std::abs(row_index_[i]) +
                   aside_columns * std::abs(column_index_[i]);
    int counts[3];
    for (int i = 0; i < 3; ++i) {
        double reach = 0;
        for (int j = 0; j < 3; ++j)
            reach += std::abs(to_lattice_[i][j]) * (grown[j] + std::abs(middle[j]));
        const double half = std::ceil(reach);
        if (!(half < double(std::numeric_limits<int>::max() / 8)))
            throw std::invalid_argument("the lattice of the light has more than " +
                                        std::to_string(std::numeric_limits<int>::max() / 4) +
                                        " points along a side; expected fewer");
        counts[i] = int(2 * half) + 1;
        centre_[i] = half;
    }
    const double voxels = double(scene.shape[0]) * scene.shape[1] * scene.shape[2],
                 needed = double(counts[0]) * counts[1] * counts[2];
    if (needed >
        std::max(kMostPerVoxel * voxels / std::min(1.0, spacing * spacing * spacing), kAlways)) {
        std::ostringstream message;
        message.precision(3);
        message << "the light's lattice would be " << counts[0] << " x " << counts[1] << " x "
                << counts[2] << " points for " << voxels
                << " voxels, which are oblong or askew to the light; expected at most "
                << kMostPerVoxel << " points a voxel: more even voxels, or a coarser spacing";
        throw std::length_error(message.str());
    }
    slices = counts[0];
    rows = counts[1];
    columns = counts[2];

    spans_.resize(std::size_t(slices) * std::size_t(rows));
    offsets_.resize(spans_.size());
    std::size_t at = 0;
    for (int p = 0; p < slices; ++p) {
        std::size_t total = 0;
        for (int q = 0; q < rows; ++q, ++at) {
            double low = 0, high = columns - 1;
            for (int i = 0; i < 3; ++i) {
                // |start + column * slope| <= grown, from the middle.
                const double start = (p - centre_[0]) * slice_index_[i] +
                                     (q - centre_[1]) * row_index_[i] -
                                     centre_[2] * column_index_[i] - middle[i];
                const double slope = column_index_[i];
                if (std::abs(slope) < 1e-12) {
                    if (std::abs(start) > grown[i]) high = -1;
                    continue;
                }
                const double one = (-grown[i] - start) / slope, two = (grown[i] - start) / slope;
                low = std::max(low, std::min(one, two));
                high = std::min(high, std::max(one, two));
            }
            if (low <= high) spans_[at] = {int(std::ceil(low)), int(std::floor(high)) + 1};
            offsets_[at] = int(total);
            if (!spans_[at].empty()) total += std::size_t(spans_[at].end - spans_[at].begin);
        }
        most_points_ = std::max(most_points_, total);
    }
    place_rows();
}

// What slices cut of the grid moves sideways from slice to slice.
void Lattice::place_rows() {
    std::vector<int> ends(std::size_t(slices), 0);
    first_columns_.assign(std::size_t(slices), round_up(columns));
    for (int p = 0; p < slices; ++p)
        for (int q = -1; q < rows; ++q) {
            const Span span = rays(p, q);
            if (span.empty()) continue;
            int &first = first_columns_[std::size_t(p)], &end = ends[std::size_t(p)];
            first = std::min(first, span.begin & ~(kLanes - 1));
            end = std::max(end, span.end);
        }
    for (std::size_t p = 1; p < first_columns_.size(); ++p)
        first_columns_[p] = std::min(first_columns_[p], first_columns_[p - 1] + kLanes);
    for (std::size_t p = first_columns_.size() - 1; p > 0; --p)
        first_columns_[p - 1] = std::min(first_columns_[p - 1], first_columns_[p] + kLanes);
    for (std::size_t p = 0; p < ends.size(); ++p)
        width_ = std::max(width_, ends[p] - first_columns_[p]);
}

Vec3d Lattice::index_of(double slice, double row, double column) const {
    Vec3d index;
    for (int i = 0; i < 3; ++i)
        index[i] = centre_index_[i] + (slice - centre_[0]) * slice_index_[i] +
                   (row - centre_[1]) * row_index_[i] + (column - centre_[2]) * column_index_[i];
    return index;
}

Vec3d Lattice::position_of(const Vec3d &index) const {
    Vec3d away;
    for (int i = 0; i < 3; ++i) away[i] = index[i] - centre_index_[i];
    const Vec3d position = multiply(to_lattice_, away.data());
    return plus(position, centre_, 1.0);
}

Vec3d Lattice::position_per_voxel(std::size_t axis) const {
    return {to_lattice_[0][axis], to_lattice_[1][axis], to_lattice_[2][axis]};
}

std::vector<Ray> plan_rays(const ConeTransportScene &scene, const Lattice &lattice) {
    std::vector<Ray> rays;
    const auto along = [](const Vec3d &direction, const Vec3d &step) {
        return dot(direction, step) / dot(step, step);
    };
    for (int d = 0; d < scene.count; ++d) {
        const Vec3d outward{scene.directions[3 * d], scene.directions[3 * d + 1],
                            scene.directions[3 * d + 2]};
        // Slices are passed against the outward direction.
        const double slices = along(outward, lattice.slice_step);
        rays.push_back({along(outward, lattice.row_step) / slices,
                        along(outward, lattice.column_step) / slices, Real(-1 / slices),
                        scene.local_weights ? Real(1) : Real(scene.weights[d])});
    }
    return rays;
}

}  // namespace volillum::cone_detail
