"""Drivers that speak ROS, asked and told tick by tick in real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from koord.runtime.drivers.ros.driver import RosDriver
from koord.runtime.drivers.ros.graph import Fields, Latest, Sender
from koord.runtime.drivers.setpoints import Drive, Position, Sensed
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.field import field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.sim.scene import device_model

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))

#: There and back through a node, in seconds, at best: what else the machine does is no part of it,
#: and `benchmarks/drivers.py` tells the median.
ROUND_TRIP_S = 0.005


def there_and_back(
    sender: Sender, echo: Latest, sent: Fields, most_s: float = 3.0
) -> tuple[Any | None, float]:
    """Send a message to a node; what comes back of it, if anything does, and after how long."""
    begun_s, back = time.perf_counter(), None
    sender.send(sent)
    while back is None and time.perf_counter() - begun_s < most_s:
        back = echo.take()
        time.sleep(0)  # threads of the library may run
    return back, time.perf_counter() - begun_s


def until(made: RosDriver, condition: Callable[[Sensed], bool], most_s: float = 30.0) -> Sensed:
    """Ask it at every tick until something holds of what it senses."""
    end_s = time.monotonic() + most_s
    while True:
        sensed = made.sense(time.monotonic())
        assert sensed is not None
        if condition(sensed):
            return sensed
        assert time.monotonic() < end_s, (sensed, made.remarks)
        time.sleep(0.01)


def driven_until(
    made: RosDriver, wish: Drive | Position, condition: Callable[[Sensed], bool]
) -> Sensed:
    """Command it at every tick until something holds."""

    def told(sensed: Sensed) -> bool:
        made.command(wish, time.monotonic())
        return condition(sensed)

    return until(made, told)


class Driven:
    """A vehicle with its pilot and guardian, in real time."""

    def __init__(self, made: RosDriver) -> None:
        vehicle = made.device.vehicle
        model = device_model(vehicle)
        guarded = Setup(usual(model.body), field(WORLD, flat=model.body.ON_GROUND), 0.1)
        settings = PilotSettings(model.body, model.planner)
        steersman = pilot(settings, WORLD, wishes=made.capabilities.wishes)
        self.driven = DrivenVehicle(made, steersman, guarded, time.monotonic())

    def until(self, condition: Callable[[], bool], most_s: float = 60.0) -> None:
        end_s = time.monotonic() + most_s
        while not condition():
            self.driven.tick(time.monotonic(), 0.0)
            assert time.monotonic() < end_s, (
                self.driven.sensed,
                self.driven.mode,
                list(self.driven.notes)[:9],
            )
            time.sleep(TICK_S)

    def go_to(self, goal: Point) -> None:
        self.until(self.started)
        self.driven.go_to(goal)
        self.driven.tick(time.monotonic(), 0.0)
        assert not self.driven.sensors.reached
        self.until(lambda: self.driven.sensors.reached)

    def started(self) -> bool:
        order = Order.ARM if self.driven.mode is Mode.DISARMED else Order.START
        self.driven.order(order, time.monotonic())
        return self.driven.mode is Mode.RUNNING
