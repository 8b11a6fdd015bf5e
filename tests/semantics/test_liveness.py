"""Runs without end: what each kind of fairness rules out, and what a lasso must show. [LIVE-RUN]
[FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME] [PROP-EVENTUALLY] [PROP-LEADS-TO] [LASSO]
"""

from __future__ import annotations

from textwrap import dedent

import pytest
from msgspec.structs import replace

from koord.semantics.domain import EXACT
from koord.semantics.liveness import responses
from koord.semantics.recordings import Opening, Recording, Round, execute
from koord.syntax import core
from koord.syntax.source import Source
from koord.syntax.system import System
from koord.traces.codec import decode, encode
from koord.traces.lassos import Flaw, broken_by, flaw_of
from koord.traces.replay import replay
from koord.traces.trace import Numbers, Sources, Trace, Violation, ViolationKind, traced
from koord.verify.engines.explicit.fair_answers import FairCycleReport, Fairness
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted
from tests.semantics.endless import GATE, PASSING, QUITTING, SERVED, TWO, system


def asked(of: System) -> FairCycleReport:
    found = lively(of, of.program.properties)
    assert isinstance(found.end, Exhausted)
    return found


def flaw(of: System, recording: Recording, stated: core.Property | None = None) -> Flaw | None:
    steps = execute(EXACT, of, recording)
    ends = [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]
    return flaw_of(of, recording, ends, stated)


ONCE = """
    local:
      bool done = false
    Do:
      pre: not done
      eff: done = true
"""

SENSOR = """
    using Road:
      sensors:
        bool reached
    local:
      bool away = false
    Go:
      pre: not away
      eff: away = true
    Return:
      pre: away and Road.reached
      eff: away = false
"""


def test_no_robot_is_passed_over_for_ever() -> None:
    of = system(ONCE + "    eventually AllDone: done\n", 3)
    assert asked(of).needs == {"AllDone": Fairness(robots=True)}


def test_a_robot_may_do_the_same_thing_for_ever() -> None:
    of = system(ONCE + "    Idle:\n      eff: pass\n    eventually AllDone: done\n", 1)
    lasso = asked(of).violated["AllDone"]
    assert [round_.events for round_ in lasso.rounds] == [(1,)]
    assert lasso.loop == 0


def test_who_stands_in_line_gets_in_if_locks_are_fair() -> None:
    of = system(GATE + SERVED)
    assert asked(of).needs == {"Served": Fairness(locks=True)}


def test_who_has_something_else_to_do_does_not_stand_in_line() -> None:
    text = GATE + "    Idle:\n      eff: pass\n" + SERVED
    lasso = asked(system(text)).violated["Served"]
    assert lasso.loop is not None
    assert all(2 in round_.events for round_ in lasso.rounds[lasso.loop :])


def test_the_environment_is_no_friend() -> None:
    of = system(SENSOR + "    eventually Back: away leadsto not away\n", 1)
    assert list(asked(of).violated) == ["Back"]


def test_who_is_expected_to_arrive_does() -> None:
    text = SENSOR + "    eventually Back: away leadsto not away\n"
    of = system(text + "    assume Arrives: away leadsto Road.reached\n")
    found = asked(of)
    assert found.violated.keys() == {"Back"}, "it may be there, and gone again when it looks"
    of = system(text + "    assume Stays: away leadsto ran(Return)\n")
    assert asked(of).needs == {"Back": Fairness(expectations=("Stays",))}


def test_expectations_of_what_cannot_be_leave_no_run() -> None:
    of = system(ONCE + "    eventually: done\n    assume Never: true leadsto done and not done\n")
    assert asked(of).is_empty
    assert not asked(system(ONCE + "    eventually: done\n")).is_empty


def test_what_was_begun_once_is_owed_until_it_comes() -> None:
    text = """
        using Road:
          sensors:
            bool reached
        local:
          bool gone = false
        Go:
          pre: not gone
          eff: gone = true
        eventually There: exists i: Road.reached@i
        """
    assert asked(system(text, 1)).violated.keys() == {"There"}
    of = system(text + "assume Arrives: ran(Go) leadsto Road.reached\n", 1)
    assert asked(of).needs == {"There": Fairness(robots=True, expectations=("Arrives",))}


