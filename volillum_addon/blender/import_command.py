"""`volillum import`: its arguments, and what it does. Needs no bpy."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..core.errors import bad
from ..readers import transfer_presets
from ..readers.formats import FORMATS, import_volume
from ..readers.frames import Name, VolumeFiles, chosen
from ..readers.gather import MOST_LEVEL
from ..readers.imported import About
from ..readers.matter import Imported, as_it_is, read_matter
from ..readers.raw import BYTE_ORDERS, TYPES, from_json
from ..readers.sequence import import_frames
from ..readers.source import Options, RawLayout
from .arguments import frame_range
from .terminal import watched


def add(command: argparse.ArgumentParser) -> None:
    """What `volillum import` understands."""
    command.description = "Reads " + ", ".join(each.label for each in FORMATS) + "."
    _add_volume(command, "a file, or a series' folder")
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="OUT.vdb",
        help="of a sequence as well with #: out_####.vdb",
    )
    add_reading(command)
    command.set_defaults(run=_import)


def _add_volume(command: argparse.ArgumentParser, what: str) -> None:
    command.add_argument(
        "volume",
        type=Path,
        nargs="+",
        metavar="VOLUME",
        help=f"{what}; a sequence as smoke_####.vdb, # for its frames' digits, or all its files",
    )
    command.add_argument(
        "--frames", type=frame_range, metavar="A-B", help="only these of a sequence"
    )


def add_reading(command: argparse.ArgumentParser) -> None:
    """What is to be read of a file."""
    command.add_argument(
        "--level",
        type=int,
        choices=range(MOST_LEVEL + 1),
        default=0,
        metavar="N",
        help="coarser by 2^N along each axis (default: 0)",
    )
    command.add_argument(
        "--channel", type=int, metavar="N", help="which of several channels or time steps, from 0"
    )
    command.add_argument("--grid", metavar="NAME", help="which grid of a VDB, array of an .npz")
    raw = command.add_argument_group("raw files (or a JSON file of the same name beside them)")
    raw.add_argument("--dims", metavar="XxYxZ", help="voxels along x, y, z")
    raw.add_argument("--type", choices=TYPES, metavar="TYPE", help="one of " + ", ".join(TYPES))
    raw.add_argument("--byte-order", choices=tuple(BYTE_ORDERS), default="little")
    raw.add_argument("--offset", type=int, default=0, metavar="BYTES", help="before the voxels")
    raw.add_argument("--spacing", metavar="X,Y,Z", help="voxel sizes (default: 1,1,1)")


def add_lit_volume(command: argparse.ArgumentParser) -> None:
    """A volume of any format to light, and how it is seen."""
    _add_volume(command, "a .vdb, or any other format")
    command.add_argument(
        "--transfer",
        choices=transfer_presets.names(),
        help="how values become matter (a .vdb is taken as it is without, others by their kind)",
    )
    add_reading(command)


def lit_volume(options: argparse.Namespace, directory: Path) -> tuple[VolumeFiles, Imported | None]:
    """The VDB files to light, and what they were imported as: made in `directory` where need be."""
    files = chosen(options.volume, options.frames)
    if as_it_is(files, options.level, options.transfer):
        return files, None
    with watched(f"reading {files.label}") as control:
        imported = read_matter(
            files, directory.absolute(), options.level, reading(options), options.transfer, control
        )
    name = options.transfer or transfer_presets.default_name(imported.about)
    _say(files, imported.about)
    print(f"transfer function {name}: {imported.transfer.summary}", file=sys.stderr)
    return imported.files, imported


def reading(options: argparse.Namespace) -> Options:
    """The arguments as a reader wants them. Raises InputError."""
    return Options(options.channel, options.grid, _layout(options))


def _layout(options: argparse.Namespace) -> RawLayout | None:
    if options.dims is None and options.type is None:
        return None
    entry: dict[str, object] = {"byte_order": options.byte_order, "offset": options.offset}
    if options.dims is not None:
        entry["dims"] = [_number(part) for part in options.dims.split("x")]
    if options.type is not None:
        entry["type"] = options.type
    if options.spacing is not None:
        entry["spacing"] = [_number(part) for part in options.spacing.split(",")]
    return from_json(entry, Path("the command line"))


def _number(text: str) -> float | int | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def describe(about: About) -> str:
    """An imported volume in one line."""
    size = " x ".join(map(str, about.shape))
    unit = f" {about.unit}" if about.unit else ""
    return f"{about.format}, {size} of {about.stored}, {about.low:g} to {about.high:g}{unit}"


def _import(options: argparse.Namespace) -> None:
    files = chosen(options.volume, options.frames)
    name = Name.hashed(options.output)
    if (name is None) == bool(files.frames):
        wanted = "one with # for the frame's number, as" if files.frames else "one file's, as"
        example = "out_####.vdb" if files.frames else "out.vdb"
        raise bad("the file to write", repr(options.output.name), f"{wanted} {example}")
    with watched(f"importing {files.label}") as control:
        if name is None:
            about = import_volume(
                files.path, options.output, options.level, reading(options), control
            )
        else:
            about = import_frames(files, name, options.level, reading(options), control)
    _say(files, about)
    print(options.output)


def _say(files: VolumeFiles, about: About) -> None:
    frames = f"{len(files.frames)} frames, " if files.frames else ""
    for line in (frames + describe(about), *(f"note: {note}" for note in about.notes)):
        print(line, file=sys.stderr)
