"""A bake's radiance for one set of lights as a file of its own.

Where a bake's channels are too many for one material, or a scene's lights are settled, one RGB grid
for each dependence on the view shows the same radiance. The file is named by the hash of what it is
made from; other lights are another file, by a dot product of the bake's channels and without any
new visibility.
"""

from __future__ import annotations

import json
import re
from hashlib import blake2b
from pathlib import Path

from ..core.errors import InputError
from ..models.volume import IlluminationVolume
from . import layout
from .hashing import DIGEST_BYTES
from .vdb import described_radiance, read_metadata, write_vdb

# The number by which Blender plays a sequence stays at the end of the name.
FRAME = re.compile(r"(_\d+)?$")


def radiance_file(volume: IlluminationVolume, baked: Path, directory: Path) -> Path:
    """The file of `volume.as_radiance()`, found in `directory` or written there.

    `volume` is that of the bake `baked` under the lights to store:
    `<bake>.radiance.<hash>.vdb`. Raises InputError where `baked` is no bake, StorageError where the
    directory cannot be written.
    """
    entries = read_metadata(baked)
    state = baked.stat()
    source = entries.get("hash", [state.st_size, state.st_mtime_ns])
    inputs = json.dumps([entries["format"], source, described_radiance(volume)])
    digest = blake2b(inputs.encode(), digest_size=DIGEST_BYTES).hexdigest()
    path = directory / _name(baked, digest)
    if not _found(path, digest):
        write_vdb(volume.as_radiance(), path, {"hash": digest}, entries["half"])
    return path


def shows(file: Path, baked: Path) -> bool:
    """Whether the file is the bake itself or one of its stored radiances."""
    before, after = _name(baked, "\0").split("\0")
    stored = file.name.startswith(before) and file.name.endswith(after)
    return file == baked or (stored and file.parent == baked.parent)


def _name(baked: Path, digest: str) -> str:
    return FRAME.sub(rf".radiance.{digest}\1", baked.stem, count=1) + ".vdb"


def _found(path: Path, digest: str) -> bool:
    try:
        layout.check_whole(path)
        return bool(read_metadata(path).get("hash") == digest)
    except InputError:
        return False
