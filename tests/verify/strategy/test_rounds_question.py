"""Bounded checks as data: the same answer in another process, and from all cubes together."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator, Sequence
from functools import partial
from os import getpid
from typing import Any

import pytest
from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT
from koord.semantics.domain import conjunction
from koord.syntax.core import UnaryOp
from koord.syntax.system import System, dealt
from koord.verify.claims import Claim, claims_of
from koord.verify.each_claim import Alone
from koord.verify.effort import Deadline
from koord.verify.encoding.cubes import Choice, Cube, cubes
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.engine_names import Engine
from koord.verify.forked import ForkedProcess, Receiver, fork
from koord.verify.helpers import PortableWork
from koord.verify.job_process import do_work
from koord.verify.ledger import Ledger
from koord.verify.processes import can_fork
from koord.verify.reduction.problems import problem_of
from koord.verify.strategy import each_claim_turn
from koord.verify.strategy.confirmation import confirmed
from koord.verify.strategy.rounds_question import (
    CUBES,
    Looked,
    RoundsQuestion,
    by_cubes,
    joined,
)
from koord.verify.strategy.time_limits import verify_apart
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.loading import program_of
from tests.verify.strategy.test_each_claim_turn import TEXT, look_at_little

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")

#: `Late` is broken in the first cube only after five rounds, and in others sooner.
LATE = """
local:
    int steps = 0
Slow:
    pre: steps < 4
    eff: steps = steps + 1
Fast:
    pre: steps < 4
    eff: steps = steps + 2
invariant Late: forall i: steps@i < 4
invariant Never: forall i: steps@i < 6
"""


#: Two claims about the same variables, in whole runs.
RUNS = """
local:
    int steps = 0
Step:
    pre: steps < 3
    eff: steps = steps + 1
