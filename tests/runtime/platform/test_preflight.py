"""What robots look at before anything is armed. (P-PREFLIGHT)"""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
from msgspec.structs import replace

from koord.api.preflight import MENDING_S, Looking, Preflight, good_enough
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.preflight import Check, Finding
from koord.runtime.deploy.running import Runner
from koord.runtime.deploy.status import unheard
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point
from koord.runtime.orders.messages import Request, Wanted
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.runtime.protocol.events import Reason
from koord.runtime.transports.transport import Visit
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import MOST_ROBOTS, order_key
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub
from tests.runtime.platform.test_driven import Guarded

# --- a vehicle ------------------------------------------------------------------------------------


class Vehicle:
    """A vehicle before a run, of which a test says what is sensed."""

    def __init__(self, expected: Point | None = (0.0, 0.0, 0.0), **limits: object) -> None:
        self.driven = Guarded("CAR").driven
        setup = self.driven._setup
        self.driven._setup = replace(setup, limits=replace(setup.limits, **limits))
        host = cast(VehicleHost, SimpleNamespace(kinds=(0,)))
        self.platform = VehiclePlatform(host, self.driven, stated=Stated(expected))
        self.now = 100.0

    def sensing(self, age_s: float = 0.0, **sensed: object) -> Vehicle:
        """Tick for a while, with something else than what the vehicle tells."""
        sense = self.driven.driver.sense

        def told(now_s: float) -> Sensed | None:
            seen = sense(now_s)
            assert seen is not None
            return replace(seen, measured_at_s=now_s - age_s, **sensed)

        self.driven.driver.sense = told  # type: ignore[method-assign]
        for _ in range(20):
            self.now += TICK_S
            self.platform.tick(self.now, None, Reason.GATHERING)
        return self

    def found(self, finding: Finding) -> dict[str, str]:
        return {one.name: one.text for one in self.platform.checks() if one.finding is finding}


def test_a_vehicle_that_stands_where_it_should_is_good() -> None:
    """(P-PREFLIGHT)"""
    one = Vehicle().sensing()
    names = {check.name for check in one.platform.checks()}
    assert names == {
        "link",
        "pose",
        "place",
        "fence",
        "position",
        "at rest",
        "armed",
        "battery",
        "dead man",
    }
    assert set(one.found(Finding.GOOD)) == names


@pytest.mark.parametrize(
    ("name", "sensed"),
    [
        ("link", {"link": False}),
        ("pose", {"age_s": 3.0}),
        ("place", {"position_m": (3.95, 0.0, 0.0)}),
        ("position", {"position_m": (0.6, 0.0, 0.0)}),
        ("at rest", {"velocity_mps": (0.3, 0.0, 0.0)}),
        ("battery", {"battery": 0.05}),
    ],
)
def test_what_is_wrong_with_a_vehicle_is_bad(name: str, sensed: dict[str, object]) -> None:
    """(P-PREFLIGHT) Each alone, but for what follows from it."""
    one = Vehicle().sensing(**sensed)  # type: ignore[arg-type]
    follows = {"link": {"at rest"}, "pose": {"at rest"}, "place": {"position"}}
    assert set(one.found(Finding.BAD)) == {name} | follows.get(name, set())


def test_a_vehicle_that_somebody_has_armed_is_for_people_to_decide() -> None:
    assert "it is armed" in Vehicle().sensing(armed=True).found(Finding.DOUBTFUL)["armed"]


def test_how_far_it_may_stand_from_its_position_is_configured() -> None:
    assert not Vehicle(start_m=0.7).sensing(position_m=(0.6, 0.0, 0.0)).found(Finding.BAD)
    assert not Vehicle(expected=None).sensing(position_m=(0.6, 0.0, 0.0)).found(Finding.BAD)
    bad = Vehicle().sensing(position_m=(0.6, 0.0, 0.0)).found(Finding.BAD)
    assert "0.60 m from (0.00, 0.00, 0.00)" in bad["position"]
    assert "limit 0.5 m" in bad["position"]


