"""Callers and robots over networks that lose, delay and repeat, in virtual time. (O-ANSWER)"""

from __future__ import annotations

from random import Random

import pytest

from koord.runtime.guardian.events import Order
from koord.runtime.orders.calling import EVERY_S, Call
from koord.runtime.orders.messages import Reply, Request, Wanted
from koord.runtime.wire.codec import OrderReader
from koord.runtime.wire.frames import order_key
from tests.runtime.orders.test_hearing import KEY, Robot

STEP_S = 0.005


class Network:
    """A caller and some robots, between which datagrams take their time."""

    def __init__(self, robots: int, loss: float, seed: int, most_delay_s: float = 0.05) -> None:
        self.robots = [Robot(pid) for pid in range(robots)]
        self.now = 0.0
        self.loss, self.most_delay_s = loss, most_delay_s
        self._draw = Random(seed)
        self._under_way: list[tuple[float, int | None, bytes]] = []
        self._reader = OrderReader(order_key(KEY))

    def send(self, to: int | None, datagram: bytes) -> None:
        for _ in range(1 + (self._draw.random() < 0.1)):
            if self._draw.random() >= self.loss:
                at = self.now + self._draw.uniform(0.0, self.most_delay_s)
                self._under_way.append((at, to, datagram))

    def say(self, request: Request) -> None:
        robot = self.robots[request.robot]
        self.send(request.robot, robot.datagram(request))

    def run(self, call: Call, most_s: float) -> float:
        """Let time pass until a call is over; return how long it took."""
        begun = self.now
        while not call.is_over and self.now - begun < most_s:
            for request in call.requests(self.now, self.wall):
                self.say(request)
            self.step(call)
        return self.now - begun

    @property
    def wall(self) -> float:
        return 1e9 + self.now

    def step(self, call: Call) -> None:
        self.now += STEP_S
        for robot in self.robots:
            robot.later(STEP_S)
        came = [one for one in self._under_way if one[0] <= self.now]
        self._under_way = [one for one in self._under_way if one[0] > self.now]
        for _, to, datagram in came:
            if to is not None:
                answer = self.robots[to].ear.hear(datagram)
                if answer is not None:
                    self.send(None, answer)
                continue
            reply = self._reader.read(datagram)
            assert isinstance(reply, Reply)
            again = call.hear(reply, self.now, self.wall)
            if again is not None:
                self.say(again)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("loss", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("wanted", [Wanted.ESTOP, Wanted.START])
def test_all_robots_hear_an_order_once_whatever_is_lost(
    wanted: Wanted, loss: float, seed: int
) -> None:
    """(O-ANSWER) (O-ONCE)"""
    network = Network(5, loss, seed)
    call = Call(range(5), wanted)
    took_s = network.run(call, 5.0)
    assert call.is_over
    assert all(one.has_done_it for one in call.robots.values())
    order = Order.ESTOP if wanted is Wanted.ESTOP else Order.START
    assert [robot.obeyed for robot in network.robots] == [[order]] * 5
    assert loss or took_s <= (2 if wanted is Wanted.ESTOP else 4) * network.most_delay_s + EVERY_S


def test_who_does_not_answer_is_not_said_to_have_stopped() -> None:
    network = Network(3, 0.0, 1)
    network.robots[2].ear.hear = lambda datagram: None  # type: ignore[method-assign]
    call = Call(range(3), Wanted.ESTOP)
    assert network.run(call, 2.0) >= 2.0
    assert [one.has_done_it for one in call.robots.values()] == [True, True, False]


def test_a_refusal_is_an_answer_and_not_a_deed() -> None:
    network = Network(2, 0.0, 1)
    network.robots[1].refuses = "it is e-stopped"
    call = Call(range(2), Wanted.START)
    network.run(call, 2.0)
    assert call.is_over
    assert [one.has_done_it for one in call.robots.values()] == [True, False]


def test_a_clock_that_is_off_costs_one_round_trip() -> None:
    """(O-STOP)"""
    network = Network(1, 0.0, 3)
    network.robots[0].wall -= 1e8
    call = Call(range(1), Wanted.ESTOP)
    assert network.run(call, 5.0) <= 4 * network.most_delay_s + EVERY_S
    assert network.robots[0].obeyed == [Order.ESTOP]


def test_robots_are_called_that_were_started_again_meanwhile() -> None:
    network = Network(1, 0.0, 3)
    call = Call(range(1), Wanted.START)
    network.robots[0].refuses = None
    for request in call.requests(0.0, network.wall):
        network.say(request)
    for _ in range(30):
        network.step(call)  # it has a stamp by now, or has said the order
    network.robots[0].restart()
    network.run(call, 2.0)
    assert call.is_over


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_heartbeats_keep_all_robots_young_and_end_with_the_caller(loss: float) -> None:
    """(O-ALIVE) (O-ANSWER) As long as somebody is there, and no longer."""
    network = Network(4, loss, 2)
    call = Call(range(4), Wanted.ALIVE)
    network.run(call, 2.0)
    oldest = 0.0
    for _ in range(1000):
        network.run(call, STEP_S)
        ages = [robot.now - (robot.ear.alive_at_s or 0.0) for robot in network.robots]
        oldest = max(oldest, *ages)
    assert oldest < (0.3 if not loss else 1.2)
    for _ in range(400):
        network.step(call)  # nobody says anything any more
    for robot in network.robots:
        assert robot.now - (robot.ear.alive_at_s or 0.0) > 1.8
