"""A headless Chromium, driven through its remote debugging port."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect
from websockets.sync.connection import Connection

#: What the browser is called where it is installed.
NAMES = ("chromium", "chromium-browser", "google-chrome")

#: What is looked at in a browser, where there is one.
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
in_a_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")

#: How long to wait for the browser, whose time is not ours.
_PATIENCE_S = 30.0


class Tab:
    """The one page of a browser. Whatever it complains of is in ``complaints``.

    It may ask for nothing, but for what is ``own``: an address begins so.
    """

    def __init__(self, socket: Connection, own: str | None = None) -> None:
        self._socket, self._number, self._own = socket, 0, own
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the Chrome DevTools protocol, and its result."""
        return self._sent(method, parameters)

    def _sent(
        self, method: str, parameters: dict[str, Any], session: str | None = None
    ) -> dict[str, Any]:
        """The result of a command: to the page, or to the frame that a session is of."""
        self._number += 1
        number = self._number
        sent: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        self._socket.send(json.dumps(sent | ({"sessionId": session} if session else {})))
        while True:
            message = json.loads(self._socket.recv(timeout=_PATIENCE_S))
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                result: dict[str, Any] = message["result"]
                return result
            self._hear(message)

    def _hear(self, message: dict[str, Any]) -> None:
        parameters = message.get("params", {})
        match message.get("method"):
            case "Runtime.exceptionThrown":
                self.complaints.append(json.dumps(parameters["exceptionDetails"])[:600])
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning"):
                self.complaints.append(json.dumps(parameters["args"])[:600])
            case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                self.complaints.append(json.dumps(parameters["entry"])[:600])
            case "Network.requestWillBeSent" if parameters["request"]["url"].startswith("http"):
                url = parameters["request"]["url"]
                if self._own is None or not url.startswith(self._own):
                    self.complaints.append(f"asks for {url}")
            case _:
                pass

    def open(self, address: str, until: str = "Boolean(window.page)") -> None:
        """Open an address, and wait until its run is there, or what else is waited for."""
        self.call("Page.navigate", url=address)
        self.until(until)

    def ask(self, expression: str, *, session: str | None = None) -> Any:
        """The value of an expression; promises are waited for."""
        asked = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        found = self._sent("Runtime.evaluate", asked, session)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def shown_frame(self, condition: str = "Boolean(window.page)") -> str:
        """A session of the frame with a process of its own where a condition holds, once it does.

        A frame that is taken away meanwhile is passed over.
        """
        end = time.monotonic() + _PATIENCE_S
        while True:
            for target in self.call("Target.getTargets")["targetInfos"]:
                if target["type"] == "iframe":
                    with suppress(AssertionError):
                        found = self.call(
                            "Target.attachToTarget", targetId=target["targetId"], flatten=True
                        )
                        session = str(found["sessionId"])
                        if self.ask(condition, session=session):
                            return session
            assert time.monotonic() < end, f"no such frame: {condition}; {self.complaints}"

    def until(self, condition: str, *, session: str | None = None) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + _PATIENCE_S
        while not self.ask(condition, session=session):
            assert time.monotonic() < end, f"not in time: {condition}; {self.complaints}"

    def press(self, key: str, *, shift: bool = False) -> None:
        """Press a key, as hands do."""
        text = {"text": key} if len(key) == 1 else {}
        event = {"key": key, "modifiers": 8 if shift else 0}
        self.call("Input.dispatchKeyEvent", type="keyDown", **event, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **event)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """``mousePressed``, ``mouseMoved``, ``mouseReleased``."""
        button = {"button": "left", "buttons": 1, "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    def picture(self, path: Path) -> None:
        """A screenshot."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))


@contextmanager
def browser(width: int = 1400, height: int = 900, own: str | None = None) -> Iterator[Tab]:
    """A browser with one empty tab; it ends with the block."""
    assert BROWSER is not None, "no Chromium is installed"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        flags = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--remote-debugging-port=0",
            f"--user-data-dir={folder}",
            f"--window-size={width},{height}",
            "about:blank",
        ]
        process = subprocess.Popen(
            [BROWSER, *flags], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            with connect(_address(Path(folder), process), max_size=None) as socket:
                tab = Tab(socket, own)
                tab.call(
                    "Emulation.setDeviceMetricsOverride",
                    width=width,
                    height=height,
                    deviceScaleFactor=1,
                    mobile=False,
                )
                yield tab
                tab.call("Browser.close")  # with all its processes, which write to the folder
        finally:
            process.terminate()
            process.wait()


def one_tab() -> Iterator[Tab]:
    """The tab of a browser, as a fixture: ``tab = pytest.fixture(scope="module")(one_tab)``."""
    with browser() as tab:
        yield tab


def _address(folder: Path, process: subprocess.Popen[bytes]) -> str:
    """The address of the tab, once the browser listens."""
    import urllib.request

    port_file, end = folder / "DevToolsActivePort", time.monotonic() + _PATIENCE_S
    while time.monotonic() < end and process.poll() is None:
        lines = port_file.read_text().split() if port_file.exists() else []
        if len(lines) == 2:
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                for target in json.load(answer):
                    if target["type"] == "page":
                        return str(target["webSocketDebuggerUrl"])
        time.sleep(0.05)
    raise RuntimeError("the browser does not answer")