def test_what_is_owed_may_be_paid_rounds_later() -> None:
    text = """
        local:
          int n = 0
        First:
          pre: n == 0
          eff: n = 1
        Second:
          pre: n == 1
          eff: n = 2
        assume Paid: ran(First) leadsto n == 2
        eventually Never: n == 3
        """
    found = asked(system(text, 1))
    assert found.violated.keys() == {"Never"}
    assert not found.is_empty


def test_what_is_urgent_needs_no_fairness() -> None:
    text = """
        local:
          int n = 0
        urgent Step:
          pre: n < 3
          eff: n = n + 1
        eventually Three: n == 3
        """
    assert asked(system(text)).needs == {"Three": Fairness()}


def test_robots_take_turns_where_all_rounds_lead_to_the_same() -> None:
    """Either robot may have the lock, and nothing changes: a fair run lets both have it."""
    text = """
        allwrite:
          int x = 0
        Tick:
          eff:
            atomic: x = 0
        eventually Never: x == 1
        """
    lasso = asked(system(text)).violated["Never"]
    assert {round_.events for round_ in lasso.rounds} == {(0, None), (None, 0)}


def test_who_stops_asking_need_not_be_granted() -> None:
    """The door may open and close for ever, and then who waits gets in; or it stays closed."""
    text = """
        allwrite:
          bool open = true
        local:
          bool inside = false
        Toggle:
          pre: pid == 0
          eff: open = not open
        Idle:
          pre: pid == 0
          eff: pass
        Enter:
          pre: pid == 1 and open and not inside
          eff:
            atomic: inside = true
        eventually In: exists i: inside@i
        """
    lasso = asked(system(text)).violated["In"]
    assert lasso.loop is not None
    assert all(round_.events == (1, None) for round_ in lasso.rounds[lasso.loop :])


def test_a_stopped_robot_is_not_passed_over() -> None:
    lasso = asked(system(QUITTING, 1)).violated["Done"]
    assert [round_.events for round_ in lasso.rounds] == [(0,), (None,)]
    assert lasso.loop == 1


def test_leads_to_is_of_one_robot_or_of_all() -> None:
    some = "    eventually Some: (exists i: n@i == 1) leadsto exists i: n@i == 2\n"
    of = system(TWO + some)
    found = asked(of)
    assert found.violated.keys() == {"Each"}
    assert found.needs["Some"] == Fairness(robots=True)
    stated = of.program.properties[0]
    assert [r.robot for r in responses(of, stated)] == [0, 1]
    steps = execute(EXACT, of, found.violated["Each"])
    ends = [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]
    broken = broken_by(of, found.violated["Each"], ends, stated)
    assert broken is not None
    assert broken[0].robot == 0


def test_eventually_is_of_each_robot_by_itself_or_of_all_at_once() -> None:
    of = system(PASSING + "    eventually Each: n == 2\n    eventually All: forall i: n@i == 2\n")
    each, together = of.program.properties
    assert [r.robot for r in responses(of, each)] == [0, 1]
    assert [r.robot for r in responses(of, together)] == [None]
    found = asked(of)
    assert found.violated.keys() == {"All"}
    assert found.needs["Each"] == Fairness(robots=True)


def test_only_ends_of_rounds_are_asked() -> None:
    """Robot 0 writes 1, robot 1 writes 2; that the first write is seen in between is not enough."""
    text = """
        allwrite:
          int x = 0
        urgent Write:
          eff: x = 1 + pid
        eventually One: x == 1
        """
    of = system(text)
    lasso = asked(of).violated["One"]
    assert all(round_.order[-1] == 1 for round_ in lasso.rounds)


def test_what_faults_is_no_run_without_end() -> None:
    text = ONCE + "    Break:\n      pre: not done\n      eff: done = 1 / 0 > 0\n"
    assert asked(system(text + "    eventually AllDone: done\n")).violated == {}


def test_a_search_that_stops_early_proves_nothing() -> None:
    of = system(ONCE + "    eventually AllDone: done\n    eventually Never: not true\n", 3)
    found = lively(of, of.program.properties, Limits(states=2), compiled_from=None)
    assert not isinstance(found.end, Exhausted)
    assert not found.needs
    found = lively(of, of.program.properties, Limits(rounds=1))
    assert not found.needs


