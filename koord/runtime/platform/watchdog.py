"""A robot's side of its watchdog: it is fed at every tick, and says if it cannot be relied on.

The watchdog is a process of its own (:mod:`.watchdog_process`), so that it survives whatever
becomes of this one. (P-WATCHDOG)
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from contextlib import suppress

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.setpoints import Capabilities, Stopper
from koord.runtime.guardian.limits import DeadMan, SafetyLimits
from koord.runtime.platform.watchdog_process import (
    FAILED,
    FED,
    OVER,
    READY,
    RELEASED,
    TRIPPED,
)
from koord.syntax.forking import FORKING

#: How long a watchdog may take to begin, and to end.
_BEGIN_S, _END_S = 20.0, 2.0

#: A watchdog that has said nothing for so long is not there.
_SILENT_S = 1.0


class Watchdog:
    """The watchdog of one vehicle, of which this robot feeds it."""

    def __init__(self, stopper: Stopper, limit_s: float) -> None:
        """Start the process, and wait until it could stop the vehicle. Raises DriverError."""
        self._limit_s = limit_s
        self._is_tripped = self._is_gone = False
        self._heard_at = time.monotonic()
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        command = [sys.executable, "-m", "koord.runtime.platform.watchdog_process"]
        with FORKING:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": paths},
                start_new_session=True,
                bufsize=0,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._feed, self._status = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._feed, False)
        os.set_blocking(self._status, False)
        plan = {
            "target": stopper.target,
            "arguments": json.loads(stopper.arguments),
            "for_s": stopper.for_s,
            "limit_s": limit_s,
        }
        self._say(json.dumps(plan).encode() + b"\n")
        self._begin()

    @property
    def process(self) -> int:
        """The id of its process."""
        return self._process.pid

    def _begin(self) -> None:
        ends_at = time.monotonic() + _BEGIN_S
        heard = b""
        while not heard.startswith(READY):
            left_s = ends_at - time.monotonic()
            has_failed = heard.startswith(FAILED) and heard.endswith(b"\n")
            if left_s <= 0 or self._is_gone or has_failed:
                self.close()
                why = heard.removeprefix(FAILED).decode(errors="replace").strip()
                raise DriverError(
                    f"the watchdog of the vehicle does not begin: {why or 'it says nothing'}",
                    "it is what stops the vehicle if this process is killed",
                )
            select.select([self._status], [], [], max(0.0, left_s))
            heard += self._hear()
        self._heard_at = time.monotonic()

    def feed(self) -> str | None:
        """Say that this robot is there; return why the watchdog cannot be relied on, if so."""
        self._say(FED)
        now = time.monotonic()
        heard = self._hear()
        if heard:
            self._heard_at = now
            at = {what: heard.rfind(what) for what in (TRIPPED, OVER)}
            if max(at.values()) >= 0:
                self._is_tripped = at[TRIPPED] > at[OVER]
        if self._is_gone:
            return (
                "the watchdog has ended, which would stop the vehicle if this process were killed"
            )
        if self._is_tripped:
            return (
                f"the watchdog holds it: this process was stuck for more than {self._limit_s:g} s"
            )
        if now - self._heard_at > _SILENT_S:
            return f"the watchdog has said nothing for {now - self._heard_at:.1f} s"
        return None

    def close(self) -> None:
        """Let go: the vehicle was brought to its last stop."""
        self._say(RELEASED)
        with FORKING:
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _say(self, what: bytes) -> None:
        try:
            os.write(self._feed, what)
        except BlockingIOError:
            pass  # it does not read; that it is silent is noticed
        except OSError:
            self._is_gone = True

    def _hear(self) -> bytes:
        try:
            heard = os.read(self._status, 1 << 16)
        except BlockingIOError:
            return b""
        except OSError:
            heard = b""
        self._is_gone = self._is_gone or not heard
        return heard


def watchdog_of(capabilities: Capabilities, limits: SafetyLimits) -> Watchdog | None:
    """The watchdog of a vehicle that is to move; None if it needs none. Raises DriverError.

    Something has to stop it if this process is killed. (P-WATCHDOG)
    """
    stopper, wanted = capabilities.stopper, limits.dead_man
    if wanted is DeadMan.NONE:
        return None
    if wanted is None and capabilities.dead_man_s is not None:
        return None
    if stopper is None:
        raise DriverError(
            "nothing would stop the vehicle if this process were killed: its driver knows of no"
            " dead-man timer, and has nothing for a watchdog",
            "if the vehicle stops by itself, name its timer in the driver's options (`dead_man`); "
            "to go without on purpose: safety: {dead_man: none}",
        )
    return Watchdog(stopper, limits.watchdog_s)
