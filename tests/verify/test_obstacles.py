"""An *unknown* says what stands in the way: the engine, the variable, and what would change it."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from random import Random

import pytest

import koord
from koord.api.verify_report import VerifyReport
from koord.cli import verdicts
from koord.cli.terminal import Style
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.verify import obstacles
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import engine as bits_engine
from koord.verify.engines.engine import Task
from koord.verify.ledger import Ledger
from koord.verify.obstacles import NotInductive, TimeUp, TooLong, Values, WholeRuns
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy.table import SAFETY
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.generators.large import large
from tests.loading import example_files, program_of
from tests.sampling import sampled

EXAMPLES = Path(__file__).resolve().parents[2] / "specs" / "examples"

#: A sensor and a variable that no search can follow, a list that may be long, and a whole run.
OPEN = """
using Watch:
    sensors:
        float speed
        int[] seen
local:
    float far = 0
    int k = 0
Go:
    pre: k < 3
    eff:
        far = far + Watch.speed * Watch.speed
        k = k + 1
invariant Near: forall i: far@i < 100 or far@i * far@i * far@i > far@i
invariant Short: forall i: len(Watch.seen@i) < 9 or k@i < 4
eventually Gone: far > 100
"""

STARTS = """
allwrite:
    float level
assume: level > 0
Rise:
    pre: level < 10
    eff:
        level = level * level
invariant Low: level * level * level < 1000000
"""

CHOICES = [c for c in SAFETY if c is not Engine.ABC]


def asked(text: str, choice: Engine | None, timeout_s: float | None = None) -> tuple[Verdict, ...]:
    system: System = dealt(program_of(text), 2)
    return verify(system, Bounds(2, timeout_s), choice).verdicts


@pytest.mark.parametrize(
    ("text", "choice"),
    [*product([OPEN, STARTS], [c for c in CHOICES if c is not None])],
    ids=lambda value: value.value if isinstance(value, Engine) else "",
)
def test_whatever_is_unknown_says_what_stands_in_the_way(text: str, choice: Engine | None) -> None:
    for verdict in asked(text, choice, 2.0):
        said = obstacles.lines(verdict.obstacles, verdict.claim.name)
        assert bool(said) is (verdict.outcome is Outcome.UNKNOWN), (choice, verdict)
        assert all("what would help: " in line for line in said)


#: Numbers that double their length in each round.
SQUARES = """
local:
    int x = 2
Step:
    eff: x = x * x
invariant Odd: forall i: x@i != 7
"""


def test_a_number_that_grows_too_long_is_named() -> None:
    system = dealt(program_of(SQUARES), 1)
    (odd, *_) = verify(system, Bounds(30), Engine.SEARCH).verdicts
    assert odd.outcome is Outcome.UNKNOWN
    assert TooLong(Engine.SEARCH, ("x",)) in odd.obstacles
    lines = obstacles.lines(odd.obstacles, "Odd")
    assert any(line.startswith("search: exact numbers in x grow") for line in lines)


@pytest.mark.parametrize(
    "task", [Task(questions=0), Task(questions=5_500, frame_questions=0)], ids=["all", "a frame's"]
)
@pytest.mark.parametrize(("rounds", "outcome"), [(1, Outcome.HOLDS), (9, Outcome.UNKNOWN)])
def test_who_looked_for_an_invariant_and_found_none_is_named(
    rounds: int, outcome: Outcome, task: Task
) -> None:
    """Also where all rounds that were asked about have been looked at."""
    text = """
allwrite:
    int x = 0
    int y = 0
Step:
    pre: x < 20
    eff:
        y = x
        x = x + 2
invariant Odd: y != 7 or x != 9
"""
    system = dealt(program_of(text), 2)
    (odd, *_) = claims = claims_of(system)
    ledger = Ledger(plain_problem(system), Bounds(rounds), Deadline.after(None), claims, 0, print)
    bits_engine.BitsEngine().work(ledger, task)
    verdict = ledger.verdict(odd)
    assert verdict.outcome is outcome
    (line,) = obstacles.lines(verdict.obstacles, "Odd")
    assert line.startswith("bits: IC3 has done all the work that it may, and found no invariant")


def test_a_proof_that_was_given_up_after_the_answers_is_told() -> None:
    text = """
local:
    int x = 0
Step:
    eff: x = x + 2
