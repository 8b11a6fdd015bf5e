"""Kept runs that reached goals: replayed on a program as it is now, and believed in nothing."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.semantics.recordings import Answer
from koord.syntax.system import System, dealt
from koord.verify.reachability_goals import reachability_goals_of
from koord.verify.strategy.resumption import PastVerification
from koord.verify.strategy.verification import verify
from koord.verify.vacuity import analysis
from koord.verify.vacuity.reaching_runs import ReachingRuns, layout_of
from koord.verify.verdicts import Bounds, Emptiness, ReachingRun, Report
from tests.generators.mutating import mutants
from tests.loading import example_program, program_of
from tests.sampling import first

BOUNDS = Bounds(4)

TEXT = """
allwrite:
    int sum = 0
local:
    int n = 0
    int start
Up:
    pre: n < 3
    eff: n = n + 1
Late:
    pre: n == 2
    eff: sum = sum + start
assume: forall i: 0 <= start@i and start@i < 9
invariant Small: forall i: n@i == 2 implies start@i < 9
"""


def of(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def looked(system: System, before: tuple[ReachingRun, ...] = (), bounds: Bounds = BOUNDS) -> Report:
    return verify(system, bounds, past=PastVerification(reaching=before, keeps_runs=True))


@pytest.fixture(scope="module")
def runs() -> tuple[ReachingRun, ...]:
    """Runs of the text that reach all that is possible in it."""
    return looked(of(TEXT)).reaching


def shown(system: System, before: tuple[ReachingRun, ...], rounds: int = 4) -> set[str]:
    """The subjects of goals that kept runs are seen to reach."""
    wished = reachability_goals_of(system)
    nevers = [goal.never for goal in wished.all]
    found = ReachingRuns(before).replayed(wished.system, nevers, rounds)
    return {goal.subject for goal in wished.all if goal.never in found.claims}


def test_runs_that_reach_goals_are_kept(runs: tuple[ReachingRun, ...]) -> None:
    assert runs
    assert shown(of(TEXT), runs) == {"Up", "Late", "Small"}


def test_nobody_is_asked_where_kept_runs_reach_all_goals(
    runs: tuple[ReachingRun, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(analysis, "unbroken", lambda *a, **k: asked.append("goals"))
    monkeypatch.setattr(analysis, "never_starts", lambda *a, **k: asked.append("start"))
    found = looked(of(TEXT.replace("n < 3", "n < 4")), runs)
    assert not asked
    assert not found.vacuities
    assert shown(of(TEXT), found.reaching) == {"Up", "Late", "Small"}


def test_goals_that_no_kept_run_reaches_are_looked_for(runs: tuple[ReachingRun, ...]) -> None:
    more = TEXT + "invariant More: forall i: n@i == 3 implies start@i < 9\n"
    found = looked(of(more), runs)
    assert not found.vacuities
    assert shown(of(more), found.reaching) == {"Up", "Late", "Small", "More"}


@pytest.mark.parametrize(
    ("old", "new", "missing"),
    first(
        1,
        [
            ("n@i == 2 implies", "n@i == 7 implies", "Small"),
            ("pre: n == 2", "pre: n == 2 and sum > 90", "Late"),
            ("eff: n = n + 1", "eff: n = n + 3", "Late"),
        ],
    ),
)
def test_what_the_changed_program_cannot_do_is_told_as_ever(
    runs: tuple[ReachingRun, ...], old: str, new: str, missing: str
) -> None:
    system = of(TEXT.replace(old, new))
    assert missing not in shown(system, runs)
    found = looked(system, runs)
    assert missing in {each.subject for each in found.vacuities}
    assert found.vacuities == looked(system).vacuities


def test_a_run_starts_only_as_the_program_assumes_now(runs: tuple[ReachingRun, ...]) -> None:
    none = of(TEXT.replace("start@i < 9\ninv", "start@i < 0\ninv"))
    assert not shown(none, runs)
    (told,) = looked(none, runs).vacuities
    assert told.what is Emptiness.ASSUMPTIONS


def test_a_run_counts_as_far_as_rounds_are_looked_at(runs: tuple[ReachingRun, ...]) -> None:
    assert shown(of(TEXT), runs, rounds=1) == {"Up"}


def test_what_a_run_does_before_it_is_none_any_more_counts(runs: tuple[ReachingRun, ...]) -> None:
    assert shown(of(TEXT.replace("pre: n == 2", "pre: n == 8")), runs) >= {"Up"}


def test_values_of_other_types_are_not_replayed(runs: tuple[ReachingRun, ...]) -> None:
    other = of(TEXT.replace("    int start", "    float start").replace("sum + start", "sum + 1"))
    assert layout_of(other) != layout_of(of(TEXT))
    assert not shown(other, runs)
    assert not shown(of(TEXT, robots=3), runs)


ASKING = """
def fun near(float x) -> bool: extern
    ensures:
        forall float y: y >= x implies result
local:
    bool isNear = false
Look:
    pre: not isNear
    eff: isNear = near(1.0)
invariant Seen: forall i: isNear@i implies near(1.0)
"""


def test_answers_that_no_function_of_the_summary_gives_show_nothing() -> None:
    """The promise is about every number, so that execution takes it on trust."""
    promised = of(ASKING)
    free = of(ASKING.replace("    ensures:\n        forall float y: y >= x implies result\n", ""))
    refusing = tuple(map(_refusing, looked(free).reaching))
    assert "Look" in shown(free, refusing)
    assert not shown(promised, refusing)


def _refusing(run: ReachingRun) -> ReachingRun:
    def no(answer: Answer) -> Answer:
        return replace(answer, value=False)

    rounds = tuple(
        replace(round_, answers=tuple(map(no, round_.answers))) for round_ in run.recording.rounds
    )
    return replace(run, recording=replace(run.recording, rounds=rounds))


@pytest.mark.parametrize(("name", "step"), [("leader_elect", 24)])
def test_mutated_programs_are_told_vacuous_with_kept_runs_as_without(name: str, step: int) -> None:
    program = example_program(name)
    before = looked(dealt(program, 2), bounds=Bounds(3)).reaching
    assert before
    for mutant in list(mutants(program))[::step]:
        system = dealt(mutant.program, 2)
        wished = reachability_goals_of(system)
        nevers = [goal.never for goal in wished.all]
        reached = ReachingRuns(before).replayed(wished.system, nevers, 3).claims
        fresh = verify(system, Bounds(3))
        empty = {(each.subject, each.span) for each in fresh.vacuities if each.certain}
        met = {(goal.subject, goal.span) for goal in wished.all if goal.never in reached}
        assert not empty & met, str(mutant)


def test_runs_are_read_off_models_only_if_somebody_keeps_them() -> None:
    assert verify(of(TEXT), BOUNDS).reaching == ()
    assert looked(of(TEXT)).reaching != ()