def test_a_fence_that_nobody_has_said_is_for_people_to_decide() -> None:
    """(P-FENCE-UNSAID)"""
    vehicle = Vehicle()
    (said,) = [one for one in vehicle.sensing().platform.checks() if one.name == "fence"]
    assert said.finding is Finding.GOOD
    vehicle.platform._stated = Stated(is_bounded=False)
    (unsaid,) = [one for one in vehicle.platform.checks() if one.name == "fence"]
    assert unsaid.finding is Finding.DOUBTFUL
    assert (
        unsaid.text == f"{said.text}, with room for all places that are named: nobody has said it"
    )


def test_a_heartbeat_that_is_asked_for_has_to_be_heard() -> None:
    one = Vehicle(heartbeat_s=1.0).sensing()
    assert "heartbeat" in one.found(Finding.BAD)
    one.platform.alive(one.now)
    one.sensing()
    assert "heartbeat" in one.found(Finding.GOOD)


def test_what_a_driver_remarks_is_for_people_to_decide() -> None:
    one = Vehicle()
    driver = type("Remarking", (type(one.driven.driver),), {"remarks": ("COM_OF_LOSS_T is 9",)})
    one.driven.driver.__class__ = driver
    assert one.sensing().found(Finding.DOUBTFUL) == {"driver": "COM_OF_LOSS_T is 9"}


# --- robots ---------------------------------------------------------------------------------------

KEY = b"key"


class Fleet:
    """Robots that wait for people, on a network in this process."""

    def __init__(self, robots: int = 3) -> None:
        self.now, self.hub = 0.0, Hub(robots)
        classes = loaded(compiled(example_program("sum_of_ids")))
        configuration = load_configuration(Source("c.yaml", f"num_robots: {robots}\n"))
        self.job = Job(classes, (0,) * robots, configuration, KEY, "run", 0.1, 0.1, None, None)
        self.job = replace(self.job, waits=True)
        self.runners = {pid: self.runner(pid, self.job) for pid in range(robots)}

    def runner(self, pid: int, job: Job) -> Runner:
        return Runner(job, pid, self.hub.transport(pid), lambda: self.now)

    def steps(self, times: int) -> None:
        for _ in range(times):
            for runner in self.runners.values():
                runner.step()
            self.now += 0.01

    def found(self, pid: int, finding: Finding) -> dict[str, str]:
        checks = self.runners[pid].status.checks
        return {one.name: one.text for one in checks if one.finding is finding}


def test_robots_see_each_other_and_are_in_no_run_before_people_say_so() -> None:
    """(P-PREFLIGHT)"""
    fleet = Fleet()
    fleet.steps(10)
    assert "clock" in fleet.found(0, Finding.PENDING)
    fleet.steps(400)
    for pid, runner in fleet.runners.items():
        assert set(fleet.found(pid, Finding.GOOD)) == {"clock", "others", "program"}
        assert set(fleet.found(pid, Finding.DOUBTFUL)) == {"e-stop"}
        assert runner.peer is None
    for runner in fleet.runners.values():
        runner.go()
    fleet.steps(300)
    assert all(runner.member.round > 5 for runner in fleet.runners.values())
    assert all(not runner.status.checks for runner in fleet.runners.values())


@pytest.mark.parametrize("last", range(3))
def test_no_run_begins_while_one_robot_still_waits(last: int) -> None:
    """(P-PREFLIGHT) The leader among them."""
    fleet = Fleet()
    fleet.steps(300)
    for pid, runner in fleet.runners.items():
        if pid != last:
            runner.go()
    fleet.steps(300)
    assert all(runner.peer is None for runner in fleet.runners.values())
    assert not fleet.found(last, Finding.BAD)
    fleet.runners[last].go()
    fleet.steps(300)
    assert all(runner.member.round > 5 for runner in fleet.runners.values())


def test_who_is_missing_is_named() -> None:
    fleet = Fleet()
    del fleet.runners[1]
    fleet.steps(400)
    assert fleet.found(0, Finding.PENDING) == {"others": "not heard of: 1"}


def test_another_program_is_bad_and_named_on_both_sides() -> None:
    fleet = Fleet(2)
    other = replace(fleet.job, program=(("program", "another"),))
    fleet.runners[1] = fleet.runner(1, other)
    fleet.steps(400)
    assert "program: none here, another there" in fleet.found(0, Finding.BAD)["program"]
    assert "program: another here, none there" in fleet.found(1, Finding.BAD)["program"]


