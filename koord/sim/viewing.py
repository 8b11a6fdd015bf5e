"""The page of a run: one HTML file that loads nothing, or the same page served live.

The page is the one that a finished run is kept in; what it shows comes as packs
(:mod:`koord.sim.packing`) in a stream of server-sent events, to each browser from the beginning.
"""

from __future__ import annotations

import base64
import threading
import time
import zlib
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from typing import Any, BinaryIO

from koord.sim.packing import pack
from koord.sim.page_files import filled
from koord.sim.run_log import LogSizes, RunLog

#: The parts of the script, in their order; each may use what stands in those before it.
_SCRIPTS = (
    "decode",
    "dom",
    "run",
    "words",
    "glyphs",
    "ground",
    "side",
    "crowd",
    "map",
    "timeline",
    "plot",
    "journal",
    "panels",
    "hands",
    "main",
)


def page_of(recording: RunLog) -> bytes:
    """Export a run as one HTML file."""
    packed = zlib.compress(pack(recording, LogSizes(), recording.sizes))
    return _page(recording.header.program, base64.b64encode(packed).decode())


def live_page(program: str) -> bytes:
    """A page without a run, which asks its server for one."""
    return _page(program, "")


class PartPage:
    """The page of a run in progress: new packs are appended to the file.

    Browsers show such a file up to where it was cut off.
    """

    def __init__(self, recording: RunLog, file: BinaryIO) -> None:
        self._recording, self._file, self._kept = recording, file, LogSizes()
        file.write(_page(recording.header.program, "packs"))

    def grow(self) -> None:
        """Write the new part of the run."""
        now = self._recording.sizes
        if now != self._kept:
            packed = base64.b64encode(pack(self._recording, self._kept, now))
            self._file.write(b'<script type="text/plain" class="pack">' + packed + b"</script>\n")
            self._file.flush()
            self._kept = now


def _page(program: str, data: str) -> bytes:
    return filled("koord.sim", f"{program} – a run", _SCRIPTS, data).encode()


#: Nobody else is to see the run: only this machine.
THIS_MACHINE = "127.0.0.1"
_EVERYWHERE = "0.0.0.0"
#: By these names browsers on this machine may ask. Another name is that of a foreign page.
_NAMES = ("127.0.0.1", "localhost")

#: How often what is new is sent.
_PERIOD_S = 0.2


class _Server(ThreadingHTTPServer):
    """An HTTP server that ignores connections broken off by browsers."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore errors of single requests: the run goes on."""


class Live:
    """A server for one run. ``with Live(recording) as live: …`` serves it at ``live.address``.

    Raises OSError if the port is taken.
    """

    def __init__(self, recording: RunLog, port: int = 0, host: str = THIS_MACHINE) -> None:
        """Make a server at an address of this machine; ``port`` 0 is any free port.

        At another one than that of loopback everybody in the network sees the run.
        """
        self._recording = recording
        self._over = threading.Event()
        self._watching = 0
        self._change = threading.Condition()
        page = live_page(recording.header.program)
        live = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                live._answer(self, page)

            def log_message(self, format: str, *arguments: Any) -> None:
                """Log nothing: messages to users come from the command line."""

        self._host = host
        self._server = _Server((host, port), Handler)
        self._thread = threading.Thread(target=self._serve, name="live page", daemon=True)

    @property
    def address(self) -> str:
        host = THIS_MACHINE if self._host == _EVERYWHERE else self._host
        return f"http://{host}:{self._server.server_address[1]}/"

    def __enter__(self) -> Live:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def wait_for_watchers(self, patience_s: float) -> None:
        """Wait until every watching browser has the end of the run."""
        with self._change:
            self._change.wait_for(lambda: self._watching == 0, patience_s)

    # --- inside ---------------------------------------------------------------------------------

    def _serve(self) -> None:
        self._server.serve_forever(poll_interval=0.1)

    def _answer(self, request: BaseHTTPRequestHandler, page: bytes) -> None:
        name = request.headers.get("Host", "").rpartition(":")[0]
        if not (name in _NAMES or (self._host != THIS_MACHINE and _is_address(name))):
            request.send_error(403)
        elif request.path == "/":
            request.send_response(200)
            request.send_header("Content-Type", "text/html; charset=utf-8")
            request.send_header("Content-Length", str(len(page)))
            request.send_header("Cache-Control", "no-store")
            request.end_headers()
            request.wfile.write(page)
        elif request.path == "/packs":
            self._stream(request)
        else:
            request.send_error(404)

    def _stream(self, request: BaseHTTPRequestHandler) -> None:
        request.close_connection = True
        request.send_response(200)
        request.send_header("Content-Type", "text/event-stream")
        request.send_header("Cache-Control", "no-store")
        request.end_headers()
        with self._change:
            self._watching += 1
        try:
            self._send_all(request)
        except OSError:
            pass  # the browser went away
        finally:
            with self._change:
                self._watching -= 1
                self._change.notify_all()

    def _send_all(self, request: BaseHTTPRequestHandler) -> None:
        sent = LogSizes()
        while not sent.ended and not self._over.is_set():
            now = self._recording.sizes
            if now != sent:
                packed = base64.b64encode(pack(self._recording, sent, now))
                request.wfile.write(b"event: pack\ndata: " + packed + b"\n\n")
                request.wfile.flush()
                sent = now
            self._over.wait(_PERIOD_S)


def _is_address(name: str) -> bool:
    """Return whether a host is named by its address: no foreign page can pretend that."""
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


class Throttle:
    """A throttle that keeps simulated time below a multiple of real time."""

    def __init__(self, factor: float) -> None:
        self._factor, self._began = factor, time.monotonic()

    def keep(self, time_s: float) -> None:
        """Wait until a simulated time is due."""
        early = self._began + time_s / self._factor - time.monotonic()
        if early > 0:
            time.sleep(early)
