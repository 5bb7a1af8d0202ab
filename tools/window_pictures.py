"""The screenshots of the documentation, from the pictures that `make window` has kept:

    .venv/bin/python tools/window_pictures.py

Cut, made smaller and reduced to a palette; each is to be looked at before it is committed.
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TARGET = ROOT / "build" / "window" / "pictures", ROOT / "docs" / "images"
MOST_BYTES = 150_000
COLOURS = 256
# Left, top, right and bottom in pixels: of the whole window, and of the 3D view with its sidebar.
SIDEBAR, TRANSFER, RENDER = (865, 83, 1120, 812), (862, 55, 1118, 634), (300, 0, 1100, 900)
INSTALL = (0, 0, 800, 640)
ROW, ERRORS = (58, 230, 1147, 620), (58, 0, 1147, 786)
# Of each image: the scenario's picture, what is cut out of it, and how large it is then.
PICTURES: dict[str, tuple[str, tuple[int, int, int, int] | None, float]] = {
    "install": ("install", INSTALL, 0.8),
    "panel_baking": ("panel_baking", SIDEBAR, 1.0),
    "panel_compared": ("panel_compared", SIDEBAR, 1.0),
    "panel_transfer": ("preset_first", TRANSFER, 1.0),
    "preset_menu": ("preset_menu", None, 0.75),
    "live": ("live_lamp", None, 0.7),
    "rendered": ("rendered", RENDER, 0.6),
    "side_by_side": ("side_by_side", ROW, 0.8),
    "error": ("error_view", ERRORS, 0.7),
    "errors": ("error_row", ERRORS, 0.75),
}


def main() -> None:
    for name, (source, box, scale) in PICTURES.items():
        image = Image.open(SOURCE / f"{source}.png").convert("RGB").crop(box)
        size = (round(image.width * scale), round(image.height * scale))
        # By their spread, not their number: the few pixels of a legend keep their colours.
        reduced = image.resize(size, Image.Resampling.LANCZOS).quantize(
            COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
        target = TARGET / f"{name}.png"
        reduced.save(target, optimize=True)
        bytes_ = target.stat().st_size
        print(f"{target.relative_to(ROOT)}: {size[0]} x {size[1]}, {bytes_ / 1000:.0f} kB")
        if bytes_ > MOST_BYTES:
            raise SystemExit(f"{target} has {bytes_} bytes; expected at most {MOST_BYTES}")


if __name__ == "__main__":
    main()
