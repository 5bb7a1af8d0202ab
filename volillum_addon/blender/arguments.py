"""Arguments of the command line that name models. Needs no bpy."""

from __future__ import annotations

import argparse

from ..core.errors import InputError
from ..models.registry import get


def model_id(text: str) -> str:
    """The id of a model, or of a composition: `sun=ID,sky=ID`."""
    try:
        return get(text.strip()).id
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def model_ids(text: str) -> tuple[str, ...]:
    """Ids divided by commas. Neighbours of the form `sun=ID` are one composition, until a kind of
    light comes again."""
    ids: list[str] = []
    kinds: set[str] = set()  # of the composition that the last id may still become
    for piece in (part.strip() for part in text.split(",")):
        kind = piece.partition("=")[0] if "=" in piece else ""
        if kind and kinds and kind not in kinds:
            ids[-1] += f",{piece}"
            kinds.add(kind)
        else:
            ids.append(piece)
            kinds = {kind} - {""}
    return tuple(model_id(each) for each in ids)


def positive(text: str) -> float:
    """A finite number above 0."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def percent(text: str) -> float:
    """`2` or `2%` as 0.02."""
    return positive(text.strip().removesuffix("%")) / 100


def frame_range(text: str) -> range:
    """`3` or `1-240`."""
    first, dash, last = text.partition("-")
    if not first.isdecimal() or (dash and not last.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is not A-B, two frames of 0 or more")
    frames = range(int(first), int(last or first) + 1)
    if not frames:
        raise argparse.ArgumentTypeError(f"{text!r} ends before it begins")
    return frames
