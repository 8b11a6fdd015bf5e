"""Liveness on circuits: what settles, what is counted, which fairness a proof needs. [T-COUNT]
[FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME]
"""

from __future__ import annotations

import pytest

from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bits.circuit import Latch
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.liveness_to_safety import settling
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.liveness import LivenessVerdicts, settled
from koord.verify.strategy.table import LIVENESS
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.semantics.endless import GATE, PASSING, QUITTING, SERVED, TWO, system

ENDS_IN_A_FAULT = """
    local:
      int n = 2
    Down:
      pre: n >= 0
      eff: n = n - n / n
    eventually Done: n < 0
"""


def asked(text: str, robots: int = 2, rounds: int = 8) -> LivenessVerdicts:
    rows = LIVENESS[Engine.BITS]
    return settled(Slices(system(text, robots)), Bounds(rounds), rows, Deadline.after(None))


def only(text: str, robots: int = 2, rounds: int = 8) -> Verdict:
    (verdict,) = asked(text, robots, rounds).verdicts
    return verdict


COUNTER = """
    local:
      int n = 0
    Step:
      pre: n < 5
      eff: n = n + 1
    eventually Five: n == 5
"""

#: Whoever looks for a path may never find one; and where a robot drives, it may never arrive.
DRIVING = """
    def fun isFree(pos[][] routes, pos[] path, int me) -> bool:
      bool free = true
      for j = 0, length(routes):
        if j != me and not pathsClear(routes[j], path):
          free = false
      return free
    using Motion
    local:
      bool busy = false
    allread:
      pos[][] route
    allwrite:
      int left = 2
    init:
      route[pid] = [Motion.psn]
    Take:
      pre: not busy
      eff:
        atomic:
          if left > 0 and isFree(route, [Motion.psn], pid):
            left = left - 1
            busy = true
            route[pid] = [Motion.psn]
    Bring:
      pre: busy and Motion.reached
      eff: busy = false
    eventually Empty: left == 0 and not (exists i: busy@i)
"""

#: The same by the library's function, which compares the path with one of no points.
BY_LIBRARY = DRIVING.replace("isFree(route,", "pathIsClear(route,")


def test_what_settles_does_so_one_after_the_other() -> None:
    """A token is taken once; who has it may let go; what goes on for ever never settles."""
    g = Graph()
    taken, held, ticking = (g.input(name) for name in ("taken", "held", "ticking"))
    take, drop = g.input("take"), g.input("drop")
    taking = g.both(take, taken ^ 1)
    latches = [
        Latch("held", held, 0, g.either(taking, g.both(held, drop ^ 1))),
        Latch("ticking", ticking, 0, ticking ^ 1),
        Latch("taken", taken, 0, g.either(taken, take)),
    ]
    assert [latch.name for latch in settling(g, latches, [])] == ["taken", "held"]


def test_counting_needs_robots_that_run() -> None:
    verdict = only(COUNTER, 3)
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.fairness == ("robots",)


def test_who_stands_in_line_needs_fair_locks() -> None:
    verdict = only(GATE + SERVED)
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.fairness == ("locks",)


def test_another_thing_to_do_is_another_way_to_wait_for_ever() -> None:
    verdict = only(GATE + SERVED + "    Idle:\n      eff: pass\n")
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.recording.loop is not None


def test_opaque_values_do_not_matter_where_they_are_not_looked_at() -> None:
    expected = """
    assume Arrives: busy leadsto ran(Bring)
    assume Finds: ran(Take) leadsto busy or left == 0
    """
    verdict = only(DRIVING + expected)
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.fairness == ("robots", "Arrives", "Finds")


@pytest.mark.parametrize("driving", [DRIVING, BY_LIBRARY])
@pytest.mark.parametrize(
    "expected",
    [
        "assume Arrives: busy leadsto ran(Bring)",
        "assume Finds: ran(Take) leadsto busy or left == 0",
    ],
)
def test_without_what_is_expected_nobody_need_arrive(driving: str, expected: str) -> None:
    """The run goes on with new positions for ever; a loop calls them what they were before."""
    verdict = only(f"{driving}\n    {expected}\n", rounds=4)
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.recording.loop is not None


def test_a_stopped_robot_is_not_passed_over() -> None:
    assert only(QUITTING, 1).outcome is Outcome.VIOLATED


def test_each_robot_by_itself() -> None:
    verdict = only(TWO)
    assert verdict.outcome is Outcome.VIOLATED
    assert verdict.counterexample is not None
    assert verdict.counterexample.robot == 0
    assert "robot 0" in verdict.counterexample.detail


def test_sooner_or_later_is_of_each_robot_by_itself() -> None:
    assert only(PASSING + "    eventually Each: n == 2\n").outcome is Outcome.HOLDS
    verdict = only(PASSING + "    eventually Each: n == 3\n")
    assert verdict.counterexample is not None
    assert verdict.counterexample.detail == "what Each waits for never comes true of robot 0"


def test_that_no_run_is_fair_is_told() -> None:
    said = asked(COUNTER + "    assume Odd: true leadsto n == 6\n")
    assert [vacuity.certain for vacuity in said.vacuities] == [True]
    assert not asked(COUNTER + "    assume Even: true leadsto n == 5\n").vacuities


def test_that_all_fair_runs_end_in_faults_is_told() -> None:
    of = system(ENDS_IN_A_FAULT)
    rows = LIVENESS[Engine.SEARCH]
    (empty,) = settled(Slices(of), Bounds(8), rows, Deadline.after(None)).vacuities
    assert "each ends in a fault" in empty.detail


def test_a_statement_that_asks_is_left_to_others() -> None:
    text = """
        def fun odd(int n) -> bool: extern
        local:
          int n = 0
        Step:
          pre: n < 5
          eff: n = n + 1
        eventually Odd: odd(n)
        """
    verdict = only(text)
    assert verdict.outcome is Outcome.UNKNOWN
    assert "external function" in verdict.reason


def test_time_may_run_out() -> None:
    said = settled(
        Slices(system(GATE + SERVED)), Bounds(8), LIVENESS[Engine.BITS], Deadline.after(0.0)
    )
    (verdict,) = said.verdicts
    assert verdict.outcome is Outcome.UNKNOWN
    assert "timeout" in verdict.reason
