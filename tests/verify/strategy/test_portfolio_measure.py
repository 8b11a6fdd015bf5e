"""The measure of `benchmarks/portfolio.py`: who says as much as `auto`, and for whom."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"

Claims = dict[str, tuple[str, int | None, bool]]


@pytest.fixture
def portfolio(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("portfolio")


def answers(portfolio: ModuleType, wall_s: float, claims: Claims) -> Any:
    """A measured answer; claims hold through a round (None: all), perhaps of every number."""
    found = [
        {
            "name": name,
            "outcome": outcome,
            "all_rounds": through is None and outcome == "holds",
            "through_round": through,
            "every_number_of_robots": of_all,
        }
        for name, (outcome, through, of_all) in claims.items()
    ]
    return portfolio.Measured(
        code=0,
        wall_s=wall_s,
        cpu_s=wall_s,
        peak_mib=0.0,
        output=json.dumps({"reports": [{"claims": found}]}),
        errors="",
        timed_out=False,
    )


HERE, EVERYWHERE = ("holds", None, False), ("holds", None, True)


@pytest.mark.parametrize(
    ("said", "as_much", "of_these"),
    [
        ({"A": EVERYWHERE, "B": HERE}, True, True),
        ({"A": HERE, "B": EVERYWHERE}, False, True),
        ({"A": EVERYWHERE, "B": ("holds", 20, False)}, False, False),
        ({"A": ("violated", None, False), "B": HERE}, False, False),
        ({"A": EVERYWHERE}, False, False),
    ],
)
def test_who_says_as_much(
    portfolio: ModuleType, said: Claims, as_much: bool, of_these: bool
) -> None:
    wanted = portfolio.verdicts(answers(portfolio, 1.0, {"A": EVERYWHERE, "B": HERE}))
    found = portfolio.verdicts(answers(portfolio, 1.0, said))
    assert portfolio.settles(found, wanted, of_robots=True) is as_much
    assert portfolio.settles(found, wanted, of_robots=False) is of_these


def test_both_excesses_are_shown(portfolio: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """One beyond whoever says as much of all robots, one beyond whoever has an answer."""
    found = {
        "auto": answers(portfolio, 2.0, {"A": EVERYWHERE}),
        "search": answers(portfolio, 0.5, {"A": HERE}),
        portfolio.EVERY_N: answers(portfolio, 1.5, {"A": EVERYWHERE}),
    }
    unknown = answers(portfolio, 0.1, {"A": ("unknown", 3, False)})
    monkeypatch.setattr(
        portfolio, "verified", lambda row, engine, patience_s: found.get(engine, unknown)
    )
    report = portfolio.Report()
    row = portfolio.beside_engines(report, portfolio.Asked("a row", ()), 40.0)
    assert (row["best"], row["best_of_these"]) == (portfolio.EVERY_N, "search")
    assert (row["excess_s"], row["met"]) == (-0.25, True)
    assert (row["excess_of_these_s"], row["met_of_these"]) == (1.05, False)


def test_rows_that_no_engine_settles_alone_are_compared_for_their_robots(
    portfolio: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {
        "auto": answers(portfolio, 1.0, {"A": EVERYWHERE, "B": HERE}),
        "bits": answers(portfolio, 1.0, {"A": HERE, "B": HERE}),
    }
    every_n = answers(portfolio, 0.1, {"A": EVERYWHERE, "B": ("unknown", 3, False)})
    monkeypatch.setattr(
        portfolio, "verified", lambda row, engine, patience_s: found.get(engine, every_n)
    )
    report = portfolio.Report()
    row = portfolio.beside_engines(report, portfolio.Asked("a row", ()), 40.0)
    assert "best" not in row
    assert row["best_of_these"] == "bits"
    assert row["met_of_these"]
