"""A process that reads a motion capture by the library ``motioncapture``, for one localiser.

The library waits where nobody answers, some of it with the interpreter in its hands: in koord's
own process that would stop a robot's rounds. It tells lines of JSON on standard output: poses with
our time, names of bodies whenever they change, errors. It ends with the process that started it.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import time
from importlib import import_module
from typing import Any

#: Of Linux: the signal that a process gets when its parent ends.
_PR_SET_PDEATHSIG = 1


def main(kind: str, body: str, settings: str) -> None:
    """Read until nobody listens."""
    _end_with_parent()
    library = import_module("motioncapture")
    try:
        capture = library.connect(kind, json.loads(settings))
        _say({"connected": True})
        names: list[str] | None = None
        while True:
            capture.waitForNextFrame()
            now_s = time.monotonic()
            bodies = capture.rigidBodies
            if names != sorted(bodies):
                names = sorted(bodies)
                _say({"names": names})
            if body in bodies:
                _say({"at_s": now_s, "pose": _pose(bodies[body])})
    except BrokenPipeError:
        return
    except Exception as error:  # of a library for many systems, each with its own
        _say({"error": str(error) or type(error).__name__})


def _pose(body: Any) -> list[float]:
    """Its position, and its orientation as wxyz."""
    turn = body.rotation
    return [float(c) for c in (*body.position, turn.w, turn.x, turn.y, turn.z)]


def _say(told: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()


def _end_with_parent() -> None:
    """Be killed with it: where the library waits, nothing else would be noticed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if os.getppid() == 1:  # it has ended already
        sys.exit()


if __name__ == "__main__":
    main(*sys.argv[1:])
