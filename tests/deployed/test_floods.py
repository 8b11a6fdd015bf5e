"""What strangers send to robots: nothing of it delays them, and all of it is counted."""

from __future__ import annotations

import pytest

from tests.deployed.conftest import MakeFleet
from tests.deployed.floods import KINDS, Flood


@pytest.mark.parametrize("count", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_floods_delay_nobody(fleet_of: MakeFleet, count: int) -> None:
    fleet = fleet_of(3)
    recorded = fleet.proxy.record()
    fleet.start_all()
    fleet.until_round(30)
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
        assert late <= usual[one.pid] + 0.02 * lasted
        assert [said.round for said in one.rounds] == list(range(-1, one.report["round"]))
    counted = sum(sum(one.drops().values()) for one in fleet)
    assert counted >= 0.9 * sent
