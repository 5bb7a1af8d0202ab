"""The one place that finds the native core."""

from __future__ import annotations

try:
    import volillum_native as native
except ImportError as error:
    raise ImportError(
        "volillum's native core (volillum_native) is not installed for this Python; "
        "install the extension's zip, or run `make` in a checkout"
    ) from error

__all__ = ["native"]
