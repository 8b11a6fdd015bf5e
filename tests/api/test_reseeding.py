"""Runs that differ in their seeds alone: what they have in common is made once."""

from __future__ import annotations

import threading
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from koord.api import fitting, reseeding
from koord.api.campaign_runs import Order, Row, row_of
from koord.api.fitting import FitRequest, fit, fit_request
from koord.api.programs import CheckReport, checked
from koord.api.reseeding import Reseeding
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import Source

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

#: A list of tasks whose length an assumption fixes.
ASSUMED = Source(
    "assumed.krd",
    """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target

allwrite:
    Task[] list

local:
    int k = 0

Go:
    pre: k < length(list)
    eff:
        Motion.target = list[k].loc
        k = k + 1

assume Three: length(list) == 3
""",
)

SCATTERED = Source(
    "scattered.yaml",
    """\
agents: [{pid: 0, on_device: car}, {pid: 1, on_device: car}]
devices:
    car: {bot_type: IDEAL, planner: STRAIGHT}
world:
    bounds: {low: [-3.5, -4, 0], high: [3.5, 4, 3]}
    scattered: 3
""",
)


def asked(program: str | Source, configuration: str | Source | None) -> FitRequest:
    named = EXAMPLES / program if isinstance(program, str) else program
    config = EXAMPLES / configuration if isinstance(configuration, str) else configuration
    return fit_request(named, config, None, None, 0, None)


def seeded(request: FitRequest, seed: int) -> FitRequest:
    return msgspec.structs.replace(request, seed=seed)


def row(request: FitRequest, seed: int) -> Row:
    made = row_of(Order(seeded(request, seed), None, 0.3, True, ""))
    assert made is not None
    return msgspec.structs.replace(made, wall_s=0.0, cpu_s=0.0, memory_mib=0.0, threads=0)


@pytest.mark.parametrize(
    ("program", "configuration"),
    [
        ("task.krd", "task.yaml"),  # robots and tasks by chance
        ("task.krd", "task_mixed.yaml"),  # neither
        ("delivery.krd", "delivery.yaml"),
        ("lineform.krd", "lineform.yaml"),
        (ASSUMED, SCATTERED),
    ],
)
def test_what_is_made_for_a_seed_is_what_would_be_made_anew(
    program: str | Source, configuration: str | Source
) -> None:
    request = asked(program, configuration)
    made = Reseeding(request)
    for seed in (2, 0, 1, 2):
        fitted, built = made.run(seed)
        anew = fit(seeded(request, seed))
        assert fitted == anew
        assert built.cast.differing == anew.problem.differing


def test_texts_are_elaborated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = [Reseeding(asked("task.krd", "task.yaml")), Reseeding(asked(ASSUMED, SCATTERED))]

    def never(*_: object) -> None:
        raise AssertionError("again")

    monkeypatch.setattr(reseeding, "fit", never)
    monkeypatch.setattr(reseeding, "elaborated", never)
    for one in made:
        places = [one.run(seed)[0].scene.world.tasks for seed in range(3)]
        assert len(set(places)) == 3


@pytest.mark.parametrize(
    ("program", "configuration"), [("task.krd", "task.yaml"), (ASSUMED, SCATTERED)]
)
def test_rows_do_not_hang_on_the_runs_before(
    program: str | Source, configuration: str | Source, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = asked(program, configuration)
    rows = [row(request, seed) for seed in (0, 1, 2)]
    assert len({one.digest for one in rows}) == 3

    # The way that each run went before, from the text on.
    monkeypatch.setattr(Reseeding, "_fitted", lambda *_: None)
    assert [row(request, seed) for seed in (2, 0, 1)] == [rows[2], rows[0], rows[1]]


def test_a_seed_with_which_something_is_wrong_is_told_as_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    request = asked(ASSUMED, SCATTERED)
    made = Reseeding(request)

    def refused(*_: object, **__: object) -> None:
        raise refusal("K931", "here", "there is no room")

    monkeypatch.setattr(reseeding, "scene", refused)
    assert made.run(1)[0] == fit(seeded(request, 1))
    monkeypatch.setattr("koord.sim.scene.scene", refused)
    with pytest.raises(KoordError, match="there is no room"):
        made.run(1)


def test_what_was_elaborated_is_not_elaborated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither by who looks at the request first; but other values are."""
    request, times = asked("task.krd", "task.yaml"), list[object]()

    def counted(*given: Any) -> CheckReport:
        times.append(given)
        return checked(*given)

    monkeypatch.setattr(fitting, "checked", counted)
    monkeypatch.setattr(fitting, "_LAST", threading.local())
    first = fit(request)
    Reseeding(request)
    assert len(times) == 5  # where each asks for itself it is 8
    path = asked("follow_path.krd", None)
    cores = [fit(replace(path, params={"height": h})).program.core for h in (1, 2, 1, Fraction(1))]
    assert cores[0] == cores[2] != cores[1]
    assert fit(request).program.core == first.program.core
