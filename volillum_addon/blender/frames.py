"""Visiting a scene's frames."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


@contextmanager
def kept_frame(scene: bpy.types.Scene) -> Iterator[None]:
    """Whatever frames are visited inside, the scene is at its own again afterwards."""
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        yield
    finally:
        scene.frame_set(frame, subframe=subframe)
