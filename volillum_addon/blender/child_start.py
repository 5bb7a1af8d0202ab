"""Started by Blender itself (`--python`): the command line with what follows `--`.

A script of its own and no part of the package: `child.command` makes the package importable.
"""

import runpy
import sys

sys.argv = ["volillum", *sys.argv[sys.argv.index("--") + 1 :]]
runpy.run_module("volillum_addon", run_name="__main__")
