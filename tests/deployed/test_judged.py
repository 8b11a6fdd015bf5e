"""Deployed robots are judged: each keeps its part, and the parts make a legal run."""

from __future__ import annotations

from pathlib import Path
from shutil import rmtree

import koord
from koord.api.merge import Merged, PartEnd
from tests.deployed.conftest import MakeFleet
from tests.deployed.fleet import Fleet


def judged_fleet(fleet_of: MakeFleet, robots: int) -> Fleet:
    """A fleet whose robots keep parts."""
    fleet = fleet_of(robots)
    for pid in range(robots):
        fleet.start(pid, words=("--trace", str(part(fleet, pid))))
    return fleet


def part(fleet: Fleet, pid: int) -> Path:
    return fleet.folder / f"{pid}.jsonl"


def merged(fleet: Fleet) -> Merged:
    found = koord.merge(part(fleet, pid) for pid in range(fleet.robots))
    assert found.refused is None
    assert koord.replay(found.trace).legal
    return found


def test_a_robot_that_was_killed_and_is_back_goes_on_in_its_part(fleet_of: MakeFleet) -> None:
    fleet = judged_fleet(fleet_of, 3)
    fleet.until_round(5)
    fleet[2].kill()
    fleet.until_further(5, 0, 1)
    fleet.again(2)
    fleet.until_further(10)
    fleet.stop()
    found = merged(fleet)
    assert found.is_whole
    assert found.trace.rounds >= 20
    assert [one.end for one in found.parts] == [PartEnd.LEFT] * 3
    events = [round_.events[2] for round_ in found.trace.recorded.recording.rounds]
    assert set(events[:6]) != {None}
    assert events.count(None) >= 5
    assert set(events[-9:-1]) != {None}


def test_a_robot_that_never_came_back_skips_to_the_end(fleet_of: MakeFleet) -> None:
    fleet = judged_fleet(fleet_of, 3)
    fleet.until_round(5)
    fleet[0].kill()
    fleet.until_further(8, 1, 2)
    fleet.stop()
    found = merged(fleet)
    assert found.is_whole
    assert found.parts[0].end is not PartEnd.LEFT
    assert found.parts[0].rounds < found.trace.rounds
    last = found.trace.recorded.recording.rounds[-1]
    assert last.events[0] is None


def test_recordings_of_several_machines_make_the_same_trace(fleet_of: MakeFleet) -> None:
    fleet = judged_fleet(fleet_of, 3)
    fleet.until_round(5)
    fleet.stop()
    recordings = [fleet.folder / str(pid) / f"{pid}.mcap" for pid in range(3)]
    assert koord.merge(recordings).trace.encoded() == merged(fleet).trace.encoded()


def test_a_robot_that_lost_its_journal_is_judged_up_to_then(fleet_of: MakeFleet) -> None:
    """It comes back mute, and tells only what it acts on: its part goes on in the same run."""
    fleet = judged_fleet(fleet_of, 3)
    fleet.until_round(5)
    fleet[2].kill()
    rmtree(fleet.folder / "2" / "state")
    fleet.until_further(3, 0, 1)
    fleet.again(2)
    fleet.until_further(8)
    fleet.stop()
    found = merged(fleet)
    assert found.is_whole
    events = [round_.events[2] for round_ in found.trace.recorded.recording.rounds]
    assert set(events[:6]) != {None}
    assert set(events[-8:]) == {None}


def test_all_may_crash_and_come_back(fleet_of: MakeFleet) -> None:
    fleet = judged_fleet(fleet_of, 3)
    fleet.until_round(5)
    for pid in range(3):
        fleet[pid].kill()
    for pid in range(3):
        fleet.again(pid)
    fleet.until_further(8)
    fleet.stop()
    assert merged(fleet).is_whole
