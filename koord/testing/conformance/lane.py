"""Checks that are made one after the other, in a process of their own beside others'. (P-KIT-JOBS)

``python -m koord.testing.conformance.lane LANE`` makes them, and tells in lines of JSON what it
does and finds; at the end, how long the driver's calls took. When its input ends it brings the
vehicle to rest, and ends.
"""

from __future__ import annotations

import os
import sys
import threading
from typing import IO

import msgspec
from msgspec import Struct

from koord.testing.conformance.bench import Call, Check
from koord.testing.conformance.findings import Finding
from koord.testing.conformance.peers import CommandPeer
from koord.testing.conformance.running import bench_of, conform
from koord.testing.conformance.subjects import Subject


class Lane(Struct, frozen=True):
    """What a process is to check, and the other side of its wire."""

    subject: Subject
    command: tuple[str, ...]
    environment: dict[str, str]
    checks: tuple[str, ...]


class Said(Struct, frozen=True, omit_defaults=True):
    """What a process says: that a check begins, what it found, or how long all calls took."""

    begins: str | None = None
    finding: Finding | None = None
    calls: tuple[Call, ...] | None = None


def main(told: str) -> None:
    """Make the checks of a lane."""
    lane = msgspec.json.decode(told, type=Lane)
    says = _private_output()
    ends = threading.Event()
    threading.Thread(target=_until_input_ends, args=(ends,), daemon=True).start()

    def say(said: Said) -> None:
        says.write(msgspec.json.encode(said) + b"\n")
        says.flush()

    def begins(check: Check) -> None:
        say(Said(begins=check.name))

    peer = CommandPeer(lane.command, lane.environment)
    bench = bench_of(lane.subject, peer, is_cancelled=ends.is_set)
    for finding in conform(bench, lane.checks, begins):
        say(Said(finding=finding))
    say(Said(calls=tuple(bench.calls())))


def _private_output() -> IO[bytes]:
    """The output, for its own words alone; what libraries print goes with the errors."""
    says = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return says


def _until_input_ends(ends: threading.Event) -> None:
    sys.stdin.buffer.read()
    ends.set()


if __name__ == "__main__":
    main(sys.argv[1])
