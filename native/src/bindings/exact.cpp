#include "volillum/exact.h"

#include <nanobind/stl/optional.h>

#include <limits>

#include "equation_reader.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace volillum;
using namespace volillum::bindings;

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

exact::Sampling sampling_of(std::int64_t directions, std::int64_t replicates, std::uint64_t seed,
                            bool clamp, int threads, Control *control) {
    if (replicates < 2)
        fail("replicates is " + std::to_string(replicates) +
             "; expected at least 2, a standard error needs two");
    if (directions < 1)
        fail("directions is " + std::to_string(directions) + "; expected 1 or more");
    return {std::size_t(directions), std::size_t(replicates), seed, clamp, threads, control};
}

exact::Medium medium_of(const PlanesArray &sigma_t, const std::optional<PlanesArray> &sigma_s,
                        const std::optional<PlanesArray> &emission,
                        const DoubleArray &index_to_world) {
    const Size3 grid = grid_shape(sigma_t, "sigma_t");
    if (sigma_s) require_grid(*sigma_s, "sigma_s", grid);
    if (emission) require_grid(*emission, "emission", grid);
    return {lattice(index_to_world), grid, planes(sigma_t),
            sigma_s ? planes(*sigma_s) : exact::Planes{},
            emission ? planes(*emission) : exact::Planes{}};
}

// Points are chosen where light is extinguished: scattering elsewhere would be missed.
void require_bounded_albedo(const PlanesArray &sigma_t, const PlanesArray &sigma_s,
                            const Size3 &grid) {
    const std::size_t voxels = grid[0] * grid[1] * grid[2];
    for (std::size_t c = 0; c < sigma_s.shape(0); ++c)
        for (std::size_t n = 0; n < voxels; ++n) {
            float sigma = sigma_t.data()[n];
            for (std::size_t t = 1; t < sigma_t.shape(0); ++t)
                sigma = std::max(sigma, sigma_t.data()[t * voxels + n]);
            if (sigma == 0.0f && sigma_s.data()[c * voxels + n] != 0.0f)
                fail("sigma_s is " + std::to_string(sigma_s.data()[c * voxels + n]) +
                     " where sigma_t is 0, at " +
                     shape_text({n / (grid[1] * grid[2]), n / grid[2] % grid[1], n % grid[2]}) +
                     "; expected sigma_s <= sigma_t");
        }
}

// Arrays for the results, over `shape`, and what Python gets of them.
struct Outputs {
    exact::Results results;
    nb::tuple tuple;

    explicit Outputs(const std::vector<std::size_t> &shape) {
        std::vector<std::size_t> colours = shape;
        colours.push_back(3);
        auto [value, value_array] = output(colours);
        auto [error, error_array] = output(colours);
        auto [neglected, neglected_array] = output(shape);
        results = {value, error, neglected};
        tuple = nb::make_tuple(value_array, error_array, neglected_array);
    }
};

OutArray exact_optical_depth(const PlanesArray &sigma_t, const DoubleArray &index_to_world,
                             const DoubleArray &origins, const DoubleArray &directions,
                             double radius, int threads, Control *control) {
    const exact::Medium medium = medium_of(sigma_t, {}, {}, index_to_world);
    const std::size_t count = rows_of_three(origins, "origins");
    if (rows_of_three(directions, "directions") != count)
        fail("directions has " + std::to_string(directions.shape(0)) +
             " rows; expected one for each of the " + std::to_string(count) + " origins");
    for (std::size_t n = 0; n < count; ++n) {
        const double *w = directions.data() + 3 * n;
        const double norm = length({w[0], w[1], w[2]});
        if (!(std::abs(norm - 1.0) <= 1e-6))
            fail("directions[" + std::to_string(n) + "] has length " + std::to_string(norm) +
                 "; expected a unit vector");
    }
    require_radius(radius);
    auto [depth, array] = output({count, sigma_t.shape(0)});
    {
        const nb::gil_scoped_release release;
        exact::optical_depth(medium, origins.data(), directions.data(), count, radius, threads,
                             control, depth);
    }
    return array;
}

