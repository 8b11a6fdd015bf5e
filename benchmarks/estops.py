"""From the first datagram of an e-stop until the driver is told, over UDP on this machine.

    python benchmarks/estops.py

A robot with a simulated car ticks twenty times a second and hears orders between ticks, as deployed
robots do. (O-AT-ONCE)
"""

from __future__ import annotations

import secrets
import threading
import time
from random import Random
from types import SimpleNamespace
from typing import cast

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.setpoints import Disarm, Setpoint
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.limits import usual
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import World
from koord.runtime.orders.hearing import Body, Hearer
from koord.runtime.orders.lines import Addresses, line_to
from koord.runtime.orders.messages import Request, Wanted
from koord.runtime.platform.checks import Stated
from koord.runtime.platform.host import VehicleHost, VehiclePlatform
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.transports.udp import Udp, on_this_machine
from koord.runtime.wire.codec import Channel, DatagramWriter
from koord.runtime.wire.frames import MOST_ROBOTS, order_key
from koord.sim.driver import vehicle
from koord.sim.scene import device_model

PORT, TIMES = 24_680, 500
KEY = order_key(secrets.token_bytes(32))
WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))


class Robot(threading.Thread):
    """One robot: its ear, its platform and its ticks. ``told_at`` is when it was last disarmed."""

    def __init__(self, transport: Udp) -> None:
        super().__init__(daemon=True)
        self.told_at = 0.0
        self.is_over = False
        self._transport = transport
        told = Vehicle("CAR", "CAR")
        model = device_model(told)
        driver = vehicle(Device(0, told, WORLD, (0.0, 0.0, 0.0)))
        command = driver.command

        def noted(setpoint: Setpoint, now_s: float) -> None:
            if isinstance(setpoint, Disarm):
                self.told_at = time.perf_counter()
            command(setpoint, now_s)

        driver.command = noted  # type: ignore[method-assign]
        setup = Setup(usual(model.body), field(WORLD, flat=True), 0.1)
        steersman = pilot(PilotSettings(model.body, model.planner), WORLD)
        driven = DrivenVehicle(driver, steersman, setup, time.monotonic())
        self._platform = VehiclePlatform(
            cast(VehicleHost, SimpleNamespace(kinds=(0,))), driven, stated=Stated()
        )
        body = Body(
            lambda order: self._platform.order(order, time.monotonic()),
            lambda: self._platform.state,
        )
        self._ear = Hearer(Channel(KEY, 1, 0), body, time.monotonic, time.time)

    def run(self) -> None:
        while not self.is_over:
            for visit in self._transport.visits():
                answer = self._ear.hear(visit.datagram)
                if answer is not None:
                    visit.answer(answer)
            due_s = self._platform.tick(time.monotonic(), 0.05, None)
            self._transport.receive(max(0.0, due_s - time.monotonic()))


def main() -> None:
    """Measure, and print medians and worst cases."""
    plan = on_this_machine(1, PORT, group=None)
    robot = Robot(Udp(plan, 0))
    robot.start()
    line = line_to(Addresses(((0, plan.addresses[0]),)))
    writer = DatagramWriter(Channel(KEY, MOST_ROBOTS, MOST_ROBOTS - 1))
    draw = Random(1)
    told_ms: list[float] = []
    answered_ms: list[float] = []
    for _ in range(TIMES):
        time.sleep(draw.uniform(0.0, TICK_S))
        wanted = Request(secrets.token_bytes(16), 0, Wanted.ESTOP, time.time(), None)
        (datagram,) = writer.datagrams(0, 0, wanted)
        begun = time.perf_counter()
        line.send(0, datagram)
        while not line.receive(1.0):
            pass
        answered_ms.append(1000 * (time.perf_counter() - begun))
        told_ms.append(1000 * (robot.told_at - begun))
    robot.is_over = True
    for what, found in (("the driver is told", told_ms), ("the caller knows", answered_ms)):
        found.sort()
        median, most = found[TIMES // 2], found[-1]
        print(
            f"{what}: median {median:.2f} ms, 99 of 100 {found[99 * TIMES // 100]:.2f} ms, ", end=""
        )
        print(f"at most {most:.2f} ms; a tick is {1000 * TICK_S:.0f} ms")


if __name__ == "__main__":
    main()
