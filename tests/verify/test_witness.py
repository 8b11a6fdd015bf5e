"""Nothing is shown that is not a run of the program which breaks the claim. [REPLAY]"""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.semantics.domain import EXACT
from koord.semantics.oracle import Phase as Asked
from koord.semantics.recordings import Opening, Recording, Round, execute
from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.system import System, dealt
from koord.syntax.types import FLOAT, INT, ListType
from koord.verify.claims import NO_FAULT, Claim, ClaimPhase, claims_of
from koord.verify.verdicts import NotReplayedError
from koord.verify.witness import replayed, simplified
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    TRUE,
    TRYSTOP,
    Build,
    I,
    bound,
    contract,
    e,
    exists,
    forall,
    length,
    lst,
    ran,
    stopped,
)
from tests.syntax import elaborating
from tests.verify.asking import bounded


def claim_of(system: System, name: str) -> Claim:
    (found,) = [claim for claim in claims_of(system) if claim.name == name]
    return found


def rounds(*events: tuple[int | None, ...], cut: bool = True) -> Recording:
    """A run in which robots move in order; the last round is cut."""
    order = tuple(range(len(events[0])))
    whole = [Round(order, each) for each in events]
    return Recording(Opening(order), (*whole[:-1], replace(whole[-1], cut=cut)))


# --- replay ---------------------------------------------------------------------------------------


def test_a_run_that_breaks_the_claim_is_shown() -> None:
    system = dealt(programs.late_violation(2), 2)
    shown = replayed(
        system, rounds((0, None), (0, None)), claim_of(system, "Small"), ClaimPhase.MIDDLE
    )
    assert (shown.round, shown.phase, shown.robot) == (2, ClaimPhase.INSIDE, 0)
    assert "Small" in shown.detail


@pytest.mark.parametrize(
    ("recording", "why"),
    [
        (rounds((0, None)), "is not broken where the run ends"),
        (rounds((None, None), (0, None)), "is not broken where the run ends"),
    ],
)
def test_a_run_that_does_not_is_not(recording: Recording, why: str) -> None:
    system = dealt(programs.late_violation(2), 2)
    with pytest.raises(NotReplayedError, match=why):
        replayed(system, recording, claim_of(system, "Small"), ClaimPhase.MIDDLE)


def test_a_run_that_the_rules_forbid_is_not_shown() -> None:
    """[SELECT] [ATOMIC]: whatever it would break."""
    system = dealt(programs.sum_of_ids(), 2)
    claim = claim_of(system, "Bounded")
    for recording in (rounds((1, None)), rounds((0, 0)), rounds((0, None), (0, None))):
        with pytest.raises(NotReplayedError, match=r"^\[(SELECT|ATOMIC)\]"):
            replayed(system, recording, claim, ClaimPhase.MIDDLE)


def test_a_fault_is_shown_where_it_is_and_hides_what_it_hides() -> None:
    """[FAULT]"""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Slip", TRUE, x.set(1), x.set(e(1, INT) / (x - 1)))
    b.invariant("Zero", forall(I, x.at(I).eq(0)))
    system = dealt(b.program(), 2)
    recording = rounds((None, 0))
    shown = replayed(system, recording, NO_FAULT, ClaimPhase.MIDDLE)
    assert (shown.robot, shown.detail) == (1, "robot 1: division by zero")
    with pytest.raises(NotReplayedError, match="faults before"):
        replayed(system, recording, claim_of(system, "Zero"), ClaimPhase.MIDDLE)
    with pytest.raises(NotReplayedError, match="no fault happened"):
        replayed(system, rounds((None, None)), NO_FAULT, ClaimPhase.MIDDLE)


