"""`python -m volillum_addon`, the same as the command `volillum`."""

import sys

from .blender.cli import main

sys.exit(main())
