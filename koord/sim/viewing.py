"""The page that shows a run: one file that loads nothing, or the same served while it goes on."""

from __future__ import annotations

import base64
import html
import re
import zlib
from importlib.resources import files
from typing import BinaryIO

from koord.sim.packing import pack
from koord.sim.run_log import LogSizes, RunLog

#: The parts of the script, in their order; each may use what stands in those before it.
_SCRIPTS = (
    "decode",
    "run",
    "words",
    "glyphs",
    "ground",
    "side",
    "map",
    "timeline",
    "panels",
    "hands",
    "main",
)


def page_of(recording: RunLog) -> bytes:
    """A run as one HTML file."""
    packed = zlib.compress(pack(recording, LogSizes(), recording.sizes))
    return _page(recording.header.program, base64.b64encode(packed).decode())


def live_page(program: str) -> bytes:
    """A page without a run, which asks the server that it came from for one."""
    return _page(program, "")


class PartPage:
    """The page of a run while it goes on: what is new is written behind it, pack after pack.

    Browsers show such a file up to where it was cut off.
    """

    def __init__(self, recording: RunLog, file: BinaryIO) -> None:
        self._recording, self._file, self._kept = recording, file, LogSizes()
        file.write(_page(recording.header.program, "packs"))

    def grow(self) -> None:
        """Write what is new."""
        now = self._recording.sizes
        if now != self._kept:
            packed = base64.b64encode(pack(self._recording, self._kept, now))
            self._file.write(b'<script type="text/plain" class="pack">' + packed + b"</script>\n")
            self._file.flush()
            self._kept = now


def _page(program: str, data: str) -> bytes:
    parts = {
        "title": html.escape(f"{program} – a run"),
        "style": _text("style.css"),
        "script": '"use strict";\n' + "\n".join(_text(f"{name}.js") for name in _SCRIPTS),
        "data": data,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _text("page.html")).encode()


def _text(name: str) -> str:
    return (files("koord.sim") / "page" / name).read_text("utf-8")
