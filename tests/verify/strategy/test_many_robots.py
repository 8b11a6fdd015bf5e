"""With many robots claims about whole runs are asked about beside those about states.

What is found counts only if the claims about states are proved for every number of robots.
"""

from __future__ import annotations

from functools import partial

import pytest
from msgspec.structs import replace

from koord.syntax.system import dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Workers
from koord.verify.engines.every_n.engine import EveryNEngine
from koord.verify.engines.every_n.questions import NOT_COVERED, NOT_INDUCTIVE
from koord.verify.ledger import Ledger, Reach
from koord.verify.processes import Job, Pool
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy import race, verification
from koord.verify.strategy.race import RaceTurn
from koord.verify.strategy.table import (
    FEW_ROBOTS,
    LIVENESS,
    SAFETY,
    AskAtOnce,
    AskEngine,
    EngineTurn,
    Fleet,
)
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.loading import program_of

MANY = FEW_ROBOTS + 1

#: That `Done` holds rests on `Small`.
TEXT = """
local:
    int n = 0
Up:
    pre: n != 3 and n < 9
    eff: n = n + 1
invariant Small: forall i: n@i <= 3
eventually Done: forall i: n@i == 3
"""


@pytest.fixture
def dropped(monkeypatch: pytest.MonkeyPatch) -> list[Job[object]]:
    """The jobs whose results were no longer needed, as they were dropped."""
    found: list[Job[object]] = []
    drop = Pool.drop

    def noted(pool: Pool, job: Job[object]) -> None:
        if job.counts and not job.is_done:  # what takes part in a race does not count
            found.append(job)
        drop(pool, job)

    monkeypatch.setattr(Pool, "drop", noted)
    return found


def of(text: str, jobs: int, names: tuple[str, ...] = ()) -> Report:
    return verify(dealt(program_of(text), MANY), Bounds(4), jobs=jobs, names=names)


def said(report: Report) -> list[tuple[str, Outcome, Engine]]:
    return [(v.claim.name, v.outcome, v.engine) for v in report.verdicts]


def test_whatever_is_asked_ahead_is_told_as_if_it_were_asked_in_turn(
    dropped: list[Job[object]],
) -> None:
    assert Fleet.MANY.has(MANY)
    report = of(TEXT, 2)
    assert said(report) == said(of(TEXT, 1))
    assert {v.engine for v in report.verdicts} == {Engine.EVERY_N}
    assert dropped == []


@pytest.fixture
def proofs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ask nobody about whole runs but for proofs for every number of robots."""
    monkeypatch.setattr(verification, "LIVENESS", {None: LIVENESS[None][:1]})


@pytest.mark.usefixtures("proofs_alone")
def test_it_counts_only_if_all_that_it_rests_on_is_proved(dropped: list[Job[object]]) -> None:
    text = TEXT.replace("int n = 0", "int n = 4")
    report = of(text, 2)
    assert said(report) == said(of(text, 1))
    assert report.verdicts[0].outcome is Outcome.VIOLATED
    assert report.verdicts[-1].outcome is not Outcome.HOLDS
    assert len(dropped) == 1


@pytest.mark.usefixtures("proofs_alone")
def test_others_that_are_needed_find_nobody_in_their_way(
    monkeypatch: pytest.MonkeyPatch, dropped: list[Job[object]]
) -> None:
    before: list[int] = []
    monkeypatch.setattr(RaceTurn, "work", lambda turn, ledger: before.append(len(dropped)))
    monkeypatch.setattr(verification, "SAFETY", {None: SAFETY[None][:4]})
    text = TEXT.replace("n@i <= 3", "n@i != 7")
    of(text, 2, ("Small",))
    assert before == [0]  # nothing is asked ahead about what nobody asks about
    of(text, 2)
    assert before == [0, 1]


def test_of_two_robots_whole_runs_are_not_asked_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """Proofs of what claims are about states are, which have nobody in their way."""
    begun: list[object] = []
    begin_here = Pool.begin_here

    def noted(pool: Pool, name: str, work: object, **others: object) -> Job[object]:
        begun.append(work)
        return begin_here(pool, name, work, **others)  # type: ignore[arg-type]

    monkeypatch.setattr(Pool, "begin_here", noted)
    monkeypatch.setattr(Pool, "submit", lambda *given, **others: pytest.fail("not needed"))
    verify(dealt(program_of(TEXT), 2), Bounds(4), jobs=2)
    (work,) = begun
    assert isinstance(work, partial)
    assert work.func is race._asked


@pytest.mark.parametrize(
    ("reason", "again"),
    [(NOT_INDUCTIVE, False), (f"{NOT_COVERED}: long lists", False), ("too much", True)],
    ids=["inductive", "covered", "time"],
)
def test_what_was_found_out_before_the_race_is_not_asked_again(reason: str, again: bool) -> None:
    """Nothing is known in the first race that was not known by then."""
    (race_row, *_) = [row for row in SAFETY[None] if isinstance(row, AskAtOnce)]
    (row,) = [
        row for row in race_row.first if isinstance(row, AskEngine) and row.fleet is Fleet.MANY
    ]
    system = dealt(program_of(TEXT), MANY)
    ledger = Ledger(plain_problem(system), Bounds(4), Deadline(), claims_of(system))
    ledger.leave(ledger.open(), Reach(Engine.EVERY_N, None, reason, 0.0))
    assert EveryNEngine().suits(ledger, row.task) is again


def test_rounds_of_many_robots_are_written_down_as_far_as_is_quick() -> None:
    """No limit of a solver counts that: eight rounds of 10 robots may take two seconds."""
    (race_row, *_) = [row for row in SAFETY[None] if isinstance(row, AskAtOnce)]
    rows = [row for row in race_row.beside if isinstance(row, AskEngine)]
    (row,) = [r for r in rows if r.engine is Engine.BMC and r.fleet is Fleet.MANY]
    system = dealt(program_of(TEXT), 40)
    ledger = Ledger(plain_problem(system), Bounds(10), Deadline(), claims_of(system))
    EngineTurn(row.engine, replace(row.task, seconds=5.0), Workers(Pool(1))).work(ledger)
    assert row.task.rounds is not None
    assert all((ledger.verdict(claim).rounds or 0) < row.task.rounds for claim in ledger.open())
