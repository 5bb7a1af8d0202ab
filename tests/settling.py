"""Waiting for what follows a scene."""

from __future__ import annotations

import time

from volillum_addon.blender.live import Live

PATIENCE_SECONDS = 120  # against a hang, on a busy machine


def settle(followed: Live) -> list[str]:
    """Look until all is answered; every message on the way."""
    begin, messages = time.monotonic(), [followed.message]
    while True:
        followed.look()
        if followed.message != messages[-1]:
            messages.append(followed.message)
        if followed.settled:
            followed.look()  # what the lights alone have changed
            messages.append(followed.message)
            return messages
        assert time.monotonic() - begin < PATIENCE_SECONDS, messages
        time.sleep(0.005)
