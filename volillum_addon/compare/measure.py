"""One model's measurements, each kept in the directory's `parts` under a hash of its inputs."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..bake.cold import cold_bake
from ..bake.hashing import KERNEL_REVISION
from ..bake.run import Plan, baked_volume, plan_bake
from ..core.control import Control
from ..core.scene import Scene
from ..models.equation import cost
from ..models.exact import SEEDS, exact_image
from ..models.image import line_integral
from ..models.model import Equation, Model, Values
from ..models.registry import get
from .cache import key_of, load, store
from .errors import field_error, image_of
from .flip import Eye, Flip
from .machine import machine
from .metrics import Agreement, Figure, Image, Mask, agreement
from .reference import Report, Stopping, gather
from .renderer import Pixels, Renderer
from .results import Saving, Seconds, Timing
from .savings import savings as saved

# What one setting may take of the full reference's seconds.
RUNG_SHARE = 1 / 8
# Raised when what a stored part holds, or how it is computed, changes.
PARTS_REVISION = 1


@dataclass(frozen=True)
class Options:
    """How thorough a comparison is.

    `samples` per seed, `noise` and `seconds` end a reference (`seconds` is the full one's budget;
    the others take a quarter); `bounces` None lets bounces.py choose. `repeats` are of every time.
    The exact image takes `points` on a ray with `directions` each, the exact field
    `voxel_directions` at `voxels` draws of visible voxels, or what takes as long for equations that
    are harder to sample (`affordable`). `published` sets the published algorithm
    beside each model that has one, `ladder` every model's other settings; `baselines` is the most
    samples of the renderer's own pictures (0: none). A setting or number of samples that would take
    longer than `rung_seconds` (None: RUNG_SHARE of `seconds`) is left out.
    """

    name: str = "volume"
    samples: int = 64
    noise: float = 0.01
    seconds: float = 120.0
    bounces: int | None = None
    repeats: int = 3
    display_samples: int = 1
    display_subpixels: int = 2
    points: int = 8
    directions: int = 32
    voxels: int = 2000
    voxel_directions: int = 2048
    seed: int = 0
    published: bool = False
    ladder: bool = False
    baselines: int = 64
    rung_seconds: float | None = None

    @property
    def rung_budget(self) -> float:
        """Seconds that one setting of a ladder or one number of samples may take."""
        return self.seconds * RUNG_SHARE if self.rung_seconds is None else self.rung_seconds


class NoWitnessError(Exception):
    """The renderer cannot solve this equation."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Where the measurements of one scene are made and kept."""

    renderer: Renderer
    options: Options
    directory: Path
    identity: str

    def part(self, kind: str, **inputs: object) -> Path:
        """The file of a part that depends on the renderer's identity and these inputs."""
        program = {"program": [__version__, KERNEL_REVISION, PARTS_REVISION]}
        key = key_of({"renderer": self.identity, **program, **inputs})
        return self.directory / "parts" / f"{kind}_{key}.npz"

    def stopping(self, share: float = 1.0) -> Stopping:
        """When a rendering with this share of the full reference's budget is good enough; its seeds
        are as much smaller, so that the fewest that make a standard error fit the budget."""
        options = self.options
        samples = max(1, round(options.samples * share))
        return Stopping(options.noise, options.seconds * share, samples)


@dataclass(frozen=True, eq=False)
class Bake:
    """A model's file, and what its cold bakes took."""

    plan: Plan
    whole: Timing
    bake: Timing
    hand_over: Timing
    peak_bytes: int

    def seconds(self, display: Timing) -> Seconds:
        """All of the model's times."""
        return Seconds(self.whole, self.bake, self.hand_over, display)


def bake(
    bench: Bench, model: Model, values: Values, control: Control, scene: Scene | None = None
) -> Bake:
    """The model's baked file with the times of cold bakes on this machine; `scene` is the
    renderer's, on another grid (None: on its own)."""
    options, scene = bench.options, scene or bench.renderer.scene
    plan = plan_bake(scene, model.id, bench.directory / "bakes", options.name, values)
    path = bench.part("times", bake=plan.hash, machine=machine(), repeats=options.repeats)
    held = load(path)
    if held is None or plan.found() is None:
        timings = cold_bake(
            scene,
            model.id,
            bench.directory / "bakes",
            options.name,
            values,
            options.repeats,
            control,
        )
        store(
            path,
            **{
                name: np.array([float(getattr(timing, name)) for timing in timings])
                for name in ("whole", "bake", "hand_over", "peak_bytes")
            },
        )
        held = load(path)
        assert held is not None
    return Bake(
        plan,
        _timing(held["whole"]),
        _timing(held["bake"]),
        _timing(held["hand_over"]),
        int(held["peak_bytes"].max()),
    )


def display(bench: Bench, baked: Bake) -> tuple[Image, Timing]:
    """The baked grids in the renderer, and the times of rendering them."""
    options, plan = bench.options, baked.plan
    path = bench.part(
        "display", bake=plan.hash, samples=options.display_samples,
        subpixels=options.display_subpixels, machine=machine(), repeats=options.repeats,
    )  # fmt: skip
    held = load(path)
    if held is None:
        pixels, seconds = [], []
        for _ in range(options.repeats):
            begin = time.perf_counter()
            pixels.append(
                bench.renderer.display(
                    plan.path, options.display_samples, options.seed, options.display_subpixels
                )
            )
            seconds.append(time.perf_counter() - begin)
        held = {"pixels": np.asarray(pixels[0], np.float64), "seconds": np.array(seconds)}
        store(path, **held)
    return Image.noiseless(held["pixels"]), _timing(held["seconds"])


