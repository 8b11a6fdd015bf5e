"""A link to a Crazyflie by cflib: what it tells is queued, and what it is told goes out once.

cflib has threads: one that sends and receives (by radio it asks for what there is with empty
packets, and repeats a packet until it is acknowledged), one that passes on what has arrived, one
for parameters, and one for pings, which is ended. None of them makes set-points. By radio, to send
waits for up to two seconds, so there is one more thread here; what it could not send in time it
drops. (C-TICK)
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from msgspec import Struct

from koord.runtime.drivers.crazyflie.library import Crazyflie, CRTPPort, LogConfig, crtp
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions

#: So many things wait to be sent at most.
_MOST = 16

#: How often it tells its state, in ms.
_STATE_MS = 200

#: What is logged, with its type on the wire where that is not its own. A block has 26 bytes.
POSE = (
    *((f"stateEstimate.{name}", None) for name in ("x", "y", "z")),
    *((f"stateEstimate.{name}", "FP16") for name in ("vx", "vy", "vz", "qx", "qy", "qz", "qw")),
)
STATE = (
    ("supervisor.info", None),
    ("pm.vbat", None),
    *((f"kalman.varP{axis}", None) for axis in "XYZ"),
)


class Up(Struct, frozen=True):
    """It is connected, and speaks this version of CRTP."""

    protocol: int


class Down(Struct, frozen=True):
    """It is not connected (any more)."""

    why: str


class Logged(Struct, frozen=True):
    """A block of variables."""

    at_s: float
    boot_ms: int  #: of 24 bits
    values: dict[str, float]


class Answer(Struct, frozen=True):
    """What it said to a command, on a port of CRTP."""

    port: int
    data: bytes


class Text(Struct, frozen=True):
    """A piece of its console."""

    text: str


Heard = Up | Down | Logged | Answer | Text

#: Something that is said, by cflib's object of the Crazyflie.
Command = Callable[[Any], None]


class Link(Protocol):
    """A link to one Crazyflie."""

    def open(self) -> None:
        """Begin to connect."""

    def receive(self) -> list[Heard]:
        """What was heard since the last time."""

    def send(self, command: Command, lasts_s: float) -> None:
        """Say something once, within this time or not at all."""

    def connect_again(self) -> None:
        """Begin to connect anew, unless that is under way."""

    def wait(self, most_s: float) -> float:
        """Wait for a moment; return for how long."""

    def close(self) -> None:
        """Let go, and tell it nothing."""


class Ear:
    """Queues what a Crazyflie of cflib tells, from whatever thread."""

    def __init__(
        self, crazyflie: Any, options: CrazyflieOptions, clock: Callable[[], float]
    ) -> None:
        self._crazyflie, self._options, self._clock = crazyflie, options, clock
        self._heard: queue.SimpleQueue[Heard] = queue.SimpleQueue()
        crazyflie.connected.add_callback(self._connected)
        for lost in (crazyflie.connection_failed, crazyflie.connection_lost):
            lost.add_callback(lambda uri, why: self._heard.put(Down(why)))
        crazyflie.console.receivedChar.add_callback(lambda text: self._heard.put(Text(text)))
        for port in (CRTPPort.SETPOINT_HL, CRTPPort.SUPERVISOR, CRTPPort.PLATFORM):
            crazyflie.add_port_callback(port, self._answered)

    def heard(self) -> list[Heard]:
        """What was heard since the last time."""
        found = []
        while not self._heard.empty():
            found.append(self._heard.get())
        return found

    def _answered(self, packet: Any) -> None:
        self._heard.put(Answer(packet.port, bytes(packet.data)))

    def _connected(self, _uri: str) -> None:
        """Ask for what is logged."""
        self._crazyflie.link_statistics.stop()
        period_ms = max(10, round(100 / self._options.telemetry) * 10)
        try:
            self._log("pose", POSE, period_ms)
            self._log("state", STATE, _STATE_MS)
        except KeyError as error:
            self._heard.put(Down(f"its firmware is too old: {error.args[0]}"))
            return
        self._heard.put(Up(self._crazyflie.platform.get_protocol_version()))

    def _log(self, name: str, variables: tuple[tuple[str, str | None], ...], period: int) -> None:
        block = LogConfig(name, period)
        for variable, kind in variables:
            block.add_variable(variable, kind)
        block.data_received_cb.add_callback(self._logged)
        self._crazyflie.log.add_config(block)
        block.start()

    def _logged(self, boot_ms: int, values: dict[str, float], _block: Any) -> None:
        self._heard.put(Logged(self._clock(), boot_ms, values))


class CflibLink:
    """A link by what the options name."""

    def __init__(self, options: CrazyflieOptions) -> None:
        self._options = options
        self._crazyflie = Crazyflie(rw_cache=options.cache)
        self._ear = Ear(self._crazyflie, options, time.monotonic)
        self._said: queue.Queue[tuple[float, Command] | None] = queue.Queue(_MOST)
        self._sender = threading.Thread(target=self._send_all, name="crazyflie", daemon=True)
        self._connecting: threading.Thread | None = None

    def open(self) -> None:
        if not crtp.CLASSES:
            crtp.init_drivers()
        self._sender.start()
        self._crazyflie.open_link(self._options.uri)

    def receive(self) -> list[Heard]:
        return self._ear.heard()

    def send(self, command: Command, lasts_s: float) -> None:
        try:
            self._said.put_nowait((time.monotonic() + lasts_s, command))
        except queue.Full:
            return  # what waits there will be too old soon

    def _send_all(self) -> None:
        while (said := self._said.get()) is not None:
            until_s, command = said
            if time.monotonic() <= until_s:
                command(self._crazyflie)

    def connect_again(self) -> None:
        if self._connecting is None or not self._connecting.is_alive():
            self._connecting = threading.Thread(target=self._reconnect, daemon=True)
            self._connecting.start()

    def _reconnect(self) -> None:
        self._shut()
        self._crazyflie.open_link(self._options.uri)

    def wait(self, most_s: float) -> float:
        time.sleep(most_s)
        return most_s

    def close(self) -> None:
        """Let go without a word: cflib's own way tells motors to stop. (C-CLOSE)"""
        if self._sender.is_alive():
            self._said.put(None)
            self._sender.join()
        if self._connecting is not None:
            self._connecting.join()
        self._shut()

    def _shut(self) -> None:
        crazyflie = self._crazyflie
        if crazyflie.incoming.is_alive():
            crazyflie.incoming.stop()
            crazyflie.incoming.join()
        link, crazyflie.link = crazyflie.link, None
        if link is not None:
            link.close()
        crazyflie.close_link()
