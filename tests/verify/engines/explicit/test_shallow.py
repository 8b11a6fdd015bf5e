"""What is violated soon is told soon: before proofs are looked for that cannot be found."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.syntax.budget import Budget
from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools, Workers
from koord.verify.engines.every_n.candidates import candidates
from koord.verify.engines.every_n.proving import infer
from koord.verify.engines.every_n.questions import SPARING
from koord.verify.engines.explicit.engine import ExplicitEngine
from koord.verify.engines.explicit.limits import HANDFUL
from koord.verify.ledger import Ledger
from koord.verify.processes import Pool
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy.table import EngineTurn
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.verify.asking import of_text

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"

#: The shortest ways, where a neighbour is no hop away.
SHORTEST = (EXAMPLES / "shortest_path.krd").read_text("utf-8").replace("known[k] + 1", "known[k]")

#: Infinitely many readings, so that no search looks at it.
SENSED = """\
using Motion:
    sensors:
        float level
local:
    float x = 0
Read:
    eff: x = Motion.level
invariant Small: forall i: x@i < 4
"""


def until(system: System, told: str) -> tuple[Report, list[str]]:
    """What is known when somebody presses Ctrl-C as soon as something is told."""
    seen: list[str] = []

    def progress(text: str) -> None:
        seen.append(text)
        if told in text:
            raise KeyboardInterrupt

    return verify(system, Bounds(20), progress=progress), seen


def test_a_shallow_violation_is_told_before_any_proof() -> None:
    report, _ = until(of_text(SHORTEST, robots=7), "every N")
    found = {v.claim.name: v for v in report.verdicts}
    assert report.interrupted
    for name, round_ in (("NeverTooShort", 1), ("Exact", 3)):
        verdict = found[name]
        assert (verdict.outcome, verdict.engine) == (Outcome.VIOLATED, Engine.SEARCH)
        assert verdict.counterexample is not None
        assert verdict.counterexample.round == round_
        assert verdict.fewest
    assert found["Source"].outcome is Outcome.UNKNOWN


def test_what_no_search_finds_is_told_before_engines_go_on_for_long() -> None:
    """Proofs for every number of robots are given up after a head start, for rounds one by one."""
    seen: list[str] = []
    report = verify(of_text(SENSED), Bounds(20), progress=seen.append)
    (small, _) = report.verdicts
    assert (small.outcome, small.engine) == (Outcome.VIOLATED, Engine.BMC)
    assert small.fewest
    assert small.counterexample is not None
    assert small.counterexample.round == 1
    assert any("bmc, round" in text for text in seen)
    assert not any(text.startswith(("bits", "spacer")) for text in seen)


def shallow(evaluations: int) -> Task:
    """A look at the first configurations."""
    return Task(Purpose.REFUTE, states=HANDFUL, evaluations=evaluations)


def test_a_shallow_search_says_nothing_of_what_holds() -> None:
    """Others say more of it: that it holds for every number of robots."""
    system = of_text(
        "local:\n    int x = 0\nUp:\n    pre: x < 2\n    eff: x = 2\n"
        "invariant Fine: forall i: x@i != 1\ninvariant Low: forall i: x@i < 2\n"
    )
    ledger = Ledger(plain_problem(system), Bounds(20), Deadline(), claims_of(system))
    ExplicitEngine(Tools(Pool(1))).work(ledger, shallow(3_000))
    fine, low, _ = (ledger.verdict(claim) for claim in ledger.claims)
    assert low.outcome is Outcome.VIOLATED
    assert (fine.outcome, fine.engine, fine.rounds) == (Outcome.UNKNOWN, Engine.NONE, None)


def counting(system: System) -> tuple[System, list[int]]:
    """The system, and how often somebody asked whether there is budget left."""
    asked = [0]

    def is_over() -> bool:
        asked[0] += 1
        return False

    return replace(system, budget=Budget(is_over)), asked


@pytest.mark.parametrize("steps", [500, 1_000])
def test_a_shallow_search_keeps_to_its_steps(steps: int) -> None:
    system, asked = counting(of_text((EXAMPLES / "fischer.krd").read_text("utf-8"), robots=3))
    ledger = Ledger(plain_problem(system), Bounds(20), Deadline(), claims_of(system))
    EngineTurn(Engine.SEARCH, shallow(steps), Workers(Pool(1))).work(ledger)
    assert 0 < asked[0] <= steps // 100 + 1


def test_looking_for_invariants_keeps_to_its_steps() -> None:
    """They are counted, so that it is the same on every machine."""
    system, asked = counting(of_text(SHORTEST, robots=7))
    claims, likely = claims_of(system), candidates(system.program)
    brief = replace(SPARING, seconds=0.05)
    found = infer(system, claims, likely, Deadline(), Effort.of_seconds(1), brief)
    assert found.proved == ()
    assert 0 < asked[0] <= 5 + 1
