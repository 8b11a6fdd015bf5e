"""A robot's side of orders: what is obeyed, and what is refused and counted. (O-KEY) … (O-RESET)"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest
from msgspec.structs import replace

from koord.runtime.guardian.events import Order
from koord.runtime.orders.hearing import FRESH_S, SAID_S, Body, Hearer, Obeyed
from koord.runtime.orders.messages import Outcome, Reply, Request, Stamp, Wanted
from koord.runtime.wire.codec import Channel, DatagramWriter, OrderReader
from koord.runtime.wire.frames import (
    MOST_ROBOTS,
    Drop,
    fleet_key,
    order_key,
    run_key,
)

KEY = b"a key that robots share, of 32 b"
STARTING, STOPPING = (Wanted.START, Wanted.RESET), (Wanted.ESTOP, Wanted.STOP, Wanted.LAND)
ORDERS = {
    Wanted.ESTOP: Order.ESTOP,
    Wanted.STOP: Order.STOP,
    Wanted.LAND: Order.LAND,
    Wanted.START: Order.START,
    Wanted.RESET: Order.RESET,
}


class Robot:
    """The ear of one robot, with clocks of its own, and a caller beside it."""

    def __init__(self, pid: int = 1, key: bytes = order_key(KEY)) -> None:
        self.now, self.wall = 100.0, 1e9
        self.obeyed: list[Order] = []
        self.refuses: str | None = None
        self._key, self._numbers = key, iter(range(1_000_000))
        self.pid = pid
        self.restart()

    def restart(self) -> None:
        """Start the robot's process again."""
        body = Body(self._obey, lambda: "standing")
        channel = Channel(self._key, 3, self.pid)
        self.ear = Hearer(channel, body, lambda: self.now, lambda: self.wall)

    def _obey(self, order: Order) -> Obeyed:
        self.obeyed.append(order)
        return Obeyed(self.refuses)

    def later(self, seconds: float) -> None:
        self.now += seconds
        self.wall += seconds

    def request(self, wanted: Wanted, stamp: Stamp | None = None) -> Request:
        """What somebody would say now."""
        number = next(self._numbers)
        return Request(number.to_bytes(16, "big"), self.pid, wanted, self.wall, stamp)

    def stamp(self) -> Stamp:
        """A stamp of now."""
        return self.tell(self.request(Wanted.ASK)).stamp

    def datagram(self, request: Request, key: bytes | None = None) -> bytes:
        channel = Channel(self._key if key is None else key, MOST_ROBOTS, MOST_ROBOTS - 1)
        (datagram,) = DatagramWriter(channel).datagrams(0, 0, request)
        return datagram

    def hear(self, datagram: bytes) -> Reply | None:
        answer = self.ear.hear(datagram)
        if answer is None:
            return None
        reply = OrderReader(self._key).read(answer)
        assert isinstance(reply, Reply)
        return reply

    def tell(self, request: Request) -> Reply:
        reply = self.hear(self.datagram(request))
        assert reply is not None
        assert (reply.id, reply.robot, reply.state) == (request.id, self.pid, "standing")
        return reply


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.mark.parametrize("wanted", ORDERS)
def test_an_order_with_a_stamp_is_obeyed(robot: Robot, wanted: Wanted) -> None:
    stamp = robot.stamp()
    robot.later(FRESH_S - 0.1)
    assert robot.tell(robot.request(wanted, stamp)).outcome is Outcome.DONE
    assert robot.obeyed == [ORDERS[wanted]]
    assert not robot.ear.drops


@pytest.mark.parametrize("wanted", STOPPING)
def test_what_stops_needs_no_stamp(robot: Robot, wanted: Wanted) -> None:
    """(O-STOP) The first datagram is enough."""
    assert robot.tell(robot.request(wanted)).outcome is Outcome.DONE
    assert robot.obeyed == [ORDERS[wanted]]