def test_another_key_is_bad() -> None:
    fleet = Fleet(2)
    fleet.runners[1] = fleet.runner(1, replace(fleet.job, key=b"another"))
    fleet.steps(400)
    assert "another key" in fleet.found(0, Finding.BAD)["others"]


def test_robots_that_wait_are_seen_by_those_in_a_run() -> None:
    """And the other way round: one that was started again."""
    fleet = Fleet()
    for runner in fleet.runners.values():
        runner.go()
    fleet.steps(300)
    fleet.runners[1] = fleet.runner(1, fleet.job)
    fleet.steps(600)
    assert set(fleet.found(1, Finding.GOOD)) >= {"others", "program"}


def test_who_comes_back_to_a_run_does_not_wait_for_those_that_are_gone() -> None:
    """(P-PREFLIGHT) A majority goes on; before a run all are waited for."""
    fleet = Fleet()
    for runner in fleet.runners.values():
        runner.go()
    fleet.steps(300)
    del fleet.runners[2]
    fleet.runners[1] = fleet.runner(1, fleet.job)
    fleet.steps(600)
    assert "not heard of: 2" in fleet.found(1, Finding.DOUBTFUL)["others"]
    assert not fleet.found(1, Finding.PENDING)


def test_an_e_stop_that_was_heard_is_good_and_a_clock_that_is_off_is_told() -> None:
    fleet = Fleet(1)
    writer = DatagramWriter(Channel(order_key(KEY), MOST_ROBOTS, MOST_ROBOTS - 1))
    fleet.steps(300)
    (datagram,) = writer.datagrams(0, 0, Request(bytes(16), 0, Wanted.ASK, 0.0, None))
    fleet.hub.visits[0].append(Visit(datagram, lambda answer: None))
    fleet.steps(2)
    assert "the clocks of the wall differ" in fleet.found(0, Finding.DOUBTFUL)["e-stop"]


# --- whether to arm -------------------------------------------------------------------------------

GOOD = Check("pose", Finding.GOOD, "there")
BAD = Check("pose", Finding.BAD, "3 s old")
OPEN = Check("others", Finding.PENDING, "not heard of: 1")
DOUBT = Check("e-stop", Finding.DOUBTFUL, "not tried")


@pytest.mark.parametrize(
    ("checks", "answer"),
    [
        ({0: (GOOD,)}, None),
        ({0: (GOOD,), 1: ()}, None),
        ({0: (GOOD,), 1: (GOOD, OPEN)}, None),
        ({0: (GOOD,), 1: (GOOD,)}, True),
        ({0: (GOOD,), 1: (GOOD, DOUBT)}, True),
        ({0: (GOOD,), 1: (GOOD, BAD)}, False),
    ],
)
def test_what_is_bad_is_not_armed_and_what_is_open_is_waited_for(
    checks: dict[int, tuple[Check, ...]],
    answer: bool | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """(P-PREFLIGHT)"""
    now = [100.0]
    monkeypatch.setattr("koord.api.preflight.time.monotonic", lambda: now[0])
    statuses = {pid: replace(unheard(pid), checks=found) for pid, found in checks.items()}
    assert good_enough(Preflight(checks, 2)) is (None if answer is None else True)
    asked, insists = (
        Looking(2, approve, only_looks=False) for approve in (good_enough, lambda found: True)
    )
    for looking in (asked, insists):
        assert looking.hear(statuses) is (True if answer else None), "bad may become good"
    now[0] += MENDING_S
    if not answer:
        assert asked.hear(statuses) is answer
        assert insists.hear(statuses) is False, "who says yes to what is not good arms nothing"


def test_what_is_bad_for_a_moment_does_not_keep_robots_from_being_armed() -> None:
    """(P-PREFLIGHT)"""
    looking = Looking(1, good_enough, only_looks=False)
    assert looking.hear({0: replace(unheard(0), checks=(GOOD, BAD))}) is None
    assert looking.hear({0: replace(unheard(0), checks=(GOOD,))}) is True
