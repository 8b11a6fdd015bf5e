"""What watchdogs of tests stop: a file that grows by a byte each time; and robots that feed one.

``stoppers.py FILE LIMIT`` is a robot that feeds a watchdog until it is killed.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from koord.runtime.drivers.setpoints import Stopper
from koord.runtime.platform.watchdog import Watchdog


class Kept:
    """A vehicle that keeps how often it was told to stop."""

    def __init__(self, file: str) -> None:
        self._file = Path(file).open("ab", buffering=0)  # noqa: SIM115

    def stop(self) -> None:
        self._file.write(b"s")

    def close(self) -> None:
        self._file.write(b"c")
        self._file.close()


class Broken:
    """A vehicle that cannot be reached."""

    def __init__(self) -> None:
        raise ValueError("there is no such vehicle")


def kept(file: Path, for_s: float = 0.5) -> Stopper:
    arguments = json.dumps({"file": str(file)}).encode()
    return Stopper("tests.runtime.platform.stoppers:Kept", arguments, for_s)


def main(file: str, limit_s: str) -> None:
    """Feed a watchdog for ever."""
    watchdog = Watchdog(kept(Path(file)), float(limit_s))
    while True:
        print(watchdog.process if watchdog.feed() is None else watchdog.feed(), flush=True)
        time.sleep(0.02)


if __name__ == "__main__":
    main(*sys.argv[1:])
