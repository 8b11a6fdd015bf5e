"""Drivers that are wrong in one way each, of a simulated vehicle on a wire that can be cut."""

from __future__ import annotations

import math
import os
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, ClassVar

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import product, turned, yaw_of
from koord.runtime.drivers.setpoints import (
    Arm,
    Capabilities,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Sensed,
    Setpoint,
    Takeoff,
    Track,
)
from koord.sim.driver import vehicle
from koord.testing.conformance import Truth

#: A vehicle that was not heard of for so long has no link.
_LINK_S = 1.0


class Fault(Enum):
    """What can be wrong with a driver."""

    NONE = "nothing"
    SWAPPED = "x and y are swapped in positions"
    MIRRORED = "y points south"
    DOWN = "z points down"
    XYZW = "quaternions are xyzw"
    DEGREES = "headings are in degrees"
    TURNS_IN_DEGREES = "yaw rates are taken for degrees"
    CENTIMETRES = "positions are in centimetres"
    BODY_VELOCITY = "velocities are in the frame of the body"
    HALF_VELOCITY = "velocities are half of what they are"
    TOO_FAST = "it drives twice as fast as it is told"
    IGNORES_HOLD = "hold is not passed on"
    CREEPS = "to hold it creeps"
    HOLDS_LATE = "hold is passed on seconds late"
    LATE = "all that it is told is passed on seconds late"
    IGNORES_DISARM = "disarm is not passed on"
    WAKES = "disarmed it moves"
    BLOCKS = "each call waits"
    BLOCKS_ONCE = "one call waits for long"
    BLOCKS_ALONE = "calls wait while nobody is there"
    OLD = "stamps are a second old"
    FUTURE = "stamps are from the future"
    BACK = "stamps go back"
    SELDOM = "a new pose comes twice a second"
    FRESH = "the last pose is stamped anew while nobody is there"
    NEVER_BACK = "a link that was lost stays lost"
    QUIET = "it says nothing of a lost link"
    OPENS_ALONE = "it opens though nobody is there"
    RAISES_ALONE = "opening it raises something of its own where nobody is there"
    RAISES = "sensing raises"
    GOES_ON = "it goes on by itself with what it was told last"
    STAYS_UP = "land is not passed on"
    TOO_HIGH = "it rises twice as high"
    TAKES_ALL = "it takes any options"
    OTHER_KIND = "it says that it drives something else"
    PERCENT = "its battery is in per cent"
    PORTS_RAISE = "an actuator that there is not makes it raise"
    OPENS_ONCE = "it does not open again"
    HIJACKS = "a second driver cuts off the first"


class Options(Struct, frozen=True, forbid_unknown_fields=True):
    fault: Fault = Fault.NONE


class Anything(Struct, frozen=True):
    fault: Fault = Fault.TAKES_ALL


class Wire:
    """The other side of the wire: a vehicle in this process, as long as it is there."""

    def __init__(self) -> None:
        self.is_running, self.is_frozen = False, False
        self.opened = 0
        self.drivers: list[Faulty] = []
        self.waited_s = 0.0  #: for how long calls have waited on purpose

    def start(self) -> None:
        self.is_running, self.is_frozen = True, False

    def stop(self) -> None:
        self.is_running = False

    def freeze(self) -> None:
        self.is_frozen = True

    def thaw(self) -> None:
        self.is_frozen = False

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)
        self.waited_s += seconds

    @property
    def is_there(self) -> bool:
        return self.is_running and not self.is_frozen

    def truth(self) -> Truth | None:
        return None

    def seen(self) -> Sequence[Truth]:
        return ()


WIRE = Wire()


