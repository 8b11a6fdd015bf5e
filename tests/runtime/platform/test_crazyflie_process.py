"""The driver of Crazyflies over UDP, by cflib with its threads; the Crazyflie is another process.

Few and in real time: what is looked for comes when it comes, and nothing is said of how soon.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.crazyflie.driver import CrazyflieDriver
from koord.runtime.drivers.crazyflie.link import CflibLink
from koord.runtime.drivers.crazyflie.options import CrazyflieOptions
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Hold,
    Land,
    Position,
    Sensed,
    Setpoint,
    Takeoff,
)
from koord.runtime.motion.world import World
from koord.testing.crazyflie.machine import Settings
from koord.testing.crazyflie.serving import datagram_of, serve
from koord.testing.sockets import Address
from tests.runtime.platform.autopilots import running

WORLD = World((-5.0, -5.0, 0.0), (5.0, 5.0, 4.0))
PATIENCE_S = 60.0
TICK_S = 0.05


@contextmanager
def crazyflie(settings: Settings) -> Iterator[Address]:
    """A Crazyflie in a process of its own; yields where it is."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        with running(serve, bound, settings):
            yield bound.getsockname()


def made(address: Address, **given: object) -> CrazyflieDriver:
    host, port = address
    options = CrazyflieOptions(
        uri=f"udp://{host}:{port}",
        connect=PATIENCE_S,
        climb=2.0,
        sink=1.0,
        **given,  # type: ignore[arg-type]
    )
    device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
    driver = CrazyflieDriver(device)
    driver.open(time.monotonic())
    return driver


def tell(driver: CrazyflieDriver, setpoint: Setpoint, until: Callable[[Sensed], bool]) -> None:
    """Tell it something at each tick until it has come of it."""
    begun = time.monotonic()
    while True:
        now = time.monotonic()
        sensed = driver.sense(now)
        assert sensed is not None, "it was known at the start where it is"
        if until(sensed):
            return
        assert now - begun < PATIENCE_S, (setpoint, sensed, driver.remarks)
        driver.command(setpoint, now)
        time.sleep(TICK_S)


def test_it_flies_there_and_lands(tmp_path: Path) -> None:
    with crazyflie(Settings(arms_itself=False)) as address:
        driver = made(address, cache=str(tmp_path))
        tell(driver, Arm(), lambda sensed: sensed.armed is True)
        tell(driver, Takeoff(0.5), lambda sensed: sensed.position_m[2] > 0.45)
        tell(driver, Position((0.5, -0.5, 0.5), None, 1.0), _is_there)
        names = {thread.name for thread in threading.enumerate()}
        assert "ping_thread" not in names
        tell(driver, Land(), lambda sensed: sensed.airborne is False)
        tell(driver, Disarm(), lambda sensed: sensed.armed is False)
        assert driver.remarks == ()
        driver.close()
    assert len(list(tmp_path.glob("*.json"))) == 2, "its tables are kept"


def _is_there(sensed: Sensed) -> bool:
    x, y, z = sensed.position_m
    return abs(x - 0.5) < 0.1 and abs(y + 0.5) < 0.1 and abs(z - 0.5) < 0.1


def fly(address: Address) -> None:
    """What the process does that is killed."""
    driver = made(address)
    tell(driver, Arm(), lambda sensed: sensed.armed is True)
    tell(driver, Takeoff(0.5), lambda sensed: sensed.position_m[2] > 0.45)
    tell(driver, Hold(), lambda sensed: False)


def test_who_asks_is_answered_alone() -> None:
    """cflib connects anew when it hears what another has asked for. (C-LINK)"""
    kinds = socket.AF_INET, socket.SOCK_DGRAM
    with (
        crazyflie(Settings()) as address,
        socket.socket(*kinds) as one,
        socket.socket(*kinds) as two,
    ):
        for client in (one, two):
            client.settimeout(PATIENCE_S)
            assert _asked(client, b"\xff", address) == b"\xff", "both are known there"
        for client, data in ((one, b"one"), (two, b"two")):
            echo = datagram_of((15, 0, data))
            assert _asked(client, echo, address) == echo


