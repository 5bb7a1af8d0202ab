"""Faults to plant, and the tests that must notice each of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """Replacing `sound` (found once in `file`) by `faulty` must fail every test in `noticed_by`."""

    name: str
    file: str
    sound: str
    faulty: str
    noticed_by: tuple[str, ...]


DOS = "tests/models/test_directional_occlusion.py"
MDOS = "tests/models/test_multidirectional_occlusion.py"
DAO = "tests/models/test_ambient_occlusion.py"
SH = "tests/models/test_spherical_harmonics.py"

FAULTS = (
    Fault(
        "the closed half of a neighbourhood in place of the open one",
        "native/src/engines/hemisphere.cpp",
        "const Vec3d falls{mean(i - 1, j, k) - mean(i + 1, j, k),",
        "const Vec3d falls{mean(i + 1, j, k) - mean(i - 1, j, k),",
        (
            f"{DAO}::test_the_open_half_is_what_the_judge_finds",
            "tests/native/test_hemisphere.py::test_a_field_that_is_linear_along_the_gradient",
        ),
    ),
    Fault(
        "the nearest voxels' shares of a half ball as of an even weight",
        "native/src/engines/hemisphere_near.cpp",
        "std::pow(u, 2 - p)",
        "std::pow(u, 2)",
        ("tests/native/test_hemisphere.py::test_the_share_of_a_voxel_on_either_side",),
    ),
    Fault(
        "1 % in the weights of a cone's directions",
        "volillum_addon/core/directions.py",
        "(weight / per_ring)[:, None]",
        "(1.01 * weight / per_ring)[:, None]",
        (f"{DOS}::test_half_space_below_an_orthographic_camera", f"{MDOS}::test_knife_edge"),
    ),
    Fault(
        "a cone's directions that jump where another axis is the nearest",
        "volillum_addon/core/directions.py",
        "turn = np.angle(AXIS_WEIGHTS @ (u + 1j * v) ** 4) / 4",
        "turn = 0.0",
        ("tests/core/test_directions.py::test_a_rule_about_a_turning_axis_never_jumps",),
    ),
    Fault(
        "a march's lattice that jumps where another axis is the nearest",
        "native/src/engines/cone_transport_lattice.cpp",
        "const double turn = std::arg(sum) / 4;",
        "const double turn = 0 * std::arg(sum);",
        (
            "tests/native/test_cone_transport.py::"
            "test_a_light_that_crosses_a_diagonal_makes_no_jump",
        ),
    ),
    Fault(
        "1 % in the weights of the sphere's directions",
        "volillum_addon/core/directions.py",
        "weights = np.repeat(weight / 2 / per_ring, per_ring)",
        "weights = np.repeat(1.01 * weight / 2 / per_ring, per_ring)",
        (f"{SH}::test_f5_uniform_environment_in_a_half_space",),
    ),
    Fault(
        "a half-voxel offset of a cropped grid",
        "volillum_addon/core/grid.py",
        "self.to_world(np.array(low, dtype=np.float64))",
        "self.to_world(np.array(low, dtype=np.float64) + 0.5)",
        ("tests/core/test_grid.py::test_crop_keeps_every_voxel_where_it_was",),
    ),
    Fault(
        "an albedo off by 1 %",
        "volillum_addon/core/medium.py",
        "return cls(sigma_t, _scaled(density, scale_rgb * albedo_rgb))",
        "return cls(sigma_t, _scaled(density, scale_rgb * albedo_rgb * 0.99))",
        ("tests/core/test_medium.py::test_density_becomes_coefficients",),
    ),
    Fault(
        "a missing 1 / (4 pi) in the brightness of a glow",
        "volillum_addon/models/operator.py",
        "return total / (4 * math.pi)",
        "return total",
        (f"{DOS}::test_half_space_below_an_orthographic_camera",),
    ),
    Fault(
        "a missing 1 / (4 pi) in the harmonics' dot product",
        "volillum_addon/models/spherical_harmonics.py",
        "truncated_radiance(operator(values), lights) / (4 * math.pi)",
        "truncated_radiance(operator(values), lights)",
        (f"{SH}::test_f5_uniform_environment_in_a_half_space",),
    ),
    Fault(
        "the printed sign of the harmonics' odd bands",
        "volillum_addon/models/spherical_harmonics.py",
        "basis = harmonics.evaluate(vectors)[:, :count]",
        "basis = harmonics.evaluate(-vectors)[:, :count]",
        (f"{SH}::test_f4_outward_directions_on_both_sides",),
    ),
    Fault(
        "a perspective cone about one direction in place of eye - x",
        "volillum_addon/models/local_cone.py",
        "axes = place - grid.to_world(index.reshape(-1, 3))",
        "axes = np.broadcast_to(place - grid.centre, (index.size // 3, 3)).copy()",
        (f"{DOS}::test_perspective_agrees_with_the_exact_solution",),
    ),
    Fault(
        "an albedo of half angle slicing off by 1 %",
        "volillum_addon/models/half_angle.py",
        "medium.sigma_s.planes(),",
        "0.99 * medium.sigma_s.planes(),",
        ("tests/models/test_half_angle.py::test_half_space",),
    ),
    Fault(
        "rays that end a step before the lamp of half angle slicing",
        "native/src/engines/cone_transport_lamp.cpp",
        "return sum / double(step.length);",
        "return sum / double(step.length) - 1.0;",
        ("tests/native/test_cone_transport.py::test_rays_end_on_the_plane_through_the_lamp",),
    ),
    Fault(
        "rays of the half angle that pass a band's border with the sums of the other row",
        "native/src/engines/cone_transport_kernels.cpp",
        "Pack for_own = here[d] * mean, for_next = below[d] * mean;",
        "Pack for_own = below[d] * mean, for_next = here[d] * mean;",
        (
            "tests/native/test_cone_transport.py::test_without_scattering_it_is_the_mean_transmittance",
        ),
    ),
    Fault(
        "1 % in the normalisation of ambient occlusion",
        "volillum_addon/models/ambient_occlusion.py",
        "total=1.0 if bounded else row.radius,",
        "total=1.01 if bounded else 1.01 * row.radius,",
        (
            f"{DAO}::test_bounded_sum_of_a_homogeneous_medium_is_its_opacity",
            f"{DAO}::test_linear_sum_of_a_homogeneous_medium_is_its_optical_depth",
        ),
    ),
    Fault(
        "products of neighbouring bins added in place of taken away",
        "volillum_addon/models/histogram.py",
        "np.maximum(glow - _dot(both, self.products)",
        "np.maximum(glow + _dot(both, self.products)",
        ("tests/models/test_histogram.py::test_dot_products_are_full_bakes",),
    ),
    Fault(
        "1 % of green in the luminance of shadow propagation",
        "volillum_addon/core/colour.py",
        "0.7152",
        "0.7224",
        ("tests/models/test_shadow_propagation.py::test_coloured_half_space",),
    ),
    Fault(
        "a half-voxel offset along the rays of the sweep",
        "native/src/engines/sweep_plan.cpp",
        "const double s : {middle - gauss * width, middle + gauss * width}",
        "const double s : {middle + 0.5 - gauss * width, middle + 0.5 + gauss * width}",
        (
            "tests/native/test_sweep.py::test_all_slices_near_is_the_exact_integral",
            f"{DOS}::test_perspective_agrees_with_the_exact_solution",
        ),
    ),
    Fault(
        "swapped lateral axes in the sweep",
        "native/src/engines/sweep_plan.cpp",
        "direction.row_slope = along[frame.row_axis] / rate;",
        "direction.row_slope = along[frame.column_axis] / rate;",
        (
            "tests/native/test_sweep.py::test_small_and_odd_grids",
            f"{DOS}::test_perspective_agrees_with_the_exact_solution",
        ),
    ),
    Fault(
        "1 % in the length of a slice step",
        "native/src/engines/sweep_plan.cpp",
        "static_cast<Real>(1.0 / rate)",
        "static_cast<Real>(1.01 / rate)",
        (
            "tests/native/test_sweep.py::test_along_an_axis_the_lattice_is_exact_too",
            f"{MDOS}::test_tilted_cone_in_a_half_space",
        ),
    ),
    Fault(
        "a constant of band 3 off by 1 % in the judge",
        "native/src/exact/sampling.h",
        "c1 = std::sqrt(21.0 / (32.0 * pi))",
        "c1 = 1.01 * std::sqrt(21.0 / (32.0 * pi))",
        (
            "tests/native/test_exact_in_scattered.py"
            "::test_harmonics_are_real_orthonormal_without_condon_shortley_sign",
        ),
    ),
    Fault(
        "grids written to files with their transform not transposed",
        "volillum_addon/bake/grids.py",
        "createLinearTransform(grid.index_to_world.T.tolist())",
        "createLinearTransform(grid.index_to_world.tolist())",
        ("tests/bake/test_grids.py::test_grid_round_trip",),
    ),
    Fault(
        "files that lack their end taken for whole",
        "volillum_addon/bake/grids.py",
        "    layout.check_whole(where)\n",
        "",
        ("tests/bake/test_grids.py::test_every_truncation_is_noticed",),
    ),
    Fault(
        "slices in the order of their files in place of their positions",
        "volillum_addon/readers/dicom.py",
        "    slices.sort(key=lambda each: float(each.position @ normal))\n",
        "",
        ("tests/readers/test_series.py::test_a_dicom_series_is_as_itk_reads_it",),
    ),
    Fault(
        "right-anterior-superior taken for left-posterior-superior",
        "volillum_addon/readers/source.py",
        '"RAS": (-1, -1, 1)',
        '"RAS": (1, 1, 1)',
        (
            "tests/readers/test_orientation.py::test_positions_are_kept",
            "tests/readers/test_real_files.py::test_nifti_is_as_itk_reads_it",
        ),
    ),
    Fault(
        "a coarse voxel in place of its first fine one",
        "volillum_addon/readers/gather.py",
        "np.full(3, (block - 1) / 2)",
        "np.full(3, 0.0)",
        ("tests/readers/test_import.py::test_a_level_is_the_mean_of_its_blocks",),
    ),
    Fault(
        "directions of the index axes as rows in place of columns",
        "volillum_addon/readers/source.py",
        "rows.T * np.asarray(spacing",
        "rows * np.asarray(spacing",
        (
            "tests/readers/test_orientation.py::test_positions_are_kept",
            "tests/readers/test_real_files.py::test_the_head_is_turned_by_30_degrees",
        ),
    ),
    Fault(
        "a kernel that shrinks as in two dimensions",
        "volillum_addon/models/photon_kernel.py",
        "return first * math.exp(log_cube / 3)",
        "return first * math.exp(log_cube / 2)",
        (
            "tests/models/test_photon_kernel.py::test_radii_have_a_closed_form",
            "tests/models/test_photon_kernel.py::test_bias_falls_with_the_square_of_the_radius",
        ),
    ),
    Fault(
        "an area light seen whole from every point of it",
        "volillum_addon/models/photon_lights.py",
        "share * _falloff(",
        "_falloff(",
        ("tests/models/test_photon_lights.py::test_an_area_light_has_a_size",),
    ),
    Fault(
        "a bake for a view that ends at its border, where interpolation reaches further",
        "volillum_addon/core/scene.py",
        "wanted = seen_region(self.need_camera(), medium.sigma_t, margin)",
        "wanted = seen_region(self.need_camera(), medium.sigma_t, -1)",
        ("tests/models/test_seen_only.py::test_the_same_image",),
    ),
    Fault(
        "a weight folded into the exponential makes numbers too small for their exponent",
        "native/include/volillum/exp_negative.h",
        "126 + std::log2(std::abs(double(weight)))",
        "126.0",
        ("tests/native/test_sweep.py::test_a_weight_of_any_size_scales_the_transmittance",),
    ),
    Fault(
        "rays that are not followed up to the voxels that are wanted",
        "native/src/engines/sweep_lattice.cpp",
        "if (sources[source] == Need::nothing) sources[source] = Need::sums;",
        "(void)sources[source];",
        ("tests/native/test_sweep_wanted.py::test_the_same_where_it_is_wanted",),
    ),
    Fault(
        "a lit band taken for dark",
        "volillum_addon/models/operator.py",
        "DARK_BAND = 1e-4",
        "DARK_BAND = 0.3",
        ("tests/models/test_lit_bands.py::test_the_same_light_from_fewer_coefficients",),
    ),
)
