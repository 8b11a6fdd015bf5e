"""Where verdicts are for every number of robots, few of them show that these say something.

[PROP-VACUOUS]
"""

from __future__ import annotations

from itertools import product

import pytest

from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System, dealt
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.engine_names import Engine
from koord.verify.reachability_goals import reachability_goals_of
from koord.verify.strategy.verification import verify
from koord.verify.vacuity import analysis, reachability, starts, unreachable
from koord.verify.verdicts import Bounds, Emptiness, Outcome, Report
from tests.loading import program_of
from tests.sampling import first

MANY = 8

TEXT = """
allwrite:
    int sum = 0
local:
    int n = 0
{assumed}
Up:
    pre: n < 3
    eff: n = n + 1
{event}
invariant Small: forall i: 0 <= n@i and n@i <= 3
"""


def report_of(event: str, assumed: str = "", robots: int = MANY) -> Report:
    return verify(dealt(program_of(TEXT.format(event=event, assumed=assumed)), robots), Bounds(4))


def event(condition: str) -> str:
    return f"Other:\n    pre: {condition}\n    eff: sum = 1\n"


def empty(report: Report) -> list[tuple[Emptiness, str, bool]]:
    return [(each.what, each.subject, each.certain) for each in report.vacuities]


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many robots each search for goals was about."""
    numbers: list[int] = []
    unbroken = reachability.unbroken

    def counted(system, *others, **named):  # type: ignore[no-untyped-def]
        numbers.append(system.robots)
        return unbroken(system, *others, **named)

    monkeypatch.setattr(analysis, "unbroken", counted)
    return numbers


def test_what_few_robots_do_is_not_looked_for_with_many(looked_at: list[int]) -> None:
    report = report_of(event("n == 2"))
    assert {v.engine for v in report.verdicts} == {Engine.EVERY_N}
    assert (empty(report), report.unlooked) == ([], ())
    assert looked_at == [3]


def test_what_no_number_of_robots_can_do_is_certain(looked_at: list[int]) -> None:
    report = report_of(event("n > 7"))
    assert empty(report) == [(Emptiness.EVENT, "Other", True)]
    assert looked_at == [3]  # a proof for every number of robots says it


def test_what_takes_more_robots_is_looked_for_with_those_that_are_asked_for(
    looked_at: list[int],
) -> None:
    report = report_of(event("numAgents > 5"))
    assert (empty(report), report.unlooked) == ([], ())
    assert looked_at == [3, MANY]


def test_what_neither_few_nor_those_can_do_is_told(looked_at: list[int]) -> None:
    report = report_of(event("numAgents > 9"))
    ((what, subject, _),) = empty(report)
    assert (what, subject) == (Emptiness.EVENT, "Other")
    assert looked_at == [3, MANY]


def test_that_so_many_robots_cannot_start_is_told() -> None:
    report = report_of("", assumed="assume: numAgents < 5")
    assert report.outcome is Outcome.HOLDS
    assert [(what, sure) for what, _, sure in empty(report)] == [(Emptiness.ASSUMPTIONS, True)]
    assert empty(report_of("", assumed="assume: numAgents > 5")) == []


def test_what_is_given_up_with_many_is_named_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    look = analysis._look

    def given_up(ledger, *others, **named):  # type: ignore[no-untyped-def]
        if ledger.system.robots == MANY:
            raise OutOfBudgetError
        return look(ledger, *others, **named)

    monkeypatch.setattr(analysis, "_look", given_up)
    report = report_of(event("numAgents > 5"))
    assert [each.subject for each in report.unlooked] == ["Other"]
    assert report.vacuities == ()


def test_what_happens_late_is_seen_before_a_solver_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All verdicts are for every round: it is all the same in which of them it happens."""
    asked: list[int] = []
    unbroken = reachability._unbroken

    def counted(system, *others, **named):  # type: ignore[no-untyped-def]
        asked.append(system.robots)
        return unbroken(system, *others, **named)

    monkeypatch.setattr(reachability, "_unbroken", counted)
    late = TEXT.format(assumed="", event="Rest:\n    pre: n == 200\n    eff: stop\n")
    system = dealt(program_of(late.replace("3", "200")), MANY)
    report = verify(system, Bounds(4))
    assert {verdict.engine for verdict in report.verdicts} == {Engine.EVERY_N}
    assert (report.vacuities, report.unlooked, asked) == ((), (), [])


