"""Long work on a terminal: one progress line, Ctrl-C at once, standard output kept clean."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from ..core.control import Control
from .jobs import Clock

# A terminal's line is rewritten this often; a file or pipe gets a line this often.
TERMINAL_SECONDS = 0.2
LINE_SECONDS = 10.0
# The first line of a pipe waits this long: work that is found on disk says nothing.
FIRST_SECONDS = 1.0


@contextlib.contextmanager
def watched(label: str, seconds: float | None = None, estimated: bool = False) -> Iterator[Control]:
    """A control whose progress is shown on standard error, a line every `seconds` (a terminal's
    line is rewritten), and which the first Ctrl-C cancels; `estimated` as for `Clock`.

    Work runs in the caller's thread, which Blender's own calls need. Python would notice a signal
    only after a kernel has returned, so another thread is woken by it.
    """
    control = Control()
    done = threading.Event()
    watcher = threading.Thread(
        target=_show, args=(label, seconds, control, done, Clock(estimated)), daemon=True
    )
    with _interrupts(control):
        watcher.start()
        try:
            yield control
        finally:
            done.set()
            watcher.join()


def _show(
    label: str, seconds: float | None, control: Control, done: threading.Event, clock: Clock
) -> None:
    terminal = sys.stderr.isatty() and seconds is None
    every = TERMINAL_SECONDS if terminal else LINE_SECONDS if seconds is None else seconds
    width = 0
    wait = min(every, FIRST_SECONDS)
    while not done.wait(wait):
        wait = every
        line = f"{clock.line(control)}  ({label})"
        # Spaces wipe what a longer line before left.
        print(f"\r{line:<{width}}" if terminal else line, end="" if terminal else "\n",
              file=sys.stderr, flush=True)  # fmt: skip
        width = max(width, len(line))
    if width and terminal:
        print(f"\r{'':<{width}}\r", end="", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _interrupts(control: Control) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    count = 0

    def note(_number: int, _frame: FrameType | None) -> None:
        nonlocal count
        count += 1
        control.cancel()
        if count > 1:  # whoever insists does not want to wait for the next poll
            raise KeyboardInterrupt

    def listen() -> None:
        while number := receiver.recv(1):
            if number[0] in numbers:
                control.cancel()

    numbers = [signal.SIGINT, *([signal.SIGBREAK] if hasattr(signal, "SIGBREAK") else [])]
    before = [(number, signal.signal(number, note)) for number in numbers]
    wakeup = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(wakeup)
        for number, handler in before:
            # None: a handler that is not Python's, as Blender's own are, which cannot be put back.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        sender.close()
        listener.join()
        receiver.close()


@contextlib.contextmanager
def quiet() -> Iterator[Callable[[str], None]]:
    """Nothing but what this program says reaches standard output: Blender prints there too. Yields
    what prints a line there all the same."""
    sys.stdout.flush()
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)

    def say(line: str) -> None:
        data = line.encode() + b"\n"
        while data:
            data = data[os.write(kept, data) :]

    try:
        os.dup2(nowhere, 1)
        yield say
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def seconds_text(seconds: float) -> str:
    """A measured time as a person reads it."""
    return f"{1000 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"
