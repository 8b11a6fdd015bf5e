"""Callers reach robots over each network, and robots answer them. (O-BESIDE)"""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from koord.runtime.orders.lines import Addresses, Line, Routes, line_to
from koord.runtime.orders.messages import Request, Wanted
from koord.runtime.transports.routed import Routed
from koord.runtime.transports.transport import Transport, Visit
from koord.runtime.transports.udp import Udp, on_this_machine
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import MOST_ROBOTS
from tests.runtime.test_transports import free_port

SAID = Request(bytes(16), 1, Wanted.ESTOP, 0.0, None)
(ORDER,) = DatagramWriter(Channel(b"key", MOST_ROBOTS, 7)).datagrams(0, 0, SAID)

Ends = tuple[list[Transport], Line]


def udp() -> Ends:
    plan = on_this_machine(2, free_port(2), group=None)
    robots: list[Transport] = [Udp(plan, pid) for pid in range(2)]
    return robots, line_to(Addresses(tuple(enumerate(plan.addresses))))


def zenoh() -> Ends:
    pytest.importorskip("zenoh")
    port = free_port(1)
    endpoint = (f"tcp/127.0.0.1:{port}",)
    robots: list[Transport] = [
        Routed("run", 0, 2, listen=endpoint),
        Routed("run", 1, 2, connect=endpoint),
    ]
    return robots, line_to(Routes((0, 1), connect=endpoint))


@pytest.fixture(params=[udp, pytest.param(zenoh, marks=pytest.mark.slow)])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    robots, line = request.param()
    yield robots, line
    for robot in robots:
        robot.close()
    line.close()


def visit(robot: Transport, line: Line, pid: int) -> Visit:
    """Say an order until a robot has it: networks need a while at first."""
    for _ in range(200):
        line.send(pid, ORDER)
        begun = time.monotonic()
        assert robot.receive(0.1) == []
        if came := robot.visits():
            assert time.monotonic() - begun < 0.09, "it wakes who waits"
            return came[0]
    raise AssertionError("it never came")


def test_an_order_reaches_its_robot_and_the_answer_its_caller(ends: Ends) -> None:
    (first, second), line = ends
    came = visit(second, line, 1)
    assert came.datagram == ORDER
    came.answer(ORDER)
    assert line.receive(5.0) == [ORDER]
    assert first.visits() == []


def test_an_order_is_none_of_what_robots_say(ends: Ends) -> None:
    (first, second), line = ends
    visit(second, line, 1)
    for _ in range(200):
        first.send(1, b"between robots")
        if came := second.receive(0.1):
            break
    assert set(came) == {b"between robots"}
    assert first.visits() == []


def test_an_answer_after_the_end_is_lost(ends: Ends) -> None:
    (_, second), line = ends
    came = visit(second, line, 1)
    second.close()
    came.answer(ORDER)
