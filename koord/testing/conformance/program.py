"""The last check: a small program is deployed on the driver, end to end, and its trace judged."""

from __future__ import annotations

import json
import math
import os
import secrets
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml
from msgspec import Struct

from koord.runtime.motion.bodies import VEHICLES
from koord.runtime.motion.world import Point
from koord.testing.conformance.bench import Bench
from koord.testing.conformance.findings import Failed, Measures
from koord.testing.conformance.holders import free_port
from koord.testing.conformance.subjects import Subject

#: It goes to these places about where it stands, in m.
_PLACES = ((0.8, 0.0), (0.8, 0.8), (0.0, 0.0))

_ROUNDS, _MOST_S = 1200, 150.0

#: The second process is started so much later; who is asked to stop has so long.
_TWIN_S, _STOPS_S = 6.0, 30.0

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


class Ended(Struct, frozen=True):
    """A command that has ended."""

    code: int
    said: str
    took_s: float = 0.0


class Deployed(Struct, frozen=True):
    """What came of deploying the program."""

    places: list[Point]
    run: Ended
    twin: Ended  #: a second process that said, meanwhile, that it is the same robot
    judged: Ended


def runs(bench: Bench, found: Measures) -> None:
    """Deploy a program that goes to some places, and judge its trace."""
    made = _deployed(bench)
    found.expect(
        made.run.code == 0,
        f"`koord deploy` ended with {made.run.code} after {made.run.took_s:.0f} s"
        + (f": {made.run.said}" if made.run.code else ""),
        "0: all places",
    )
    words = made.judged.said.rpartition(": ")[2]
    found.expect(made.judged.code == 0, words, "a trace that is legal and breaks nothing")
    if bench.peer is not None and bench.peer.truth() is not None:
        for place in made.places:
            near = min(math.dist(one.position_m, place) for one in bench.peer.seen())
            found.at_most(near, 0.35, f"({place[0]:.1f}, {place[1]:.1f}): it came near to")


def twin(bench: Bench, found: Measures) -> None:
    """Start a second process with the same pid, while the program runs: it is refused."""
    made = _deployed(bench)
    found.expect(made.twin.code not in (0, None), made.twin.said, "refused")
    found.expect(made.run.code == 0, f"the first one ended with {made.run.code}", "0: it goes on")


def _deployed(bench: Bench) -> Deployed:
    """Deploy the program, once for all checks. Raises Failed and Skipped."""
    bench.may_move()

    def deploy() -> Deployed:
        if bench.is_open:
            bench.settle()
            bench.close()
        if bench.peer is not None and not bench.peer.is_running:
            bench.peer.start()
        places = _places(bench)
        with tempfile.TemporaryDirectory() as folder:
            return _deploy(Path(folder), bench.subject, places)

    return bench.keep("deployed", deploy)


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


def _deploy(folder: Path, subject: Subject, places: list[Point]) -> Deployed:
    """Deploy the program, and another process of the same robot in the meantime."""
    written = ", ".join(f"pos({x:.3f}, {y:.3f}, {z:.3f})" for x, y, z in places)
    (folder / "places.krd").write_text(_PROGRAM.format(places=written), encoding="utf-8")
    (folder / "places.yaml").write_text(_configuration(subject, places), encoding="utf-8")
    how = ["--dry-run"] if subject.is_virtual else ["--arm", "--yes"]
    words = ["deploy", "places.krd", "places.yaml", "--pid", "0", "--rounds", str(_ROUNDS), *how]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        "KOORD_KEY": secrets.token_hex(32),
    }

    def started(*words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "koord", *words],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    first = started(*words, "--trace", "part.jsonl")
    begun_s = time.monotonic()
    try:
        time.sleep(_TWIN_S)
        other = _ended(started(*words, "--state", "other"), _MOST_S)
    finally:
        run = _ended(first, _MOST_S)
    judged = _ended(started("merge", "part.jsonl", "-o", "trace.json"), _MOST_S)
    took = Ended(run.code, run.said, time.monotonic() - begun_s)
    return Deployed(places, took, other, judged)


def _ended(process: subprocess.Popen[str], most_s: float) -> Ended:
    """Wait for a process. Raises Failed if it does not end; it is asked to stop safely first."""
    try:
        said, _ = process.communicate(timeout=most_s)
    except subprocess.TimeoutExpired:
        process.terminate()
        try:
            process.communicate(timeout=_STOPS_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        raise Failed(f"a deployed robot goes on after {most_s:g} s", "it ends") from None
    except BaseException:
        process.terminate()
        process.wait()
        raise
    return Ended(process.returncode, " ".join(said.split())[-400:])


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
        "network": {"port": free_port()},
        "world": {"bounds": {"low": list(world.low), "high": list(world.high)}},
    }
    return yaml.safe_dump(told)
