"""A headless Chromium that is driven as by a person: keys, window sizes, light and dark.

The WebDriver protocol is JSON over HTTP; chromedriver speaks it, so that no library is needed.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
import urllib.request
from types import TracebackType
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
ENTER, SPACE, TAB = "\ue007", " ", "\ue004"
PATIENCE_SECONDS = 120


def found() -> str | None:
    """The browser's program, where there is one that can be driven."""
    browser = next((path for path in map(shutil.which, BROWSERS) if path), None)
    return browser if shutil.which("chromedriver") else None


class Browser:
    """One window; `width` and `height` in pixels."""

    def __init__(self, width: int, height: int = 900, dark: bool = False) -> None:
        self._size, self._dark = (width, height), dark
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)

    def __enter__(self) -> Browser:
        self._driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, text=True
        )
        assert self._driver.stdout is not None
        line = next(line for line in self._driver.stdout if "started successfully on port" in line)
        port = re.findall(r"port (\d+)", line)[-1]
        self._address = f"http://127.0.0.1:{port}/session"
        options = {
            "binary": found(),
            "args": [*ARGUMENTS, f"--user-data-dir={self._profile.name}",
                     "--window-size={},{}".format(*self._size)],
        }  # fmt: skip
        wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        session = self._send("", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]
        self._address += f"/{session}"
        self._tool(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": "dark" if self._dark else "light"}],
        )
        width, height = self._size
        self._tool("Emulation.setDeviceMetricsOverride", width=width, height=height,
                   deviceScaleFactor=1, mobile=False)  # fmt: skip
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        try:
            self._send("", method="DELETE")
        finally:
            self._driver.terminate()
            self._driver.communicate()
            self._profile.cleanup()

    def open(self, address: str) -> None:
        """Load a page to its end."""
        self._send("/url", {"url": address})

    def run(self, script: str, *arguments: object) -> Any:
        """What a function's body with these `arguments` returns in the page."""
        return self._send("/execute/sync", {"script": script, "args": list(arguments)})

    def press(self, key: str) -> None:
        """Press and release a key, wherever the focus is."""
        keys = [{"type": kind, "value": key} for kind in ("keyDown", "keyUp")]
        self._send("/actions", {"actions": [{"type": "key", "id": "keys", "actions": keys}]})

    def complaints(self) -> list[str]:
        """What the console has got since the last call."""
        return [entry["message"] for entry in self._send("/se/log", {"type": "browser"})]

    def picture(self) -> str:
        """A PNG of the window, base64."""
        return str(self._send("/screenshot", method="GET"))

    def _tool(self, command: str, **parameters: object) -> None:
        self._send("/goog/cdp/execute", {"cmd": command, "params": parameters})

    def _send(self, path: str, content: object = None, method: str = "POST") -> Any:
        data = json.dumps(content).encode() if content is not None else None
        request = urllib.request.Request(
            self._address + path, data, {"Content-Type": "application/json"}, method=method
        )
        with urllib.request.urlopen(request, timeout=PATIENCE_SECONDS) as answer:
            return json.load(answer)["value"]
