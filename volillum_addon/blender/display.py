"""Showing a bake: a material of plain nodes that turns its grids into emission.

    absorption = sigma_t, scattering = 0,
    emission = sigma_s max(0, L_i) + the medium's own,
    L_i = sum of weight * product of channels * angular factor

which is what models.image.line_integral integrates.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bake.radiance_file import radiance_file
from ..bake.vdb import read_vdb
from ..core.errors import InputError, bad
from ..models.illuminate import relight
from ..models.volume import IlluminationVolume
from .light_reader import read_lights
from .nodes import Term, Tree
from .radiance_nodes import CHANNEL, in_scattered
from .sandbox import add_object, load_volume

# EEVEE silently drops what a material reads beyond this many grids.
EEVEE_GRIDS = 15
SIGMA_T, SIGMA_S, EMISSION = "density", "volillum_sigma_s", "volillum_emission"


def show_bake(
    path: Path,
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    as_radiance: bool = False,
) -> bpy.types.Object:
    """A volume object that shows the bake under the scene's current lights.

    `as_radiance` stores their radiance in a file of its own and shows that; so it is done anyway
    where the bake has more grids than the scene's engine reads. Raises InputError when the file is
    no bake, or holds too many grids even so.
    """
    volume = relight(read_vdb(path), read_lights(scene))
    limit = grid_limit(scene)
    volume, path = displayed(volume, path, path.parent, limit, as_radiance)
    data = shown_data(volume, path, limit)
    shown = bpy.data.objects.new(path.stem, data)
    collection.objects.link(shown)
    return shown


def shown_data(volume: IlluminationVolume, path: Path, limit: int | None) -> bpy.types.Volume:
    """The file of the volume with the material that shows it."""
    material = display_material(path.stem, volume, limit)
    try:
        data = load_volume(path)
    except InputError:
        bpy.data.materials.remove(material)
        raise
    data.materials.append(material)
    return data


def grid_limit(scene: bpy.types.Scene) -> int | None:
    """How many grids the scene's engine reads in one material; None: any number."""
    return EEVEE_GRIDS if scene.render.engine == "BLENDER_EEVEE" else None


def displayed(
    volume: IlluminationVolume,
    path: Path,
    directory: Path,
    limit: int | None,
    as_radiance: bool = False,
) -> tuple[IlluminationVolume, Path]:
    """What to show of the bake `path`, read and relit as `volume`, and its file: the bake itself,
    or its stored radiance (written into `directory`) where the bake has more grids than `limit`."""
    if as_radiance or (limit is not None and len(_grids(volume)) > limit):
        return volume.as_radiance(), radiance_file(volume, path, directory)
    return volume, path


def display_material(
    name: str, volume: IlluminationVolume, limit: int | None = EEVEE_GRIDS
) -> bpy.types.Material:
    """The material of a bake's radiance. Other lights of the same kinds change constants alone.

    `limit` is how many grids the engine reads (None: any number).
    """
    grids = _grids(volume)
    if limit is not None and len(grids) > limit:
        raise InputError(
            f"the bake of {volume.model} needs {len(grids)} grids in one material; EEVEE reads at "
            f"most {limit} (a lower order or grey extinction needs fewer, Cycles reads them all)"
        )
    material = bpy.data.materials.new(name)
    tree = Tree(material.node_tree)
    radiance = tree.vector("MAXIMUM", in_scattered(tree, volume), (0, 0, 0))
    glow: list[Term] = [tree.vector("MULTIPLY", _sigma_s(tree, volume), radiance)]
    if volume.image_emission and volume.medium.emission is not None:
        glow.append(tree.positive(EMISSION))
    _coefficients(tree, volume, scatter=(0, 0, 0), emission=tree.sum(glow))
    return material


def medium_material(name: str, volume: IlluminationVolume) -> bpy.types.Material:
    """The material that scatters as the volume's medium does, for the references."""
    material = bpy.data.materials.new(name)
    tree = Tree(material.node_tree)
    emission: Term = (0, 0, 0)
    if volume.medium.emission is not None:
        emission = tree.positive(EMISSION)
    node = _coefficients(tree, volume, scatter=_sigma_s(tree, volume), emission=emission)
    node.phase = "HENYEY_GREENSTEIN"
    node.inputs["Anisotropy"].default_value = volume.medium.g
    return material


def _coefficients(
    tree: Tree, volume: IlluminationVolume, scatter: Term, emission: Term
) -> bpy.types.Node:
    """Volume Coefficients whose extinction is sigma_t whatever it scatters."""
    node = tree.node("ShaderNodeVolumeCoefficients")
    extinction: Term = tree.positive(SIGMA_T)
    if isinstance(scatter, bpy.types.NodeSocket):
        albedo = volume.medium.constant_albedo
        if albedo is not None:
            extinction = tree.vector("MULTIPLY", extinction, tuple(1 - albedo))
        else:
            extinction = tree.vector("SUBTRACT", extinction, scatter)
    tree.feed(node.inputs["Absorption Coefficients"], extinction)
    tree.feed(node.inputs["Scatter Coefficients"], scatter)
    tree.feed(node.inputs["Emission Coefficients"], emission)
    output = tree.node("ShaderNodeOutputMaterial")
    tree.feed(output.inputs["Volume"], node.outputs[0])
    return node


def _sigma_s(tree: Tree, volume: IlluminationVolume) -> bpy.types.NodeSocket:
    albedo = volume.medium.constant_albedo
    if albedo is None:
        return tree.positive(SIGMA_S)
    return tree.vector("MULTIPLY", tree.positive(SIGMA_T), tuple(albedo))


def _grids(volume: IlluminationVolume) -> set[str]:
    channels = {factor.channel for term in volume.radiance for factor in term.factors}
    for channel in channels:
        if channel not in volume.channels:
            raise bad(
                f"{volume.model}'s channel",
                repr(channel),
                "one of " + ", ".join(volume.channels),
                "the scene has other lights than the bake",
            )
    return (
        {SIGMA_T}
        | {CHANNEL + channel for channel in channels}
        | ({SIGMA_S} if volume.medium.constant_albedo is None else set())
        | ({EMISSION} if volume.image_emission and volume.medium.emission is not None else set())
    )


def add_volume(
    scene: bpy.types.Scene, path: Path, material: bpy.types.Material
) -> bpy.types.Object:
    """A volume object of the file in the scene."""
    data = load_volume(path)
    data.materials.append(material)
    return add_object(scene, data)
