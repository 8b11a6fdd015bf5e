"""Orders from Python. (specs/orders/README.md)"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import koord
from koord.api.orders import HeartbeatHeard
from koord.api.progress import Cancellation, Progress
from koord.runtime.guardian.events import Order
from koord.runtime.orders.hearing import Body, Hearer, Obeyed
from koord.runtime.orders.lines import Addresses
from koord.runtime.orders.places import Access, left
from koord.runtime.transports.udp import Udp, on_this_machine
from koord.runtime.wire.codec import Channel
from tests.runtime.test_transports import free_port

KEY = b"an order key of this machine, 32"


class Robots(threading.Thread):
    """Robots of this machine that hear orders, and obey."""

    def __init__(self, robots: int) -> None:
        super().__init__(daemon=True)

        self.obeyed: list[tuple[int, Order]] = []
        self.refuses: str | None = None
        self.is_over = False
        self.plan = on_this_machine(robots, free_port(robots), group=None)
        self._ends = [Udp(self.plan, pid) for pid in range(robots)]
        self.ears = [
            Hearer(Channel(KEY, robots, pid), self._body(pid), time.monotonic, time.time)
            for pid in range(robots)
        ]

    def _body(self, pid: int) -> Body:
        def obey(order: Order) -> Obeyed:
            self.obeyed.append((pid, order))
            return Obeyed(self.refuses)

        return Body(obey, lambda: "standing")

    def run(self) -> None:
        while not self.is_over:
            for end, ear in zip(self._ends, self.ears, strict=True):
                end.receive(0.002)
                for visit in end.visits():
                    answer = ear.hear(visit.datagram)
                    if answer is not None:
                        visit.answer(answer)
        for end in self._ends:
            end.close()


@contextmanager
def running(configuration: str, robots: int = 3) -> Iterator[Robots]:
    """Robots that are found as those of a configuration."""
    made = Robots(robots)
    made.start()
    reach = Addresses(tuple(enumerate(made.plan.addresses)))
    try:
        with left(configuration, Access(KEY, encrypts=False, reach=reach, is_whole=True)):
            yield made
    finally:
        made.is_over = True
        made.join()


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A machine on which nothing else runs; the name of a configuration, which need not be read."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "machine"))
    os.mkdir(tmp_path / "machine")
    return str(tmp_path / "task.yaml")


def test_all_robots_of_this_machine_are_stopped(here: str) -> None:
    """(O-HERE)"""
    with running(here) as robots:
        report = koord.estop()
        assert report.ok
        assert sorted(robots.obeyed) == [(pid, Order.ESTOP) for pid in range(3)]
        assert str(report) == "robot 0: standing\nrobot 1: standing\nrobot 2: standing"
        assert koord.estop(here, robots=[1]).ok
        assert robots.obeyed[3:] == [(1, Order.ESTOP)]
        assert koord.estop(here, test=True).ok
        assert len(robots.obeyed) == 4


def test_what_is_refused_is_told(here: str) -> None:
    with running(here, 1) as robots:
        robots.refuses = "it is e-stopped"
        report = koord.order(here, "start")
        assert not report.ok
        assert str(report) == "robot 0: refused: it is e-stopped (standing)"
        robots.refuses = None
        assert koord.order(here, "start").ok
        with pytest.raises(koord.ArgumentError, match="is no order: there are stop, start"):
            koord.order(here, "alive")


def test_heartbeats_end_with_who_sends_them(here: str) -> None:
    """(O-ALIVE)"""
    cancellation, heard = Cancellation(), list[HeartbeatHeard]()
    with running(here, 2) as robots:

        def listen(told: Progress) -> None:
            assert isinstance(told, HeartbeatHeard)
            heard.append(told)
            if all(ear.alive_at_s is not None for ear in robots.ears) and len(heard) > 5:
                cancellation.cancel()

        assert koord.heartbeat(here, progress=listen, cancellation=cancellation) is None
        assert robots.obeyed == []
    assert [one.state for one in heard[-1].robots] == ["standing", "standing"]


def test_pressing_is_an_e_stop(here: str) -> None:
    with running(here, 2) as robots:
        report = koord.heartbeat(here, pressed=lambda: robots.ears[1].alive_at_s is not None)
        assert report is not None
        assert report.ok
        assert sorted(robots.obeyed) == [(0, Order.ESTOP), (1, Order.ESTOP)]


def test_robots_of_a_killed_process_need_not_answer(here: str) -> None:
    with running(here, 1):
        file = next(Path(os.environ["XDG_RUNTIME_DIR"]).rglob("*.run"))
        gone = file.read_text(encoding="utf-8").replace(str(os.getpid()), str(2**22 - 1))
        other = file.with_name("gone.run")
        other.write_text(gone.replace('"robots":[[0', '"robots":[[7'), encoding="utf-8")
        other.chmod(0o600)
        report = koord.estop()
        assert report.ok
        assert [one.pid for one in report.robots] == [0]
        assert not other.exists(), "nobody asks for them again"
