"""What is looked for after the verdicts is named, bounded, and told of where it was given up."""

from __future__ import annotations

import pytest

from koord.syntax.system import System, dealt
from koord.verify.effort import Deadline
from koord.verify.ledger import Ledger
from koord.verify.strategy.verification import verify
from koord.verify.vacuity import analysis
from koord.verify.verdicts import Bounds, Emptiness, Outcome, Report
from tests.loading import program_of

TEXT = """
local:
    int n = 0
Up:
    pre: n < 3
    eff: n = n + 1
Never:
    pre: n > 7
    eff: n = 0
invariant Few: forall i: n@i > 8 implies n@i < 3
invariant Small: forall i: n@i <= 3
"""


@pytest.fixture
def system() -> System:
    return dealt(program_of(TEXT), 2)


def named(report: Report) -> list[str]:
    return [each.what.of(each.subject) for each in report.unlooked]


def test_with_time_for_it_nothing_is_left_open(system: System) -> None:
    report = verify(system, Bounds(4))
    assert report.unlooked == ()
    found = {(v.what, v.subject) for v in report.vacuities if v.certain}
    assert found >= {(Emptiness.EVENT, "Never"), (Emptiness.SUPPOSITION, "Few")}


def test_what_it_is_not_worth_to_look_for_is_named(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(analysis, "_worth", lambda ledger, *, every_n=False: 0.0)
    report = verify(system, Bounds(4))
    assert report.outcome is Outcome.HOLDS
    assert not report.interrupted
    assert named(report) == ["event Up", "event Never", "what Few supposes"]


def test_it_is_worth_more_where_verdicts_took_longer(system: System) -> None:
    class Took(Ledger):
        def verdict(self, claim):  # type: ignore[no-untyped-def]
            return type("Verdict", (), {"seconds": self.bounds.timeout_s})

    def worth(seconds: float) -> float:
        bounds = Bounds(4, seconds)
        return analysis._worth(
            Took(None, bounds, Deadline(), ("any",))  # type: ignore[arg-type]
        )

    assert worth(0.1) == analysis.WORTH_S
    assert worth(100.0) == 100.0 * analysis.WORTH


def test_the_live_line_says_what_is_looked_for(system: System) -> None:
    told: list[str] = []
    verify(system, Bounds(4), progress=told.append)
    looked = [text for text in told if text.startswith("looking for what never happens: ")]
    assert any("event Up, event Never and 1 more" in text for text in looked)
