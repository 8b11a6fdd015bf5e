"""Fleets whose robots crash all the time, on a network that loses, doubles, delays and reorders."""

from __future__ import annotations

from random import Random

import pytest

from koord.runtime.chaos.network import Faults
from tests.deployed.conftest import MakeFleet
from tests.sampling import first

#: Not so bad that a fleet of these rounds could not go on at all.
_STORM = Faults(loss=0.1, duplication=0.1, least_delay_s=0.0, most_delay_s=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_any_number_crashes_in_a_storm_and_the_run_goes_on(fleet_of: MakeFleet, seed: int) -> None:
    draw = Random(seed)
    fleet = fleet_of(4)
    fleet.proxy.faults = _STORM
    fleet.start_all()
    fleet.until_round(5)
    for _ in range(6):
        crashed = [pid for pid in range(4) if draw.random() < 0.5] or [draw.randrange(4)]
        for pid in crashed:
            fleet[pid].kill()
        for pid in crashed:
            fleet.again(pid)
        fleet.until_further(draw.randrange(3, 15), within_s=20.0)
    fleet.proxy.faults = Faults(least_delay_s=0.0, most_delay_s=0.0)
    fleet.until_further(10)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["trouble"] is None for one in fleet)


@pytest.mark.slow
@pytest.mark.parametrize("pid", first(2, [0, 2]))
def test_a_process_that_stands_still_for_a_while_harms_nobody(
    fleet_of: MakeFleet, pid: int
) -> None:
    fleet = fleet_of(3)
    fleet.start_all()
    fleet.until_round(5)
    others = [one for one in range(3) if one != pid]
    with fleet[pid].standing_still():
        fleet.until_further(20, *others)
    fleet.until_further(10)
    fleet.stop()
    assert fleet.disagreements() == []
    assert all(one.report["trouble"] is None for one in fleet)


@pytest.mark.slow
def test_a_network_in_parts_decides_in_one_of_them(fleet_of: MakeFleet) -> None:
    """The part with a majority goes on; the other holds, says so, and is there again at once."""
    fleet = fleet_of(4)
    fleet.start_all()
    fleet.until_round(5)
    fleet.proxy.cut = frozenset({"0"})
    fleet.until_further(10, 1, 2, 3)
    assert fleet[0].status["holding"] is not None
    fleet.proxy.cut = frozenset({"0", "3"})
    fleet.until(lambda: fleet[1].status["holding"] is not None, "held: two of four are too few")
    at, carried = fleet.round, fleet.proxy.carried
    fleet.until(lambda: fleet.proxy.carried > carried + 100, "tried again and again")
    assert fleet.round <= at + 1
    fleet.proxy.cut = frozenset()
    fleet.until_further(10)
    fleet.stop()
    assert fleet.disagreements() == []
