"""Claims about whole runs: engines race on slices, and answers count in the table's order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import pytest

from koord.syntax.system import dealt
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task
from koord.verify.processes import Pool, can_fork
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy import liveness
from koord.verify.strategy.liveness import LivenessVerdicts, settled
from koord.verify.strategy.table import LIVENESS, AskAtOnce, AskEngine, LivenessRow, Patience
from koord.verify.verdicts import Bounds, Outcome
from tests.agreement.test_live_slices import compare
from tests.loading import program_of, protocol_text
from tests.sampling import but_slow, sampled

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")

COUNTER = """
local:
    int n = 0
    int m = 0
Step:
    pre: n < 5
    eff: n = n + 1
Turn:
    pre: true
    eff: m = 1 - m
eventually Five: forall i: n@i == 5
eventually Six: exists i: n@i == 6
eventually Turned: exists i: m@i == 1
"""

_LEMMAS = AskEngine(Engine.EVERY_N, Task(Purpose.INFER, seconds=3.0), opaque=True)
_SEARCH = AskEngine(Engine.SEARCH)
_BITS = AskEngine(Engine.BITS, opaque=True)


def told(
    text: str, jobs: int, rows: Sequence[LivenessRow] = LIVENESS[None], robots: int = 2
) -> LivenessVerdicts:
    system = dealt(program_of(text), robots)
    with Pool(jobs) as pool:
        return settled(Slices(system), Bounds(8), rows, Deadline.after(None), pool=pool)


def said(found: LivenessVerdicts) -> list[tuple[str, Outcome, Engine, str]]:
    return [(v.claim.name, v.outcome, v.engine, v.reason) for v in found.verdicts]


@pytest.mark.parametrize("jobs", but_slow([3], [2, 3]))
def test_verdicts_are_equal_whatever_the_number_of_processes(jobs: int) -> None:
    rows = (AskAtOnce((), (_BITS, _SEARCH)),)
    alone = said(told(COUNTER, 1, rows))
    assert said(told(COUNTER, jobs, rows)) == alone
    assert [outcome for _, outcome, *_ in alone] == [
        Outcome.VIOLATED,
        Outcome.VIOLATED,
        Outcome.HOLDS,
    ]


@pytest.mark.parametrize("jobs", but_slow([1], [1, 2]))
def test_who_says_more_is_waited_for(jobs: int) -> None:
    text = protocol_text("gate")
    (first,) = told(text, jobs, (AskAtOnce((_LEMMAS,), (_SEARCH,)),)).verdicts
    (last,) = told(text, jobs, (AskAtOnce((), (_SEARCH, _LEMMAS)),)).verdicts
    assert (first.engine, last.engine) == (Engine.EVERY_N, Engine.SEARCH)


@pytest.mark.parametrize("jobs", but_slow([2], [1, 2]))
@pytest.mark.parametrize(
    ("steps", "engine"), [(0, Engine.SEARCH), (1_000_000, Engine.EVERY_N)], ids=["none", "much"]
)
def test_who_says_more_is_waited_for_with_patience(jobs: int, steps: int, engine: Engine) -> None:
    row = AskAtOnce((_LEMMAS,), (_SEARCH,), patience=Patience(times=0.0, steps=steps))
    (verdict,) = told(protocol_text("gate"), jobs, (row,)).verdicts
    assert (verdict.outcome, verdict.engine) == (Outcome.HOLDS, engine)


@pytest.mark.parametrize("engine", [_SEARCH, _BITS])
def test_what_is_found_out_besides_is_told(engine: AskEngine) -> None:
    never = COUNTER + "assume Odd: true leadsto n == 7\n"
    found = told(never, 2, (AskAtOnce((), (engine,)),))
    assert any(vacuity.certain for vacuity in found.vacuities)


def test_an_engine_that_dies_costs_its_own_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def dying(self: liveness._Asking, *given: object) -> None:
        raise MemoryError

    monkeypatch.setattr(liveness._Asking, "on_opaque", dying)
    found = told(COUNTER, 2, (AskAtOnce((_BITS,), (_SEARCH,)),))
    assert {v.engine for v in found.verdicts} == {Engine.SEARCH}
    assert {failure.who for failure in found.failures} == {Engine.BITS.value}


def test_few_questions_settle_what_is_easy_and_end_what_is_not() -> None:
    def asked(questions: int) -> Outcome:
        task = Task(rounds=4, questions=questions)
        row = AskEngine(Engine.BITS, task, opaque=True)
        (verdict,) = told(protocol_text("gate"), 1, (row,)).verdicts
        return verdict.outcome

    assert [asked(questions) for questions in (0, 3_000)] == [Outcome.UNKNOWN, Outcome.HOLDS]


@pytest.mark.parametrize("first", sampled(2, range(0, 24, 2)))
def test_slices_of_races_say_what_a_search_says_of_all(
    monkeypatch: pytest.MonkeyPatch, first: int
) -> None:
    race = AskAtOnce((), (_BITS, _SEARCH))
    monkeypatch.setitem(LIVENESS, None, (race,))
    count = sum((compare(seed, None, 60) for seed in range(first, first + 2)), Counter[str]())
    assert count.total() > 0, count
