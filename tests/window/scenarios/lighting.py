"""Live: the picture follows the lights."""

import bpy
from eyes import difference, look, picture
from hand import drag, into_view, key, select, write
from sidebar import press
from steps import Steps
from user import MODEL, OTHER, choose_model, lit_view, open_scene, package, scene, settings, volumes

# Places about the view's middle.
RIGHT, BELOW, BESIDE = (200, 0), (20, -200), (-300, 100)
# What Blender calls a new lamp; the smoke is 50 units across.
LAMP, LAMP_WATTS = "Point", 1e5


def live() -> Steps:
    """Turn the sun, then move a lamp, and look; a model of which only the light is changed."""
    yield from open_scene("live")
    yield from choose_model(MODEL)
    getattr(settings(), MODEL).directions = 16
    yield from lit_view()
    yield from press("volillum.live(")
    yield lambda: following().settled
    before = yield from look()
    picture("live_before", "view")
    yield from select("Sun")
    place = turned(scene().objects["Sun"])
    files = yield from shown_during(drag("r", RIGHT, BELOW))
    assert turned(scene().objects["Sun"]) != place
    assert len(files) > 2, files
    yield lambda: following().settled
    after = yield from look()
    picture("live_after", "view")
    assert difference(before, after) > OTHER
    assert following().message.startswith("in full after")
    assert volumes() == {"smoke": False, settings().baked.shown.name: True}
    yield from add_lamp()
    yield lambda: "inside the volume" in following().message
    picture("live_refused", "sidebar")
    yield from drag("g", (0, 0), BESIDE)
    yield lambda: following().settled
    lamp = yield from look()
    picture("live_lamp", "view")
    assert difference(lamp, after) > OTHER
    yield from press("volillum.live(")
    assert following() is None
    assert volumes() == {"smoke": False, settings().baked.shown.name: True}


def following() -> object:
    """What follows the scene."""
    return package("blender.live_session").current()


def turned(item: bpy.types.Object) -> tuple[float, ...]:
    """Where it stands and looks to."""
    return tuple(value for row in item.matrix_world for value in row)


def shown_during(steps: Steps) -> Steps:
    """Every file that is shown while the steps are taken."""
    files = {settings().baked.shown.data.filepath}
    for wait in steps:
        yield wait
        files.add(settings().baked.shown.data.filepath)
    return files


def add_lamp() -> Steps:
    """Shift+A, and its name."""
    yield from into_view()
    key("shift+a")
    yield 1.0
    write(LAMP)
    yield 1.0
    key("Return")
    yield lambda: scene().view_layers[0].objects.active.name == LAMP
    scene().objects[LAMP].data.energy = LAMP_WATTS
