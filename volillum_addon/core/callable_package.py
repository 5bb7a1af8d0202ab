"""Packages that share their name with a public function: volillum.bake, volillum.models.

Importing a sub-package sets it as an attribute of its parent, over the parent's lazy function of
that name. So the package itself can be called as that function.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any


def callable_as(package: str, module: str, function: str) -> None:
    """Let `package` be called as `function` of `module` (relative), imported at the first call."""

    class CallablePackage(ModuleType):
        def __call__(self, *arguments: Any, **named: Any) -> Any:
            return getattr(import_module(module, package), function)(*arguments, **named)

    sys.modules[package].__class__ = CallablePackage