// A unit direction toward the eye for each point; any where the value does not depend on it.
std::vector<double> views_of(const std::optional<DoubleArray> &view, std::size_t count,
                             const exact::Equation &equation) {
    std::vector<double> views(3 * count, 0.0);
    if (!view && equation.g != 0.0)
        fail("view is None; a phase function with g = " + std::to_string(equation.g) +
             " depends on it");
    if (view && rows_of_three(*view, "view") != count)
        fail("view has " + std::to_string(view->shape(0)) + " rows; expected one for each of the " +
             std::to_string(count) + " points");
    for (std::size_t n = 0; n < count; ++n) {
        const double *v = view ? view->data() + 3 * n : nullptr;
        const double norm = v ? length({v[0], v[1], v[2]}) : 1.0;
        if (!(norm > 0.0)) fail("view[" + std::to_string(n) + "] is zero; expected a direction");
        for (std::size_t a = 0; a < 3; ++a) views[3 * n + a] = v ? v[a] / norm : double(a == 2);
    }
    return views;
}

nb::tuple exact_in_scattered(const PlanesArray &sigma_t, const DoubleArray &index_to_world,
                             const DoubleArray &points, const nb::list &terms,
                             const std::optional<PlanesArray> &sigma_s,
                             const std::optional<PlanesArray> &emission, const nb::dict &equation,
                             const std::optional<DoubleArray> &view, double radius,
                             std::int64_t directions, std::int64_t replicates, std::uint64_t seed,
                             bool clamp, int threads, Control *control) {
    const exact::Medium medium = medium_of(sigma_t, sigma_s, emission, index_to_world);
    const std::size_t count = rows_of_three(points, "points");
    const EquationReader read(equation, terms, radius, medium);
    const exact::Sampling sampling =
        sampling_of(directions, replicates, seed, clamp, threads, control);
    const std::vector<double> views = views_of(view, count, read.equation());
    const Outputs outputs({count});
    {
        const nb::gil_scoped_release release;
        exact::in_scattered(medium, read.equation(), points.data(), views.data(), count, sampling,
                            outputs.results);
    }
    return outputs.tuple;
}

nb::tuple exact_visibility_harmonics(const PlanesArray &sigma_t, const DoubleArray &index_to_world,
                                     const DoubleArray &points, std::int64_t order, double radius,
                                     std::int64_t directions, std::int64_t replicates,
                                     std::uint64_t seed, int threads, Control *control) {
    const exact::Medium medium = medium_of(sigma_t, {}, {}, index_to_world);
    const std::size_t count = rows_of_three(points, "points");
    if (order < 0 || order > 3)
        fail("order is " + std::to_string(order) + "; expected 0, 1, 2 or 3");
    require_radius(radius);
    const exact::Sampling sampling =
        sampling_of(directions, replicates, seed, false, threads, control);
    const std::size_t harmonics = std::size_t((order + 1) * (order + 1));
    auto [value, value_array] = output({count, harmonics, sigma_t.shape(0)});
    auto [error, error_array] = output({count, harmonics, sigma_t.shape(0)});
    {
        const nb::gil_scoped_release release;
        exact::visibility_harmonics(medium, radius, harmonics, points.data(), count, sampling,
                                    value, error);
    }
    return nb::make_tuple(value_array, error_array);
}

