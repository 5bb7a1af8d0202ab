"""Errors in the volume as colours: blue where a model is too dark, red where it is too bright,
light grey where it is right; and the legend beside it."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bake.error_file import DENSITY, ERROR, FieldError
from ..models.registry import get
from .nodes import Term, Tree
from .placing import Place, write
from .sandbox import load_volume

# From the most negative to the most positive error, evenly: ColorBrewer's RdBu of five, reversed.
SCHEME = ("#0571b0", "#92c5de", "#f7f7f7", "#f4a582", "#ca0020")
# A legend's bar, in widths of a volume: how high, how far below the volume, and its text; the title
# in shares of that.
BAR, BELOW, TEXT, TITLE = 0.05, 0.45, 0.055, 0.9
# How wide the title is, in widths of the bar.
TITLE_WIDTH = 1.2
# Where along the legend its bar's attribute runs from 0 to 1.
ALONG = "along"


def _linear(code: str) -> NDArray[np.float64]:
    srgb = np.array([int(code[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


STOPS = np.array([_linear(code) for code in SCHEME])


def colours(error: ArrayLike, limit: float) -> NDArray[np.float64]:
    """Linear RGB [..., 3] of errors; `limit` and more have the full colour."""
    share = np.clip(np.asarray(error, np.float64) / limit, -1, 1)
    places = np.linspace(-1, 1, len(STOPS))
    return np.stack([np.interp(share, places, stop) for stop in STOPS.T], axis=-1)


def error_material(name: str, limit: float) -> bpy.types.Material:
    """Extinction sigma_t whose emission makes what is opaque have the colour of its error."""
    material = bpy.data.materials.new(name)
    tree = Tree(material.node_tree)
    error = tree.math("MULTIPLY_ADD", tree.component(ERROR), 0.5 / limit, 0.5)
    density = tree.positive(DENSITY)
    node = tree.node("ShaderNodeVolumeCoefficients")
    tree.feed(node.inputs["Absorption Coefficients"], density)
    tree.feed(node.inputs["Scatter Coefficients"], (0, 0, 0))
    glow = tree.vector("MULTIPLY", density, _ramp(tree, error))
    tree.feed(node.inputs["Emission Coefficients"], glow)
    tree.feed(tree.node("ShaderNodeOutputMaterial").inputs["Volume"], node.outputs[0])
    return material


def error_object(found: FieldError, limit: float) -> bpy.types.Object:
    """A volume object that shows the error; in no collection yet."""
    data = load_volume(found.path)
    data.materials.append(error_material(found.path.stem, limit))
    return bpy.data.objects.new(f"{get(found.model).label}: error", data)


def legend(place: Place, limit: float, noise: float, size: float = 1.0) -> list[bpy.types.Object]:
    """The scale below a volume and its name, or below the middle of a row of them, `size` volumes
    wide: bar, numbers and title."""
    top = -place.height / place.width / 2 - BELOW
    high, text = BAR * size, TEXT * size
    percent = f"{100 * limit:.3g} %"
    numbers = ((f"-{percent}", -0.5), ("0", 0.0), (f"+{percent}", 0.5))
    title = (
        "In-scattered radiance against full scattering,\n"
        f"relative to its RMS (noise {100 * noise:.2g} %)"
    )
    return [
        _bar(place, size, top, high),
        *(
            write(each, text * place.width, place.point(x * size, top - high - text), place)
            for each, x in numbers
        ),
        write(title, TITLE * text * place.width, place.point(0, top - high - 2 * text), place),
    ]


def legend_end(size: float) -> float:
    """How far below the volume a legend ends, in widths of a volume."""
    return BELOW + (BAR + 3.5 * TEXT) * size


def summary(found: Sequence[FieldError]) -> str:
    """One line for each model: its error's root mean square and mean."""
    return "\n".join(
        f"{get(each.model).label}: error {100 * each.rms:.3g} % (RMS), "
        f"{100 * each.mean:+.3g} % on average, noise {100 * each.noise:.2g} %"
        for each in found
    )


def _bar(place: Place, width: float, top: float, high: float) -> bpy.types.Object:
    left, right, bottom = -width / 2, width / 2, top - high
    places = ((left, bottom), (right, bottom), (right, top), (left, top))
    corners = [place.point(x, y) for x, y in places]
    data = bpy.data.meshes.new("Volillum legend")
    data.from_pydata([tuple(corner) for corner in corners], [], [(0, 1, 2, 3)])
    along = data.attributes.new(ALONG, "FLOAT", "POINT")
    along.data.foreach_set("value", [0.0, 1.0, 1.0, 0.0])
    material = bpy.data.materials.new("Volillum legend")
    tree = Tree(material.node_tree)
    light = tree.node("ShaderNodeEmission")
    tree.feed(light.inputs["Color"], _ramp(tree, tree.component(ALONG)))
    tree.feed(tree.node("ShaderNodeOutputMaterial").inputs["Surface"], light.outputs[0])
    data.materials.append(material)
    return bpy.data.objects.new("Volillum legend", data)


def _ramp(tree: Tree, place: Term) -> bpy.types.NodeSocket:
    """The colour at a place from 0 to 1."""
    node = tree.node("ShaderNodeValToRGB")
    ramp = node.color_ramp
    ramp.color_mode, ramp.interpolation = "RGB", "LINEAR"
    ends = np.linspace(0, 1, len(STOPS))
    for _ in ends[2:]:
        ramp.elements.new(0.5)
    for element, end, stop in zip(ramp.elements, ends, STOPS, strict=True):
        element.position, element.color = end, (*stop, 1.0)
    tree.feed(node.inputs[0], place)
    return node.outputs["Color"]
