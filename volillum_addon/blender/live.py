"""What is shown follows the scene while the user works in it.

Every look at the scene compares what the chosen model's bake depends on (`staleness.state`) and the
lights with what is shown. Lights that the model only multiplies with are a matter of the material's
constants; whatever needs a new bake is baked in a thread, coarse first and then in full, while the
last good result stays. Nothing waits for anything: the main thread reads and shows.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ..bake.run import Baked, bake_file, baked_volume
from ..bake.vdb import write_vdb
from ..core.coarse import coarsened
from ..core.control import Control
from ..core.errors import InputError
from ..core.scene import Scene
from ..models.illuminate import illuminate, relight
from ..models.model import Value
from ..models.registry import get
from ..models.volume import IlluminationVolume
from . import showing, staleness, work
from .asked import Held
from .constants import assign, constants, same_nodes
from .display import display_material, displayed, grid_limit, shown_data
from .jobs import Job, Work
from .light_reader import read_lights
from .places import block_file, output_directory, relative
from .properties import chosen_model, model_values
from .scene_reader import Reading, read_scene_camera

# As many voxels as two cores bake, write and load in a fraction of a second by any model's fast
# settings.
COARSE_VOXELS = 64**3
# The full bake waits until the scene has rested for so long: it would only be cancelled.
REST_SECONDS = 0.25


@dataclass(frozen=True, eq=False)
class Result:
    """A bake's volume and file; `baked` only of a full one."""

    volume: IlluminationVolume
    path: Path
    baked: Baked | None = None


