"""Rounds in which nobody acts are the same many at once and one by one, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import simulation
from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.configuration.checking import load
from koord.runtime.proposals import Decision
from koord.sim.running import Ending, Simulation, Striding, run
from koord.sim.strides import Strides
from koord.sim.vehicles.compiled_contact import CompiledWheels
from koord.sim.vehicles.compiled_legs import DrivenSquad
from koord.sim.vehicles.room import Room
from koord.sim.vehicles.rovers import Differentials
from koord.syntax.source import Source
from tests.runtime.column_twins import check_columns
from tests.sampling import first

#: Robots that go there and back again, each as far as its number says, and tell how often.
THERE = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
allread:
    int[] gone = 0
local:
    pos home
    int k = 0
def fun apart(pos a, pos b) -> bool:
    return abs(a.x - b.x) + abs(a.y - b.y) > 0.5
init:
    home = Motion.psn
    Motion.target = Motion.psn
Go:
    pre: Motion.reached and k < LAST
    eff:
        k = k + 1
        gone[pid] = k
        Motion.target = pos(home.x + LEG * (k % 2), home.y, home.z)
invariant Told: gone[pid] == k
invariant Near: abs(Motion.psn.x - home.x) <= FAR
invariant Goes: GOES
invariant Apart: forall i: forall j: i == j or apart(Motion.psn@i, Motion.psn@j)
"""

#: What is written in the place of words.
USUAL = {"LAST": "9", "LEG": "1.5", "FAR": "100.0", "GOES": "k >= 0"}


