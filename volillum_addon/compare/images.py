"""Pictures of a comparison: tone-mapped images, signed errors, a contact sheet, OpenEXR files.

Every picture of one comparison has the same exposure: the 99th percentile of the full-scattering
luminance inside the silhouette becomes 0.9, what lies above 1 is cut, and the sRGB transfer curve
follows. No other tone curve: equal colours are equal radiances.

Signed errors are luminances relative to the mean luminance of full scattering inside the
silhouette, on one colour scale for all models: blue where the image is too dark, black where it is
right (and beside the volume), orange where it is too bright.
"""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import numpy as np
import OpenEXR
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure as Canvas
from matplotlib.image import imsave
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from ..bake.store import replacing
from ..core.colour import LUMINANCE
from .errors import ErrorImages
from .results import Comparison

WHITE_QUANTILE, WHITE = 0.99, 0.9
# The colour scale's end: nearly all errors of all models are inside it.
SCALE_QUANTILE = 0.98
ROUND = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
# Equally light on both sides (Rec.709 luminance), and black where there is no error: it lies on
# black backgrounds in light and dark pages alike. Orange against blue is told apart by all eyes.
ERROR_COLOURS = LinearSegmentedColormap.from_list(
    "error", ["#b8e2ff", "#3f9dea", "#155494", "#000000", "#8f3a10", "#ea7a33", "#ffd6ab"]
)

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Tone:
    """What turns radiance into pixels of this comparison."""

    exposure: float
    mean: float  # mean luminance of the truth, what errors are relative to
    limit: float  # end of the error scale, relative

    @classmethod
    def of(cls, comparison: Comparison) -> Tone:
        """The one exposure and the one error scale of a comparison."""
        full = (comparison.full.image.value @ LUMINANCE)[comparison.mask]
        white = max(float(np.quantile(full, WHITE_QUANTILE)), 1e-12)
        mean = max(float(full.mean()), 1e-12)
        errors = [
            np.abs(found.images.total @ LUMINANCE)[comparison.mask] / mean
            for _, found in comparison.measured
        ]
        largest = float(np.quantile(np.concatenate(errors), SCALE_QUANTILE)) if errors else 1.0
        return cls(WHITE / white, mean, round_up(max(largest, 1e-4)))

    def picture(self, radiance: NDArray[np.float64]) -> Bytes:
        """Radiance [h, w, 3] as sRGB [h, w, 3]."""
        linear = np.clip(radiance * self.exposure, 0, 1)
        curve = np.where(
            linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
        )  # fmt: skip
        return np.rint(curve * 255).astype(np.uint8)

    def error_picture(self, error: NDArray[np.float64]) -> Bytes:
        """A signed error [h, w, 3] on the common colour scale."""
        relative = (error @ LUMINANCE) / self.mean / self.limit
        return np.asarray(ERROR_COLOURS(0.5 + 0.5 * np.clip(relative, -1, 1), bytes=True)[..., :3])


def round_up(value: float) -> float:
    """The next of a few round numbers."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in ROUND if step * power >= value * (1 - 1e-9))


def png(pixels: Bytes) -> bytes:
    """Pixels [h, w, 3] as a PNG file."""
    buffer = io.BytesIO()
    imsave(buffer, pixels, format="png")
    return buffer.getvalue()


def data_uri(pixels: Bytes) -> str:
    """Pixels as a data: address for a page without external resources."""
    return "data:image/png;base64," + base64.b64encode(png(pixels)).decode("ascii")


def colour_bar(width: int = 256, height: int = 12) -> Bytes:
    """The error scale from its lower to its upper end, [height, width, 3]."""
    ramp = np.broadcast_to(np.linspace(0, 1, width), (height, width))
    return np.asarray(ERROR_COLOURS(ramp, bytes=True)[..., :3])


def layers(images: ErrorImages) -> dict[str, NDArray[np.float64]]:
    """The parts of a model's OpenEXR file: linear radiance, names as in the report."""
    return {
        "model": images.displayed.value,
        "reference": images.full.value,
        "error": images.total,
        "exact": images.exact.value,
        "integrated": images.integrated.value,
        "error_display": images.display,
        "error_numerical": images.numerical,
        "error_model": images.model,
        "noise_reference": np.sqrt(images.full.variance),
        "noise_exact": np.sqrt(images.exact.variance),
    }


def write_exr(images: ErrorImages, path: Path) -> None:
    """Write a multi-part OpenEXR of 32-bit float layers, whole or not at all."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(dict(header), {"RGB": np.ascontiguousarray(layer, dtype=np.float32)}, name)
        for name, layer in layers(images).items()
    ]
    with replacing(path) as temporary:
        OpenEXR.File(parts).write(str(temporary))


def write_contact_sheet(comparison: Comparison, path: Path) -> None:
    """Write a labelled grid: one row a model (display, full scattering, and the signed errors)."""
    tone = Tone.of(comparison)
    columns = ("display", "full scattering", "total error", "= model", "+ numerical", "+ display")
    count = len(comparison.measured)
    height, width = comparison.mask.shape
    cell = 2.0  # inches
    canvas = Canvas(
        figsize=(cell * len(columns) + 0.4, (cell * height / width + 0.05) * count + 1.0),
        facecolor="#14161a",
        # Titles stick out of the first row: the padding keeps them inside.
        layout=ConstrainedLayoutEngine(h_pad=0.1),
    )
    axes = canvas.subplots(count, len(columns), squeeze=False)
    for row, (model, found) in enumerate(comparison.measured):
        images = found.images
        cells = [tone.picture(images.displayed.value), tone.picture(images.full.value)]
        errors = (images.total, images.model, images.numerical, images.display)
        cells += [tone.error_picture(error) for error in errors]
        for column, (axis, cell_pixels) in enumerate(zip(axes[row], cells, strict=True)):
            axis.imshow(cell_pixels, interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
            for spine in axis.spines.values():
                spine.set_visible(False)
            if row == 0:
                axis.set_title(columns[column], color="#e8e6e3", fontsize=9)
        axes[row][0].set_ylabel(fill(model.label, 18), color="#e8e6e3", fontsize=9)
    scale = canvas.colorbar(
        ScalarMappable(Normalize(-100 * tone.limit, 100 * tone.limit), ERROR_COLOURS),
        ax=axes, orientation="horizontal", fraction=0.03, pad=0.02, aspect=60
    )  # fmt: skip
    scale.set_label(
        f"{comparison.name}: signed error, % of the mean of full scattering",
        color="#e8e6e3",
        fontsize=9,
    )
    scale.ax.tick_params(colors="#e8e6e3", labelsize=8)
    with replacing(path) as temporary:
        canvas.savefig(temporary, format="png", dpi=130)