def test_what_is_not_finite_is_said() -> None:
    text = """
        allwrite:
          float x
        assume: x > 0
        eventually: x > 1
        """
    of = system(text)
    assert isinstance(lively(of, of.program.properties).end, NotFinite)


# --- lassos that are none -------------------------------------------------------------------------


def lasso_of(of: System) -> tuple[Recording, core.Property]:
    ((name, recording),) = asked(of).violated.items()
    return recording, next(p for p in of.program.properties if p.name == name)


def idle(of: System, rounds: int, loop: int) -> Recording:
    """A run in which nobody ever does anything."""
    robots = range(of.robots)
    round_ = Round(tuple(robots), (None,) * of.robots)
    opening = Opening(tuple(robots))
    return Recording(opening, (round_,) * rounds, loop)


def test_skipping_for_ever_is_not_fair() -> None:
    of = system(ONCE + "    eventually AllDone: done\n")
    found = flaw(of, idle(of, 1, 0), of.program.properties[0])
    assert found is not None
    assert found.rule == "FAIR-ROBOT"
    assert "robot 0" in found.reason


def test_a_lasso_has_to_close() -> None:
    of = system(ONCE + "    eventually Never: not true\n")
    recording, stated = lasso_of(of)
    assert flaw(of, recording, stated) is None
    assert recording.loop is not None
    longer = replace(recording, loop=0)
    found = flaw(of, longer, stated)
    assert found is not None
    assert found.rule == "LASSO"
    assert "done" in found.reason


def test_a_lasso_has_to_break_what_it_says() -> None:
    of = system(ONCE + "    eventually Never: not true\n    eventually AllDone: done\n")
    recording = asked(of).violated["Never"]
    found = flaw(of, recording, of.program.properties[1])
    assert found is not None
    assert found.rule == "PROP-EVENTUALLY"


def test_asking_in_vain_is_not_fair() -> None:
    of = system(GATE + SERVED)
    enter = Round((0, 1), (0, None))
    leave = Round((0, 1), (1, None))
    recording = Recording(idle(of, 1, 0).opening, (enter, leave), 0)
    found = flaw(of, recording, of.program.properties[0])
    assert found is not None
    assert found.rule == "FAIR-LOCK"
    assert "robot 1" in found.reason
    assert "holder" in found.reason


def test_a_lasso_does_what_is_expected() -> None:
    text = ONCE + "    eventually Never: not true\n"
    recording, stated = lasso_of(system(text))
    of = system(text + "    assume Undo: done leadsto not done\n")
    found = flaw(of, recording, of.program.properties[0])
    assert found is not None
    assert found.rule == "FAIR-ASSUME"
    assert "Undo" in found.reason
    del stated


# --- traces ---------------------------------------------------------------------------------------


def trace_of(text: str, robots: int = 2) -> Trace:
    of = system(text, robots)
    recording, stated = lasso_of(of)
    sources = Sources(Source("live.krd", dedent(text)))
    violation = Violation(ViolationKind.PROPERTY, stated.name, len(recording.rounds) - 1, None)
    return traced(sources, of, Numbers.EXACT, recording, violation)


def test_traces_with_loops_come_back_and_replay() -> None:
    trace = trace_of(GATE + "    eventually Never: holder == 7\n")
    raw = encode(trace)
    assert b'"version": 2' in raw
    back = decode(raw, "trace.json")
    assert back.recording == trace.recording
    assert back.recording.loop is not None
    assert replay(back).refused is None


@pytest.mark.parametrize(
    ("wrong", "rule"),
    [
        (lambda trace: replace(trace, recording=replace(trace.recording, loop=0)), "LASSO"),
        (
            lambda trace: replace(
                trace, violation=Violation(ViolationKind.PROPERTY, "Other", 0, None)
            ),
            "LASSO",
        ),
        (lambda trace: replace(trace, recording=replace(trace.recording, loop=None)), "LASSO"),
    ],
)
def test_replay_refuses_loops_that_are_none(wrong: object, rule: str) -> None:
    assert callable(wrong)
    trace = trace_of(ONCE + "    eventually Never: not true\n")
    assert replay(trace).refused is None
    refused = replay(wrong(trace)).refused
    assert refused is not None
    assert refused.rule == rule
