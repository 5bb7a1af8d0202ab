"""From scenes and models to VDB files. Called, it is the public function `volillum.bake`."""

from ..core.callable_package import callable_as

callable_as(__name__, "..models.illuminate", "bake")
