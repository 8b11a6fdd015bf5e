"""What strangers send to robots: nothing of it delays them, and all of it is counted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice

import pytest

from tests.deployed.conftest import MakeFleet
from tests.deployed.fleet import UNHURRIED_S, Fleet
from tests.deployed.floods import KINDS, Flood
from tests.deployed.proxy import Datagram


@pytest.mark.parametrize(
    "encrypts", [False, pytest.param(True, marks=(pytest.mark.slow, pytest.mark.sample))]
)
@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_floods_delay_nobody(fleet_of: MakeFleet, count: int, encrypts: bool) -> None:
    if encrypts:
        pytest.importorskip("cryptography")
    fleet = fleet_of(3, encrypts=encrypts, delta_s=UNHURRIED_S)
    recorded = fleet.proxy.record()
    fleet.start_all()
    fleet.until_round(8)
    known = [one.data for one in recorded]
    begun = fleet.round
    usual = {one.pid: one.status["late"] for one in fleet}
    sent = 0
    for number, kind in enumerate(KINDS):
        sent += fleet.proxy.flood((0, 1, 2), Flood(kind, known, seed=number).of(count))
    fleet.until_further(5)
    fleet.stop()
    assert fleet.disagreements() == []
    lasted = fleet.round - begun
    for one in fleet:
        late = one.report["late"] - usual[one.pid]
        assert late <= 1 + 0.02 * lasted
        assert [said.round for said in one.rounds] == list(range(-1, one.report["round"]))
    counted = sum(sum(one.drops().values()) for one in fleet)
    assert counted >= 0.9 * sent


@pytest.fixture(scope="module")
def beginnings(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Datagram]:
    """How robots of another run found each other, and how one of them came back."""
    pytest.importorskip("mcap")
    with Fleet(tmp_path_factory.mktemp("beginnings"), 3) as fleet:
        recorded = fleet.proxy.record()
        fleet.start_all()
        fleet.until_round(0)
        fleet[2].kill()
        fleet.again(2)
        fleet.until_further(3)
    return tuple(recorded)


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_beginnings_of_other_runs_keep_no_run_from_beginning(
    fleet_of: MakeFleet, beginnings: Sequence[Datagram], count: int
) -> None:
    """Those of an earlier one, its own ones as they were recorded, and damaged ones of both."""
    fleet = fleet_of(3, delta_s=UNHURRIED_S)
    own = fleet.proxy.record()
    fleet.start(0)
    fleet.start(1)
    fleet.heard_at_s("0", "1")
    fleet.proxy.replay(islice(cycle(beginnings), count // 2))
    known = [one.data for one in (*beginnings, *own)]
    for number, kind in enumerate(KINDS):
        fleet.proxy.flood((0, 1), Flood(kind, known, seed=number).of(count // 10))
    fleet.start(2)
    fleet.heard_at_s("2")
    fleet.until_round(3, within_s=5.0)
    fleet.proxy.replay(own[: count // 2])
    fleet.until_further(5, within_s=5.0)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["late"] <= 1 for one in fleet)
