"""Robots are told where they are when somebody looks, and have then what they would have had."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from hypothesis import given
from hypothesis import strategies as st

from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import simulation
from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load
from koord.runtime.engine import RoundEngine
from koord.sim.reading import Reader
from koord.sim.running import Simulation, run
from koord.syntax.source import Source
from tests.runtime.column_twins import PlainHost, program_of
from tests.sampling import first

#: Robots with sensors of several widths.
SENSING = """\
using Motion:
    sensors:
        pos psn
        bool reached
using Rail:
    sensors:
        float position
local:
    int k = 0
Never:
    pre: k > 0
    eff: k = 0
"""

_PARTS = st.sampled_from([0.0, -0.0, 1.0, 2.5])
_PLACES = st.lists(st.tuples(_PARTS, _PARTS, _PARTS), min_size=2, max_size=2)
_ROUNDS = st.lists(
    st.tuples(_PLACES, st.lists(st.booleans(), min_size=2, max_size=2), st.booleans()),
    min_size=1,
    max_size=12,
)


@given(rounds=_ROUNDS)
def test_late_or_at_once_robots_have_the_same_to_the_bit(
    rounds: list[tuple[list[tuple[float, float, float]], list[bool], bool]],
) -> None:
    """Zeros of the other sign are no other values, however late robots hear of them."""
    classes, kinds = loaded(compiled(program_of(SENSING))), (0, 0)
    start = {"Motion_psn": (0.0, 0.0, 0.0), "Motion_reached": False, "Rail_position": 0.0}

    class Host(SimpleNamespace):
        def read(self, robot: Any) -> dict[str, Any]:
            return start

        def ranging(self, robot: int) -> tuple[str, ...]:
            return ()

    host = Host(kinds=kinds, classes=classes, modules={}, scanners={}, told_more=[])
    readers = [Reader(cast("Any", host)) for _ in range(2)]
    fleets = [
        RoundEngine(classes, kinds, 0.1, PlainHost(lambda robot, round_: start)) for _ in range(2)
    ]
    host.sensed = SimpleNamespace(position=np.zeros((2, 3)), reached=np.zeros(2, np.bool_))
    for fleet, reader in zip(fleets, readers, strict=True):
        fleet.begin()
        reader.read(fleet.robots).write()
    for places, reached, is_looked_at in rounds:
        host.sensed = SimpleNamespace(position=np.array(places), reached=np.array(reached))
        at_once, late = (
            reader.read(fleet.robots) for reader, fleet in zip(readers, fleets, strict=True)
        )
        at_once.write()
        if is_looked_at:
            late.write()
            one, other = ([repr(vars(robot)) for robot in fleet.robots] for fleet in fleets)
            assert one == other


#: Robots that go up and down: some of their events are Python's, and some claims are broken.
LIFTS = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
local:
    pos home
    int k = 0
    int ticks = 0
    {more}
init:
    home = Motion.psn
    Motion.target = Motion.psn
Go:
    pre: {guard}
    eff:
        k = k + 1
        {effect}
        Motion.target = home + pos(0.0, 0.0, 0.3 * (k % 3))
Tick:
    pre: Motion.psn.z > home.z + 0.1 and ticks < 20
    eff:
        ticks = ticks + 1
"""

CLAIMS = """\
invariant Low: Motion.psn.z <= home.z + 0.25
invariant Sum: 1 / (k - 2) < 9 or Motion.psn.z < 1.2
"""

#: What is Python's: nothing; an event; a guard; where an event is in doubt.
WHOSE = {
    "code": {"more": "int j = 0", "guard": "Motion.reached", "effect": "j = j + 1"},
    "event": {
        "more": "List<pos> been = []",
        "guard": "Motion.reached",
        "effect": "been.append(Motion.psn)",
    },
    "guard": {
        "more": "List<pos> been = []",
        "guard": "Motion.reached and len(been) < 9",
        "effect": "been.append(Motion.psn)",
    },
    "doubt": {
        "more": "float last = 0.0",
        "guard": "Motion.reached",
        "effect": "last = Motion.psn.z + k * 4000000000000000000",
    },
    "doubtful guard": {
        "more": "float last = 0.0",
        "guard": "Motion.reached and (k + 3) * 2000000000000000000 != 7",
        "effect": "last = Motion.psn.z",
    },
}


def lifts(whose: str, count: int, claims: str) -> Fitted:
    places = {k: [2 * (k % 8), 2 * (k // 8), 1] for k in range(count)}
    lines = f"num_robots: {count}\npositions: {places}\n"
    lines += "device: {bot_type: QUAD, planner: STRAIGHT}\n"
    lines += "world: {bounds: {low: [-4, -4, 0], high: [40, 40, 3]}}\n"
    source = Source("lifts.krd", LIFTS.format(**WHOSE[whose]) + claims)
    return fit(FitRequest(source, load(Source("fleet.yaml", lines)), (), {}))


@pytest.mark.parametrize("claims", ["", CLAIMS], ids=["unclaimed", "claimed"])
@pytest.mark.parametrize("every", first(1, [7, 1_000]))
@pytest.mark.parametrize("whose", WHOSE)
def test_runs_are_the_same_however_seldom_somebody_looks(
    whose: str, every: int, claims: str
) -> None:
    fitted = lifts(whose, 5, claims)
    one = simulation(fitted, Simulation, keep_going=True, kernels=False)
    other = simulation(fitted, Simulation, keep_going=True)
    engine = other.engine
    assert isinstance(engine, ColumnEngine)
    engine.after = 0
    if every < 1_000:
        other.striding = None  # who looks at rounds when they are over has them one by one
    one.begin()
    other.begin()
    right = run(other, 12.0)
    for number, _ in enumerate(run(one, 12.0)):
        next(right)
        if number % every == every - 1:
            pairs = zip(one.engine.robots, other.engine.robots, strict=True)
            assert all(repr(vars(robot)) == repr(vars(twin)) for robot, twin in pairs)
    assert next(right, None) is None
    assert one.figures() == other.figures()
    assert one.broken == other.broken
    names = {"invariant Low", "invariant Sum"} if claims else set()
    assert {broken.claim for broken in one.broken} == names
    assert repr(one.recording.rounds) == repr(other.recording.rounds)
    found = [repr(vars(robot)) for robot in one.engine.robots]
    assert found == [repr(vars(robot)) for robot in other.engine.robots]
    of = engine.counts
    made_by = {
        "code": (True, False, False),
        "event": (True, False, True),
        "guard": (False, False, True),
        "doubt": (True, True, False),
        "doubtful guard": (True, True, False),
    }
    assert (of.by_code > 20, of.in_doubt > 0, of.by_robots > 0) == made_by[whose]
