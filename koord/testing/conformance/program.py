"""The last check: a small program is deployed on the driver, end to end, and its trace judged."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from koord.runtime.motion.bodies import VEHICLES
from koord.runtime.motion.world import Point
from koord.testing.conformance.bench import Bench
from koord.testing.conformance.findings import Failed, Measures
from koord.testing.conformance.subjects import Subject

#: It goes to these places about where it stands, in m.
_PLACES = ((0.8, 0.0), (0.8, 0.8), (0.0, 0.0))

_ROUNDS, _MOST_S = 1200, 150.0

_DELTA_S = 0.1

_PROGRAM = """\
# Go to each place, one after the other, and stop at the last.
param pos[] places = [{places}]

using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target

local:
    int visited = 0

Go:
    pre: Motion.reached and visited < length(places)
    eff:
        Motion.target = places[visited]
        visited = visited + 1

End:
    pre: Motion.reached and visited >= length(places)
    eff:
        stop

invariant InOrder: visited >= 0 and visited <= length(places)
"""


def runs(bench: Bench, found: Measures) -> None:
    """Deploy a program that goes to some places, and judge its trace."""
    bench.may_move()
    subject = bench.subject
    if bench.is_open:
        bench.settle()
        bench.close()
    if bench.peer is not None and not bench.peer.is_running:
        bench.peer.start()
    with tempfile.TemporaryDirectory() as folder:
        places = _places(bench)
        told = _deployed(Path(folder), subject, places)
        found.expect(
            told["code"] == 0,
            f"`koord deploy` ended with {told['code']} after {told['took_s']:.0f} s"
            + (f": {told['said']}" if told["code"] else ""),
            "0: all places, a trace that is legal and breaks nothing",
        )
    if bench.peer is not None and bench.peer.truth() is not None:
        for place in places:
            near = min(math.dist(one.position_m, place) for one in bench.peer.seen())
            found.at_most(near, 0.35, f"({place[0]:.1f}, {place[1]:.1f}): it came near to")


def _places(bench: Bench) -> list[Point]:
    """The places, about where the vehicle stands."""
    if bench.subject.is_virtual:
        x, y, z = bench.subject.at_m
    else:
        sensed = bench.tick().sensed
        x, y, _ = sensed.position_m
        z = bench.subject.at_m[2]
        bench.close()
    if bench.subject.flies:
        z += 1.2
    return [(x + dx, y + dy, z) for dx, dy in _PLACES]


def _deployed(folder: Path, subject: Subject, places: list[Point]) -> dict[str, Any]:
    """Deploy the program; return the exit code, how long it took, and what was said."""
    written = ", ".join(f"pos({x:.3f}, {y:.3f}, {z:.3f})" for x, y, z in places)
    (folder / "places.krd").write_text(_PROGRAM.format(places=written), encoding="utf-8")
    (folder / "places.yaml").write_text(_configuration(subject, places), encoding="utf-8")
    how = ["--dry-run"] if subject.is_virtual else ["--arm", "--yes"]
    begun_s = time.monotonic()
    try:
        ran = subprocess.run(
            [
                *(sys.executable, "-m", "koord", "deploy", "places.krd", "places.yaml"),
                *("--all-local", "--rounds", str(_ROUNDS), "--trace", "trace.json", *how),
            ],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            capture_output=True,
            text=True,
            timeout=_MOST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"`koord deploy` goes on after {_MOST_S:g} s", "all places visited") from None
    said = " ".join(f"{ran.stdout} {ran.stderr}".split())[-400:]
    return {"code": ran.returncode, "took_s": time.monotonic() - begun_s, "said": said}


def _configuration(subject: Subject, places: list[Point]) -> str:
    x, y, _ = subject.at_m if subject.is_virtual else places[-1]
    world, ground = subject.world, subject.at_m[2]
    device: dict[str, Any] = {
        "bot_name": "kit",
        "bot_type": subject.vehicle,
        "planner": VEHICLES[subject.vehicle].planners[0].value,
    }
    if not subject.is_virtual:
        device |= {"driver": subject.name or subject.target, "options": json.loads(subject.options)}
    told = {
        "delta": _DELTA_S,
        "num_robots": 1,
        "device": device,
        "positions": {0: [x, y, ground]},
        "world": {"bounds": {"low": list(world.low), "high": list(world.high)}},
    }
    return yaml.safe_dump(told)
