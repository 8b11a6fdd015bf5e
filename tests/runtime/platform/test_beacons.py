"""Beacons: what robots tell each other of their vehicles, beside the agreement. (P-BEACON)"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from koord.runtime.chaos.storm import Journal, StormRobot
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.guardian.events import Other
from koord.runtime.motion.group import TICK_S
from koord.runtime.node import Peer
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import BEACON_S, VehicleHost, VehiclePlatform
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import Beacon
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import run_key
from tests.runtime.hub import Hub


class Standing:
    """A vehicle that stands, and keeps what it is told of others."""

    def __init__(self) -> None:
        self.sensed = Sensed((1.0, 2.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.5, 0.0, 0.0), 9.9)
        self.others: tuple[Other, ...] = ()
        self.mode = None

    def tick(
        self,
        now_s: float,
        age_s: float | None,
        why: Reason | None,
        others: tuple[Other, ...],
        alive_s: float | None,
    ) -> None:
        self.others = others


class Host:
    kinds = (0, 0, 0)


def platform() -> tuple[VehiclePlatform, Standing]:
    vehicle = Standing()
    return VehiclePlatform(
        cast(VehicleHost, Host()), cast(DrivenVehicle, vehicle), stated=Stated()
    ), vehicle


def test_a_robot_says_where_it_is_ten_times_a_second() -> None:
    made, _ = platform()
    said = [made.beacon(10.0 + TICK_S * k) for k in range(40)]
    assert said[0] == Beacon((1.0, 2.0, 0.0), (0.5, 0.0, 0.0), 10.0 - 9.9)
    assert sum(one is not None for one in said) == round(40 * TICK_S / BEACON_S)


def test_what_is_heard_grows_older() -> None:
    made, vehicle = platform()
    made.hear(2, Beacon((3.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.25), 20.0)
    made.tick(20.5, None, None)
    assert vehicle.others == (Other(2, (3.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.75),)


def test_a_beacon_reaches_all_others_and_no_step_of_the_protocol() -> None:
    hub, key, heard = Hub(3), run_key(b"a key", b"a run"), list[tuple[int, int, Beacon]]()
    setup = Setup(3, Timing.of(0.1, 3))
    peers = [
        Peer(
            Channel(key, 3, pid),
            setup,
            fresh(setup, pid),
            StormRobot(pid, Journal()),
            hub.transport(pid),
            lambda: 0.0,
        )
        for pid in range(3)
    ]

    def hears(pid: int) -> Callable[[int, Beacon], None]:
        return lambda sender, beacon: heard.append((pid, sender, beacon))

    for pid, peer in enumerate(peers):
        peer.on_beacon = hears(pid)
    before = [peer.node.state for peer in peers]
    said = Beacon((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.1)
    peers[1].tell(said)
    for peer in peers:
        peer.turn(0.0)
    assert heard == [(0, 1, said), (2, 1, said)]
    assert [peer.node.state for peer in peers] == before