eventually Two: forall i: steps@i >= 2
eventually Four: forall i: steps@i >= 4
"""


class Silent:
    """A channel to nobody."""

    def __call__(self, text: str) -> None:
        pass

    def note(self, value: object) -> None:
        pass

    def lasting(self, until: float | None) -> None:
        pass


#: The processes of helpers.
_STARTED: list[ForkedProcess] = []


@pytest.fixture(autouse=True)
def nobody_is_left() -> Iterator[None]:
    yield
    while _STARTED:
        _STARTED.pop().join()


class Forking(Struct):
    """Helpers that answer in processes of this machine, of what can be sent to others."""

    asked: list[str]

    def ask(self, question: PortableWork) -> Receiver:
        self.asked.append(type(question).__name__)
        sent = pickle.loads(pickle.dumps(question))
        process, receives = fork(partial(do_work, sent, getpid()))
        _STARTED.append(process)
        return receives


def system_of(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def ledger_of(system: System, rounds: int) -> Ledger:
    problem = problem_of(system)
    return Ledger(problem, Bounds(rounds), Deadline(), claims_of(problem.system))


def answers(claim: Claim, questions: Sequence[RoundsQuestion]) -> list[Looked]:
    """The answers in order, up to the first one that violates the claim."""
    found = []
    for question in questions:
        found.append(question(Silent()))
        if found[-1].violates(claim):
            break
    return found


def verdict(system: System, rounds: int, name: str, looked: Looked) -> Verdict:
    ledger = ledger_of(system, rounds)
    (claim,) = (claim for claim in ledger.claims if claim.name == name)
    ledger.take(looked.found.said)
    return replace(ledger.verdict(claim), seconds=0.0)


def without_times(report: Report) -> list[Verdict]:
    return [replace(each, seconds=0.0) for each in report.verdicts]


# --- cubes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "robots"), [(LATE, 2), (TEXT, 2), (LATE, 3)])
def test_every_run_is_in_exactly_one_cube(text: str, robots: int) -> None:
    system = system_of(text, robots)
    split = cubes(system, CUBES, 2)
    assert len(split) >= CUBES
    unrolling = Unrolling(system)
    moments = unrolling.moments()
    while len(unrolling.rounds) < 2:
        next(moments)
    d, solver = unrolling.encoder.d, unrolling.solver
    met = [
        conjunction(
            d,
            [t for n, taken in enumerate(unrolling.rounds) for t in cube.met(d, n, taken.options)],
        )
        for cube in split
    ]
    out = [d.unary(UnaryOp.NOT, each) for each in met]
    assert solver.check(out, Deadline()) is SolverAnswer.UNSAT, "each run is in one"
    for n, each in enumerate(met[:4]):
        for other in met[n + 1 :]:
            assert solver.check([each, other], Deadline()) is SolverAnswer.UNSAT


def test_cubes_are_the_same_however_many_are_wanted_of_few_events() -> None:
    system = system_of(LATE, 1)
    assert cubes(system, 4, 1) == tuple(Cube((Choice(0, 0, e),)) for e in (0, 1, NO_EVENT))
    assert cubes(system, 1, 9) == (Cube(),)
    assert cubes(system, 16, 0) == (Cube(),)


@pytest.mark.parametrize("name", ["Late", "Never", "no fault"])
@pytest.mark.parametrize("known", [None, 1, pytest.param(0, marks=pytest.mark.slow), 2])
def test_all_cubes_together_say_what_one_check_says(name: str, known: int | None) -> None:
    system, rounds = system_of(LATE), 4
    ledger = ledger_of(system, rounds)
    (claim,) = (claim for claim in ledger.claims if claim.name == name)
    whole = RoundsQuestion(ledger.detached([claim]), claim, None)(Silent())
    if known is not None:
        early = ledger_of(system, known)
        early.take(RoundsQuestion(early.detached([claim]), claim, None)(Silent()).found.said)
        if claim in early.verdicts:
            return
        reach = early.extract([claim]).reaches[claim]
        ledger.leave([claim], reach[-1])
    questions = by_cubes(ledger, claim)
    assert {question.known for question in questions} == {known}
    looks = answers(claim, questions)
    together = verdict(system, rounds, name, joined(claim, looks, known))
    alone = verdict(system, rounds, name, whole)
    if alone.outcome is not Outcome.VIOLATED:
        assert together == alone
        return
    assert together.outcome is Outcome.VIOLATED
    assert together.engine is alone.engine
    assert together.counterexample is not None
    assert alone.counterexample is not None
    assert together.counterexample.round >= alone.counterexample.round
    broken = [question(Silent()).found.said.verdicts.get(claim) for question in questions]
    shown = [v.counterexample for v in broken if v is not None]
    assert min(run.round for run in shown if run is not None) == alone.counterexample.round
    assert not together.fewest or together.counterexample.round == alone.counterexample.round


def test_a_cube_s_shortest_run_is_not_said_to_be_the_shortest() -> None:
    system = system_of(LATE)
    ledger = ledger_of(system, 5)
    claim = ledger.claims[0]
    looks = answers(claim, by_cubes(ledger, claim))
    own = looks[-1].found.said.verdicts[claim]
    assert own.fewest
    assert not joined(claim, looks, None).found.said.verdicts[claim].fewest
    assert joined(claim, looks, 4).found.said.verdicts[claim].fewest


def test_a_claim_holds_no_further_than_in_the_least_of_its_cubes() -> None:
    system = system_of(LATE)
    ledger = ledger_of(system, 5)
    claim = ledger.claims[1]
    assert claim.name == "Never"
    questions = by_cubes(ledger, claim)
    looks = answers(claim, questions)
    shallow = replace(ledger.detached([claim]), bounds=Bounds(1))
    looks[1] = replace(questions[1], ledger=shallow)(Silent())
    found = joined(claim, looks, None)
    assert [reach.rounds for reach in found.found.said.reaches[claim]] == [1]
    assert verdict(system, 5, "Never", found).outcome is Outcome.UNKNOWN


def test_moments_are_those_of_whoever_looks_at_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clocks of machines differ: what is left of the time is sent, and comes back as a distance."""
    clock = [90.0, 5.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(time, "process_time", lambda: clock[1])
    sent = pickle.dumps([Deadline(100.0, 7.0), Deadline()])
    clock[:] = [1000.0, 0.5]
    assert pickle.loads(sent) == [Deadline(1010.0, 2.5), Deadline()]
    system = system_of(LATE)
    ledger = ledger_of(system, 1)
    claim = ledger.claims[0]
    there = Alone(replace(ledger.extract([claim]), spans={claim: [(1001.0, 1003.0)]}), 1000.0)
    assert there.as_of(20.0).spans == {claim: [(21.0, 23.0)]}


# --- helpers --------------------------------------------------------------------------------------


@pytest.mark.parametrize("choice", [Engine.BMC, pytest.param(None, marks=pytest.mark.slow)])
def test_verdicts_are_the_same_with_helpers(
    choice: Engine | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = system_of(TEXT)
    look_at_little(monkeypatch)
    little = (each_claim_turn._Slice(0, False), each_claim_turn._Slice(2, True))
    monkeypatch.setattr(each_claim_turn, "SLICES", little)
    helpers: Any = Forking([])
    one = verify(system, Bounds(5), choice)
    other = verify(system, Bounds(5), choice, helpers=helpers)
    assert without_times(one) == without_times(other)
    assert one.vacuities == other.vacuities
    assert choice is None or "RoundsQuestion" in helpers.asked


def test_claims_about_whole_runs_are_asked_elsewhere() -> None:
    system = system_of(RUNS)
    helpers: Any = Forking([])
    one = verify(system, Bounds(5), Engine.BITS)
    other = verify(system, Bounds(5), Engine.BITS, helpers=helpers)
    assert without_times(one) == without_times(other)
    assert "LassoQuestion" in helpers.asked
    assert [v.outcome for v in one.verdicts[-2:]] == [Outcome.HOLDS, Outcome.VIOLATED]


@pytest.mark.slow
def test_cubes_of_helpers_give_the_same_outcomes(monkeypatch: pytest.MonkeyPatch) -> None:
    system = system_of(LATE)
    look_at_little(monkeypatch)
    monkeypatch.setattr(each_claim_turn, "SLICES", (each_claim_turn._Slice(0, False),))
    helpers: Any = Forking([])
    one = verify(system, Bounds(4), Engine.BMC)
    other = verify(system, Bounds(4), Engine.BMC, helpers=helpers)
    assert len(helpers.asked) >= CUBES
    told = [
        [(v.claim, v.outcome, v.engine, v.rounds) for v in report.verdicts]
        for report in (one, other)
    ]
    assert told[0] == told[1]
    assert {v.outcome for v in one.verdicts} == {Outcome.HOLDS, Outcome.VIOLATED}


def test_a_limit_for_each_claim_is_kept_elsewhere_too() -> None:
    system = system_of(TEXT)
    helpers: Any = Forking([])
    report = verify_apart(system, Bounds(3, claim_s=60.0), Engine.BMC, helpers=helpers)
    one = verify_apart(system, Bounds(3, claim_s=60.0), Engine.BMC)
    assert without_times(report) == without_times(one)
    assert "ClaimQuestion" in helpers.asked


def test_a_run_from_another_machine_is_replayed() -> None:
    system = system_of(LATE)
    report = verify(system, Bounds(4), Engine.BMC)
    assert without_times(confirmed(system, report)) == without_times(report)
    broken, *others = report.verdicts
    assert broken.counterexample is not None
    recording = broken.counterexample.recording
    shorter = replace(recording, rounds=recording.rounds[:-1])
    wrong = replace(broken, counterexample=replace(broken.counterexample, recording=shorter))
    found, *rest = confirmed(system, replace(report, verdicts=(wrong, *others))).verdicts
    assert found.outcome is Outcome.UNKNOWN
    assert "did not replay" in found.reason
    assert rest == others