class Faulty:
    """A driver of a simulated vehicle, with a fault."""

    OPTIONS: ClassVar[type[Struct]] = Options

    def __init__(self, device: Device) -> None:
        self.fault: Fault = device.options.fault
        self.real = vehicle(device)
        self.is_cut = False
        self._last: Sensed | None = None
        self._heard_s = -math.inf
        self._late: deque[tuple[float, Setpoint]] = deque()
        self._moves: Setpoint = Hold()
        self._led: Drive | None = None  #: how it was led last
        self._held_s: float | None = None  #: since when it is to hold
        self._calls = 0

    @property
    def capabilities(self) -> Capabilities:
        told = replace(self.real.capabilities, tells_battery=True)
        if self.fault is Fault.OTHER_KIND:
            return replace(told, kinds=("SUBMARINE",))
        return told

    def open(self, now_s: float) -> None:
        if not WIRE.is_there and self.fault is Fault.RAISES_ALONE:
            raise TimeoutError("timed out")
        if not WIRE.is_there and self.fault is not Fault.OPENS_ALONE:
            raise DriverError("nobody is there", "switch it on")
        WIRE.opened += 1
        if self.fault is Fault.OPENS_ONCE and WIRE.opened > 1:
            raise DriverError("the port is taken", "close it first")
        if self.fault is Fault.HIJACKS:
            for other in WIRE.drivers:
                other.is_cut = True
        WIRE.drivers.append(self)
        self.real.open(now_s)
        self._hear(now_s)

    def sense(self, now_s: float) -> Sensed | None:
        self._calls += 1
        self._wait()
        if self.fault is Fault.RAISES and self._calls > 20:
            raise ZeroDivisionError("division by zero")
        if self.fault is Fault.GOES_ON and isinstance(self._moves, Drive | Track):
            self._moves = _onward(self._moves)
            self.real.command(self._moves, now_s)
        while self._late and self._late[0][0] <= now_s:
            self.real.command(self._late.popleft()[1], now_s)
        lost = self._last is not None and not self._last.link
        if WIRE.is_there and not self.is_cut and not (self.fault is Fault.NEVER_BACK and lost):
            self._hear(now_s)
        assert self._last is not None
        if self.fault is Fault.FRESH:
            return replace(self._last, measured_at_s=now_s)
        self._last = replace(self._last, link=now_s - self._heard_s <= _LINK_S)
        return self._last

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        self._wait()
        if not WIRE.is_there or self.is_cut:
            return
        if isinstance(setpoint, Drive | Track | Position | Hold | Land | Disarm):
            self._moves = setpoint
        passed = self._passed(setpoint)
        if passed is None:
            return
        if self.fault is Fault.LATE:
            self._late.append((now_s + 4.0, passed))
        elif self.fault is Fault.HOLDS_LATE:
            self.real.command(self._still_led(setpoint, now_s), now_s)
        else:
            self.real.command(passed, now_s)

    def ports(self) -> Mapping[str, Any]:
        return {}

    def act(self, port: str, value: Any) -> None:
        if self.fault is Fault.PORTS_RAISE:
            raise KeyError(port)

    @property
    def remarks(self) -> tuple[str, ...]:
        lost = self._last is not None and not self._last.link
        return ("nothing is heard",) if lost and self.fault is not Fault.QUIET else ()

    def close(self) -> None:
        if self in WIRE.drivers:
            WIRE.drivers.remove(self)

    # --- what is wrong --------------------------------------------------------------------------

    def _wait(self) -> None:
        alone = not WIRE.is_there
        if self.fault is Fault.BLOCKS or (self.fault is Fault.BLOCKS_ALONE and alone):
            WIRE.wait(0.015)
        if self.fault is Fault.BLOCKS_ONCE and self._calls == 9:
            WIRE.wait(0.3)

    def _hear(self, now_s: float) -> None:
        if self.fault is Fault.SELDOM and now_s - self._heard_s < 0.5:
            return
        sensed = self.real.sense(now_s)
        assert sensed is not None
        self._heard_s = now_s
        self._last = replace(self._wrong(sensed, now_s), battery=0.8)
        if self.fault is Fault.PERCENT:
            self._last = replace(self._last, battery=80.0)

    def _wrong(self, sensed: Sensed, now_s: float) -> Sensed:
        x, y, z = sensed.position_m
        w, i, j, k = sensed.attitude
        heading = yaw_of(sensed.attitude)
        vx, vy, vz = sensed.velocity_mps
        match self.fault:
            case Fault.SWAPPED:
                return replace(sensed, position_m=(y, x, z))
            case Fault.MIRRORED:
                return replace(sensed, position_m=(x, -y, z))
            case Fault.DOWN:
                return replace(sensed, position_m=(x, y, -z))
            case Fault.XYZW:
                return replace(sensed, attitude=(i, j, k, w))
            case Fault.DEGREES:
                more = turned(math.degrees(heading) - heading)
                return replace(sensed, attitude=product(more, sensed.attitude))
            case Fault.CENTIMETRES:
                return replace(sensed, position_m=(100 * x, 100 * y, 100 * z))
            case Fault.BODY_VELOCITY:
                c, s = math.cos(heading), math.sin(heading)
                return replace(sensed, velocity_mps=(c * vx + s * vy, c * vy - s * vx, vz))
            case Fault.HALF_VELOCITY:
                return replace(sensed, velocity_mps=(vx / 2, vy / 2, vz / 2))
            case Fault.OLD:
                return replace(sensed, measured_at_s=now_s - 1.0)
            case Fault.FUTURE:
                return replace(sensed, measured_at_s=now_s + 0.2)
            case Fault.BACK:
                return replace(sensed, measured_at_s=now_s - 0.04 * (self._calls % 3))
            case _:
                return sensed

    def _still_led(self, setpoint: Setpoint, now_s: float) -> Setpoint:
        """What it goes on with for some seconds after it was told to hold."""
        if not isinstance(setpoint, Hold):
            self._held_s = None
            self._led = setpoint if isinstance(setpoint, Drive) else None
        elif self._held_s is None:
            self._held_s = now_s
        late = self._held_s is not None and now_s - self._held_s < 2.5
        return self._led if late and self._led is not None else setpoint

    def _passed(self, setpoint: Setpoint) -> Setpoint | None:
        """What becomes of what it is told."""
        match self.fault, setpoint:
            case Fault.TURNS_IN_DEGREES, Drive(speed_mps=speed, yaw_rate_radps=rate):
                return Drive(speed, math.radians(rate))
            case Fault.TOO_FAST, Drive(speed_mps=speed, yaw_rate_radps=rate):
                return Drive(2 * speed, 2 * rate)
            case (Fault.IGNORES_HOLD, Hold()) | (Fault.IGNORES_DISARM, Disarm()):
                return self._moves if isinstance(self._moves, Drive) else Drive(0.4)
            case Fault.CREEPS, Hold():
                return Drive(0.1)
            case Fault.WAKES, Disarm():
                self.real.command(Arm(), self.real._now_s or 0.0)
                return Drive(0.3)
            case Fault.STAYS_UP, Land():
                return Hold()
            case Fault.TOO_HIGH, Takeoff(height_m=height):
                return Takeoff(2 * height)
            case _:
                return setpoint


class Credulous(Faulty):
    """It takes any options."""

    OPTIONS: ClassVar[type[Struct]] = Anything


def dies(device: Device) -> Faulty:
    """End the process in which it is to be made."""
    print("it has died", file=sys.stderr, flush=True)
    os._exit(3)


dies.OPTIONS = Options  # type: ignore[attr-defined]


def _onward(setpoint: Drive | Track) -> Drive | Track:
    """The same again; what is tracked goes on with its velocity."""
    if isinstance(setpoint, Drive):
        return setpoint
    (x, y, z), (vx, vy, vz) = setpoint.position_m, setpoint.velocity_mps
    return replace(setpoint, position_m=(x + vx * 0.05, y + vy * 0.05, z + vz * 0.05))
