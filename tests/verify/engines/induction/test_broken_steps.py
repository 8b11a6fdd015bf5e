"""Counterexamples to induction are steps of the semantics, from where all claims hold."""

from __future__ import annotations

from importlib import import_module
from itertools import permutations

import pytest

from koord.semantics.configurations import NO_EVENT, Configuration, Turn
from koord.semantics.domain import EXACT, Constant
from koord.semantics.recordings import RecordedInputs
from koord.semantics.rounds import IllegalStepError, evolved, run_event, run_skip
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import INT
from koord.verify.claims import Claim, ClaimPhase, StepFindings, broken, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.induction.proving import prove
from koord.verify.verdicts import BrokenStep, Outcome
from tests.semantics import programs
from tests.semantics.building import PID, TRUE, Build, I, J, forall
from tests.verify.asking import SECONDS, ask

NO_INPUTS = RecordedInputs()


def racing() -> core.Program:
    """Each takes the next number; nothing says that numbers so far are below it."""
    b = Build("racing")
    total, done, mine = b.allwrite("total", INT, 0), b.allread("done", INT, 0), b.local("mine", INT)
    b.event(
        "Take",
        done[PID].eq(0),
        b.atomic(total.set(total + 1), mine.set(total), done[PID].set(1)),
    )
    distinct = (I.ne(J) & done[I].eq(1) & done[J].eq(1)) >> mine.at(I).ne(mine.at(J))
    b.invariant("Distinct", forall(I, forall(J, distinct)))
    return b.program()


def overwriting() -> core.Program:
    """Whoever comes last wins, which an order of robots must explain."""
    b = Build("overwriting")
    x, y = b.allwrite("x", INT, 0), b.local("y", INT, 0)
    b.event("Set", y < 3, x.set(PID), y.set(y + 1))
    b.invariant("Odd", x.ne(1))
    return b.program()


def stale() -> core.Program:
    b = Build("stale")
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Go", TRUE, y.set(y + x), x.set(x + 1))
    b.invariant("Low", forall(I, y.at(I) < 7))
    return b.program()


def step_of(system: System, name: str, depth: int) -> BrokenStep:
    claims = [claim for claim in claims_of(system) if claim.stated is not None]
    result = prove(system, claims, (), Deadline.after(SECONDS), depth=depth)
    (found,) = [step for claim, step in result.steps.items() if claim.name == name]
    return found


def breaks(system: System, claim: Claim, configuration: Configuration[Constant]) -> bool:
    findings: StepFindings[Constant] = StepFindings(False)
    violated, _ = broken(EXACT, system, claim, configuration, findings, NO_INPUTS)
    return violated is True


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize(
    ("program", "name"),
    [(racing(), "Distinct"), (overwriting(), "Odd"), (stale(), "Low")],
    ids=lambda x: x.name if isinstance(x, core.Program) else x,
)
def test_the_claims_hold_before_and_one_breaks_at_the_end(
    program: core.Program, name: str, depth: int
) -> None:
    system = dealt(program, 2)
    step = step_of(system, name, depth)
    assert len(step.configurations) == depth + 1 == len(step.events) + 1
    stated = [claim for claim in claims_of(system) if claim.stated is not None]
    for configuration in step.configurations[:-1]:
        assert not any(breaks(system, claim, configuration) for claim in stated)
    assert any(breaks(system, c, step.configurations[-1]) for c in stated if c.name == name)


def test_what_the_solver_answers_at_once_is_not_split(monkeypatch: pytest.MonkeyPatch) -> None:
    def split(*given: object) -> None:
        pytest.fail("nobody asks for cases")

    monkeypatch.setattr(import_module(prove.__module__), "cases", split)
    assert step_of(dealt(racing(), 2), "Distinct", 1).phase is ClaimPhase.MIDDLE


@pytest.mark.parametrize("program", [racing(), overwriting(), stale()], ids=lambda p: p.name)
def test_each_round_is_one_of_the_semantics(program: core.Program) -> None:
    """Some order of the robots leads from each configuration to the next."""
    system = dealt(program, 2)
    names = [claim.name for claim in claims_of(system) if claim.stated is not None]
    step = step_of(system, names[0], 2)
    for before, events, after in zip(
        step.configurations, step.events, step.configurations[1:], strict=False
    ):
        last = after is step.configurations[-1]
        phase = step.phase if last else ClaimPhase.END
        assert any(reaches(system, before, order, events, phase, after) for order in ORDERS)


ORDERS = list(permutations(range(2)))


def reaches(
    system: System,
    before: Configuration[Constant],
    order: tuple[int, ...],
    events: tuple[int, ...],
    phase: ClaimPhase,
    after: Configuration[Constant],
) -> bool:
    current = before
    assert all(robot.turn is Turn.PROG for robot in before.robots)
    try:
        for robot in order:
            if events[robot] == NO_EVENT:
                current = run_skip(EXACT, system, current, robot, NO_INPUTS).configuration
            else:
                position = events[robot]
                taken = run_event(EXACT, system, current, robot, position, NO_INPUTS)
                current = taken.configuration
        if phase is ClaimPhase.END:
            current = evolved(EXACT, system, current, NO_INPUTS).configuration
    except IllegalStepError:
        return False
    own = [(r.locals, r.ports, r.status, r.ran) for r in current.robots]
    return current.store == after.store and own == [
        (r.locals, r.ports, r.status, r.ran) for r in after.robots
    ]


def test_what_is_unknown_says_why_and_what_holds_does_not() -> None:
    asked = ask(racing(), robots=2, choice=Engine.INDUCTION)
    verdict = asked["Distinct"]
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.step is not None
    # The shortest step, though longer ones were tried.
    assert len(verdict.step.events) == 1
    assert all(v.step is None for v in ask(programs.sum_of_ids(), robots=2))
