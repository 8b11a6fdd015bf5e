"""Programs in several processes: the same runs, also if processes are late, fail or are killed."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import closing
from functools import partial
from multiprocessing import get_context
from typing import Any

import pytest

pytest.importorskip("llvmlite")

from koord.api.fitting import FitRequest, Fitted, fit
from koord.api.sim_setup import simulation
from koord.runtime.configuration.checking import load
from koord.runtime.robot import Robot
from koord.sim.groups import GroupedSimulation
from koord.sim.running import Ending, Simulation, run
from koord.syntax.source import Source
from tests.sampling import first
from tests.sim.test_kernels import shuttles

#: Each robot counts its rounds, and all together count them, one at a time.
COUNTING = """\
using Motion
local:
    int n = 0
allwrite:
    int total = 0
Count:
    pre: n < 100
    eff:
        n = n + 1
        atomic:
            total = total + 1
"""


class Clock:
    """A clock that stands unless it is put forward."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def counting(program: str = COUNTING) -> Fitted:
    lines = "num_robots: 4\npositions: {0: [0, 0, 1], 1: [2, 0, 1], 2: [4, 0, 1], 3: [6, 0, 1]}\n"
    lines += "device: {bot_type: IDEAL}\nworld: {bounds: {low: [-4, -4, 0], high: [9, 9, 3]}}\n"
    source = Source("counting.krd", program)
    return fit(FitRequest(source, load(Source("fleet.yaml", lines)), (), {}))


def grouped(fitted: Fitted, processes: int = 3, **more: Any) -> GroupedSimulation:
    kind = partial(GroupedSimulation, processes=processes, **more)
    return simulation(fitted, kind, keep_going=True)


@pytest.fixture
def elsewhere() -> Callable[[], bool]:
    """Whether this process is another one than that of the test."""
    first = os.getpid()
    return lambda: os.getpid() != first


@pytest.mark.parametrize("after", first(2, [0, 40, None]))
@pytest.mark.parametrize("processes", [2, 3])
def test_a_fleet_makes_the_same_run(after: int | None, processes: int) -> None:
    """By machine code from the first round on, from a later one on, and not at all."""
    fitted = shuttles(9, "QUAD")
    one = simulation(fitted, Simulation, keep_going=True, kernels=False)
    one.begin()
    expected = list(run(one, 12.0))
    with closing(grouped(fitted, processes)) as several:
        several.parted.after = 10**9 if after is None else after
        several.begin()
        assert len(several.groups) == processes
        assert sorted(pid for group in several.groups for pid in group) == list(range(9))
        for decision, same in zip(run(several, 12.0), expected, strict=True):
            assert set(decision.ran) == set(same.ran)
            assert set(decision.writes) == set(same.writes)
    assert several.figures().digest == one.figures().digest
    assert [vars(r) for r in several.parted.robots] == [vars(r) for r in one.engine.robots]
    assert several.looked == one.looked
    assert several.parted.counts.by_code == 0 if after is None else several.parted.counts.by_code
    assert not any(process.is_alive() for process in several.processes)


def test_columns_know_what_robots_did_elsewhere_without_machine_code() -> None:
    """Of claims code is asked, of which the first process has columns alone."""
    chosen = COUNTING.replace("        n = n + 1", "        stdout << n\n        n = n + 1")
    chosen += "invariant Counted: n <= total\ninvariant Few: n <= 3\n"
    with closing(grouped(counting(chosen))) as made:
        made.parted.after = 0
        made.begin()
        list(run(made, 2.0))
        few = [one for one in made.broken if one.claim.endswith("Few")]
        assert {pid for one in few for pid in one.robots} == {0, 1, 2, 3}
        assert not [one for one in made.broken if one.claim.endswith("Counted")]
        assert made.parted.fleet is not None


def test_who_is_late_skips_and_is_heard_again(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Callable[[], bool]
) -> None:
    real, clock, go = Robot.propose, Clock(), get_context("fork").Event()

    def hesitates(self: Robot, round_: int, *given: Any, **more: Any) -> Any:
        if elsewhere() and self.pid == 3 and round_ == 5:
            go.wait()
        return real(self, round_, *given, **more)

    monkeypatch.setattr(Robot, "propose", hesitates)
    fitted = counting(COUNTING.replace("atomic:", "if true:"))
    made = grouped(fitted, 2, patience_s=600.0, clock=clock)
    with closing(made):
        made.begin()
        assert made.groups == ((0, 1), (2, 3))
        ran = []
        for number in range(9):
            if number in (5, 6):
                clock.now_s += 1_000.0
            if number == 7:
                go.set()
            ran.append({taken.robot for taken in made.round().ran})
        assert ran == [{0, 1} if number in (5, 6) else {0, 1, 2, 3} for number in range(9)]
        assert made.late == 2
        assert [vars(robot)["n"] for robot in made.parted.robots] == [9, 9, 7, 7]
        assert made.parted.store.values["total"] == 9


def test_robots_with_urgent_events_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Callable[[], bool]
) -> None:
    """However late it is, by any clock."""
    clock, real = Clock(), Robot.propose

    def hesitates(self: Robot, round_: int, *given: Any, **more: Any) -> Any:
        if elsewhere():
            os.sched_yield()
        return real(self, round_, *given, **more)

    monkeypatch.setattr(Robot, "propose", hesitates)
    urgent = COUNTING.replace("Count:\n", "urgent Count:\n")
    with closing(grouped(counting(urgent), patience_s=0.0, clock=clock)) as made:
        made.begin()
        for _ in range(20):
            clock.now_s += 1_000.0
            made.round()
        assert made.late == 0
        assert made.parted.store.values["total"] == 20


def test_what_programs_raise_elsewhere_is_raised(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Callable[[], bool]
) -> None:
    real = Robot.propose

    def fails(self: Robot, round_: int, *given: Any, **more: Any) -> Any:
        if elsewhere() and round_ == 3:
            raise LookupError(f"robot {self.pid}")
        return real(self, round_, *given, **more)

    monkeypatch.setattr(Robot, "propose", fails)
    with closing(grouped(counting())) as made:
        made.begin()
        with pytest.raises(LookupError, match="robot 1"):
            list(run(made, 10.0))
    assert not any(process.is_alive() for process in made.processes)


def test_a_killed_process_ends_the_run() -> None:
    with closing(grouped(counting())) as made:
        made.begin()
        made.round()
        victim = made.processes[1].pid
        assert victim is not None
        os.kill(victim, signal.SIGKILL)
        made.processes[1].join()
        list(run(made, 10.0))
        assert made.ending is Ending.SILENT
        assert made.died == (2, 3)
        # What it had proposed by then may have come about.
        assert made.parted.round in (1, 2)


def test_one_robot_is_alone() -> None:
    fitted = fit(
        FitRequest(
            Source("counting.krd", COUNTING),
            load(Source("one.yaml", "num_robots: 1\ndevice: {bot_type: IDEAL}\n")),
            (),
            {},
        )
    )
    with closing(grouped(fitted)) as made:
        made.begin()
        assert (made.groups, made.processes) == ((), ())
        list(run(made, 1.0))
        assert made.parted.store.values["total"] == 10