@pytest.mark.parametrize(("names", "jobs"), first(1, product([("Begun",), ()], [1, 2])))
def test_claims_about_whole_runs_are_about_those_that_are_asked_for(
    names: tuple[str, ...], jobs: int
) -> None:
    text = TEXT.format(event=event("numAgents == 3"), assumed="") + "eventually Begun: sum >= 0\n"
    report = verify(dealt(program_of(text), MANY), Bounds(4), names=names, jobs=jobs)
    assert report.failures == ()
    told = {each.subject for each in report.vacuities if each.what is Emptiness.EVENT}
    assert told | {each.subject for each in report.unlooked} == {"Other"}


def test_few_robots_are_up_to_three_of_each_kind() -> None:
    system = dealt(program_of(TEXT.format(event="", assumed="")), 3)
    assert unreachable.few_of(system) is None
    many = dealt(system.program, MANY)
    few = unreachable.few_of(many)
    assert few is not None
    assert few.kinds == (0, 0, 0)


def test_the_search_has_a_share_of_the_time_of_the_proofs() -> None:
    class Took:
        claims = ("any",)

        def __init__(self, seconds: float) -> None:
            self.seconds = seconds

        def verdict(self, claim: object) -> Took:
            return self

    def worth(seconds: float) -> float:
        return analysis._worth(Took(seconds), every_n=True)  # type: ignore[arg-type]

    assert worth(0.1) == analysis.SHARE_S
    assert worth(100.0) == 100.0 * analysis.SHARE


APART = """
local:
    int seat
    int n = 0
assume: forall i, j: i != j implies seat@i != seat@j
assume: numAgents < {most}
Up:
    pre: n < 3
    eff: n = n + 1
invariant Small: forall i: n@i <= 3
"""


@pytest.mark.parametrize(
    ("robots", "asked"), [(2, [None]), (3, [None]), (4, [frozenset({0, 1}), None])]
)
def test_two_of_three_are_not_asked_about_before_all_three(
    robots: int, asked: list[frozenset[int] | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """To ask what two can do takes as long as to ask about three, and is asked for all rounds."""
    movers: list[frozenset[int] | None] = []

    def counted(system: System, seed: int, moving: frozenset[int] | None = None) -> Unrolling:
        movers.append(moving)
        return Unrolling(system, seed, moving)

    monkeypatch.setattr(reachability, "Unrolling", counted)
    system = dealt(program_of(TEXT.format(event=event("n > 7"), assumed="")), robots)
    goals = reachability_goals_of(system)
    nevers = [goal.never for goal in goals.all if goal.subject == "Other"]
    found = reachability.unbroken(goals.system, nevers, 4, Deadline(), Effort.of_seconds(5), runs=4)
    assert (found.claims, found.known) == (frozenset(nevers), True)
    assert movers == asked


TWO_KINDS = """
agent Car:
    local:
        int n = 0
    Up:
        pre: n < 3
        eff: n = n + 1
agent Drone:
    local:
        int m = 0
    Fly:
        pre: m < 3
        eff: m = m + 1
"""


@pytest.mark.parametrize(("most", "asked"), [(100, [40, 12]), (10, [40, 12, 40])])
def test_some_robots_are_asked_about_where_all_take_long_to_write(
    most: int, asked: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers: list[int] = []
    never_starts = starts.never_starts

    def counted(system, *others):  # type: ignore[no-untyped-def]
        numbers.append(system.robots)
        return never_starts(system, *others)

    monkeypatch.setattr(starts, "never_starts", counted)
    system = dealt(program_of(APART.format(most=most)), 40)
    found = starts.many_never_start(system, 0, Deadline(), Effort.of_seconds(5))
    assert numbers == asked
    assert (found is not None) == (most < 40)


def test_some_robots_are_of_each_kind() -> None:
    system = System(program_of(TWO_KINDS), (0,) * 30 + (1, 1))
    some = starts.some_of(system)
    assert some is not None
    assert some.kinds == (0,) * 10 + (1, 1)
    assert starts.some_of(some) is None
