"""The example programs for every number of robots; what is wrong with some is never proved."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from koord.verify.engines.every_n.questions import GENEROUS, SPARING, ProofBudget
from tests.sampling import but_slow, first
from tests.verify.engines.every_n.asking import asked, proved

EXAMPLES = Path(__file__).parents[4] / "specs" / "examples"

#: The claims that are proved, of each program; None: all of them.
PROVED: dict[str, set[str] | None] = {
    "allstop": {"Together", "Range"},
    "cars_and_drones": None,
    "fischer": None,
    "fischer_drift": None,
    "delivery": None,
    "follow_path": None,
    "leader_elect": None,
    "lineform_1d": None,
    "mapping": None,
    "sum_of_ids": None,
    "waypoints": None,
}


@pytest.mark.parametrize(
    "name",
    first(2, but_slow(["delivery", "allstop", "cars_and_drones", "mapping"], sorted(PROVED))),
)
def test_examples_hold_for_every_number_of_robots(name: str) -> None:
    text = (EXAMPLES / f"{name}.krd").read_text(encoding="utf-8")
    stated = {
        line.split()[1].rstrip(":") for line in text.splitlines() if "invariant " in line[:10]
    }
    wanted = PROVED[name]
    assert proved(text) >= ({*stated, "no fault"} if wanted is None else wanted)


@pytest.mark.slow
def test_what_is_too_much_for_the_solver_is_asked_once_more_with_more_facts() -> None:
    """With this seed it does not come upon a model in which few facts hold, nor need it."""
    text = (EXAMPLES / "sum_of_ids.krd").read_text(encoding="utf-8")
    assert {"Total", "Known"} <= {claim.name for claim in asked(text, seed=3).proved}


@pytest.mark.parametrize(
    ("name", "claims", "thrift"),
    first(
        1,
        [
            ("lineform", {"Fence", "Heard", "Aim", "EndsStand", "no fault"}, SPARING),
            ("task", {"Holds", "Exclusive", "Route", "Along", "Clearance", "no fault"}, SPARING),
            ("follow_points", {"InStep", "Legs", "no fault"}, GENEROUS),
        ],
    ),
    ids=["lineform", "task", "follow_points"],
)
def test_larger_examples(name: str, claims: set[str], thrift: ProofBudget) -> None:
    text = (EXAMPLES / f"{name}.krd").read_text(encoding="utf-8")
    assert {claim.name for claim in asked(text, thrift).proved} >= claims


def violated() -> list[tuple[str, set[str]]]:
    """Of the broken programs, as they come, the claims that are known to be violated."""
    expected = yaml.safe_load((EXAMPLES / "expected.yaml").read_text(encoding="utf-8"))
    found = []
    for name, entry in sorted(expected.items()):
        says = [run.get("says", {}) for run in entry["runs"] if "set" not in run]
        bad = {k for said in says for k, what in said.items() if what.startswith("violated")}
        if name.startswith("broken/") and bad and "delta" not in entry["runs"][0]:
            found.append((name, bad))
    return found


SLOW = {
    "task_no_lock",
    "allstop_alone",
    "cars_and_drones_low",
    "follow_path_takeoff",
    "mapping_blind",
    "sats2_out_of_turn",
    "sats_report_for_ever",
    "follow_points_ahead",
    "lineform_ends",
    "shapeform_edge",
    "delivery_no_lock",
    "sum_of_ids_after_you",
    "shortest_path_one_way",
}


@pytest.mark.parametrize(
    ("name", "bad"),
    first(
        6,
        [
            pytest.param(n, b, id=Path(n).stem, marks=[pytest.mark.slow] * (Path(n).stem in SLOW))
            for n, b in violated()
        ],
    ),
)
def test_what_is_violated_is_never_proved(name: str, bad: set[str]) -> None:
    assert not proved((EXAMPLES / name).read_text(encoding="utf-8")) & bad
