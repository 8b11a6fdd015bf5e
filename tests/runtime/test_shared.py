"""Several robots in one process: their sockets, their turns, and what becomes of them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

import koord
from koord.api.deployed import FleetHeard
from koord.api.results import ArgumentError
from koord.runtime.deploy import local
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.deploy.running import Runner, _is_timeless
from koord.runtime.deploy.supervision import EndCause
from koord.runtime.deploy.together import Going, run_together
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import Ask, Beacon, Snapshot
from koord.runtime.robot import Robot
from koord.runtime.transports.shared import SharedUdp
from koord.runtime.transports.transport import TransportError
from koord.runtime.transports.udp import LEAST_WAITING, on_this_machine
from koord.runtime.wire.codec import Channel, DatagramReader, DatagramWriter, Opened
from koord.runtime.wire.frames import FIRST_ORDER_KIND, KIND_AT, NAME, Drop, run_key
from tests.runtime.test_transports import free_port

COUNT = koord.Source(
    "count.krd",
    "allwrite:\n  int total = 0\nlocal:\n  int x = 0\n"
    "Up:\n  pre: x < 5\n  eff:\n    atomic:\n      total = total + 1\n      x = x + 1\n",
)
FIVE = koord.read_configuration(koord.Source("five.yaml", "num_robots: 5\ndelta: 0.05\n"))


# --- sockets --------------------------------------------------------------------------------------


def heard(shared: SharedUdp, *pids: int) -> list[list[bytes]]:
    """What some robots have heard, when each has, or nothing comes."""
    found: list[list[bytes]] = [[] for _ in pids]
    for _ in range(100):
        shared.wait(0.05)
        for got, pid in zip(found, pids, strict=True):
            got += shared.ends[pid].receive(0.0)
        if all(found):
            break
    return found


@pytest.mark.parametrize("has_group", [True, False])
def test_what_is_told_to_all_gets_to_all_others_once(has_group: bool) -> None:
    group = {} if has_group else {"group": None}
    plan = on_this_machine(4, free_port(4), **group)
    with closing(SharedUdp(plan, (0, 1, 2))) as here, closing(SharedUdp(plan, (3,))) as there:
        here.ends[1].tell(b"to all")
        assert heard(here, 0, 2) == [[b"to all"], [b"to all"]]
        assert heard(there, 3) == [[b"to all"]]
        assert here.ends[1].receive(0.0) == []
        there.ends[3].send(1, b"to one")
        assert heard(here, 1) == [[b"to one"]]
        assert not here.ends[0].has_mail
        # What has come may change what there is to do; if nothing has, the robot would have waited.
        assert here.ends[1].wanted_s == 0.0
        assert here.ends[1].receive(0.3) == []
        assert here.ends[1].wanted_s == 0.3


def test_who_leaves_hears_nothing_and_the_others_do() -> None:
    plan = on_this_machine(3, free_port(3))
    with closing(SharedUdp(plan, (0, 1, 2))) as shared:
        shared.ends[1].close()
        shared.ends[1].close()
        shared.ends[0].tell(b"still there?")
        assert heard(shared, 2) == [[b"still there?"]]
        assert not shared.ends[1].has_mail
        assert shared.ends[1].dropped == 0


def test_orders_are_visits_that_can_be_answered() -> None:
    plan = on_this_machine(2, free_port(2))
    order = bytearray(60)
    order[0], order[KIND_AT] = NAME, FIRST_ORDER_KIND
    with closing(SharedUdp(plan, (0, 1))) as shared:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
            somebody.settimeout(5.0)
            somebody.bind(("127.0.0.1", 0))
            somebody.sendto(bytes(order), plan.addresses[1])
            for _ in range(100):
                shared.wait(0.05)
                if shared.ends[1].has_mail:
                    break
            (visit,) = shared.ends[1].visits()
            assert visit.datagram == bytes(order)
            visit.answer(b"heard")
            assert somebody.recv(100) == b"heard"
        assert shared.ends[0].visits() == []
        assert shared.ends[1].receive(0.0) == []


def test_what_waits_takes_up_bounded_memory() -> None:
    plan = on_this_machine(2, free_port(2))
    with closing(SharedUdp(plan, (0, 1))) as shared:
        for _ in range(LEAST_WAITING + 3):
            shared.ends[1].take(b"?", plan.addresses[0])
        assert shared.ends[1].dropped == 3


def test_a_port_that_is_taken_is_told_and_leaves_nothing_open() -> None:
    plan = on_this_machine(3, free_port(3))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(plan.addresses[2])
        with pytest.raises(TransportError, match="cannot be listened on"):
            SharedUdp(plan, (0, 1, 2))
    with closing(SharedUdp(plan, (0, 1, 2))):
        pass


def test_what_is_opened_once_is_new_to_each_robot_once() -> None:
    key = run_key(b"a key", b"a run")
    opened = Opened(Channel(key, 4, 0))
    readers = [DatagramReader(Channel(key, 4, pid), opened=opened) for pid in (1, 2)]
    (datagram,) = DatagramWriter(Channel(key, 4, 0)).datagrams(1, 0, Ask(7))
    for reader in readers:
        letter = reader.read(datagram)
        assert letter is not None
        assert (letter.sender, letter.message) == (0, Ask(7))
    for reader in readers:
        assert reader.read(datagram) is None
        assert reader.drops == {Drop.REPLAYED: 1}


def test_what_is_not_authentic_or_in_a_robots_own_name_each_says_for_itself() -> None:
    key = run_key(b"a key", b"a run")
    opened = Opened(Channel(key, 4, 0))
    readers = [DatagramReader(Channel(key, 4, pid), opened=opened) for pid in (1, 2)]
    (twin,) = DatagramWriter(Channel(key, 4, 1, start=5)).datagrams(1, 0, Ask(7))
    forged = twin[:-1] + bytes([twin[-1] ^ 1])
    assert [reader.read(forged) for reader in readers] == [None, None]
    mine, others = (reader.read(twin) for reader in readers)
    assert mine is None
    assert others is not None
    assert readers[0].drops == {Drop.FORGED: 1, Drop.TWIN: 1}
    assert readers[1].drops == {Drop.FORGED: 1}


def test_long_messages_are_whole_when_all_pieces_have_come() -> None:
    key = run_key(b"a key", b"a run")
    opened = Opened(Channel(key, 4, 0))
    readers = [DatagramReader(Channel(key, 4, pid), opened=opened) for pid in (1, 2)]
    store = bytes(range(256)) * 16
    snapshot = Snapshot(0, 3, b"chain", (1,) * 4, (None,) * 4, store, False)
    *first, last = DatagramWriter(Channel(key, 4, 0)).datagrams(1, 0, snapshot)
    for reader in readers:
        assert [reader.read(piece) for piece in first] == [None] * len(first)
        letter = reader.read(last)
        assert letter is not None
        assert letter.message == snapshot


# --- turns ----------------------------------------------------------------------------------------


class Ends:
    """A network on which mail comes at certain times, by a clock that waiting puts forward."""

    def __init__(self, mail: dict[float, int]) -> None:
        self.now_s, self.mail = 0.0, dict(mail)
        self.has_mail = [False, False]

    def wait(self, timeout_s: float) -> None:
        due = [at for at in self.mail if at <= self.now_s + timeout_s]
        self.now_s = min(due) if due else self.now_s + timeout_s
        for at in due[:1]:
            self.has_mail[self.mail.pop(at)] = True


class End:
    def __init__(self, ends: Ends, pid: int) -> None:
        self.wanted_s = 0.5
        self._ends, self._pid = ends, pid

    @property
    def has_mail(self) -> bool:
        return self._ends.has_mail[self._pid]


def test_robots_have_their_turn_when_it_is_due_or_they_have_mail() -> None:
    ends, turns = Ends({1.25: 1, 2.5: 0}), []

    def robot(pid: int, rests: list[float | None]) -> Iterator[float | None]:
        for rests_s in rests:
            turns.append((pid, ends.now_s))
            ends.has_mail[pid] = False
            yield rests_s

    rests: list[list[float | None]] = [[1.0, 1.0, 5.0, None], [9.0, 9.0]]
    shared: Any = ends
    going = [Going(End(ends, pid), robot(pid, rests[pid])) for pid in range(2)]  # type: ignore[arg-type]
    run_together(shared, going, lambda: ends.now_s)
    assert turns == [(0, 0.0), (1, 0.0), (0, 1.0), (1, 1.25), (0, 2.0), (0, 2.5)]


# --- robots ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("processes", [1, 2, 9])
def test_robots_that_share_processes_make_a_run(processes: int) -> None:
    deployed = koord.deploy(COUNT, FIVE, rounds=30, as_fast_as_possible=True, processes=processes)
    assert deployed.is_complete
    assert {pid: one.round for pid, one in deployed.statuses.items()} == dict.fromkeys(range(5), 30)
    assert not deployed.broken


def test_what_has_steps_to_take_or_something_to_say_is_asked_in_each_turn() -> None:
    class Ticking(IdealHost):
        def tick(self, now_s: float, round_age_s: float | None, reason: Reason | None) -> float:
            return now_s + 0.1

    class Telling(IdealHost):
        def beacon(self, now_s: float) -> Beacon | None:
            return Beacon((now_s, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)

    hosts = (IdealHost, Ticking, Telling)
    assert [_is_timeless(made(Robot, 0, 1, 0.1, 0)) for made in hosts] == [True, False, False]


def test_a_robot_that_crashes_leaves_the_others_of_its_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Crashing(Runner):
        """A robot that falls over in its first turn, if it is robot 1."""

        def going(self, *arguments: Any) -> Any:
            if self.member.robot.pid == 1 and multiprocessing.current_process().name != "robot 1":
                raise ValueError("no such thing")
            return super().going(*arguments)

    monkeypatch.setattr(local, "Runner", Crashing)
    deployed = koord.deploy(COUNT, FIVE, rounds=20, processes=2, restart=True)
    assert deployed.is_complete
    assert {pid: one.restarts for pid, one in deployed.processes.items()} == {
        **dict.fromkeys(range(5), 0),
        1: 1,
    }
    end = deployed.processes[1].end
    assert end is not None
    assert end.cause is EndCause.CRASHED
    assert "no such thing" in str(end)


def test_a_killed_process_is_told_of_all_its_robots_and_they_come_back_alone() -> None:
    struck: list[int] = []

    def strike(told: koord.Progress) -> None:
        assert isinstance(told, FleetHeard)
        if (
            struck
            or any(told.statuses[pid].round < 3 for pid in told.statuses)
            or not told.statuses
        ):
            return
        (victim,) = [p for p in multiprocessing.active_children() if p.name == "robots 0 to 1"]
        assert victim.pid is not None
        struck.append(victim.pid)
        os.kill(victim.pid, signal.SIGKILL)

    deployed = koord.deploy(COUNT, FIVE, rounds=40, processes=2, restart=True, progress=strike)
    assert deployed.is_complete
    assert [deployed.processes[pid].restarts for pid in range(5)] == [1, 1, 0, 0, 0]
    ends = [deployed.processes[pid].end for pid in (0, 1)]
    assert all(end is not None and end.cause is EndCause.KILLED for end in ends)


@pytest.mark.parametrize(
    ("pid", "processes", "story"), [(0, 2, "all on this machine"), (None, 0, "1 to")]
)
def test_processes_are_of_robots_of_one_machine(
    pid: int | None, processes: int, story: str
) -> None:
    with pytest.raises(ArgumentError, match=story):
        koord.deploy(COUNT, FIVE, pid=pid, processes=processes)