nb::tuple exact_image(const PlanesArray &sigma_t, const PlanesArray &sigma_s,
                      const std::optional<PlanesArray> &emission, const DoubleArray &index_to_world,
                      const nb::list &terms, const DoubleArray &rays, std::int64_t width,
                      std::int64_t height, const nb::dict &equation, double radius,
                      std::int64_t points, std::int64_t directions, std::int64_t replicates,
                      std::uint64_t seed, bool clamp, int threads, Control *control) {
    const exact::Medium medium = medium_of(sigma_t, sigma_s, emission, index_to_world);
    require_bounded_albedo(sigma_t, sigma_s, medium.shape);
    const auto [w, h] = image_size(width, height);
    const std::array<Vec3, 6> camera = camera_rays(rays, w, h);
    const EquationReader read(equation, terms, radius, medium);
    const exact::Sampling sampling =
        sampling_of(directions, replicates, seed, clamp, threads, control);
    if (points < 1) fail("points is " + std::to_string(points) + "; expected 1 or more");
    const Outputs outputs({h, w});
    {
        const nb::gil_scoped_release release;
        exact::image(medium, read.equation(), bool(emission), {camera.data(), w, h},
                     std::size_t(points), sampling, outputs.results);
    }
    return outputs.tuple;
}

nb::dict plain() {
    nb::dict equation;
    equation["kind"] = "gather";
    return equation;
}

}  // namespace

