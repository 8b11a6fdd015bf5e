"""The process that drives a vehicle and is killed: ``python -m koord.testing.conformance.killed``.

It tells at each tick where the vehicle is and how far it has got, as a line of JSON.
"""

from __future__ import annotations

import json
import math
import os
import sys

import msgspec

from koord.testing.conformance.bench import Bench, RealClock
from koord.testing.conformance.leading import Line, along
from koord.testing.conformance.moving import ahead
from koord.testing.conformance.subjects import Subject

#: So far it would go; it is killed on its way.
_FAR_M = 30.0


def main(told: str) -> None:
    """Drive the vehicle of a subject until somebody kills this process."""
    subject = msgspec.json.decode(told, type=Subject)
    bench = Bench(subject, None, RealClock(), lambda: os.getppid() == 1)
    first = bench.ready().sensed
    line = Line(first.position_m, ahead(bench, first), _FAR_M, subject.speed_mps)
    leads = along(bench.driver.capabilities, subject.body, line, bench.clock.now())
    while True:
        here = bench.tick(leads).sensed.position_m
        moved = math.dist(here, first.position_m)
        sys.stdout.write(json.dumps({"position": here, "moved": moved}) + "\n")
        sys.stdout.flush()
        if moved > subject.room_m:
            return  # nobody has killed it


if __name__ == "__main__":
    main(sys.argv[1])
