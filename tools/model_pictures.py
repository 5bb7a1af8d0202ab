"""The pictures of the pages about the models, from the files of `make demo`:

    python tools/model_pictures.py build/demo docs/images/models

Each shows the model's bake, full scattering and the signed error, by one exposure and one error
scale for all models.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import OpenEXR
from matplotlib.image import imsave

sys.path.insert(0, str(Path(__file__).parents[1]))

from volillum_addon.compare.images import WHITE, Tone
from volillum_addon.core.colour import LUMINANCE
from volillum_addon.models.registry import MODELS

# Enlarged by whole pixels: what is measured are these pixels and nothing between them.
ENLARGED, GAP = 3, 8
ERROR_LIMIT = 1.0  # of the mean of full scattering


def layers(path: Path) -> dict[str, np.ndarray]:
    """The float layers of a comparison's file, [h, w, 3], by name."""
    return {part.name(): part.channels["RGB"].pixels for part in OpenEXR.File(str(path)).parts}


def main(demo: Path, target: Path) -> None:
    target.mkdir(parents=True, exist_ok=True)
    for model in MODELS:
        found = layers(demo / f"{model}.exr")
        full = found["reference"] @ LUMINANCE
        lit = full[full > 0.02 * full.max()]
        tone = Tone(WHITE / float(np.quantile(lit, 0.99)), float(lit.mean()), ERROR_LIMIT)
        cells = [
            tone.picture(found["model"]),
            tone.picture(found["reference"]),
            tone.error_picture(found["error"]),
        ]
        large = [cell.repeat(ENLARGED, 0).repeat(ENLARGED, 1) for cell in cells]
        gap = np.zeros((large[0].shape[0], GAP, 3), np.uint8)
        imsave(target / f"{model}.png", np.concatenate([large[0], gap, large[1], gap, large[2]], 1))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
