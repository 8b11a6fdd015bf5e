"""Long work ends when nobody waits any longer, and what is half done does not count."""

from __future__ import annotations

import json
from itertools import count
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.cli import run
from koord.cli.exits import Exit
from koord.cli.main import main
from koord.syntax.budget import Budget, OutOfBudgetError
from koord.syntax.system import System, dealt
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.property_checks import OutOfBounds
from koord.verify.engines.explicit.search import survey
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.loading import program_of
from tests.sampling import first
from tests.semantics.driving import drive

LONG = """\
local:
  int x = 0
Count:
  eff:
    for i = 0, 1000:
      for j = 0, 300:
        x = x + 1
"""

#: Every order of writes counts, and the formula of a round grows with the square of the robots.
WIDE = f"""\
allwrite:
  int x = 0
  int[30] cells = [{", ".join("0" * 30)}]
Go:
  eff:
    cells[x % 30] = pid
    x = x + cells[(x + pid) % 30]
invariant Small: x < 1000
"""

#: A body that is long without any loop: so long that the verifier would write terms for an hour.
MANY = (
    "def fun f(int a) -> int:\n"
    + "".join(f"  if a == {n}: return {n * n}\n" for n in range(2_000))
    + "  return 0\nlocal:\n  int x = 0\nGo:\n  eff: x = f(x)\n"
)


def system(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def after(asks: int) -> Budget:
    """The budget of somebody who waits for so many looks at the clock."""
    looks = count()
    return Budget(lambda: next(looks) >= asks)


def test_a_turn_is_cut_short() -> None:
    driven = drive(system(LONG).program, 1)
    driven.run.system = replace(driven.run.system, budget=after(3))
    before = driven.run.configuration
    with pytest.raises(OutOfBudgetError):
        driven.go(0, "Count")
    assert driven.run.configuration is before


@pytest.mark.parametrize("choice", first(1, [Engine.BMC, Engine.INDUCTION, None]))
@pytest.mark.parametrize("text", [WIDE, MANY], ids=["wide", "many"])
def test_writing_formulas_ends_in_time(text: str, choice: Engine | None) -> None:
    report = verify(system(text, 12), Bounds(rounds=50, timeout_s=0.01), choice)
    assert report.outcome is Outcome.UNKNOWN
    assert not report.interrupted
    assert {verdict.reason for verdict in report.verdicts} == {"timeout"}


@pytest.mark.parametrize(
    "text", first(2, [LONG + "invariant Small: x < 7\n", WIDE, MANY]), ids=["long", "wide", "many"]
)
def test_a_verification_can_be_interrupted_while_it_writes(text: str) -> None:
    looks = count()
    report = verify(system(text, 12), Bounds(rounds=50), interrupted=lambda: next(looks) >= 5)
    assert report.interrupted
    assert "interrupted" in {verdict.reason for verdict in report.verdicts}


@pytest.mark.parametrize("at_once", [1, 70, 1_000])
def test_work_counts_however_much_is_spent_at_once(at_once: int) -> None:
    heard: list[int] = []
    whole = Budget(lambda: False, heard=heard.append)

    def work(budget: Budget) -> None:
        for _ in range(7_000 // at_once):
            budget.spend(at_once)

    work(whole)
    assert 6_900 <= sum(heard) <= 7_000
    with pytest.raises(OutOfBudgetError):
        work(whole.rationed(5_000))


def test_a_search_ends_inside_of_a_state() -> None:
    subject = replace(system(LONG), budget=after(3))
    found = survey(subject, ()).end
    assert isinstance(found, OutOfBounds)
    assert found.reason == "out of time"


def test_a_run_that_is_interrupted_in_a_turn_keeps_what_was_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Impatient:
        """Interrupted when it was asked so often."""

        @property
        def requested(self) -> bool:
            return next(looks) >= 60

        def __enter__(self) -> Impatient:
            return self

        def __exit__(self, *story: object) -> None:
            return None

    looks = count()
    monkeypatch.setattr(run, "Interruption", Impatient)
    monkeypatch.chdir(tmp_path)
    Path("long.krd").write_text(LONG.replace("1000", "10"), encoding="utf-8")
    arguments = ["run", "long.krd", "--robots", "3", "--rounds", "9", "--trace", "t.json"]
    assert main(arguments) == Exit.INTERRUPTED
    assert "interrupted after 0 rounds" in capsys.readouterr().out
    document = json.loads(Path("t.json").read_text("utf-8"))
    (cut,) = document["run"]["rounds"]
    assert cut["order"] == [0, 1, 2][: len(cut["order"])]
    assert 1 <= len(cut["order"]) < 3
    assert main(["replay", "t.json"]) == Exit.OK


# --- as deep as may be --------------------------------------------------------------------------


def nested(bodies: int, depth: int) -> str:
    """Functions that call each other from deep inside of conditions."""
    made = ["def fun f0(int a) -> bool:\n  return a > 0\n"]
    for n in range(1, bodies):
        inner = f"f{n - 1}(a)"
        for k in range(depth):
            inner = f"({inner} {'and' if k % 2 else 'or'} a < {k})"
        made.append(f"def fun f{n}(int a) -> bool:\n  return {inner}\n")
    return "".join(made) + (
        f"local:\n  int x = 0\nGo:\n  eff:\n    if f{bodies - 1}(x): x = 1\n"
        f"invariant Deep: forall i: f{bodies - 1}(x@i) implies x@i >= 0\n"
    )


def looped(bodies: int, depth: int) -> str:
    """Functions that call each other from deep inside of loops."""
    made = ["def fun f0(int a) -> int:\n  return a + 1\n"]
    for n in range(1, bodies):
        loops = "".join(f"  {'  ' * k}for i{k} = 0, 1:\n" for k in range(depth))
        inner = f"  {'  ' * depth}if a < 9: r = f{n - 1}(r)\n"
        made.append(f"def fun f{n}(int a) -> int:\n  int r = a\n{loops}{inner}  return r\n")
    return "".join(made) + f"local:\n  int x = 0\nGo:\n  eff: x = f{bodies - 1}(x)\n"


@pytest.mark.parametrize(
    "text",
    [nested(2, 95), nested(3, 70), nested(20, 5), looped(2, 45), looped(4, 22), looped(12, 4)],
    ids=["expression", "expressions", "calls", "loops", "loops of loops", "short loops"],
)
@pytest.mark.parametrize("choice", [Engine.BMC, Engine.SEARCH])
def test_what_is_as_deep_as_may_be_overflows_nobody(text: str, choice: Engine | None) -> None:
    subject = system(text, 1)
    report = verify(subject, Bounds(rounds=1, timeout_s=0.5), choice)
    assert report.outcome in (Outcome.HOLDS, Outcome.UNKNOWN)
    drive(subject.program, 1).round("Go")
