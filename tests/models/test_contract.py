"""The laws that every model keeps, whatever its equation: tested over all of MODELS.

Deterministic models keep them to rounding or to the order of their discretisation, a stochastic
one within the standard errors that it reports.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from media import smooth_random

from volillum_addon.core.camera import Camera
from volillum_addon.core.errors import InputError
from volillum_addon.core.grid import Grid
from volillum_addon.core.lights import DistantLight, EnvironmentLight
from volillum_addon.core.medium import Medium
from volillum_addon.core.scene import Scene
from volillum_addon.models.illuminate import illuminate
from volillum_addon.models.model import Model
from volillum_addon.models.registry import models
from volillum_addon.models.volume import IlluminationVolume

every_model = pytest.mark.parametrize("model", models(), ids=lambda model: model.id)

SUN = DistantLight((0.3, -0.5, 0.8), (2.0, 1.5, 1.0), 0.1)
SKY = EnvironmentLight((0.2, 0.3, 0.5))
CAMERA = Camera((2.0, -7.0, 3.0), (0.3, 0.3, 0.3))
