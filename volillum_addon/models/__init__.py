"""The illumination models. Called, it is the public function `volillum.models`."""

from ..core.callable_package import callable_as

callable_as(__name__, ".registry", "models")
