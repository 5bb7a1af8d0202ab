"""A Blender volume material as a Medium, where its nodes have a plain meaning.

Coefficients as Cycles computes them; everything has to be linear in the volume's grids, because a
Medium is the trilinear interpolant of its voxels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.errors import InputError
from ..core.grid import Grid, occupied
from ..core.medium import Medium
from .fields import Field, link_source, node_place, read_constant, read_input, unsupported

SHADERS = (
    "Principled Volume, Volume Coefficients, Volume Scatter, Volume Absorption, Emission and Add "
    "Shader"
)
# Anisotropies that differ by less are one phase function.
SAME_G = 1e-6


@dataclass(frozen=True)
class MediumSettings:
    """How a volume without a material is seen: extinction per density and world unit, albedo."""

    density_scale: ArrayLike | float = 1.0
    albedo: ArrayLike | float = 0.9


@dataclass(frozen=True, eq=False)
class Closure:
    """Coefficients per unit of Blender's density, still as fields; emission as radiance/length."""

    sigma_s: Field
    sigma_a: Field
    emission: Field
    g: float = 0.0


def volume_material(volume: bpy.types.Object) -> bpy.types.Material | None:
    """The material that Blender renders the volume with."""
    for slot in volume.material_slots:
        if slot.material is not None:
            return slot.material
    return None


def read_medium(
    material: bpy.types.Material | None,
    load: Callable[[str], Grid],
    density_grid: str,
    factor: float,
    settings: MediumSettings,
) -> tuple[Medium, tuple[str, ...]]:
    """The medium and notes in plain words.

    `load` gives a grid of the file by name, in world space; `factor` scales all coefficients of a
    material (Volume.render.space OBJECT). Without a material `settings` applies to `density_grid`.
    """
    if material is None:
        medium = Medium.from_density(load(density_grid), settings.density_scale, settings.albedo)
        return medium, ("the volume has no material: the density scale and albedo settings apply",)
    closures = read_closures(material)
    notes = []
    nothing = Field.of(0)
    sigma_s, sigma_a, emission = nothing, nothing, nothing
    for closure in closures:
        sigma_s, sigma_a = sigma_s + closure.sigma_s, sigma_a + closure.sigma_a
        emission = emission + closure.emission
    for name, part in (("scattering", sigma_s), ("absorption", sigma_a)):
        if np.any(part.constant != 0):
            raise InputError(
                f"{material.name!r} has constant {name} {np.round(part.constant, 6).tolist()}; "
                "expected it in proportion to a grid (Blender would fill the volume's padded box)"
            )
    sigma_t = sigma_s + sigma_a
    names = list(dict.fromkeys([*sigma_t.grids, *emission.grids]))
    if not sigma_t.grids:
        raise InputError(
            f"{material.name!r} has no extinction; expected scattering or absorption by a grid"
        )
    grids = _common_lattice({name: load(name) for name in names})
    if np.any(emission.constant != 0):
        notes.append(
            "the material's constant emission counts where there is extinction; Blender also "
            "lets the padding around the volume glow"
        )
    extinction = _evaluate(sigma_t, grids, factor)
    glow = None
    if emission.grids or np.any(emission.constant != 0):
        where = occupied(extinction.values)
        glow = _evaluate(emission, grids, factor, where)
    scattering = _evaluate(sigma_s, grids, factor)
    medium = Medium(
        Grid(extinction.values, extinction.index_to_world, "sigma_t"),
        Grid(scattering.values, extinction.index_to_world, "sigma_s"),
        None if glow is None else Grid(glow.values, extinction.index_to_world, "emission"),
        _one_g(material, closures),
    )
    return medium, tuple(notes)


def _one_g(material: bpy.types.Material, closures: list[Closure]) -> float:
    values = [c.g for c in closures if c.sigma_s.grids]
    if values and max(values) - min(values) > SAME_G:
        raise InputError(
            f"{material.name!r} mixes anisotropies {min(values):g} and {max(values):g}; "
            "expected one"
        )
    return values[0] if values else 0.0


def _common_lattice(grids: dict[str, Grid]) -> dict[str, Grid]:
    """All grids on the union of their boxes; their lattices may differ by whole voxels only."""
    names = list(grids)
    first = grids[names[0]]
    offsets: dict[str, NDArray[np.int64]] = {}
    for name, grid in grids.items():
        relative = np.linalg.solve(first.index_to_world, grid.index_to_world)
        offset = np.round(relative[:3, 3])
        if not np.allclose(relative[:3, :3], np.eye(3), atol=1e-5) or not np.allclose(
            relative[:3, 3], offset, atol=1e-3
        ):
            raise InputError(
                f"grids {names[0]!r} and {name!r} have different voxels; expected one lattice"
            )
        offsets[name] = offset.astype(np.int64)
    low = np.min([offsets[name] for name in names], axis=0)
    high = np.max([offsets[name] + np.array(grids[name].shape) for name in names], axis=0)
    result: dict[str, Grid] = {}
    for name, grid in grids.items():
        a, b = low - offsets[name], high - offsets[name]
        cropped = grid.crop((int(a[0]), int(a[1]), int(a[2])), (int(b[0]), int(b[1]), int(b[2])))
        affine = cropped.index_to_world if name == names[0] else result[names[0]].index_to_world
        result[name] = Grid(cropped.values, affine, name)
    return result