class Live:
    """Follows one scene until `stop`; `look` is called again and again, in the main thread."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._held = Held(scene)
        self._folder = tempfile.TemporaryDirectory(prefix="volillum-live-")
        self._count = 0
        self._job: Job[Result] | None = None
        self._begin = 0.0  # when the change was seen that is being answered
        self._baking, self._coarse = "", True  # the state that the job answers, and how
        self._seen, self._rested = "", 0.0  # the last state, and since when
        self._reading: tuple[str, Reading] | None = None  # and the medium's state
        self._shown: Result | None = None
        self._full: Result | None = None  # the last full bake
        self._state = ""  # what `_shown` answers
        self._too_coarse = self._refused = ""  # states that no coarse bake, or none, serves
        self._lighting = ""
        self.message = "looking"

    @property
    def scene(self) -> bpy.types.Scene:
        """The scene; InputError when it is gone."""
        return self._held.get()

    def follows(self, scene: bpy.types.Scene) -> bool:
        """Whether it is this scene."""
        return self._held.holds(scene)

    @property
    def settled(self) -> bool:
        """Whether what is shown is the scene's own full bake, and nothing is under way."""
        whole = self._shown is not None and self._shown.baked is not None
        return whole and self._job is None and self._state == self._seen

    def look(self) -> None:
        """Answer what has changed. Raises InputError only when the scene is gone."""
        scene = self.scene
        try:
            self._answer(scene)
        except InputError as error:
            self._drop_job()
            self.message = str(error)

    def stop(self) -> None:
        """End what is under way; a coarse bake is no longer shown, a full one stays."""
        self._drop_job()
        if self._shown is not None and self._shown.baked is None:
            with suppress(InputError):  # the scene is gone
                showing.hide(self.scene)
        self._shown = None
        self._folder.cleanup()

    def _answer(self, scene: bpy.types.Scene) -> None:
        volume = work.chosen_volume(scene)
        if volume is None:
            raise InputError("choose the volume to light")
        scene.view_layers[0].update()
        state, medium = staleness.state(scene, volume)
        now = time.perf_counter()
        if state != self._seen:
            self._seen, self._rested = state, now
        if self._job is not None:
            # A coarse one is soon there: while a light is dragged, each is shown, if a little late.
            if self._baking != state and not self._coarse:
                self._job.cancel()
            if self._job.state == "running":
                return
            self._collect(scene, self._job)
        if state == self._refused:
            return  # and said so
        if self._shown is None or self._state != state:
            self._begin = now
            self._start(scene, state, medium, coarse=state != self._too_coarse)
        elif scene.volillum.baked.shown is None:  # an undo took it away
            self._show(scene, self._shown)
        elif self._shown.baked is None:
            if now - self._rested >= REST_SECONDS:
                self._start(scene, state, medium, coarse=False)
        elif self._lighting != self._lights(scene):
            self._begin = now
            self._relight(scene)

    def _start(self, scene: bpy.types.Scene, state: str, medium: str, coarse: bool) -> None:
        settings = scene.volillum
        reading = self._read(scene, medium)
        model = chosen_model(settings)
        values = model_values(settings, model)
        self._count += 1
        path = Path(self._folder.name) / f"{reading.stem}.{model}.live-{self._count}.vdb"
        directory = output_directory(settings.directory)

        def compute(control: Control) -> Result:
            if coarse:
                return _coarse(reading.scene, model, values, path, control)
            baked = bake_file(reading.scene, model, directory, reading.stem, values, control)
            return Result(baked_volume(reading.scene, baked.path), baked.path, baked)

        self._baking, self._coarse = state, coarse
        self._job = Job("Live", Work(compute, lambda _: ""))

    def _read(self, scene: bpy.types.Scene, medium: str) -> Reading:
        """The scene; its medium, which takes time to read, only when it has changed."""
        if self._reading is None or self._reading[0] != medium:
            self._reading = medium, work.read(scene)
        held = self._reading[1]
        now = Scene(
            held.scene.medium, read_lights(scene), read_scene_camera(scene),
            scene.volillum.seen_only,
        )  # fmt: skip
        return replace(held, scene=now)

    def _collect(self, scene: bpy.types.Scene, job: Job[Result]) -> None:
        self._job = None
        if job.state == "cancelled":
            return
        try:
            result = job.result()
        except InputError:
            # What a coarse grid cannot serve, the full one may; what that cannot, nothing will
            # until something changes.
            if self._coarse:
                self._too_coarse = self._baking
                return
            self._refused = self._baking
            raise
        self._show(scene, result)
        self._state = self._baking
        how = "coarse" if result.baked is None else "in full"
        self.message = f"{how} after {time.perf_counter() - self._begin:.2f} s"

    def _show(self, scene: bpy.types.Scene, result: Result) -> None:
        """Show the result under the lights as they are now, in the object that is there."""
        settings = scene.volillum
        limit = grid_limit(scene)
        volume = relight(result.volume, read_lights(scene))
        folder = Path(self._folder.name)
        volume, path = displayed(volume, result.path, folder, limit, settings.as_radiance)
        data = shown_data(volume, path, limit)
        data.filepath = relative(path)
        shown = settings.baked.shown
        if shown is None:
            shown = bpy.data.objects.new(path.stem, data)
            scene.collection.objects.link(shown)
            settings.baked.shown = shown
        else:
            before, shown.data = shown.data, data
            showing.discard_data(before)
        source = work.chosen_volume(scene)
        showing.step_aside(scene, source, "BAKE", showing.NO_NOISE)
        if result.baked is not None and source is not None:
            gone = self._replaced(result)
            # A/B must not switch to a file that goes.
            aside = gone is None or settings.baked.path != relative(gone)
            work.keep(scene, result.baked, staleness.source(settings, source), aside)
        self._forget(result)
        self._shown = result
        self._lighting = self._lights(scene)
        settings.baked.lighting = self._lighting

    def _relight(self, scene: bpy.types.Scene) -> None:
        """New constants for the material; a new material where it needs other nodes."""
        assert self._shown is not None
        shown = scene.volillum.baked.shown
        limit = grid_limit(scene)
        volume = relight(self._shown.volume, read_lights(scene))
        material = shown.data.materials[0]
        if block_file(shown.data) != self._shown.path:
            self._show(scene, self._shown)  # one stored grid of radiance: another file
        else:
            made = display_material(material.name, volume, limit)
            values = constants(made)
            if same_nodes(values, constants(material)):
                assign(material, values)
                bpy.data.materials.remove(made)
            else:
                shown.data.materials[0] = made
                bpy.data.materials.remove(material)
        self._lighting = self._lights(scene)
        scene.volillum.baked.lighting = self._lighting
        self.message = f"relit in {1000 * (time.perf_counter() - self._begin):.0f} ms"

    def _lights(self, scene: bpy.types.Scene) -> str:
        volume = work.chosen_volume(scene)
        return staleness.lighting(scene, volume, get(chosen_model(scene.volillum)))

    def _forget(self, after: Result) -> None:
        """Remove the files that `after` replaces: of a coarse bake always, of a full one when the
        next full one is there, unless it was on the disk before."""
        if self._shown is not None and self._shown.baked is None and self._shown != after:
            self._shown.path.unlink(missing_ok=True)
        if after.baked is None:
            return
        gone, self._full = self._replaced(after), after
        if gone is not None:
            gone.unlink(missing_ok=True)

    def _replaced(self, after: Result) -> Path | None:
        """The file of the last full bake, where it was made here and goes when `after` is there."""
        before = self._full
        if before is None or before.baked is None or before.baked.found:
            return None
        return before.path if before.path != after.path else None

    def _drop_job(self) -> None:
        if self._job is not None:
            self._job.cancel()
            self._job = None


def _coarse(
    scene: Scene, model: str, values: dict[str, Value], path: Path, control: Control
) -> Result:
    """A bake of a coarse grid by the model's fast settings, in a file of its own."""
    fast = {**values, **get(model).first_look}
    volume = illuminate(coarsened(scene, COARSE_VOXELS), model, fast, control)
    write_vdb(volume, path)
    return Result(volume, path)
