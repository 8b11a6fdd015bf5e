"""Once all that was asked is answered, not much more work is done."""

from __future__ import annotations

import pytest

from koord.verify import ledger
from koord.verify.engine_names import Engine
from koord.verify.obstacles import TimeUp
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.verify.asking import of_text

#: Sums of squares are no 7, which no engine here proves.
SQUARES = """\
local:
    int x = 0
    int y = 0
Go:
    eff:
        y = y + x * x
        x = x + 1
invariant NotSeven: forall i: y@i != 7
"""


def asked(work_s: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Report, set[str]]:
    """What is said, and which engines were asked after all was answered."""
    monkeypatch.setattr(ledger, "ANSWERED_ALL_S", work_s)
    told: set[str] = set()

    def progress(text: str) -> None:
        if "answered; " in text:
            told.add(text.split(": ")[1].split(",")[0].split(" ")[0])

    system = of_text(SQUARES, robots=1)
    return verify(system, Bounds(2), progress=progress), told


@pytest.mark.slow
def test_nobody_is_asked_once_all_is_answered_and_the_work_is_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    report, told = asked(0.0, monkeypatch)
    verdict = report.verdicts[0]
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.rounds is not None
    assert not told & {Engine.SEARCH.value, Engine.BITS.value}
    # Whoever gave more time would know no more.
    assert not any(isinstance(each, TimeUp) for each in verdict.obstacles)


@pytest.mark.slow
def test_some_work_is_done_for_all_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    report, told = asked(20.0, monkeypatch)
    assert report.verdicts[0].outcome is Outcome.HOLDS
    assert Engine.BITS.value in told