@pytest.mark.parametrize("wanted", STARTING)
def test_what_starts_needs_a_stamp(robot: Robot, wanted: Wanted) -> None:
    """(O-START)"""
    assert robot.tell(robot.request(wanted)).outcome is Outcome.STALE
    assert robot.obeyed == []
    assert robot.ear.drops == {Drop.STALE: 1}


@pytest.mark.parametrize("wanted", ORDERS)
def test_a_recorded_order_is_of_no_use_later(robot: Robot, wanted: Wanted) -> None:
    """(O-STAMP) Another robot has heard it, and this one has not."""
    recorded = robot.datagram(robot.request(wanted, robot.stamp()))
    robot.later(SAID_S + 1.0)
    reply = robot.hear(recorded)
    assert reply is not None
    assert reply.outcome is Outcome.STALE
    assert robot.obeyed == []
    assert robot.ear.drops == {Drop.STALE: 1}


@pytest.mark.parametrize("wanted", STARTING)
def test_a_stamp_is_of_one_process(robot: Robot, wanted: Wanted) -> None:
    """(O-STAMP)"""
    recorded = robot.datagram(robot.request(wanted, robot.stamp()))
    robot.restart()
    reply = robot.hear(recorded)
    assert reply is not None
    assert reply.outcome is Outcome.STALE
    assert robot.obeyed == []


@pytest.mark.parametrize("wanted", STARTING)
def test_a_stamp_of_the_future_is_none(robot: Robot, wanted: Wanted) -> None:
    stamp = replace(robot.stamp(), at_s=robot.now + 1.0)
    assert robot.tell(robot.request(wanted, stamp)).outcome is Outcome.STALE


@pytest.mark.parametrize("off_s", [-SAID_S - 1.0, SAID_S + 1.0, 1e8])
def test_robots_without_the_time_are_stopped_by_their_stamp(robot: Robot, off_s: float) -> None:
    """(O-STOP) One round trip more."""
    robot.wall += off_s
    said = replace(robot.request(Wanted.ESTOP), said_at_s=robot.wall - off_s)
    reply = robot.tell(said)
    assert (reply.outcome, robot.obeyed) == (Outcome.STALE, [])
    again = robot.tell(replace(said, stamp=reply.stamp))
    assert (again.outcome, robot.obeyed) == (Outcome.DONE, [Order.ESTOP])


@pytest.mark.parametrize("wanted", ORDERS)
def test_a_copy_is_answered_and_not_obeyed_again(robot: Robot, wanted: Wanted) -> None:
    """(O-ONCE)"""
    copied = robot.datagram(robot.request(wanted, robot.stamp()))
    for _ in range(3):
        reply = robot.hear(copied)
        assert reply is not None
        assert reply.outcome is Outcome.DONE
        robot.later(0.5)
    assert len(robot.obeyed) == 1


def test_a_late_copy_of_an_e_stop_stops_nobody_after_a_reset(robot: Robot) -> None:
    """(O-ONCE)"""
    stopped = robot.datagram(robot.request(Wanted.ESTOP))
    robot.hear(stopped)
    robot.later(1.0)
    robot.tell(robot.request(Wanted.RESET, robot.stamp()))
    robot.hear(stopped)
    assert robot.obeyed == [Order.ESTOP, Order.RESET]


@pytest.mark.parametrize("start", STARTING)
@pytest.mark.parametrize("stop", STOPPING)
def test_a_start_that_was_under_way_for_longer_than_the_stop_is_void(
    robot: Robot, start: Wanted, stop: Wanted
) -> None:
    """(O-LATER) The network has delayed it."""
    late = robot.datagram(robot.request(start, robot.stamp()))
    robot.later(1.0)
    robot.tell(robot.request(stop))
    reply = robot.hear(late)
    assert reply is not None
    assert reply.outcome is Outcome.STALE
    robot.later(0.1)
    assert robot.tell(robot.request(start, robot.stamp())).outcome is Outcome.DONE
    assert robot.obeyed == [ORDERS[stop], ORDERS[start]]