def integral(bench: Bench, baked: Bake, control: Control) -> tuple[Image, NDArray[np.float64]]:
    """The core's line integral of the baked grids, and the transmittance [h, w, 1 or 3]."""
    path = bench.part("integral", bake=baked.plan.hash)
    held = load(path)
    if held is None:
        scene = bench.renderer.scene
        radiance, transmittance = line_integral(
            baked_volume(scene, baked.plan.path),
            scene.need_camera(),
            bench.renderer.width,
            bench.renderer.height,
            control=control,
        )
        held = {"radiance": radiance, "transmittance": transmittance}
        store(path, **held)
    return Image.noiseless(held["radiance"]), held["transmittance"]


def savings(
    bench: Bench, baked: Bake, model: Model, values: Values, control: Control
) -> tuple[Saving, ...]:
    """What the scene lacks, and what that saves."""
    path = bench.part("savings", bake=baked.plan.hash, machine=machine())
    held = load(path)
    if held is None:
        found = saved(bench.renderer.scene, model, values, control)
        held = {
            "what": np.array([each.what for each in found], np.str_),
            "seconds": np.array([each.seconds for each in found]),
            "stored": np.array([each.stored for each in found]),
        }
        store(path, **held)
    return tuple(
        Saving(str(what), float(seconds), float(size))
        for what, seconds, size in zip(held["what"], held["seconds"], held["stored"], strict=True)
    )


def exact(
    bench: Bench, model: Model, values: Values, control: Control, clamped: bool = True
) -> Image:
    """The image of the model's exact solution; `clamped` False leaves out the clamp at 0."""
    options = bench.options
    equations = model.equations(bench.renderer.scene, values)
    directions = affordable(equations, options.directions)
    quality = {"points": options.points, "directions": directions, "seed": options.seed}
    # Where the model has no clamp, the image without it is the same one and is found again; so is
    # that of another algorithm or another cost for the same equation.
    clamped = clamped or not any(each.operator.clamped for each in equations)
    path = bench.part("exact", equations=_described(equations), clamped=clamped, **quality)
    held = load(path)
    if held is None:
        image = image_of(
            exact_image(
                bench.renderer.scene,
                model.id,
                bench.renderer.width,
                bench.renderer.height,
                values,
                control=control,
                clamped=clamped,
                **quality,
            )
        )
        held = {"value": image.value, "variance": image.variance,
                "degrees": np.array(image.degrees)}  # fmt: skip
        store(path, **held)
    return Image(held["value"], held["variance"], float(held["degrees"]))


def field(bench: Bench, baked: Bake, control: Control) -> Figure:
    """The numerical error of the baked field at camera-visible voxels."""
    options = bench.options
    equations = get(baked.plan.model).equations(bench.renderer.scene, baked.plan.values)
    directions = affordable(equations, options.voxel_directions)
    path = bench.part(
        "field", bake=baked.plan.hash, voxels=options.voxels, directions=directions,
        seed=options.seed,
    )  # fmt: skip
    held = load(path)
    if held is None:
        scene = bench.renderer.scene
        figure = field_error(
            scene,
            baked_volume(scene, baked.plan.path),
            options.voxels,
            directions,
            options.seed,
            control,
        )
        store(path, **asdict(figure))
        return figure
    return Figure(
        float(held["relative_rmse"]),
        float(held["noise"]),
        float(held["bias"]),
        float(held["bias_noise"]),
        is_bound=bool(held["is_bound"]),
    )


def witness(
    bench: Bench, model: Model, values: Values, mask: Mask, control: Control, report: Report
) -> Agreement | None:
    """Whether the renderer's own solution of the model's equation agrees with the exact image;
    None where it has none. A witness does not clamp, so the exact image is taken without."""
    equations = model.equations(bench.renderer.scene, values)
    stopping = bench.stopping(0.25)

    def draw(seed: int) -> Pixels:
        total: Pixels | None = None
        for index, each in enumerate(equations):
            pixels = bench.renderer.witness(
                each.operator, stopping.samples, seed + SEEDS * index, each.scene.lights
            )
            if pixels is None:
                raise NoWitnessError
            total = pixels if total is None else total + pixels
        if total is None:
            raise NoWitnessError
        return total

    path = bench.part("witness", equations=_described(equations), samples=stopping.samples)
    try:
        tally = gather(path, draw, stopping, mask, control, report)
    except NoWitnessError:
        return None
    truth = exact(bench, model, values, control, clamped=False)
    return agreement(truth, tally.image(), mask)


def flip(bench: Bench, eye: Eye, draws: NDArray[np.floating]) -> Flip:
    """How different the picture looks, from independent draws [n, h, w, 3] of it."""
    path = bench.part("flip", draws=draws, **eye.identity())
    held = load(path)
    if held is None:
        seen = eye.flip(list(draws))
        store(path, **asdict(seen))
        return seen
    return Flip(float(held["value"]), float(held["noise"]), bool(held["is_bound"]))


def affordable(equations: tuple[Equation, ...], wanted: int) -> int:
    """Samples of these equations that take about as long as `wanted` rays of visibility."""
    return max(1, wanted // max(cost(each.operator) for each in equations))


def _described(equations: tuple[Equation, ...]) -> list[object]:
    """What an exact image depends on beside the renderer's identity."""
    return [
        [repr(each.operator), [light.kind for light in each.scene.lights]] for each in equations
    ]


def _timing(seconds: NDArray[np.float64]) -> Timing:
    return Timing(tuple(float(value) for value in seconds))
