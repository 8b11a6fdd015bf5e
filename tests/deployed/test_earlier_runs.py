"""Datagrams of a run that was, with the same key and the same name: nobody takes them for new."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle, islice
from pathlib import Path

import pytest

from tests.deployed.conftest import MakeFleet
from tests.deployed.fleet import UNHURRIED_S, Fleet
from tests.deployed.proxy import Datagram


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Datagram]:
    """All that was sent in a run of three robots, of whom one crashed and came back."""
    pytest.importorskip("mcap")
    with Fleet(tmp_path_factory.mktemp("earlier"), 3) as fleet:
        recorded = fleet.proxy.record()
        fleet.start_all()
        fleet.until_round(20)
        fleet[2].kill()
        fleet.again(2)
        fleet.until_further(20)
        fleet.stop()
    return tuple(recorded)


def _dropped(fleet: Fleet) -> int:
    return sum(sum(one.drops().values()) for one in fleet)


def test_a_run_begins_and_goes_on_as_if_there_had_been_none_before(
    fleet_of: MakeFleet, earlier: Sequence[Datagram]
) -> None:
    """They come before it begins, while its robots look for each other, at once and afterwards."""
    fleet = fleet_of(3, delta_s=UNHURRIED_S)
    for pid in range(3):
        fleet.start(pid)
        fleet.heard_at_s(str(pid))
        fleet.proxy.replay(earlier)
    fleet.until_round(2, within_s=5.0)
    before = _dropped(fleet)
    sent = fleet.proxy.replay(earlier)
    fleet.until_further(6, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert _dropped(fleet) - before >= 0.95 * sent
    for one in fleet:
        assert one.report["trouble"] is None
        assert one.report["late"] <= 1
        assert one.report["overdue"] <= 2


def test_a_robot_that_is_cut_off_acts_on_no_round_of_another_run(
    fleet_of: MakeFleet, earlier: Sequence[Datagram]
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    fleet.proxy.cut = frozenset({"2"})
    fleet.until_further(3, 0, 1)
    fleet.until(lambda: fleet[2].status["holding"] is not None, "held")
    alone = fleet[2].round
    fleet.proxy.replay(one for one in earlier if one.to == 2)
    fleet.until_further(10, 0, 1)
    assert fleet[2].round == alone
    fleet.proxy.cut = frozenset()
    fleet.until_further(5, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []


@pytest.mark.slow
def test_what_the_leader_of_another_run_said_first_keeps_nobody_waiting(
    fleet_of: MakeFleet, earlier: Sequence[Datagram]
) -> None:
    """Not even if it comes all the time while robots agree on their run."""
    first = [next(one for one in earlier if (one.sender, one.to) == (0, to)) for to in (1, 2)]
    fleet = fleet_of(3)
    fleet.start(0)
    fleet.start(1)
    fleet.heard_at_s("0", "1")
    fleet.start(2)
    while not fleet.is_heard("2"):
        fleet.proxy.replay(islice(cycle(first), 100))
    fleet.proxy.replay(islice(cycle(first), 3_000))
    fleet.until_round(5, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []


@pytest.mark.slow
def test_a_robot_that_is_alone_begins_no_run_of_old_datagrams(
    fleet_of: MakeFleet, earlier: Sequence[Datagram]
) -> None:
    fleet = fleet_of(3)
    fleet.start(2)
    fleet.heard_at_s("2")
    sent = fleet.proxy.replay(one for one in earlier if one.to == 2)
    fleet.until(lambda: _dropped(fleet) >= 0.95 * sent, "all dropped", 3.0)
    assert fleet[2].rounds == []


def _ran_since(fleet: Fleet, before: Sequence[int]) -> bool:
    """Return whether every robot has run events since they had run so many."""
    return all(one.status["ran"] > ran for one, ran in zip(fleet, before, strict=True))


@pytest.mark.slow
def test_no_single_datagram_of_another_run_silences_a_robot(
    fleet_of: MakeFleet, earlier: Sequence[Datagram]
) -> None:
    """Least of all one that it sent after a crash, which it has not had in this run."""
    fleet = fleet_of(3, delta_s=0.1)
    fleet.start_all()
    fleet.until_round(5)
    kinds = {(one.sender, one.to, len(one.data)): one for one in earlier}
    for number, one in enumerate(islice(kinds.values(), 200), 1):
        fleet.proxy.inject(one.to, one.data, one.sender)
        if number % 10 == 0:
            # Whoever is silenced is late in all rounds from then on, and runs none of them. How
            # many rounds run in time says nothing: a machine that is loaded makes robots late.
            before = [one.status["ran"] for one in fleet]
            fleet.until(partial(_ran_since, fleet, before), "run by all robots")
    fleet.stop()
    assert fleet.disagreements() == []


@pytest.mark.slow
def test_a_robot_that_comes_back_is_not_shown_another_run(
    fleet_of: MakeFleet, earlier: Sequence[Datagram], tmp_path: Path
) -> None:
    """With its journal or without: what it is told while it asks comes from this run."""
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(10)
    for state in (None, tmp_path / "elsewhere"):
        fleet[2].kill()
        fleet.again(2, state=state)
        fleet.heard_at_s("2")
        fleet.proxy.replay(earlier)
        fleet.until_further(10, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
