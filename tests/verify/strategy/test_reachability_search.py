"""The look for what never happens, which is begun beside engines and done in any case."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Ledger
from koord.verify.processes import Pool
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy.resumption import PastVerification, Steps
from koord.verify.strategy.table import FEW_ROBOTS
from koord.verify.strategy.verification import _ReachabilitySearch
from koord.verify.vacuity import analysis, reachability
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import program_of

TEXT = """
local:
    int n = 0
Up:
    pre: n < 3
    eff: n = n + 1
invariant Small: forall i: 0 <= n@i and n@i <= 3
"""


@pytest.fixture
def pool() -> Iterator[Pool]:
    with Pool(2) as made:
        yield made


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many robots each search in this process was about."""
    numbers: list[int] = []
    unbroken = reachability.unbroken

    def counted(system, *others, **named):  # type: ignore[no-untyped-def]
        numbers.append(system.robots)
        return unbroken(system, *others, **named)

    monkeypatch.setattr(analysis, "unbroken", counted)
    return numbers


def ledger_of(system: System) -> Ledger:
    return Ledger(plain_problem(system), Bounds(4), Deadline(), claims_of(system))


def search_of(system: System, pool: Pool) -> _ReachabilitySearch:
    return _ReachabilitySearch(
        pool, Steps(PastVerification()), system, plain_problem(system), wanted=True
    )


def test_it_goes_before_what_may_be_in_vain(pool: Pool) -> None:
    def forever(tell: JobChannel) -> None:
        while True:
            signal.pause()

    jobs = [pool.submit("", forever) for _ in range(2)]
    assert [job.process is not None for job in jobs] == [True, False]
    system = dealt(program_of(TEXT), 2)
    search = search_of(system, pool)
    search.begin(ledger_of(system), ())
    assert search.job is not None
    assert [job is search.job for job in pool._waiting] == [True, False]


@pytest.mark.parametrize("robots", [FEW_ROBOTS, FEW_ROBOTS + 1])
def test_with_many_robots_few_are_enough_whoever_was_looked_at_before(
    pool: Pool, looked_at: list[int], robots: int
) -> None:
    """It was begun when nobody knew that verdicts would be for every number of robots."""
    system = dealt(program_of(TEXT), robots)
    ledger, search = ledger_of(system), search_of(system, pool)
    search.begin(ledger, ())
    assert not search.every_n
    ledger.settle({c: Verdict(c, Outcome.HOLDS, Engine.EVERY_N, 0.0) for c in ledger.claims})
    found = search.end(ledger, ())
    assert (found.vacuities, found.unlooked, search.failures) == ((), (), [])
    assert looked_at == ([] if robots <= FEW_ROBOTS else [3])
