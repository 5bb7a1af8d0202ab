"""How soon live answers, for each model: a light dimmed, a light turned, the first picture.

    python tests/benchmarks/bench_live.py [--size 128] [--repeats 5]

Times are from the look that notices a change to the shown result (the drawing of the viewport
apart). `blocked` is the longest single look: for so long the interface waits. A light that is
dimmed, and for models that keep no direction one that is turned, needs new constants alone.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from plumes import plume_scene

import volillum_addon
from volillum_addon.blender import live_session
from volillum_addon.models.registry import models


class Watch:
    """Looks until something is shown, and remembers the longest look."""

    def __init__(self, live: Any) -> None:
        self.live, self.blocked = live, 0.0

    def answered(self) -> float:
        """Until the constants are new, or else a coarse bake is shown."""
        begin = time.perf_counter()
        self.live.message = ""
        while not self.live.message.startswith(("relit", "coarse")):
            look = time.perf_counter()
            self.live.look()
            now = time.perf_counter()
            self.blocked = max(self.blocked, now - look)
            if now - begin > 60:
                raise RuntimeError(f"no answer within a minute: {self.live.message}")
            time.sleep(0.001)
        return time.perf_counter() - begin

    def settle(self) -> float:
        begin = time.perf_counter()
        while not self.live.settled:
            self.live.look()
            time.sleep(0.001)
        return time.perf_counter() - begin


def measure(scene: bpy.types.Scene, repeats: int) -> dict[str, list[float]]:
    sun = next(each for each in scene.objects if each.type == "LIGHT")
    live = live_session.start(scene)
    watch, found = Watch(live), {"first": [], "dimmed": [], "turned": [], "full": []}
    found["first"].append(watch.answered())
    found["full"].append(watch.settle())
    for _ in range(repeats):
        watch.settle()
        sun.data.energy *= 1.1
        found["dimmed"].append(watch.answered())
        watch.settle()
        sun.rotation_euler[0] += math.radians(3)
        found["turned"].append(watch.answered())
    watch.settle()
    found["blocked"] = [watch.blocked]
    live_session.stop()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Time live mode.")
    parser.add_argument("--size", type=int, default=128, help="voxels along each axis")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    volillum_addon.register()
    with (
        tempfile.TemporaryDirectory() as folder,
        plume_scene(Path(folder) / "plume.vdb", (options.size,) * 3) as scene,
        bpy.context.temp_override(scene=scene),
    ):
        scene.volillum.directory = folder
        for model in models():
            scene.volillum.model = model.id
            found = measure(scene, options.repeats)
            line = "  ".join(
                f"{name} {1e3 * float(np.median(times)):7.1f} ms" for name, times in found.items()
            )
            print(f"{model.id:28} {line}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