def _asked(client: socket.socket, data: bytes, address: Address) -> bytes:
    """The first answer that is not of its console."""
    client.sendto(data, address)
    while (answer := client.recv(64))[0] >> 4 == 0:
        pass
    return answer


@pytest.mark.slow
def test_its_firmware_stops_it_when_koord_is_killed() -> None:
    """An onlooker connects by a link of its own, and says nothing. (C-SILENCE)"""
    with crazyflie(Settings()) as address:
        looking = made(address, reset=False)
        with running(fly, address) as flying:
            look(looking, lambda sensed: sensed.position_m[2] > 0.4)
            flying.kill()
        look(looking, lambda sensed: not sensed.link and sensed.position_m[2] < 0.02)
        assert "it has locked itself" in looking.remarks[0]
        looking.close()


def look(driver: CrazyflieDriver, until: Callable[[Sensed], bool]) -> None:
    begun = time.monotonic()
    while not ((sensed := driver.sense(time.monotonic())) and until(sensed)):
        assert time.monotonic() - begun < PATIENCE_S, (sensed, driver.remarks)
        time.sleep(TICK_S)


@pytest.mark.slow
def test_who_is_let_go_of_in_the_air_is_not_told_to_stop_its_motors() -> None:
    """cflib's own way to close a link sends a thrust of zero. (C-CLOSE)"""
    with crazyflie(Settings()) as address:
        looking, driver = made(address, reset=False), made(address)
        tell(driver, Arm(), lambda sensed: sensed.armed is True)
        tell(driver, Takeoff(1.5), lambda sensed: sensed.position_m[2] > 1.4)
        tell(driver, Land(), lambda sensed: sensed.position_m[2] < 1.3)
        driver.close()
        look(looking, lambda sensed: sensed.airborne is False)
        assert looking.remarks == (), "it has landed by itself, and not fallen"
        looking.close()


@pytest.mark.slow
def test_a_crazyflie_that_was_switched_off_and_on_is_found_again() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        with running(serve, bound, Settings()):
            driver = made(bound.getsockname())
        look(driver, lambda sensed: not sensed.link)
        with running(serve, bound, Settings(start_m=(1.0, 0.0, 0.0))):
            look(driver, lambda sensed: sensed.link and sensed.position_m[0] > 0.9)
            assert driver.remarks == ()
            driver.close()


def test_nobody_there_is_an_error_that_says_where() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        host, port = bound.getsockname()
        options = CrazyflieOptions(uri=f"udp://{host}:{port}", connect=0.3)
        device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
        with pytest.raises(DriverError, match=f"nothing is heard of .*{port}"):
            CrazyflieDriver(device).open(time.monotonic())


@pytest.mark.skipif(os.path.exists("/dev/bus/usb"), reason="there may be a Crazyradio")
def test_a_crazyradio_that_is_not_plugged_in_is_named() -> None:
    options = CrazyflieOptions(uri="radio://0/80/2M/E7E7E7E7E7")
    device = Device(0, Vehicle("drone", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=options)
    with pytest.raises(DriverError, match="there is no Crazyradio") as caught:
        CrazyflieDriver(device).open(time.monotonic())
    assert "plug it in" in caught.value.hint


def test_what_could_not_be_sent_in_time_is_dropped_and_nobody_waits_for_it() -> None:
    """By radio, to send waits for two seconds: the tick does not. (C-TICK)"""
    link = CflibLink(CrazyflieOptions(uri="udp://127.0.0.1:1"))
    blocked, sent = threading.Event(), list[int]()
    link._sender.start()
    link.send(lambda _: assert_set(blocked), PATIENCE_S)
    for number in range(100):
        link.send(lambda _, number=number: sent.append(number), 0.0)  # type: ignore[misc]
    blocked.set()
    link.send(lambda _: sent.append(-1), PATIENCE_S)
    begun = time.monotonic()
    while not sent and time.monotonic() - begun < PATIENCE_S:
        link.send(lambda _: sent.append(-1), PATIENCE_S)
        time.sleep(0.01)
    link.close()
    assert set(sent) == {-1}


def assert_set(event: threading.Event) -> None:
    assert event.wait(PATIENCE_S)
