"""What a vehicle hears of its program, and what the program reads of the vehicle."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.deploy.member import Member
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import PlannerName
from koord.runtime.motion.library import Library
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.proposals import Admitted, Decision, Proposal
from koord.runtime.protocol.messages import LogEntry
from koord.syntax.load import load
from koord.syntax.source import Source

PROGRAM = """\
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos target
local:
    pos seen
    int sent = 0
Go:
    pre: sent < 2
    eff:
        seen = Motion.psn
        sent = sent + 1
        Motion.target = pos(sent, 0, 0)
"""


class Told:
    """A vehicle that keeps what it is told."""

    def __init__(self) -> None:
        self.heard: list[Point] = []
        self.sensed = SimpleNamespace(position_m=(5.0, 6.0, 0.0))
        self.reached = False
        self.waits = False
        self.flights: list[bool] = []
        self.readings: dict[str, Any] = {}
        self.acted: list[tuple[str, Any]] = []
        self.driver = SimpleNamespace(
            ports=lambda: self.readings, act=lambda port, value: self.acted.append((port, value))
        )

    @property
    def sensors(self) -> MotionSensors:
        place = self.sensed.position_m
        return MotionSensors(place, 0.0, self.reached, PlannerName.STRAIGHT, MotionState.IDLE)

    def go_to(self, target: Point) -> None:
        self.heard.append(target)

    @property
    def pilot(self) -> Told:
        return self

    def wait_for_takeoff(self) -> None:
        self.waits = True

    def take_off(self, up: bool) -> None:
        self.flights.append(up)


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def member(told: Told) -> Member:
    made = member_of(PROGRAM, told)
    assert not told.waits
    return made


def member_of(program: str, told: Told) -> Member:
    """A member that runs a program on a vehicle."""
    report = load(Source("orders.krd", program))
    assert report.program is not None
    classes = loaded(compiled(report.program))
    library = cast(Library, SimpleNamespace(begin_round=lambda: None))
    vehicle = cast(DrivenVehicle, told)
    host = VehicleHost(classes, (0,), World(), library, vehicle)
    platform = VehiclePlatform(host, vehicle, stated=Stated())
    return Member(classes[0](0, (0,), 0.1, platform), platform)


def decided(member: Member, proposal: Proposal | None, *, is_let_through: bool) -> None:
    """Commit a round as its decision has it."""
    assert proposal is not None
    attempt = proposal.attempts[0]
    kept = Admitted(0, attempt.event) if is_let_through else None
    ran: Any = (kept,) if kept is not None else ()
    writes = attempt.writes if is_let_through else ()
    skipped = () if is_let_through else (0,)
    member.commit(LogEntry(Decision(proposal.round, ran, skipped, writes)), kept)


def test_a_vehicle_hears_of_a_turn_that_was_let_through(member: Member, told: Told) -> None:
    """(P-ORDER) Once, and not before the decision."""
    decided(member, member.propose(-1), is_let_through=True)
    proposal = member.propose(0)
    assert told.heard == []
    decided(member, proposal, is_let_through=True)
    assert told.heard == [(1.0, 0.0, 0.0)]


def test_a_vehicle_never_hears_of_a_turn_that_was_thrown_away(member: Member, told: Told) -> None:
    """(P-ORDER)"""
    decided(member, member.propose(-1), is_let_through=True)
    decided(member, member.propose(0), is_let_through=False)
    assert told.heard == []
    decided(member, member.propose(1), is_let_through=True)
    assert told.heard == [(1.0, 0.0, 0.0)]
    decided(member, member.propose(2), is_let_through=True)
    assert told.heard == [(1.0, 0.0, 0.0), (2.0, 0.0, 0.0)]


FLYING = """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target
        boolean takeoff
local:
    int turn = 0
Next:
    pre: turn < 4
    eff:
        turn = turn + 1
        Motion.takeoff = turn == 2 or turn == 3
"""


def test_a_program_asks_to_take_off_and_to_land(told: Told) -> None:
    """(P-TAKEOFF) (P-ORDER) Each once; who was never told to take off need not land."""
    member = member_of(FLYING, told)
    assert told.waits
    decided(member, member.propose(-1), is_let_through=True)
    heard = []
    for round_ in range(4):
        decided(member, member.propose(round_), is_let_through=True)
        heard.append([*told.flights])
    assert heard == [[], [True], [True], [True, False]]
    assert told.heard == []


def test_a_program_reads_where_the_vehicle_is_now(member: Member, told: Told) -> None:
    """(P-READ) Whatever a journal says of where it was."""
    decided(member, member.propose(-1), is_let_through=True)
    decided(member, member.propose(0), is_let_through=True)
    told.sensed.position_m = (7.0, 8.0, 0.0)
    member.host.position = (0.0, 0.0, 0.0)
    decided(member, member.propose(1), is_let_through=True)
    assert vars(member.robot)["seen"] == (7.0, 8.0, 0.0)
    assert member.host.position == (7.0, 8.0, 0.0)


LAMPS = """\
using Motion:
    sensors:
        pos psn
using Lamp:
    sensors:
        float charge
    actuators:
        boolean on
local:
    float seen = 0.0
Light:
    pre: seen < 2.0
    eff:
        seen = Lamp.charge
        Lamp.on = Lamp.charge > 0.6
"""


def test_a_driver_serves_ports_of_the_programs_own_modules(told: Told) -> None:
    """(P-DRIVER) (P-ORDER) A reading of another type does not count; an actuator, once."""
    told.readings = {"charge": 0.75, "more": 1}
    member = member_of(LAMPS, told)
    decided(member, member.propose(-1), is_let_through=True)
    decided(member, member.propose(0), is_let_through=False)
    assert told.acted == []
    for turn in range(1, 4):
        decided(member, member.propose(turn), is_let_through=True)
    assert told.acted[-1] == ("on", True)
    assert len(told.acted) == len(set(told.acted))
    told.readings = {"charge": "full"}
    decided(member, member.propose(4), is_let_through=True)
    assert told.acted[-1] == ("on", True)
    assert cast(Any, member).robot.seen == 0.75
