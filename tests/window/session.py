"""Run by Blender itself: takes the steps of the scenario named after `--`, `module.function`, and
quits. What follows the name is the scenario's own.

Writes /volillum/<scenario>.json: {"error": null, or what went wrong}.
"""

import json
import sys
import traceback
from importlib import import_module
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import eyes
import sidebar
import steps

# A comparison on a busy machine takes minutes.
PATIENCE_SECONDS = 300.0
name = sys.argv[sys.argv.index("--") + 1]


def end(error: BaseException | None) -> None:
    """Write how it went and leave."""
    lines = None
    if error is not None:
        lines = "".join(traceback.format_exception(error))
        eyes.picture(f"{name}_failed")
    sidebar.keep_places()
    Path(f"/volillum/{name}.json").write_text(json.dumps({"error": lines}))
    bpy.ops.wm.quit_blender()


bpy.context.preferences.view.show_splash = False
# The display has no manager that would place a second window: all happens in the one there is.
bpy.context.preferences.view.filebrowser_display_type = "SCREEN"
bpy.context.preferences.view.render_display_type = "SCREEN"
# Without a graphics card a view takes seconds to draw: as little of it and as seldom as can be. A
# sidebar that covers the view would have it drawn anew for every button under the mouse.
bpy.context.preferences.system.use_region_overlap = False
bpy.context.preferences.system.viewport_aa = "OFF"
bpy.context.preferences.filepaths.use_auto_save_temporary_files = False
module, function = name.split(".")
scenario = getattr(import_module(f"scenarios.{module}"), function)
steps.drive(scenario(), end, PATIENCE_SECONDS)
