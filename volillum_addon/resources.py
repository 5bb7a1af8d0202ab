"""Where the files that come with the package are, in a checkout and in an installed extension.

Both lay them beside the package.
"""

from pathlib import Path

PRESETS = Path(__file__).resolve().parents[1] / "presets"
