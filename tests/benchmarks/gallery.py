"""The gallery's page from what `volillum gallery all -o build/gallery` left.

    python tests/benchmarks/gallery.py [--pictures build/gallery] [-o docs/gallery.md]

Each scene's two pictures become one JPEG beside the page; every number comes from the JSON files.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread, imsave

from volillum_addon.blender import gallery_presets

HEAD = """# Gallery

Standard scenes from real volumes, each one command: `volillum gallery NAME -o DIR`. On the left a
bake, displayed by Cycles at one sample; on the right Cycles' full scattering of the same
medium. Both have one exposure. `make gallery` writes this page; seconds are of the machine that it
was written on, with other work beside. Scenes whose volume does not come with volillum need the
folder `VOLILLUM_DATA`; the command says which one is missing.
"""
QUALITY = 88


def section(found: dict[str, Any], picture: str) -> list[str]:
    """One scene's picture and numbers."""
    seconds, cycles, after = found["seconds"], found["cycles"], found["after_exposure"]
    given = "".join(f", {name} {value}" for name, value in found["parameters"].items())
    bound = "< " if after["is_bound"] else ""
    return [
        f"## {found['name']}",
        "",
        f"{found['summary']} {' x '.join(map(str, found['voxels']))} voxels.",
        "",
        f"![{found['summary']}]({picture})",
        "",
        "| | |",
        "| --- | --- |",
        f"| bake ({found['why']}) | {found['label']}{given} |",
        f"| seconds: bake, hand-over, display | {seconds['bake']:.2f}, {seconds['hand_over']:.2f}, "
        f"{seconds['display']:.2f} |",
        f"| Cycles: seconds, samples, bounces, noise | {seconds['cycles']:.0f}, "
        f"{cycles['samples']}, {cycles['bounces']}, {100 * cycles['noise']:.2g} % |",
        f"| total error | {100 * found['total']['relative_rmse']:.3g} % |",
        f"| after exposure | {bound}{100 * after['relative_rmse']:.3g} ± "
        f"{100 * after['noise']:.1g} % |",
        "",
    ]


def side_by_side(pictures: Path, name: str, target: Path) -> None:
    """The bake and Cycles as one JPEG."""
    left, right = (imread(pictures / f"{name}.{kind}.png")[..., :3] for kind in ("baked", "cycles"))
    gap = np.ones((len(left), 4, 3), left.dtype)
    target.parent.mkdir(parents=True, exist_ok=True)
    imsave(target, np.concatenate([left, gap, right], axis=1), pil_kwargs={"quality": QUALITY})


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the gallery's page.")
    parser.add_argument("--pictures", type=Path, default=Path("build/gallery"))
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/gallery.md"))
    options = parser.parse_args()
    lines = [HEAD]
    for name in gallery_presets.names():
        file = options.pictures / f"{name}.json"
        if not file.exists():
            lines += [f"## {name}", "", gallery_presets.exhibit(name).summary,
                      "Not shown here: its volume was not there.", ""]  # fmt: skip
            continue
        image = options.output.parent / "images" / f"gallery_{name}.jpg"
        side_by_side(options.pictures, name, image)
        lines += section(json.loads(file.read_text(encoding="utf-8")), f"images/{image.name}")
    options.output.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
