"""Why a lasso is fair: what is said of it is so, by the plain search's own account. [LASSO]"""

from __future__ import annotations

from functools import partial
from random import Random

import pytest

from koord.refinement.generating.programs import system as generated
from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.liveness import expected
from koord.semantics.oracle import NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import Recording, execute
from koord.semantics.turns import guard_of
from koord.syntax.system import Status, System
from koord.traces.fairness import EventStatus, Excuses, excuses, told
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import Limits
from tests.agreement.test_lassos import LIVELY, searched, with_liveness
from tests.semantics.endless import GATE, QUITTING, SERVED, system
from tests.semantics.plain_search import every_outcome


def explained(of: System, recording: Recording) -> tuple[Excuses, list[Configuration[Constant]]]:
    steps = execute(EXACT, of, recording)
    ends = [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]
    return excuses(of, recording, ends), ends


def assert_true(of: System, recording: Recording) -> Excuses:
    """All that is said is recomputed turn by turn, and together it is what fairness wants."""
    found, ends = explained(of, recording)
    assert recording.loop is not None
    rounds = range(recording.loop + 1, len(recording.rounds) + 1)
    assert found.rounds == tuple(rounds)
    for robot in found.robots:
        i, events = robot.robot, of.agent(robot.robot).events
        does = {n: recording.rounds[n - 1].events[i] for n in rounds}
        may, can = {}, {}
        for n in rounds:
            c = ends[n - 1]
            said = []
            if c.robots[i].status != Status.STOPPED:
                for event in events:
                    asking = partial(guard_of, EXACT, of, i, c.robots[i], event)
                    said.append(list(every_outcome(asking)))
            may[n] = [any(h is True or s is not True for h, s in each) for each in said]
            can[n] = any(all(h is True for h, _ in each) for each in said)
        assert robot.runs == tuple(n for n in rounds if does[n] is not None)
        assert robot.idle == tuple(n for n in rounds if not can[n])
        assert robot.skips == tuple(n for n in rounds if can[n] and does[n] is None)
        assert robot.runs or robot.idle  # [FAIR-ROBOT]
        for position, shown in enumerate(robot.events):
            assert shown.enabled == tuple(n for n in rounds if may[n] and may[n][position])
            assert shown.ran == tuple(n for n in rounds if does[n] == position)
            always = len(shown.enabled) == len(rounds)
            assert shown.standing is (
                EventStatus.RUNS
                if shown.ran
                else EventStatus.ALWAYS
                if always
                else EventStatus.AT_TIMES
                if shown.enabled
                else EventStatus.NEVER
            )
        for lock in robot.locks:
            of_class = {
                p
                for p, event in enumerate(events)
                if any(
                    of.program.lock_classes[k].variables == lock.variables
                    for k in event.lock_classes
                )
            }
            asks = (
                n
                for n in rounds
                if can[n] and {p for p, open_ in enumerate(may[n]) if open_} <= of_class
            )
            assert lock.asks == tuple(asks)
            assert lock.granted == tuple(n for n in rounds if does[n] in of_class)
            assert lock.granted or not lock.asks  # [FAIR-LOCK]
    for expectation, response in zip(found.expectations, expected(of), strict=True):
        met = []
        for n in rounds:
            goal = response.goal
            holds, _ = holds_in(EXACT, of, ends[n], goal.condition, goal.bound, NoInputs())
            met += [n] if holds is True else []
        assert (expectation.name, expectation.robot, expectation.met) == (
            response.name,
            response.robot,
            tuple(met),
        )
    assert all(told(found))
    return found


def lassos(seeds: range) -> int:
    count = 0
    for seed in seeds:
        random = Random(seed)
        of = with_liveness(generated(random, LIVELY), random)
        found = searched(of)
        for recording in found.violated.values() if found is not None else ():
            assert_true(of, recording)
            count += 1
    return count


def test_what_is_said_of_lassos_of_generated_programs_is_so() -> None:
    assert lassos(range(25)) > 15


@pytest.mark.slow
def test_what_is_said_of_lassos_of_many_generated_programs_is_so() -> None:
    assert lassos(range(30_000, 30_400)) > 200


def only(text: str, name: str, robots: int = 2) -> tuple[System, Excuses]:
    of = system(text, robots)
    found = lively(of, of.program.properties, Limits(states=500))
    return of, assert_true(of, found.violated[name])


def test_who_asks_for_a_lock_has_it_at_times() -> None:
    """Two robots go in and out by turns, and the third place that is waited for there is not."""
    _, found = only(GATE + SERVED + "    eventually Third: holder == 2\n", "Third")
    assert all(lock.granted for robot in found.robots for lock in robot.locks)
    assert any("asks for the lock of holder" in line for line in told(found))


def test_who_has_stopped_never_runs_and_may() -> None:
    _, found = only(QUITTING, "Done")
    assert any(not robot.runs and robot.idle for robot in found.robots)
    assert any("never runs: it can run nothing in" in line for line in told(found))
