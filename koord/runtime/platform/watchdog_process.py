"""The process of a watchdog: it stops a vehicle whose robot is killed or stuck. (P-WATCHDOG)

It has a session of its own, hears its robot on one pipe and answers on another, and imports nothing
of koord but what it stops the vehicle with. All that it is told at the start is one line of JSON.
"""

from __future__ import annotations

import json
import os
import select
import signal
import time
from contextlib import suppress
from importlib import import_module
from typing import Any

#: What the robot says: that it is there, and that the vehicle has been brought to its last stop.
FED, RELEASED = b".", b"q"

#: What the watchdog says: it is ready, there, has stopped the vehicle, and has let go of it again.
READY, THERE, TRIPPED, OVER, FAILED = b"r", b".", b"t", b"o", b"!"

#: How often the vehicle is told to stop, and how often the robot hears that the watchdog is there.
_AGAIN_S, _THERE_S = 0.05, 0.1

#: A robot that was stuck has to be there for so long before it is believed.
_BACK_S = 1.0

#: The longest first line.
_LONGEST = 1 << 16


def main(feed: int, status: int) -> None:
    """Watch a robot that feeds one pipe, until it lets go; say how it is on the other one."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # these are the robot's; it says when it is over
        with suppress(AttributeError):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    os.set_blocking(status, False)
    plan = json.loads(_line(feed))
    try:
        module, _, name = plan["target"].partition(":")
        stopper = getattr(import_module(module), name)(**plan["arguments"])
    except Exception as error:  # whatever it is: the robot tells people
        _say(status, FAILED + f"{type(error).__name__}: {error}\n".encode())
        return
    _say(status, READY)
    _watch(stopper, plan["limit_s"], plan["for_s"], feed, status)
    stopper.close()


def _watch(stopper: Any, limit_s: float, for_s: float, feed: int, status: int) -> None:
    fed_at: float | None = None  #: None: the robot has not begun
    back_at: float | None = None  #: since when a robot that was stuck is there again
    gone_at: float | None = None
    is_tripped, said_at, told_at = False, 0.0, 0.0
    while True:
        wait_s = _AGAIN_S if is_tripped or fed_at is None else min(limit_s / 4, _THERE_S)
        if gone_at is not None:
            time.sleep(wait_s)
        elif select.select([feed], [], [], wait_s)[0]:
            heard, now = os.read(feed, 4096), time.monotonic()
            if RELEASED in heard:
                return
            if not heard:
                gone_at = now
            elif is_tripped and (fed_at is None or now - fed_at > limit_s):
                back_at = now
            fed_at = now if heard else fed_at
        now = time.monotonic()
        is_late = gone_at is not None or (fed_at is not None and now - fed_at > limit_s)
        if is_late and not is_tripped:
            is_tripped, back_at = True, None
            _say(status, TRIPPED)
        elif is_tripped and not is_late and back_at is not None and now - back_at >= _BACK_S:
            is_tripped = False
            _say(status, OVER)
        if is_tripped and now - told_at >= _AGAIN_S / 2:
            told_at = now
            with suppress(Exception):  # the next one may get through
                stopper.stop()
        if gone_at is not None and now - gone_at >= for_s:
            return
        if now - said_at >= _THERE_S:
            said_at = now
            _say(status, THERE)


def _line(feed: int) -> bytes:
    """The first line, byte by byte, as what comes after it is the robot's feed."""
    line = b""
    while not line.endswith(b"\n") and len(line) < _LONGEST:
        one = os.read(feed, 1)
        if not one:
            break
        line += one
    return line


def _say(status: int, what: bytes) -> None:
    with suppress(OSError):  # the robot is gone, or stuck
        os.write(status, what)


if __name__ == "__main__":
    main(0, 1)
