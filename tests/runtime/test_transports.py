"""The conformance kit that every transport passes, and whole runs over each of them.

Real sockets are used on loopback. Nothing here asserts how long something takes: waiting ends when
what is waited for has come, or after so many tries.
"""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from types import SimpleNamespace

import pytest

from koord.runtime.chaos.storm import Journal, StormRobot
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.deploy.job import Job
from koord.runtime.deploy.running import Runner
from koord.runtime.node import Peer
from koord.runtime.protocol.handshake import (
    NONCE_BYTES,
    RUN_BYTES,
    Join,
    RefusalReason,
    Refused,
    Roll,
)
from koord.runtime.protocol.messages import Ask
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh
from koord.runtime.transports import udp as udp_transport
from koord.runtime.transports.routed import MOST_WAITING, Routed
from koord.runtime.transports.transport import Transport, TransportError
from koord.runtime.transports.udp import Delivery, Pace, Plan, Udp, on_this_machine
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import LONGEST, Drop, fleet_key, run_key
from koord.syntax.source import Source
from tests.loading import example_program
from tests.runtime.hub import Hub
from tests.runtime.together import KEY, together

Make = Callable[[int], list[Transport]]

_PORTS = count(0)


def free_port(robots: int) -> int:
    """The first of a row of ports that nobody listens on, other than all given out before."""
    while True:
        port = 20_000 + (next(_PORTS) * 40 + time.time_ns() // 1000) % 20_000
        with ExitStack() as stack:
            try:
                for k in range(robots + 1):
                    one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                    one.bind(("127.0.0.1", port + k))
            except OSError:
                continue
            return port


def in_process(robots: int) -> list[Transport]:
    hub = Hub(robots)
    return [hub.transport(pid) for pid in range(robots)]


def unicast(robots: int) -> list[Transport]:
    plan = on_this_machine(robots, free_port(robots), group=None)
    return [Udp(plan, pid) for pid in range(robots)]


def multicast(robots: int) -> list[Transport]:
    plan = on_this_machine(robots, free_port(robots))
    return [Udp(plan, pid) for pid in range(robots)]


def broadcast(robots: int) -> list[Transport]:
    """As in the paper's configurations: 127.255.255.255, and an address for each robot."""
    port = free_port(robots)
    addresses = tuple((f"127.0.1.{pid}", port) for pid in range(robots))
    plan = Plan(addresses, Delivery.SUBNET, ("127.255.255.255", port))
    return [Udp(plan, pid) for pid in range(robots)]


def zenoh(robots: int) -> list[Transport]:
    pytest.importorskip("zenoh")
    port = free_port(robots)
    made: list[Transport] = []
    for pid in range(robots):
        listen = (f"tcp/127.0.0.1:{port + pid}",)
        connect = tuple(f"tcp/127.0.0.1:{port + k}" for k in range(pid))
        made.append(Routed(f"run {port}", pid, robots, connect, listen))
    return made


_SLOW = (pytest.mark.slow, pytest.mark.sample)
MAKERS = [in_process, unicast, multicast, broadcast, pytest.param(zenoh, marks=_SLOW)]


@pytest.fixture(params=MAKERS, ids=lambda make: make.__name__)
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    opened: list[Transport] = []

    def opening(robots: int) -> list[Transport]:
        opened.extend(request.param(robots))
        wait_for_each_other(opened)
        return opened

    yield opening
    for transport in opened:
        transport.close()


def wait_for_each_other(transports: list[Transport]) -> None:
    """Routed sessions find each other in their own time."""
    for _ in range(200):
        for transport in transports:
            transport.tell(b"hello")
        heard = [bool(transport.receive(0.05)) for transport in transports]
        if all(heard):
            break
    for transport in transports:
        while transport.receive(0.02):
            pass


def came(transport: Transport, many: int) -> list[bytes]:
    """So many datagrams, unless they are lost."""
    got: list[bytes] = []
    for _ in range(100):
        got += transport.receive(0.05)
        if len(got) >= many:
            break
    return got


# --- the kit --------------------------------------------------------------------------------------


def test_a_datagram_gets_to_one_robot(make: Make) -> None:
    one, two, three = make(3)
    one.send(1, b"to you")
    assert came(two, 1) == [b"to you"]
    assert three.receive(0.0) == []
    assert one.receive(0.0) == []


def test_a_datagram_gets_to_all_others_once(make: Make) -> None:
    transports = make(3)
    transports[1].tell(b"to all")
    assert came(transports[0], 1) == [b"to all"]
    assert came(transports[2], 1) == [b"to all"]
    assert transports[1].receive(0.02) == []


def test_the_longest_datagram_arrives_whole(make: Make) -> None:
    one, two = make(2)
    one.send(1, bytes(range(256)) * 5 + bytes(LONGEST - 1280))
    assert [len(datagram) for datagram in came(two, 1)] == [LONGEST]


def test_many_datagrams_arrive(make: Make) -> None:
    one, two = make(2)
    for k in range(300):
        one.send(1, b"%d" % k)
    assert sorted(came(two, 300)) == sorted(b"%d" % k for k in range(300))


def test_nothing_is_nothing(make: Make) -> None:
    one, _ = make(2)
    assert one.receive(0.0) == []
    assert one.receive(0.001) == []


def test_closing_twice_is_closing(make: Make) -> None:
    one, two = make(2)
    one.close()
    one.close()
    one.send(1, b"lost")
    one.tell(b"lost")
    assert one.receive(0.0) == []
    assert two.receive(0.02) == []


def test_sending_to_a_robot_that_is_gone_is_loss(make: Make) -> None:
    one, two = make(2)
    two.close()
    for _ in range(5):
        one.send(1, b"anyone?")
        one.receive(0.0)


def test_robots_agree_over_it(make: Make) -> None:
    """Three robots on one thread, as fast as it goes."""
    setup = Setup(3, Timing.of(0.0, 3))
    key = run_key(KEY, b"a run")
    peers = [
        Peer(
            Channel(key, 3, pid),
            setup,
            fresh(setup, pid),
            StormRobot(pid, Journal()),
            transport,
            time.monotonic,
        )
        for pid, transport in enumerate(make(3))
    ]
    for peer in peers:
        peer.start()
    for _ in range(100_000):
        for peer in peers:
            peer.turn(0.0)
        if all(peer.node.state.round >= 12 for peer in peers):
            break
    least = min(peer.node.state.round for peer in peers)
    assert least >= 12
    chains = {held.digest for peer in peers for held in peer.node.state.log if held.round == 11}
    assert len(chains) == 1
    assert sum(peer.drops.total() for peer in peers) == 0


# --- floods ---------------------------------------------------------------------------------------


class Sample:
    """As zenoh hands it to a subscriber."""

    def __init__(self, datagram: bytes, key_expr: str = "koord/run/to/0") -> None:
        self.payload = self
        self.key_expr = key_expr
        self._datagram = datagram

    def to_bytes(self) -> bytes:
        return self._datagram


class Session:
    """As much of a session of zenoh's as the transport needs, where it is not installed."""

    def __init__(self) -> None:
        self.subscribers: dict[str, Callable[[Sample], None]] = {}

    def declare_subscriber(self, key: str, handler: Callable[[Sample], None]) -> None:
        self.subscribers[key] = handler

    def close(self) -> None:
        self.subscribers.clear()


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    """The session that the next transport opens."""
    made = Session()
    config = SimpleNamespace(insert_json5=lambda key, value: None)
    stub = SimpleNamespace(
        Config=lambda: config,
        open=lambda config: made,
        init_log_from_env_or=lambda level: None,
        ZError=OSError,
    )
    monkeypatch.setitem(sys.modules, "zenoh", stub)
    return made


def test_a_flood_over_zenoh_fills_no_memory_and_is_told(session: Session) -> None:
    """A flood of ten times as many datagrams as may wait, some of them very long."""
    transport = Routed("run", 0, 2)
    (to_me, to_all, _) = session.subscribers.values()
    for k in range(5 * MOST_WAITING):
        to_me(Sample(b"%d" % k + bytes(100 * LONGEST * (k % 512 == 0))))
        to_all(Sample(b"%d" % k, "koord/run/all/1"))
    assert transport.dropped == 9 * MOST_WAITING
    classes = loaded(compiled(example_program("sum_of_ids")))
    configuration = load_configuration(Source("c.yaml", "num_robots: 2\n"))
    job = Job(classes, (0, 0), configuration, KEY, "run", 0.1, 0.0, 5, None)
    runner = Runner(job, 0, transport)
    assert dict(runner.status.drops)[Drop.CROWDED.value] == 9 * MOST_WAITING
    came: list[bytes] = []
    while some := transport.receive(0.0):
        came += some
    assert len(came) == MOST_WAITING
    assert max(map(len, came)) == LONGEST + 1, "as over UDP: enough to see that it is too long"
    to_me(Sample(b"a friend"))
    assert transport.receive(0.0) == [b"a friend"], "there is room again"
    transport.close()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says how many it drops")
@pytest.mark.parametrize("opened", [unicast, multicast])
def test_what_the_kernel_has_no_room_for_is_told(
    opened: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(udp_transport, "_BUFFER_BYTES", 20_000)
    one, other = opened(2)
    sent = 200
    for _ in range(sent):
        one.tell(bytes(1000))
    lost = other.dropped
    assert 0 < lost < sent
    came: list[bytes] = []
    while some := other.receive(0.0):
        came += some
    assert len(came) == sent - lost
    assert other.dropped == lost
    for transport in (one, other):
        transport.close()
    assert other.dropped == lost, "also when nobody can ask the kernel any more"


def test_a_socket_to_which_datagrams_come_singly_is_asked_once_for_each() -> None:
    pace, taken = Pace(), []
    for came in [3, 2, *[1] * 11, 2, 2]:
        taken.append(pace.takes_all())
        pace.came += came
    # After several at once, and after a few that came singly, all that has come is taken.
    assert taken == [True, True, True, *[False] * 8, True, False, False, False]


def test_what_came_to_a_socket_is_taken_in_the_end() -> None:
    one, other = unicast(2)
    for _ in range(4):  # singly, as in rounds
        one.send(1, b"?")
        assert other.receive(1.0) == [b"?"]
    for k in range(100):
        one.send(1, b"%d" % k)
    came: list[bytes] = []
    while some := other.receive(0.0):
        came += some
    assert came == [b"%d" % k for k in range(100)]
    one.close()
    other.close()


# --- each its own ---------------------------------------------------------------------------------


def test_an_address_that_cannot_be_had_is_told() -> None:
    port = free_port(2)
    first = Udp(on_this_machine(2, port), 0)
    with pytest.raises(TransportError, match=f"127.0.0.1:{port + 1}"):
        Udp(on_this_machine(2, port), 0)
    first.close()
    with pytest.raises(TransportError, match="listened on"):
        Udp(Plan((("192.0.2.1", port),)), 0)


def test_a_multicast_datagram_is_sent_once() -> None:
    port = free_port(4)
    udp = Udp(on_this_machine(4, port), 0)
    udp.tell(b"x")
    assert udp.sent == 1
    udp.close()
    alone = Udp(on_this_machine(4, port, group=None), 0)
    alone.tell(b"x")
    assert alone.sent == 3
    alone.close()


def test_what_is_said_in_handshakes_is_handed_on_and_no_message_of_the_run() -> None:
    peer = together(Setup(2, Timing.of(0.1, 2))).peers[0]
    handed_on: list[bytes] = []
    peer.on_handshake = handed_on.append
    nonce, run = bytes(NONCE_BYTES), bytes(RUN_BYTES)
    said = (Join(nonce, b"", b"", ()), Roll((nonce, nonce)), Refused(nonce, RefusalReason.TWICE))
    writer = DatagramWriter(Channel(fleet_key(KEY, "a run"), 2, 1))
    datagrams = [d for one in said for d in writer.datagrams(0, 0, one)]
    datagrams += DatagramWriter(Channel(run_key(KEY, run), 2, 1)).datagrams(0, 0, Ask(0))
    for datagram in (b"", b"K", *datagrams):
        peer.read(datagram)
    assert handed_on == datagrams[: len(said)]
    assert peer.drops[Drop.SIZE] == 2
    assert peer.drops[Drop.FORGED] == 1, "the question is of another run"
    assert peer.counts.arrived == len(said) + 3


@pytest.mark.parametrize("robots", [1, 2, 5, 16])
def test_a_run_in_virtual_time_sends_what_it_should(robots: int) -> None:
    made = together(Setup(robots, Timing.of(0.1, robots)))
    made.run(20)
    before = made.hub.sent
    made.run(40)
    if robots == 1:
        assert made.hub.sent == 0
    else:
        assert made.hub.sent - before <= 20 * (2 * robots + 2)
    assert made.now < 4.2
    assert {len(ledger.acted) for ledger in made.ledgers} <= {41, 42}


def test_robots_of_two_runs_on_one_network_do_not_disturb_each_other() -> None:
    """Their datagrams are as good as forged to each other."""
    made = together(Setup(2, Timing.of(0.1, 2)))
    stranger = made.join(fresh(made.setup, 1), made.hub.transport(1), run=b"another")
    made.peers.pop()
    made.ledgers.pop()
    for _ in range(3):
        stranger.turn(0.0)
        made.run(made.peers[0].node.state.round + 2)
    assert made.peers[0].drops[Drop.FORGED] > 0
    assert stranger.node.state.round == -1