def fleet(count: int, delta: float = 0.1, device: str = "", more: str = "", **words: str) -> Fitted:
    text = THERE
    for word, value in {**USUAL, **words}.items():
        text = text.replace(word, value)
    side = math.ceil(math.sqrt(count))
    places = {k: [6 * (k // side), 3 * (k % side) + 0.0, 1] for k in range(count)}
    lines = f"delta: {delta}\nnum_robots: {count}\npositions: {places}\n"
    lines += "world: {bounds: {low: [-40, -40, 0], high: [140, 140, 3]}}\n"
    lines += f"device: {{bot_type: QUAD, planner: STRAIGHT{device}}}\n{more}"
    source = Source("there.krd", text)
    return fit(FitRequest(source, load(Source("fleet.yaml", lines)), (), {}))


class Counting:
    """What makes strides, and counts the rounds."""

    def __init__(self, run: Simulation) -> None:
        self.made: list[int] = []
        self._inner: Striding | None = None
        self._of = run

    def make(self, until_s: float) -> list[Decision]:
        if self._inner is None:
            self._inner = Strides.of(self._of)
        found = [] if self._inner is None else self._inner.make(until_s)
        if found:
            self.made.append(len(found))
        return found


def run_of(
    fitted: Fitted, *, strides: bool, keep_going: bool = True
) -> tuple[Simulation, Counting]:
    made = simulation(fitted, Simulation, keep_going=keep_going)
    assert isinstance(made.engine, ColumnEngine)
    made.engine.after = 0
    counting = Counting(made)
    made.striding = (lambda _: counting) if strides else None
    made.begin()
    return made, counting


def both(fitted: Fitted, time_s: float, *, keep_going: bool = True) -> tuple[Simulation, int]:
    """Run with strides and without, and compare all that is seen; how many rounds were strides."""
    runs = [run_of(fitted, strides=on, keep_going=keep_going) for on in (False, True)]
    (one, _), (other, counting) = runs
    decisions = [[*run(each, time_s)] for each in (one, other)]
    assert decisions[0] == decisions[1]
    assert one.ending == other.ending
    assert one.figures() == other.figures()
    assert one.looked == other.looked
    assert one.broken == other.broken
    assert one.noticed == other.noticed
    assert one.standing == other.standing
    assert one.time_s == other.time_s
    first, second = one.recording, other.recording
    for name in ("times_s", "separations_m", "rounds", "tasks", "violations", "still", "ending"):
        assert repr(getattr(first, name)) == repr(getattr(second, name)), name
    assert len(first.poses) == len(second.poses)
    assert all(map(np.array_equal, first.poses, second.poses))
    assert repr(first.paths) == repr(second.paths)
    assert isinstance(one.engine, ColumnEngine)
    assert isinstance(other.engine, ColumnEngine)
    assert one.engine.counts == other.engine.counts
    pairs = zip(one.engine.robots, other.engine.robots, strict=True)
    for robot, twin in pairs:
        assert repr(vars(robot)) == repr(vars(twin))
        assert (robot.had_an_event, robot.ran) == (twin.had_an_event, twin.ran)
    check_columns(other.engine)
    states = zip(_states(one), _states(other), strict=True)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in states)
    return other, sum(counting.made)


def _states(made: Simulation) -> Iterator[np.ndarray]:
    watchman = made.watchman
    for squad, _ in made.fleet.squads:
        group, automata = squad.group, squad.group.automata
        yield from (group.s, group.speed, squad.attitude(), *squad.truth(), made.fleet.tilts(ALL))
        yield from (automata.state, automata.since_s, automata.reached, automata.has_route)
        if isinstance(squad, DrivenSquad):
            assert isinstance(squad.vehicles, CompiledWheels)
            cars, law = squad.vehicles, squad.tracker
            model, floor = cars.own_model(), cars.floor
            yield from (model.speed, cars.steering, floor.bodies, np.array([floor.room.left_m]))
            yield from (squad.command, *squad.own(), law.legs.way, law.legs.waited)
            if isinstance(model, Differentials):
                yield model.wheels
            yield np.array([squad.phase])
    yield from (watchman.lingering.at, watchman.lingering.since_s, made.gauge.going.last)
    yield from (made.host.sensed.position, made.host.sensed.short_m, made.host.sensed.state)
    yield np.array([watchman.now_s, watchman.still_s, watchman.sees_some_go])


ALL = np.arange(2)


def of_cars(count: int, kinds: str = "car quad", more: str = "", **words: str) -> Fitted:
    """A fleet of cars and drones in turn, or of what else kinds says."""
    text = THERE
    for word, value in {**USUAL, **words}.items():
        text = text.replace(word, value)
    side, named = math.ceil(math.sqrt(count)), kinds.split()
    lines = ["delta: 0.1", "devices:"]
    lines += ["    car: {bot_type: CAR, planner: RRT_CAR}"]
    lines += ["    shaky: {bot_type: CAR, planner: RRT_CAR, simulation: {noise: {position: 0.01}}}"]
    lines += ["    quick: {bot_type: CAR, planner: RRT_CAR, simulation: {steering: PURSUIT}}"]
    lines += ["    keen: {bot_type: CAR, planner: RRT_CAR, simulation: {visit: {epsilon: 0.004}}}"]
    lines += ["    wide: {bot_type: CAR, planner: RRT_CAR, simulation: {planning: {takes: 0.05}}}"]
    lines += ["    rover: {bot_type: DIFF, planner: STRAIGHT}"]
    lines += ["    calm: {bot_type: QUAD, planner: STRAIGHT, simulation: {visit: {epsilon: 0.1}}}"]
    lines += ["    quad: {bot_type: QUAD, planner: STRAIGHT}", "agents:"]
    for k in range(count):
        kind = named[k % len(named)]
        place = [4 * (k // side), 2.5 * (k % side), int(kind in ("quad", "calm"))]
        lines.append(f"    - {{pid: {k}, on_device: {kind}, position: {place}}}")
    lines.append("world: {bounds: {low: [-4, -4, 0], high: [90, 90, 3]}}")
    source = Source("there.krd", text)
    loaded = load(Source("fleet.yaml", "\n".join(lines) + "\n" + more))
    return fit(FitRequest(source, loaded, (), {}))


@pytest.mark.parametrize(
    ("count", "leg", "least"),
    first(
        1,
        [
            (2, "1.5", 60),
            (7, "(1.5 + 0.2 * pid)", 20),
            (9, "(1.9 - 3.8 * (pid % 2))", 20),  # some come near to each other
            (72, "1.5", 20),
        ],
    ),
)
def test_cars_among_drones_stride_too(count: int, leg: str, least: int) -> None:
    _, strides = both(of_cars(count, LEG=leg), 16.0 if count < 50 else 6.0)
    assert strides >= least


def test_drones_of_several_kinds_stride_with_cars() -> None:
    _, strides = both(of_cars(7, "quad car calm", LEG="(1.5 + 0.1 * pid)"), 12.0)
    assert strides >= 20


def test_cars_without_drones_stride_too() -> None:
    _, strides = both(of_cars(3, "car"), 10.0)
    assert strides >= 20


def test_cars_in_pursuit_stride_too() -> None:
    """Their law acts at each tick, and not at each second."""
    _, strides = both(of_cars(5, "quick quad", LEG="(1.5 + 0.2 * pid)"), 12.0)
    assert strides >= 60


@pytest.mark.parametrize("kinds", ["rover quad", "rover"], ids=["mixed", "alone"])
def test_robots_on_two_wheels_stride_too(kinds: str) -> None:
    """Those turn on the spot first; poses hang on where their wheels are, and on nothing else."""
    made, strides = both(of_cars(5, kinds, LEG="(1.5 + 0.2 * pid)"), 16.0)
    assert strides >= 60
    assert made.figures().robots[0].events > 2


def test_cars_that_may_touch_something_do_not_stride(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cars that drive towards each other: pymunk is not asked, and then it is."""
    looked, suffices = [], Room.suffices

    def noted(room: Room, *given: Any) -> bool:
        looked.append(suffices(room, *given))
        return looked[-1]

    monkeypatch.setattr(Room, "suffices", noted)
    made, strides = both(of_cars(4, more="monitor: {safety: 0.1}\n", LEG="(2 - 2.0 * pid)"), 9.0)
    assert strides > 10
    assert {*looked} == {True, False}
    assert made.fleet.touched(0)


def test_cars_that_miss_their_ways_plan_anew() -> None:
    made, strides = both(of_cars(4, "keen quad"), 16.0)
    assert strides > 10
    given = made.fleet.squads[0][0].group.routes.given.max()
    assert given > 2 + made.figures().robots[0].events


@pytest.mark.parametrize("kinds", ["shaky quad", "car wide quad", "shaky"])
def test_fleets_of_other_kinds_make_rounds_one_by_one(kinds: str) -> None:
    """Cars that are measured by chance, cars of two kinds on one floor."""
    _, strides = both(of_cars(4, kinds), 5.0)
    assert strides == 0


@pytest.mark.parametrize(
    ("count", "delta", "leg", "least"),
    first(
        2,
        [
            (2, 0.1, "1.5", 100),
            (5, 0.2, "1.5", 0),  # poses are recorded within each round
            (70, 0.1, "1.5", 40),
            (70, 0.1, "(1.8 - 3.6 * (pid % 2))", 40),  # others are nearest in turn
            (210, 0.1, "1.5", 4),  # variables are recorded now and then
        ],
    ),
)
def test_runs_are_the_same(count: int, delta: float, leg: str, least: int) -> None:
    _, strides = both(fleet(count, delta, LEG=leg), 20.0 if count < 50 else 8.0)
    assert strides >= least


def test_who_arrives_by_itself_is_seen_at_once() -> None:
    _, strides = both(fleet(3, LEG="(1.5 + 0.4 * pid)"), 25.0)
    assert strides > 20


@pytest.mark.parametrize("count", [1 + 1, 5])
def test_almost_all_rounds_are_parts_of_strides(count: int) -> None:
    """In which robots arrive, and act: all at once, so that nobody goes then, or one by one."""
    leg = "1.5" if count == 2 else "(1.5 + 0.3 * pid)"
    made, strides = both(fleet(count, LEG=leg), 20.0)
    assert sum(bool((one.deeds >= 0).any()) for one in made.recording.rounds) > 5
    assert strides > made.engine.round - 12  # before the first


@pytest.mark.parametrize("keep_going", [False, True])
def test_claims_that_break_as_robots_act_are_seen_at_once(keep_going: bool) -> None:
    made, strides = both(fleet(3, GOES="k != 3"), 12.0, keep_going=keep_going)
    assert made.ending is (Ending.LIMIT if keep_going else Ending.VIOLATED)
    assert made.broken
    assert strides > 10


def test_claims_that_break_as_robots_arrive_are_seen_at_once() -> None:
    at_home = "not Motion.reached or k != 3 or abs(Motion.psn.x - home.x) < 0.7"
    made, strides = both(fleet(4, LEG="(1.5 + 0.3 * pid)", GOES=at_home), 15.0)
    assert {broken.robots for broken in made.broken} == {(k,) for k in range(4)}
    assert strides > 20


def test_claims_that_break_within_are_seen_at_once() -> None:
    made, strides = both(fleet(4, FAR="1.2"), 12.0)
    assert made.broken
    assert strides > 20
    assert all(broken.time_s * 10 % 1 < 1e-6 for broken in made.broken)


def test_separation_that_is_lost_within_is_seen_at_once() -> None:
    made, strides = both(fleet(4, more="monitor: {safety: 2.5}\n", LEG="(1.5 - 2.0 * pid)"), 12.0)
    assert any(broken.claim == "separation" for broken in made.broken)
    assert strides > 10


def test_air_that_blocks_is_seen_at_once() -> None:
    """Robots that do not come forward are blocked for the watchman, and he is in doubt before."""
    wind = ", simulation: {wind: {mean: [-60, 0, 0]}}"
    made, _ = both(fleet(3, device=wind), 12.0)
    assert made.ending is not None


def test_a_run_ends_where_nobody_goes_any_more() -> None:
    made, strides = both(fleet(4, LAST="3"), 60.0)
    assert made.ending is Ending.STILL
    assert strides > 10


def test_ticks_of_an_odd_number_are_made_one_by_one() -> None:
    _, strides = both(fleet(3, 0.05), 6.0)
    assert strides == 0


def test_runs_end_in_time() -> None:
    for time_s in (3.95, 4.0, 4.05, 4.1):
        made, _ = both(fleet(3), time_s)
        assert made.time_s == pytest.approx(math.ceil(time_s * 10 - 1e-6) / 10)


def test_who_ends_a_run_within_a_stride_hears_no_more() -> None:
    made, counting = run_of(fleet(3), strides=True)
    heard = 0
    for _ in run(made, 60.0):
        heard += 1
        if counting.made and counting.made[-1] > 3:
            made.end(Ending.INTERRUPTED)
    assert made.ending is Ending.INTERRUPTED
    assert heard < made.engine.round


@pytest.mark.parametrize("what", ["summaries", "schedule"])
def test_who_listens_hears_each_round(what: str) -> None:
    made = simulation(fleet(3), Simulation, check_summaries=what == "summaries")
    assert isinstance(made.engine, ColumnEngine)
    made.engine.after = 0
    made.begin()
    if what == "schedule":
        made.schedule = type("Other", (type(made.schedule),), {})()
    for _ in range(8):
        made.round()
    assert Strides.of(made) is None