invariant Odd: forall i: x@i != 91
"""
    system = dealt(program_of(text), 1)
    report = verify(system, Bounds(2), Engine.INDUCTION)
    odd = report.verdicts[0]
    assert (odd.outcome, odd.rounds) == (Outcome.HOLDS, 2)
    assert [type(each) for each in odd.obstacles] == [NotInductive]
    loaded = koord.load(Source("odd.krd", text))
    whole = VerifyReport(loaded, system, Bounds(2), report)
    shown = "\n".join(verdicts.lines(whole, Style()))
    assert "a proof for all rounds was looked for besides, and given up, of Odd:" in shown
    assert "'kind': 'NotInductive'" in str(whole.to_dict())
    (alone, *_) = verify(system, Bounds(2), Engine.BMC).verdicts
    assert alone.outcome is Outcome.HOLDS
    assert not alone.obstacles  # nobody looked for one


def assert_said(system: System, choice: Engine | None, where: object) -> int:
    """How many claims are unknown; each names engine, variable or claim, and cure."""
    count = 0
    for verdict in verify(system, Bounds(2, 1.0), choice).verdicts:
        lines = obstacles.lines(verdict.obstacles, verdict.claim.name)
        if verdict.outcome is Outcome.UNKNOWN:
            count += 1
            assert lines, (where, choice, verdict)
            assert all("; what would help: " in line for line in lines), lines
            named = [e for e in verdict.obstacles if e.engine is not Engine.NONE]
            assert named or is_of_none(verdict), (where, choice, verdict)
        elif verdict.outcome is Outcome.VIOLATED:
            assert not lines, (where, choice, verdict)
    return count


def is_of_none(verdict: Verdict) -> bool:
    """Whether what stands in the way is no engine's: the time, or that no engine can tell."""
    return all(isinstance(each, TimeUp | WholeRuns) for each in verdict.obstacles)


#: Engines that leave much open.
LEAVING = (Engine.SEARCH, Engine.INDUCTION, Engine.BITS)


@pytest.mark.parametrize("name", ["lineform", "hvac"])
def test_every_unknown_of_an_example_says_why(name: str) -> None:
    text = (EXAMPLES / f"{name}.krd").read_text(encoding="utf-8")
    assert assert_said(dealt(program_of(text), 2), Engine.SEARCH, name) > 0


@pytest.mark.slow
@pytest.mark.parametrize("path", example_files(), ids=lambda path: path.stem)
def test_every_unknown_of_all_examples_says_why(path: Path) -> None:
    program = program_of(path.read_text(encoding="utf-8"))
    if len(program.agents) == 1:
        for choice in (*LEAVING, Engine.SPACER, Engine.BMC):
            assert_said(dealt(program, 2), choice, path.stem)


@pytest.mark.parametrize("seeds", sampled(range(1), [range(2), range(100, 200)]))
def test_every_unknown_of_generated_programs_says_why(seeds: range) -> None:
    for seed in seeds:
        for choice in LEAVING:
            assert_said(large(Random(seed)), choice, seed)


def test_the_search_names_what_it_cannot_follow() -> None:
    found = {v.claim.name: v.obstacles for v in asked(STARTS, Engine.SEARCH)}
    assert [o.names for o in found["Low"] if isinstance(o, Values)] == [("level",)]
    found = {v.claim.name: v.obstacles for v in asked(OPEN, Engine.SEARCH)}
    assert [o.names for o in found["Near"] if isinstance(o, Values)] == [("Watch.speed",)]
    assert [o.names for o in found["Gone"] if isinstance(o, Values)] == [("Watch.speed",)]


def test_engines_that_know_nothing_of_whole_runs_are_told_from_those_that_do() -> None:
    found = {v.claim.name: v.obstacles for v in asked(OPEN, Engine.INDUCTION)}
    assert found["Gone"] == (WholeRuns(),)


@pytest.mark.parametrize("choice", CHOICES)
def test_when_time_is_up_more_of_it_would_help(choice: Engine | None) -> None:
    left = [v for v in asked(STARTS, choice, 0.0) if v.outcome is Outcome.UNKNOWN]
    assert "Low" in {verdict.claim.name for verdict in left}
    for verdict in left:
        assert any("--timeout" in line for line in obstacles.lines(verdict.obstacles, "Low"))
