"""A run is one program, one key and one team: who does not belong to it is named."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec import Struct

from tests.deployed.conftest import MakeFleet
from tests.deployed.fleet import RobotProcess
from tests.deployed.recordings import LEDGER
from tests.sampling import sampled

#: Whoever does not belong to a run is named so soon after both sides have spoken.
SOON_S = 2.0


class Difference(Struct, frozen=True):
    """What is different on a robot: fields of its start, and what has to be said of it."""

    told: str
    fields: dict[str, Any] = {}
    replaced: tuple[str, str] | None = None  #: a text in the program, and what stands there

    def __str__(self) -> str:
        return self.told.partition("|")[0]

    def changes(self, folder: Path) -> dict[str, Any]:
        """The fields of the robot's start; a program that is another is put into a folder."""
        if not self.replaced:
            return self.fields
        path = folder / "ledger.krd"
        path.write_text(
            LEDGER.read_text(encoding="utf-8").replace(*self.replaced), encoding="utf-8"
        )
        return {**self.fields, "program": path}


DIFFERENCES = [
    Difference("param step|step", {"settings": ("step=2",)}),
    Difference("program|Mark", replaced=("31 * mark[pid]", "37 * mark[pid]")),
    Difference("key", {"key": "another secret of theirs"}),
    Difference("encryption", {"encrypts": True}),
    Difference("leader", {"leader": 1}),
    Difference("delta|δ", {"delta_s": 0.07}),
]


def _named(differences: list[Difference]) -> str:
    return str(differences[0]) if len(differences) == 1 else "all of them"


@pytest.mark.parametrize(
    "differences", sampled(DIFFERENCES, ([one] for one in DIFFERENCES)), ids=_named
)
def test_robots_that_differ_are_named_on_both_sides(
    fleet_of: MakeFleet, tmp_path: Path, differences: list[Difference]
) -> None:
    fleet = fleet_of(1 + len(differences))
    fleet.start(0)
    for pid, difference in enumerate(differences, 1):
        fleet.start(pid, **difference.changes(tmp_path))
    by_s = fleet.heard_at_s(*map(str, range(fleet.robots))) + SOON_S
    for pid, difference in enumerate(differences, 1):
        fleet.until_said(fleet[pid], difference.told, by_s)
        fleet.until_said(fleet[0], rf"robot {pid}\b.*({difference.told})", by_s)
    assert fleet.round == -1


@pytest.mark.slow
@pytest.mark.parametrize("difference", DIFFERENCES, ids=str)
def test_a_robot_that_comes_back_different_is_named_while_the_others_go_on(
    fleet_of: MakeFleet, tmp_path: Path, difference: Difference
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet[2].kill()
    fleet.again(2, **difference.changes(tmp_path))
    by_s = fleet.heard_at_s("2") + SOON_S
    fleet.until_said(fleet[2], difference.told, by_s)
    fleet.until_said(fleet[0], rf"robot 2\b.*({difference.told})", by_s)
    fleet.until_further(10, 0, 1)
    assert fleet[2].rounds == []
    fleet.stop()
    assert fleet.disagreements() == []


def test_the_same_text_under_another_path_is_the_same_program(
    fleet_of: MakeFleet, tmp_path: Path
) -> None:
    other = tmp_path / "elsewhere.krd"
    other.write_bytes(LEDGER.read_bytes())
    fleet = fleet_of(2)
    fleet.start(0)
    fleet.start(1, program=other)
    fleet.heard_at_s("0", "1")
    fleet.until_round(5, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []


@pytest.mark.parametrize("is_late", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_two_processes_of_one_robot_are_named(fleet_of: MakeFleet, is_late: bool) -> None:
    """By the others, and by that of both which is not heard: who runs knows of no other."""
    fleet = fleet_of(3)
    fleet.start_all()
    if is_late:
        fleet.until_round(5)
    twin = fleet.start(2, seat="2b")
    by_s = fleet.heard_at_s("0", "1", "2", "2b") + SOON_S
    fleet.until_said(fleet[0], r"robot 2\b", by_s)
    fleet.until_further(5, 0, 1)

    def is_known(one: RobotProcess) -> bool:
        """Whether a process is heard, or tells of the other."""
        is_told = one.has_said("robot 2.*(two|another|twice)")
        return bool(is_told) or one.rounds[-1].round > fleet.round - 9

    for one in (fleet[2], twin):
        fleet.until(partial(is_known, one), "heard, or told of the other")
    fleet.stop()
    assert fleet.disagreements() == []


def test_a_second_process_at_one_address_is_refused(fleet_of: MakeFleet) -> None:
    fleet = fleet_of(1)
    first = fleet.start(0)
    fleet.until_round(2)
    second = fleet.again(0)
    assert second.end() == 2
    assert "cannot be listened on" in second.out
    before = first.round
    fleet.until(lambda: first.round > before + 2, "going on")
