"""What tests of deployed fleets rely on can fail: contradictions are found, faults happen."""

from __future__ import annotations

import socket
import time

import pytest
from msgspec.structs import replace

from koord.runtime.chaos.network import Faults
from tests.deployed.proxy import Proxy
from tests.deployed.recordings import Recording, Said, disagreements

_TOLD = tuple(Said(round_, "Mark", late=False, found=7 * round_, lost=0) for round_ in range(4))


def test_robots_that_say_the_same_agree() -> None:
    skipped = replace(_TOLD[1], event=None, found=None, lost=None)
    others = (_TOLD[0], skipped, *_TOLD[2:])
    assert disagreements([(0, Recording(list(_TOLD))), (1, Recording(list(others)))]) == []
    back = Recording(list(_TOLD[3:]))
    assert disagreements([(0, Recording(list(_TOLD[:3]))), (0, back)]) == []


@pytest.mark.parametrize(
    ("pid", "rounds", "told"),
    [
        (1, [replace(_TOLD[2], found=15)], "in round 2 robot 0 found 14, robot 1 15"),
        (0, [replace(_TOLD[2], event=None)], "robot 0 did round 2 twice"),
        (1, [_TOLD[2], _TOLD[1]], "robot 1 went from round 2 to 1"),
        (1, [replace(_TOLD[3], lost=-2)], "robot 1 has lost -2 of its own turns in round 3"),
    ],
)
def test_robots_that_contradict_each_other_are_named(
    pid: int, rounds: list[Said], told: str
) -> None:
    found = disagreements([(0, Recording(list(_TOLD))), (pid, Recording(rounds))])
    assert len(found) == 1
    assert found[0].startswith(told)


class Two:
    """Two sockets with a proxy between them."""

    def __init__(self) -> None:
        self.proxy = Proxy(2, seed=1)
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        self.seats = []
        for pid, one in enumerate(self.sockets):
            one.bind(("127.0.0.1", 0))
            one.settimeout(0.5)
            self.seats.append(self.proxy.seat(str(pid), pid, one.getsockname()))

    def send(self, count: int) -> list[bytes]:
        """What arrives at the second one of so many datagrams of the first one, in this order."""
        for number in range(count):
            address = self.seats[0].others[1].getsockname()
            self.sockets[0].sendto(number.to_bytes(2), address)
            time.sleep(0.0005)
        came = []
        try:
            while True:
                data, source = self.sockets[1].recvfrom(100)
                assert source == self.seats[1].others[0].getsockname()
                came.append(data)
        except TimeoutError:
            return came

    def close(self) -> None:
        self.proxy.close()
        for one in self.sockets:
            one.close()


def test_the_network_does_to_datagrams_what_it_is_told_to() -> None:
    two = Two()
    try:
        recorded = two.proxy.record()
        sent = [number.to_bytes(2) for number in range(200)]
        assert two.send(200) == sent
        assert [one.data for one in recorded] == sent
        two.proxy.faults = Faults(loss=0.3, duplication=0.3, least_delay_s=0.0, most_delay_s=0.01)
        came = two.send(200)
        assert 100 < len(set(came)) < 180
        assert len(came) > len(set(came)) + 10
        assert came != sorted(came)
        two.proxy.cut = frozenset({"1"})
        assert two.send(20) == []
        assert two.proxy.replay(recorded[:20]) == 20
    finally:
        two.close()
