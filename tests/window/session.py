"""Run by Blender itself: takes the steps of the scenario named after `--`, and quits.
What follows the name is the scenario's own.

Writes /volillum/<scenario>.json: {"error": null, or what went wrong}.
"""

import json
import sys
import traceback
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import hand
import scenarios

# A comparison on a busy machine takes minutes.
PATIENCE_SECONDS = 300.0
name = sys.argv[sys.argv.index("--") + 1]


def end(error: BaseException | None) -> None:
    """Write how it went and leave."""
    lines = None
    if error is not None:
        lines = "".join(traceback.format_exception(error))
        hand.picture(f"{name}_failed")
    Path(f"/volillum/{name}.json").write_text(json.dumps({"error": lines}))
    bpy.ops.wm.quit_blender()


bpy.context.preferences.view.show_splash = False
# Without a graphics card a view takes seconds to draw: as little of it and as seldom as can be. A
# sidebar that covers the view would have it drawn anew for every button under the mouse.
bpy.context.preferences.system.use_region_overlap = False
bpy.context.preferences.system.viewport_aa = "OFF"
bpy.context.preferences.filepaths.use_auto_save_temporary_files = False
hand.drive(getattr(scenarios, name)(), end, PATIENCE_SECONDS)