void bind_exact(nb::module_ &module) {
    module.def("exact_optical_depth", &exact_optical_depth, "sigma_t"_a.noconvert(),
               "index_to_world"_a, "origins"_a, "directions"_a, nb::kw_only(),
               "radius"_a = infinity, "threads"_a = 0, "control"_a = nb::none(),
               R"(Optical depth of the trilinear medium along rays, exact to rounding.

sigma_t: float32 [c, nx, ny, nz], c = 1 or 3, per world unit. index_to_world: 4 x 4 affine.
origins, directions: float64 [n, 3], world; directions are unit vectors. The depth runs to the
medium's border (one voxel beyond the border voxels) or to `radius` world units.
Returns float64 [n, c].)");
    module.def(
        "exact_in_scattered", &exact_in_scattered, "sigma_t"_a.noconvert(), "index_to_world"_a,
        "points"_a, "terms"_a, nb::kw_only(), "sigma_s"_a.noconvert().none() = nb::none(),
        "emission"_a.noconvert().none() = nb::none(), "equation"_a = plain(), "view"_a = nb::none(),
        "radius"_a = infinity, "directions"_a = 1024, "replicates"_a = 8, "seed"_a = 0,
        "clamp"_a = false, "threads"_a = 0, "control"_a = nb::none(),
        R"(In-scattered radiance at points, from the equation itself:

    gather:     L_i(x) = sum_terms (1 / Omega) int_lobe L(w) exp(-od(x, x + radius w)) dw
    scattered:  L_i(x) = sum_terms L V, V(x) = (1 / Omega) int_lobe [T + int T sigma_s V ds] dw
    occluded:   L_i(x) = L (1 - scale mean_lobe int_0^radius s^(2 - p) occluder(x + s w) ds)
    coloured:   L_i(x) = sum_terms mean_lobe Q, Q = L T + int T (colour sigma_s L + emission) ds,
                or with split sum_terms lambda(L T(x, axis)) mean_lobe (Q / lambda(Q))
    transported: L_i(x, v) = int p L dw, L = L_lights T + int T (sigma_s L_i + emission) ds

sigma_t: float32 [c, nx, ny, nz], c = 1 or 3. points: float64 [n, 3], world.
terms: a list of (axis, toward, cos_theta, radiance). The lobe is the cone of half angle
acos(cos_theta) (-1: the whole sphere, 1: the axis alone) about the direction `axis`, or, toward a
'point' or a 'lamp', about the direction from x to the world point `axis`. radiance: float64 [k, 3],
k = 1, 4, 9 or 16, real orthonormal spherical harmonics of L(w) over outward world directions at
index l (l + 1) + m, without the Condon-Shortley sign; for k = 1, L = radiance / sqrt(4 pi). A
lamp's L is that at distance 1, it falls off with the squared distance, and rays toward it end where
they are nearest to it.
equation: a dict of 'kind', and for occluded 'occluder' (float32 [1 or 3, nx, ny, nz]), 'outward'
(float32 [3, ...], world vectors: the lobe is the half space about it where it is not 0; or None:
the sphere), 'weight_p', 'scale'; for coloured 'beta' (the lobe's weight is cos^beta), 'colour',
'emission' and 'split' (0 or 1). lambda is Rec. 709 luminance; where lambda(Q) < 1e-6 lambda(L), the
hue is the light's; for transported, which has no terms, 'g', 'emission' and 'lights', a list of
dicts of 'kind', 'share' of the effort and
    'distant':  'colour' (fluence), 'direction' toward it, 'cos_angle' of its half angle
    'lamp':     'colour' (intensity), 'position', 'shape': 'point'; 'spot' with 'direction',
                'cos_angle' and 'blend', smoothstep of (cos - cos_angle) / blend; 'flat' with
                'direction', 'half_width' and 'half_height' (vectors, may be 0) and 'ellipse'
    'constant': 'colour' (radiance)
    'image':    'image' [h, w, 3], constant over each latitude-longitude pixel, and 'rotation'
scattered, coloured and transported need sigma_s.
view: float64 [n, 3], directions toward the eye, needed where g is not 0.
directions: rays or random walks per point and term in all, shared among `replicates` independent
randomisations. clamp: values below 0 become 0 (after averaging).
Returns value and its standard error, float64 [n, 3] each, and float64 [n], the share of the walks'
weight that was given up after 16384 collisions. A point's result depends on its index, the seed
and nothing else of the call's order.)");
    module.def("exact_visibility_harmonics", &exact_visibility_harmonics, "sigma_t"_a.noconvert(),
               "index_to_world"_a, "points"_a, nb::kw_only(), "order"_a = 3, "radius"_a = infinity,
               "directions"_a = 1024, "replicates"_a = 8, "seed"_a = 0, "threads"_a = 0,
               "control"_a = nb::none(),
               R"(Spherical harmonics of the visibility at points,

    V_lm(x) = int exp(-od(x, x + radius w)) Y_lm(w) dw

over outward world directions w, real and orthonormal without the Condon-Shortley sign, at index
l (l + 1) + m up to l = order (0 to 3).
sigma_t: float32 [c, nx, ny, nz], c = 1 or 3. points: float64 [n, 3], world.
directions: rays per point in all, shared among `replicates` independent randomisations.
Returns value and standard error, float64 [n, (order + 1)^2, c] each.)");
    module.def("exact_image", &exact_image, "sigma_t"_a.noconvert(), "sigma_s"_a.noconvert(),
               "emission"_a.noconvert().none(), "index_to_world"_a, "terms"_a, "rays"_a, "width"_a,
               "height"_a, nb::kw_only(), "equation"_a = plain(), "radius"_a = infinity,
               "points"_a = 8, "directions"_a = 64, "replicates"_a = 8, "seed"_a = 0,
               "clamp"_a = false, "threads"_a = 0, "control"_a = nb::none(),
               R"(Image of a model's exact solution, the mean over each pixel's area of

    L = int tau (sigma_s L_i + emission) ds

with L_i, `terms` and `equation` as in exact_in_scattered, without background.
sigma_t, sigma_s: float32 [1 or 3, nx, ny, nz]; sigma_s may not exceed sigma_t. emission: None or
float32 [1 or 3, nx, ny, nz], radiance per length (sigma_a L_e).
rays: float64 [6, 3]: the ray through image position (u, v) starts at rays[0] + u rays[1] +
v rays[2] toward rays[3] + u rays[4] + v rays[5]. Pixel (x, y) covers [x, x + 1] x [y, y + 1]; row 0
is the top.
Per pixel: `replicates` independent estimates of `points` rays with one point of collision each, and
`directions` rays or walks per term from there; clamp: L_i below 0 becomes 0 at each point, before
averaging.
Returns radiance and its standard error, float64 [height, width, 3] each, and the neglected share
[height, width] as in exact_in_scattered.)");
}
