"""Simulated runs are the same with and without machine code of programs, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("llvmlite")

from koord.api.fitting import FitRequest, Fitted, fit, fit_request
from koord.api.sim_setup import simulation
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.configuration.checking import load
from koord.sim.run_log import Idle
from koord.sim.running import Ending, Simulation, run
from koord.syntax.source import Source
from tests.runtime.column_twins import check_columns
from tests.sampling import but_slow

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: Programs, their configurations, and the seconds that they are run.
RUNS = (
    ("cars_and_drones", None, 12.0),
    ("delivery", None, 12.0),
    ("follow_path", None, 12.0),
    ("follow_points", None, 12.0),
    ("lineform", None, 12.0),
    ("mapping", None, 6.0),
    ("shapeform", None, 4.0),
    ("shapeform", "shapeform_9", 12.0),
    ("shapeform", "shapeform_36", 2.0),
    ("task", None, 8.0),
    ("task", "task_diff", 6.0),
    ("task", "task_mixed", 6.0),
    ("waypoints", None, 12.0),
)

#: Robots that go to and fro, tell each other how far they are, and stop.
SHUTTLES = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
allread:
    int[] done = 0
allwrite:
    int total = 0
local:
    pos home
    int k = 0
init:
    home = Motion.psn
    Motion.target = Motion.psn
Go:
    pre: Motion.reached and k < 5 and abs(Motion.psn.x - home.x) < 1.0
    eff:
        k = k + 1
        done[pid] = k
        Motion.target = pos(home.x + 0.3 * (k % 2), home.y, home.z)
        if k == 3:
            atomic:
                total = total + 1
Rest:
    pre: k == 5 and min(done) > 3
    eff:
        stop
invariant Counted: total <= numAgents
"""


def shuttles(count: int, kind: str) -> Fitted:
    places = {k: [2 * (k % 8), 2 * (k // 8), 1 - (kind == "CAR")] for k in range(count)}
    lines = f"num_robots: {count}\npositions: {places}\n"
    lines += f"device: {{bot_type: {kind}, planner: STRAIGHT}}\n"
    lines += "world: {bounds: {low: [-4, -4, 0], high: [40, 40, 3]}}\n"
    source = Source("shuttles.krd", SHUTTLES)
    return fit(FitRequest(source, load(Source("fleet.yaml", lines)), (), {}))


def both(fitted: Fitted, time_s: float) -> tuple[Simulation, ColumnEngine]:
    """Run without machine code and with it, and compare both to the end."""
    one = simulation(fitted, Simulation, keep_going=True, kernels=False)
    other = simulation(fitted, Simulation, keep_going=True)
    engine = other.engine
    assert isinstance(engine, ColumnEngine)
    assert not isinstance(one.engine, ColumnEngine)
    engine.after = 0
    one.begin()
    other.begin()
    left, right = run(one, time_s), run(other, time_s)
    for decision in left:
        same = next(right)
        assert (same.ran, same.skipped, same.fault) == (
            decision.ran,
            decision.skipped,
            decision.fault,
        )
        check_columns(engine)
    assert next(right, None) is None
    assert one.ending == other.ending
    assert one.figures() == other.figures()
    assert repr(one.engine.store.values) == repr(engine.store.values)
    pairs = zip(one.engine.robots, engine.robots, strict=True)
    assert all(repr(vars(robot)) == repr(vars(twin)) for robot, twin in pairs)
    assert one.looked == other.looked
    assert repr(one.recording.rounds) == repr(other.recording.rounds)
    return other, engine


@pytest.mark.parametrize(
    ("name", "configuration", "time_s"),
    but_slow({name for name, _, _ in RUNS if name not in ("lineform", "follow_path")}, RUNS),
)
def test_examples_run_as_without(name: str, configuration: str | None, time_s: float) -> None:
    config = None if configuration is None else str(EXAMPLES / f"{configuration}.yaml")
    fitted = fit(fit_request(str(EXAMPLES / f"{name}.krd"), config, None, None, 0, None))
    _, engine = both(fitted, time_s)
    assert engine.counts.in_doubt == 0
    if name in ("cars_and_drones", "lineform"):
        assert engine.counts.by_code > 20


@pytest.mark.parametrize(
    ("kind", "count"), [("QUAD", 20), pytest.param("IDEAL", 40, marks=pytest.mark.slow)]
)
def test_robots_that_stop_run_as_without(kind: str, count: int) -> None:
    made, engine = both(shuttles(count, kind), 20.0)
    assert engine.counts.by_code > 10 * count
    assert engine.counts.in_doubt == engine.counts.by_robots == 0
    assert made.engine.store.values["total"] == count


@pytest.mark.parametrize("several", [(), ("--runs", "2")])
def test_kernels_can_be_left_out(
    several: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []

    def counted(*given: Any, **named: Any) -> ColumnEngine:
        made.append(given)
        return ColumnEngine(*given, **named)

    monkeypatch.setattr("koord.sim.running.ColumnEngine", counted)
    words = ["sim", str(EXAMPLES / "lineform.krd"), "--time", "0.3", "--no-html", *several]
    assert main([*words, "--kernels", "off"]) == Exit.OK
    assert made == []
    assert main(words) == Exit.OK
    assert len(made) == max(1, len(several))


#: One robot stops at once; the others do something, but nothing comes of it, until one of two
#: claims is broken: of itself, not of the other.
IDLE = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
local:
    int k = 0
    int same = 0
Stop:
    pre: pid == 0
    eff:
        stop
Count:
    pre: pid == 1 and k < LIMIT
    eff:
        k = k + 1
Nothing:
    pre: pid == 2 and k >= 0 and IDLY
    eff:
        same = 0
invariant Fine: same == 0
invariant Few: k < 12 or pid != 1
"""


def idle(limit: int, idly: str) -> Fitted:
    text = IDLE.replace("LIMIT", str(limit)).replace("IDLY", idly)
    places = {k: [2 * k, 0, 1] for k in range(4)}
    lines = f"num_robots: 4\npositions: {places}\ndevice: {{bot_type: QUAD, planner: STRAIGHT}}\n"
    lines += "world: {bounds: {low: [-4, -4, 0], high: [40, 40, 3]}}\n"
    return fit(FitRequest(Source("idle.krd", text), load(Source("fleet.yaml", lines)), (), {}))


@pytest.mark.parametrize("idly", ["false", "true"])
@pytest.mark.parametrize("limit", [3, 15])
def test_rounds_in_which_nothing_comes_of_anything(limit: int, idly: str) -> None:
    """Who has stopped is said to have; a claim is broken by itself; and the run ends as still."""
    made, engine = both(idle(limit, idly), 20.0)
    assert engine.counts.by_code > 60
    assert made.ending is Ending.STILL
    assert made.time_s < 6.0
    assert [one.claim for one in made.broken] == (["invariant Few"] if limit == 15 else [])
    assert {int(done.deeds[0]) for done in made.recording.rounds[2:]} == {int(Idle.STOPPED)}
