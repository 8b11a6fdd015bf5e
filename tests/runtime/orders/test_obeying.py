"""What orders do: to a vehicle, and to a robot in whatever state its protocol is."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from msgspec.structs import replace

from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.deploy.job import Job, ideal_host
from koord.runtime.deploy.member import Platform
from koord.runtime.deploy.running import Runner
from koord.runtime.drivers.setpoints import Disarm, Hold, Setpoint
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.group import TICK_S
from koord.runtime.orders.hearing import Obeyed
from koord.runtime.orders.messages import Outcome, Reply, Request, Stamp, Wanted
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.runtime.protocol.events import Reason
from koord.runtime.transports.transport import Visit
from koord.runtime.wire.codec import Channel, DatagramWriter, OrderReader
from koord.runtime.wire.frames import MOST_ROBOTS, order_key
from koord.syntax.source import Source
from tests.loading import example_program
from tests.rules import Rules
from tests.runtime.hub import Hub
from tests.runtime.platform.test_driven import Guarded

# --- rules ----------------------------------------------------------------------------------------

RULE = re.compile(r"^\*\*(O-[A-Z-]+?)\.\*\*", re.MULTILINE)
CITED = re.compile(r"\((O-[A-Z]+(?:-[A-Z]+)*)\)")
RULES = Rules("orders", (RULE,), CITED, Path(__file__).name)


def test_rules_are_stated_once() -> None:
    assert len(RULES.stated) >= 10
    assert len(RULES.stated) == len(set(RULES.stated))


@pytest.mark.parametrize("rule", RULES.stated)
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in RULES.cited("koord"), f"no code cites {rule}"
    here = CITED.findall(Path(__file__).read_text(encoding="utf-8"))
    assert rule in RULES.cited("tests") | set(here), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    assert RULES.cited("koord", "tests") <= set(RULES.stated)


# --- a vehicle ------------------------------------------------------------------------------------


class Vehicle:
    """A vehicle on its platform, with a clock of its own."""

    def __init__(self, *, arms: bool = True) -> None:
        self.driven = Guarded("CAR").driven
        host = cast(VehicleHost, SimpleNamespace(kinds=(0,)))
        self.platform = VehiclePlatform(host, self.driven, stated=Stated(), arms=arms)
        self.now = 100.0
        self.commanded: list[Setpoint] = []
        command = self.driven.driver.command

        def kept(setpoint: Setpoint, now_s: float) -> None:
            self.commanded.append(setpoint)
            command(setpoint, now_s)

        self.driven.driver.command = kept  # type: ignore[method-assign]

    def tick(self, times: int) -> Vehicle:
        for _ in range(times):
            self.now += TICK_S
            self.platform.tick(self.now, 0.05, None)
        return self

    def say(self, order: Order) -> Obeyed:
        return self.platform.order(order, self.now)

    def is_in(self, mode: Mode) -> bool:
        return self.driven.mode is mode


def test_an_e_stop_is_with_the_driver_before_the_next_tick() -> None:
    """(O-AT-ONCE)"""
    one = Vehicle().tick(60)
    assert one.is_in(Mode.RUNNING)
    one.commanded.clear()
    assert one.say(Order.ESTOP).refused is None
    assert one.commanded == [Disarm()]
    assert one.platform.state.startswith("e-stopped")


def test_reset_moves_nothing_and_start_does() -> None:
    """(O-RESET)"""
    one = Vehicle().tick(60)
    one.say(Order.ESTOP)
    one.tick(100)
    assert one.is_in(Mode.ESTOPPED)
    refused = one.say(Order.START).refused
    assert refused is not None
    assert "reset" in refused
    assert one.say(Order.RESET).refused is None
    one.commanded.clear()
    one.tick(100)
    assert one.is_in(Mode.DISARMED)
    assert set(one.commanded) == {Disarm()}
    assert any("start" in remark for remark in one.platform.remarks)
    assert one.say(Order.START).refused is None
    assert one.tick(60).is_in(Mode.RUNNING)


def test_a_stop_holds_until_start() -> None:
    one = Vehicle().tick(60)
    one.say(Order.STOP)
    one.commanded.clear()
    assert one.tick(100).is_in(Mode.HOLDING)
    assert set(one.commanded) == {Hold()}
    one.say(Order.START)
    assert one.tick(30).is_in(Mode.RUNNING)


def test_who_has_stopped_for_good_goes_on_after_start() -> None:
    one = Vehicle().tick(60)
    one.say(Order.STOP)
    one.tick(400)
    assert one.is_in(Mode.STOPPED)
    assert one.say(Order.START).refused is None
    assert one.tick(60).is_in(Mode.RUNNING)


def test_start_arms_nothing_that_may_not_move() -> None:
    """(O-RESET) (P-ARM)"""
    one = Vehicle(arms=False).tick(60)
    assert one.say(Order.START).refused is not None
    assert one.tick(60).is_in(Mode.DISARMED)


@pytest.mark.parametrize("order", [Order.ESTOP, Order.STOP, Order.LAND])
def test_what_is_told_to_stop_before_it_is_armed_is_not_armed(order: Order) -> None:
    one = Vehicle()
    one.say(order)
    one.tick(100)
    assert one.driven.mode in (Mode.DISARMED, Mode.ESTOPPED)


def test_who_leaves_the_run_is_not_started() -> None:
    one = Vehicle().tick(60)
    one.platform.stop(one.now)
    one.tick(60)
    assert one.say(Order.START).refused is not None
    assert one.tick(60).is_in(Mode.STOPPED)


def test_without_a_heartbeat_it_does_not_move_and_says_what_to_run() -> None:
    """(O-ALIVE) (G-HEARTBEAT)"""
    one = Vehicle()
    setup = one.driven._setup
    one.driven._setup = replace(setup, limits=replace(setup.limits, heartbeat_s=0.5))
    assert one.tick(100).is_in(Mode.ARMED)
    assert any("koord heartbeat" in remark for remark in one.platform.remarks)
    for _ in range(100):
        one.platform.alive(one.now - 0.2)
        one.tick(1)
    assert one.is_in(Mode.RUNNING)
    one.tick(12)
    assert one.is_in(Mode.HOLDING)
    assert Condition.HEARTBEAT in one.driven.conditions
    assert any("koord heartbeat" in remark for remark in one.platform.remarks)


# --- a robot --------------------------------------------------------------------------------------

KEY = b"key"


class Told(IdealHost):
    """A point that keeps what it is told."""

    def __init__(self, host: IdealHost) -> None:
        self.__dict__.update(vars(host))
        self.orders: list[Order] = []
        self.alive_at_s: float | None = None

    def order(self, order: Order, now_s: float) -> Obeyed:
        self.orders.append(order)
        return Obeyed()

    def alive(self, at_s: float) -> None:
        self.alive_at_s = at_s


class Fleet:
    """Robots on a network in this process, and somebody who says something to them."""

    def __init__(self, robots: int = 3, journals: Path | None = None) -> None:
        self.now, self.hub = 0.0, Hub(robots)
        self.hosts: dict[int, Told] = {}
        self.answers: list[bytes] = []
        classes = loaded(compiled(example_program("sum_of_ids")))
        configuration = load_configuration(Source("c.yaml", f"num_robots: {robots}\n"))
        self.job = Job(classes, (0,) * robots, configuration, KEY, "run", 0.1, 0.1, None, journals)
        self.job = replace(self.job, platforms=self._platform)
        self._numbers = iter(range(1_000_000))
        self.runners = {pid: self._runner(pid) for pid in range(robots)}

    def _runner(self, pid: int) -> Runner:
        return Runner(self.job, pid, self.hub.transport(pid), lambda: self.now)

    def _platform(self, job: Job, pid: int) -> Platform:
        self.hosts[pid] = Told(ideal_host(job, pid))
        return self.hosts[pid]

    def held(self, pid: int) -> Reason | None:
        return self.runners[pid].member.holding

    def steps(self, times: int) -> None:
        for _ in range(times):
            for runner in self.runners.values():
                runner.step()
            self.now += 0.01

    def say(self, pid: int, wanted: Wanted, stamp: Stamp | None = None) -> Callable[[], Reply]:
        """Say something to a robot; return what gives its answer."""
        channel = Channel(order_key(KEY), MOST_ROBOTS, MOST_ROBOTS - 1)
        number = next(self._numbers).to_bytes(16, "big")

        request = Request(number, pid, wanted, time.time(), stamp)
        (datagram,) = DatagramWriter(channel).datagrams(0, 0, request)
        answers: list[bytes] = []
        self.hub.visits[pid].append(Visit(datagram, answers.append))

        def answered() -> Reply:
            (answer,) = answers
            reply = OrderReader(order_key(KEY)).read(answer)
            assert isinstance(reply, Reply)
            return reply

        return answered


def test_a_robot_that_waits_for_others_is_stopped() -> None:
    """(O-BESIDE) Before it is in any run."""
    fleet = Fleet()
    del fleet.runners[2]
    fleet.steps(50)
    assert fleet.runners[0].peer is None
    answer = fleet.say(0, Wanted.ESTOP)
    fleet.runners[0].step()
    assert fleet.hosts[0].orders == [Order.ESTOP]
    assert answer().outcome is Outcome.DONE


def test_robots_in_a_run_and_without_a_majority_are_stopped() -> None:
    """(O-BESIDE) And the step of the protocol knows nothing of it."""
    fleet = Fleet()
    fleet.steps(300)
    assert fleet.runners[0].member.round > 10
    fleet.say(0, Wanted.ESTOP)
    fleet.steps(50)
    assert fleet.hosts[0].orders == [Order.ESTOP]
    assert fleet.held(0) is None
    for pid in (1, 2):
        del fleet.runners[pid]
    fleet.steps(600)
    assert fleet.held(0) is Reason.NO_MAJORITY
    fleet.say(0, Wanted.STOP)
    fleet.runners[0].step()
    assert fleet.hosts[0].orders == [Order.ESTOP, Order.STOP]


def test_a_robot_that_cannot_write_is_stopped(tmp_path: Path) -> None:
    """(O-BESIDE)"""
    fleet = Fleet(1, tmp_path / "none")
    fleet.steps(50)
    assert fleet.runners[0].member.unwritable is not None
    fleet.say(0, Wanted.ESTOP)
    fleet.runners[0].step()
    assert fleet.hosts[0].orders == [Order.ESTOP]


def test_heartbeats_reach_the_platform() -> None:
    """(O-ALIVE)"""
    fleet = Fleet(2)
    fleet.steps(100)
    asked = fleet.say(1, Wanted.ASK)
    fleet.steps(1)
    stamp = asked().stamp
    fleet.steps(20)
    fleet.say(1, Wanted.ALIVE, stamp)
    fleet.steps(1)
    assert fleet.hosts[1].alive_at_s == stamp.at_s
    assert fleet.hosts[0].alive_at_s is None


def test_forged_orders_are_counted_in_the_report_of_a_robot() -> None:
    """(O-KEY)"""
    fleet = Fleet(1)
    fleet.steps(50)
    channel = Channel(order_key(b"another"), MOST_ROBOTS, MOST_ROBOTS - 1)
    request = Request(bytes(16), 0, Wanted.ESTOP, 0.0, None)
    (datagram,) = DatagramWriter(channel).datagrams(0, 0, request)
    fleet.hub.visits[0].append(Visit(datagram, fleet.answers.append))
    fleet.steps(1)
    assert (fleet.hosts[0].orders, fleet.answers) == ([], [])
    assert [n for reason, n in fleet.runners[0].status.drops if "not authentic" in reason] == [1]