def _evaluate(
    wanted: Field, grids: dict[str, Grid], factor: float, where: NDArray[np.bool_] | None = None
) -> Grid:
    """The field at the voxels, one channel where all three are equal."""
    lattice = next(iter(grids.values()))
    total = np.zeros((*lattice.shape, 3))
    if where is not None:
        total[where] = wanted.constant
    for name, matrix in wanted.grids.items():
        values = grids[name].values.astype(np.float64)
        wide = np.broadcast_to(values[..., None], total.shape) if values.ndim == 3 else values
        total += wide @ matrix.T
    scaled: NDArray[np.float32] = (total * factor).astype(np.float32)
    if np.array_equal(scaled[..., 0], scaled[..., 1]) and np.array_equal(
        scaled[..., 0], scaled[..., 2]
    ):
        return lattice.with_values(np.ascontiguousarray(scaled[..., 0]))
    return lattice.with_values(scaled)


def read_closures(material: bpy.types.Material) -> list[Closure]:
    """The closures that the material adds up. Raises InputError for what has no plain meaning."""
    output = material.node_tree.get_output_node("CYCLES") if material.node_tree else None
    source = link_source(output.inputs["Volume"]) if output is not None else None
    if source is None:
        raise InputError(
            f"material {material.name!r} has no volume shader; expected {SHADERS} at its "
            "output's Volume (or no material)"
        )
    return _closures(source.node)


def _closures(node: bpy.types.Node) -> list[Closure]:
    if node.mute:
        raise InputError(f"{node_place(node)} is muted; expected it to be removed or switched on")
    if node.bl_idname == "ShaderNodeAddShader":
        sources = [link_source(socket) for socket in node.inputs]
        return [closure for s in sources if s is not None for closure in _closures(s.node)]
    if node.bl_idname not in _READERS:
        raise unsupported(node, SHADERS)
    return [_READERS[node.bl_idname](node)]


def _phase(node: bpy.types.Node) -> float:
    """G of the node's phase function."""
    if node.phase != "HENYEY_GREENSTEIN":
        raise InputError(
            f"{node_place(node)} has the phase function {node.phase}; expected HENYEY_GREENSTEIN"
        )
    return float(read_constant(node.inputs["Anisotropy"])[0])


def _principled(node: bpy.types.Node) -> Closure:
    where = node_place(node)
    density = read_input(node.inputs["Density"])
    name = node.inputs["Density Attribute"].default_value
    if name:
        density = density.times(Field(np.zeros(3), {name: np.eye(3)}), where)
    colour = read_input(node.inputs["Color"])
    if node.inputs["Color Attribute"].default_value:
        grid = node.inputs["Color Attribute"].default_value
        colour = colour.times(Field(np.zeros(3), {grid: np.eye(3)}), where)
    if colour.grids:
        raise InputError(f"{where} has a colour that varies; expected a constant colour")
    if float(read_constant(node.inputs["Blackbody Intensity"])[0]) != 0:
        raise InputError(f"{where} has blackbody emission; expected Blackbody Intensity 0")
    # Cycles: the absorption colour acts by its square root, where the colour leaves room.
    tint = np.sqrt(np.maximum(read_constant(node.inputs["Absorption Color"]), 0))
    absorbed = np.maximum(1 - colour.constant, 0) * np.maximum(1 - tint, 0)
    glow = read_input(node.inputs["Emission Strength"]).times(
        read_input(node.inputs["Emission Color"]), where
    )
    return Closure(
        sigma_s=density.times(colour, where),
        sigma_a=density.times(Field.of(absorbed), where),
        emission=glow,
        g=float(read_constant(node.inputs["Anisotropy"])[0]),
    )


def _coefficients(node: bpy.types.Node) -> Closure:
    return Closure(
        sigma_s=read_input(node.inputs["Scatter Coefficients"]),
        sigma_a=read_input(node.inputs["Absorption Coefficients"]),
        emission=read_input(node.inputs["Emission Coefficients"]),
        g=_phase(node),
    )


def _scatter(node: bpy.types.Node) -> Closure:
    colour, density = read_input(node.inputs["Color"]), read_input(node.inputs["Density"])
    return Closure(colour.times(density, node_place(node)), Field.of(0), Field.of(0), _phase(node))


def _absorption(node: bpy.types.Node) -> Closure:
    colour = read_constant(node.inputs["Color"])
    density = read_input(node.inputs["Density"])
    absorbed = Field.of(np.maximum(1 - colour, 0)).times(density, node_place(node))
    return Closure(Field.of(0), absorbed, Field.of(0))


def _emission(node: bpy.types.Node) -> Closure:
    glow = read_input(node.inputs["Strength"]).times(
        read_input(node.inputs["Color"]), node_place(node)
    )
    return Closure(Field.of(0), Field.of(0), glow)


_READERS: dict[str, Callable[[bpy.types.Node], Closure]] = {
    "ShaderNodeVolumePrincipled": _principled,
    "ShaderNodeVolumeCoefficients": _coefficients,
    "ShaderNodeVolumeScatter": _scatter,
    "ShaderNodeVolumeAbsorption": _absorption,
    "ShaderNodeEmission": _emission,
}