def test_what_is_said_to_another_robot_is_dropped(robot: Robot) -> None:
    """(O-ADDRESSEE)"""
    assert robot.hear(robot.datagram(replace(robot.request(Wanted.ESTOP), robot=2))) is None
    assert (robot.obeyed, robot.ear.drops) == ([], {Drop.STRANGER: 1})


@pytest.mark.parametrize(
    "key",
    [
        pytest.param(order_key(b"another key that robots share, of"), id="of others"),
        pytest.param(run_key(KEY, b"x"), id="of a run"),
        pytest.param(fleet_key(KEY, "x"), id="before runs"),
    ],
)
def test_who_has_not_the_key_is_not_heard(robot: Robot, key: bytes) -> None:
    """(O-KEY)"""
    assert robot.hear(robot.datagram(robot.request(Wanted.ESTOP), key)) is None
    assert (robot.obeyed, robot.ear.drops) == ([], {Drop.FORGED: 1})
    assert robot.ear.heard_at_s is None


def test_an_answer_that_comes_back_is_no_order(robot: Robot) -> None:
    answer = robot.ear.hear(robot.datagram(robot.request(Wanted.ESTOP)))
    assert answer is not None
    assert robot.ear.hear(answer) is None
    assert robot.ear.drops == {Drop.MALFORMED: 1}


def _damaged(datagram: bytes, draw: Random) -> Iterator[bytes]:
    """Datagrams that differ from one in few bytes, or in length."""
    for at in range(len(datagram)):
        yield datagram[:at] + bytes([datagram[at] ^ (1 << draw.randrange(8))]) + datagram[at + 1 :]
        yield datagram[:at]
    for _ in range(200):
        yield draw.randbytes(draw.randrange(200))
        yield datagram + draw.randbytes(draw.randrange(1, 30))


def test_no_damage_makes_an_order(robot: Robot) -> None:
    """(O-KEY) Whatever arrives, nothing is raised, obeyed or answered, and all is counted."""
    whole = robot.datagram(robot.request(Wanted.START, robot.stamp()))
    damaged = list(_damaged(whole, Random(7)))
    for datagram in damaged:
        assert robot.ear.hear(datagram) is None
    assert robot.obeyed == []
    assert robot.ear.drops.total() == len(damaged)


# --- heartbeats -----------------------------------------------------------------------------------


def test_a_heartbeat_is_as_old_as_its_stamp(robot: Robot) -> None:
    """(O-ALIVE) However long it was under way."""
    stamp = robot.stamp()
    robot.later(3.0)
    beat = robot.datagram(robot.request(Wanted.ALIVE, stamp))
    robot.hear(beat)
    assert robot.ear.alive_at_s == 100.0
    robot.later(1.0)
    robot.hear(robot.datagram(robot.request(Wanted.ALIVE, robot.stamp())))
    assert robot.ear.alive_at_s == 104.0
    robot.later(1.0)
    robot.hear(beat)
    assert robot.ear.alive_at_s == 104.0, "an old one, said again, makes it neither older nor newer"


def test_a_heartbeat_without_a_stamp_is_none(robot: Robot) -> None:
    assert robot.tell(robot.request(Wanted.ALIVE)).outcome is Outcome.STALE
    old = robot.stamp()
    robot.later(FRESH_S + 0.1)
    assert robot.tell(robot.request(Wanted.ALIVE, old)).outcome is Outcome.STALE
    assert robot.ear.alive_at_s is None


def test_a_refusal_is_told(robot: Robot) -> None:
    robot.refuses = "it is e-stopped"
    reply = robot.tell(robot.request(Wanted.START, robot.stamp()))
    assert (reply.outcome, reply.why) == (Outcome.REFUSED, "it is e-stopped")