def test_what_is_kept_of_a_run_ends_at_its_fault() -> None:
    """[FAULT] [REPLAY]: an engine may say what the others do; a fault has no successors."""
    b = Build()
    n = b.local("n", INT, 0)
    b.event("Slip", TRUE, n.set(e(1, INT) / n))
    system = dealt(b.program(), 3)
    found = rounds((None, None, None), (None, 0, None), cut=False)
    for order, moved in (((0, 1, 2), (0, 1)), ((2, 1, 0), (2, 1))):
        first, last = found.rounds
        recording = replace(found, rounds=(first, replace(last, order=order)))
        shown = replayed(system, recording, NO_FAULT, ClaimPhase.END)
        assert (shown.round, shown.phase, shown.robot) == (2, ClaimPhase.INSIDE, 1)
        assert shown.recording.rounds == (first, Round(moved, (None, 0, None), cut=True))


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2)])
def test_what_is_kept_of_a_run_ends_with_the_turn_that_breaks_the_claim(
    order: tuple[int, ...],
) -> None:
    """[REPLAY]: an engine looks behind the turns of all who run an event."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Up", TRUE, x.set(x + 1))
    b.invariant("Zero", forall(I, x.at(I).eq(0)))
    system = dealt(b.program(), 3)
    found = replace(rounds((0, 0, None)), rounds=(Round(order, (0, 0, None), cut=True),))
    shown = replayed(system, found, claim_of(system, "Zero"), ClaimPhase.MIDDLE)
    assert (shown.robot, shown.phase) == (order[0], ClaimPhase.INSIDE)
    events = tuple(0 if robot == order[0] else None for robot in range(3))
    assert shown.recording.rounds == (Round(order[:1], events, cut=True),)


def test_a_lost_update_needs_two_writes_that_meet_and_an_update() -> None:
    """[LOST-UPDATE]"""
    b = Build()
    x = b.allwrite("x", ListType(INT), lst(INT, 0, 0))
    b.event("Up", TRUE, x[PID].set(x[PID] + 1))
    b.event("Set", TRUE, x[0].set(5))
    system = dealt(b.program(), 2)
    claim = claim_of(system, "no lost update of x")
    assert replayed(system, rounds((0, 1)), claim, ClaimPhase.MIDDLE).round == 1
    for events in ((0, 0), (1, 1), (0, None), (1, 0)):
        with pytest.raises(NotReplayedError, match="not broken"):
            replayed(system, rounds(events), claim, ClaimPhase.MIDDLE)


@pytest.mark.parametrize(
    ("order", "said"),
    [
        ((0, 1), "robot 1 updates what it read before robot 0 wrote"),
        ((1, 0), "robot 0 undoes what robot 1 updated"),
    ],
)
def test_a_lost_update_is_told_with_its_statement(order: tuple[int, int], said: str) -> None:
    """[LOST-UPDATE]: whose update, who wrote too, and where the update stands."""
    b = Build()
    x = b.allwrite("x", INT, 0)
    plain = x.set(x + 1)
    assert isinstance(plain, core.Assign)
    up = replace(plain, span=Span("x.krd", 7, 9, 7, 18))
    b.event("Set", TRUE, x.set(5))
    b.event("Up", TRUE, b.local("y", INT, 0).set(1), up)
    system = dealt(b.program(), 2)
    run = replace(rounds((0, 1)), rounds=(Round(order, (0, 1), (), (), True),))
    shown = replayed(system, run, claim_of(system, "no lost update of x"), ClaimPhase.MIDDLE)
    assert shown.detail == f"robots {order[0]} and {order[1]} write x in one round: {said}"
    assert shown.span == up.span


def test_a_broken_contract_is_the_robots_whose_ports_they_are() -> None:
    """[PROP-CONTRACT]"""
    b = Build()
    heat = b.sensor("heat", INT, PID)
    b.module("Unit", [heat.set(heat + 1)], contracts=[contract("Low", [], [heat.primed < 3])])
    system = dealt(b.program(), 2)
    claim = claim_of(system, "contract Low")
    shown = replayed(system, rounds((None, None), (None, None), cut=False), claim, ClaimPhase.END)
    assert (shown.round, shown.robot) == (2, 1)
    with pytest.raises(NotReplayedError):
        replayed(system, rounds((None, None), cut=False), claim, ClaimPhase.END)


# --- recordings -----------------------------------------------------------------------------------


def test_everything_left_open_is_in_the_recording() -> None:
    """[RECORDING]: starts, readings, choices, answers, and those that a property asks for."""
    b = Build("open")
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("dice", [n], up, ensures=[up >= 1, up <= n], fresh=True)
    x = b.local("x", INT, core.Start.ARBITRARY)
    heat, made = b.sensor("heat", INT, 0, "Free"), b.sensor("made", FLOAT, 0, "Made")
    b.module("Free", contracts=[contract("Some", [], [heat.primed > 3])])
    b.module("Made", [made.set(b.choose(1, 2))])
    b.assume(forall(I, x.at(I) > 40))
    b.event("Go", x > 40, x.set(b.ask("dice", 6)))
    broken = (x.at(0) < 9) & (x.at(1) < 9) & (made.at(0) > 1) & (heat.at(1) > 5)
    b.invariant("Never", ~broken | (b.ask("dice", 2) > 1))
    checked = bounded(b.program(), rounds=2)
    shown = checked.violated["Never"]
    assert shown.round == 1
    assert shown.phase is ClaimPhase.END
    recording = shown.recording
    starts = {(start.home.value, start.robot) for start in recording.opening.starts}
    assert starts == {("local", 0), ("local", 1)}
    (only,) = recording.rounds
    assert {(r.robot, r.slot) for r in only.readings} == {(0, 0), (1, 0)}
    asked = {(a.phase, a.robot, a.function) for a in only.answers}
    assert asked >= {
        (Asked.PROG, 0, "dice"),
        (Asked.PROG, 1, "dice"),
        (Asked.ENV, 0, None),
        (Asked.ENV, 1, None),
        (Asked.CHECK, 0, "dice"),
    }


def test_what_the_order_decides_is_in_the_recording() -> None:
    """[SHARED-ASSIGN]: who wins, in each of several rounds."""
    b = Build()
    x = b.allwrite("x", INT, -1)
    seen = b.local("seen", ListType(INT), lst(INT))
    b.event("Go", TRUE, seen.append(x), x.set(PID), urgent=True)
    for wanted in ((2, 0, 1), (1, 1, 0)):
        met = length(seen.at(1)).eq(4)
        for position, winner in enumerate(wanted):
            met = met & seen.at(1)[position + 1].eq(winner)
        b.properties.clear()
        b.invariant("Never", ~met)
        shown = bounded(b.program(), robots=3, rounds=4).violated["Never"]
        orders = [round_.order[-1] for round_ in shown.recording.rounds[:3]]
        assert orders == list(wanted)


def test_an_order_of_init_is_in_the_recording() -> None:
    """[INIT]"""
    b = Build()
    x = b.allwrite("x", INT, -1)
    b.init(x.set(PID))
    b.invariant("NotOne", x.ne(1))
    shown = bounded(b.program(), robots=3, rounds=0).violated["NotOne"]
    assert shown.recording.opening.order[-1] == 1


def test_a_run_that_ends_inside_a_round_is_cut() -> None:
    """[T-PREFIX]: robots that have not moved are not in its last round."""
    b = Build()
    b.event("Ask", TRUE, TRYSTOP, urgent=True)
    b.invariant("Never", forall(I, stopped(I)) | ~exists(I, ran(0, I)))
    shown = bounded(b.program(), rounds=2).violated["Never"]
    (only,) = shown.recording.rounds
    assert only.cut
    assert len(only.order) == 1


# --- simpler runs ---------------------------------------------------------------------------------


def test_events_that_need_not_be_are_left_out() -> None:
    system = dealt(programs.late_violation(3), 3)
    claim = claim_of(system, "Small")
    everyone = rounds((0, 0, 0), (0, 0, 0), (0, 0, 0))
    simple = simplified(system, everyone, claim)
    assert sum(e is not None for round_ in simple.rounds for e in round_.events) == 3
    assert len(simple.rounds) == 3
    replayed(system, simple, claim, ClaimPhase.MIDDLE)
    assert simplified(system, everyone, claim, tries=0) == everyone
    assert simplified(system, simple, claim) == simple


def test_urgent_events_are_not_left_out() -> None:
    """[SKIP]"""
    b = Build()
    n = b.local("n", INT, 0)
    b.event("Count", TRUE, n.set(n + 1), urgent=True)
    b.invariant("Small", forall(I, n.at(I) < 2))
    system = dealt(b.program(), 2)
    simple = simplified(system, rounds((0, 0), (0, 0)), claim_of(system, "Small"))
    # Of the last round a part would do, but its order names both.
    assert simple.rounds[0].events == (0, 0)


def test_every_step_of_what_is_shown_is_legal() -> None:
    for program in (*programs.RUNNING, programs.late_violation(2)):
        checked = bounded(program, robots=3, rounds=2)
        for name, shown in checked.violated.items():
            steps = list(execute(EXACT, checked.system, shown.recording))
            assert steps, (program.name, name)
            claim = claim_of(checked.system, name)
            simple = simplified(checked.system, shown.recording, claim)
            assert len(simple.rounds) == shown.round
            replayed(checked.system, simple, claim, shown.phase)


@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("x >= 0", "read of an unset value"),
        ("forall i: forall j: i != j implies x@i < 3", "read of an unset value"),
        ("exists i: x@i > 0", "read of an unset value"),
        ("n / n > 1", "division by zero"),
        ("n > 0", None),
    ],
)
def test_a_statement_that_is_false_for_a_fault_says_so(statement: str, kind: str | None) -> None:
    """[PROP-FAULT]"""
    text = (
        f"local:\n  int x\n  int n = 0\nGo:\n  pre: n < 0\n  eff: x = n\ninvariant A: {statement}\n"
    )
    system = dealt(elaborating.program(text), 2)
    start = Recording(Opening((0, 1)), ())
    found = replayed(system, start, claim_of(system, "A"), ClaimPhase.INIT)
    if kind is None:
        assert found.fault is None
        assert "evaluated" not in found.detail
    else:
        assert found.fault is not None
        assert found.fault.kind.value == kind
        assert f"since it cannot be evaluated: {kind}" in found.detail
        assert str(found.fault.span) in found.detail
