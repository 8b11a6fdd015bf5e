"""Invariants that were found for a proof, as they are shown."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

import koord
from koord.api.verify_report import VerifyReport
from koord.cli import verdicts
from koord.cli.terminal import Style
from koord.cli.verdicts import MOST_SHOWN
from koord.syntax import core
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.syntax.types import BOOL
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds
from tests.loading import program_of

TEXT = """
allwrite:
    int n = 0
Step:
    pre: n < 3
    eff: atomic: n = n + 1
invariant Small: n <= 3
"""


def _shown(lengths: list[int]) -> list[str]:
    """What is said of invariants that say so many times that Small is so."""
    system = dealt(program_of(TEXT), 1)
    report = verify(system, Bounds(2))
    (small,) = system.program.properties

    def said(times: int) -> core.Property:
        whole = small.condition
        for _ in range(times - 1):
            whole = core.Binary(core.BinaryOp.AND, whole, small.condition, BOOL)
        return replace(small, name="", condition=whole)

    lemmas = tuple(said(times) for times in lengths)
    first, *rest = report.verdicts
    found = replace(report, verdicts=(replace(first, lemmas=lemmas), *rest))
    whole = VerifyReport(koord.load(Source("small.krd", TEXT)), system, Bounds(2), found)
    text = "\n".join(verdicts.lines(whole, Style()))
    _, _, after = text.partition("invariants that were found for it:\n")
    return [line.strip() for line in after.split("\n\n")[0].splitlines()]


@pytest.mark.parametrize(
    ("lengths", "shown", "rest"),
    [
        ([1, 2], 2, []),
        ([1, 40, 2], 2, ["… 1 more: --save-invariants FILE writes them all"]),
        ([40, 50], 0, ["… 2 long ones: --save-invariants FILE writes them all"]),
        (
            [*range(1, MOST_SHOWN + 3)],
            MOST_SHOWN,
            ["… 2 more: --save-invariants FILE writes them all"],
        ),
    ],
)
def test_long_ones_are_counted_and_not_shown(
    lengths: list[int], shown: int, rest: list[str]
) -> None:
    lines = _shown(lengths)
    assert lines[shown:] == rest
    assert all(line.startswith("n <= 3") for line in lines[:shown])
