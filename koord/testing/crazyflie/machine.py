"""What a simulated Crazyflie makes of packets, and what it tells: without clock or socket.

It does what its firmware does (bitcraze/crazyflie-firmware 2a18fc29, of August 2026), as far as a
client can see it: the supervisor's states (`supervisor.c`, `supervisor_state_machine.c`),
set-points with priorities (`commander.c`), landing by the high-level commander. It shares nothing
with the driver.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from koord.testing.autopilot.airframe import Airframe, Target, Vector, product
from koord.testing.crazyflie.attitudes import Quaternion, unpacked, yaw_of
from koord.testing.crazyflie.settings import Settings as Settings
from koord.testing.crazyflie.settings import State as State
from koord.testing.crazyflie.tables import Kind, Logs, Parameters

_STEP_S = 0.01

#: `supervisor.c`: set-points older than these make it level out, and fall; it counts as flying for
#: so long after its motors ran last; `platform_defaults.h`: so long after landing it disarms, and
#: after arming if it does not fly.
_LEVEL_S, _FALL_S, _FLYING_S, _LANDED_S, _PREFLIGHT_S = 0.5, 2.0, 2.0, 3.0, 30.0

#: Poses from outside count for so long.
_POSE_S = 0.5

#: Variances of an estimate that is good, and of one that nothing supports, in m².
_SURE_M2, _UNSURE_M2 = 1e-4, 100.0

_EMPTY_V, _FULL_V = 3.0, 4.2

_PROTOCOL = 12

#: `errno`
_EBUSY = 16


_MAY_FLY = (State.READY, State.FLYING, State.LANDED, State.LEVEL_OUT)


class Priority(Enum):
    """Whose set-points count: those of a higher number."""

    LOWEST = 1
    HIGH_LEVEL = 2
    RADIO = 3


class Said(Struct, frozen=True):
    """A set-point; without a target motors stop."""

    target: Target | None
    at_s: float


class Landing(Struct, frozen=True):
    """What the high-level commander flies by itself."""

    start_m: Vector
    end_down_m: float
    begun_s: float
    lasts_s: float


Packet = tuple[int, int, bytes]  #: port, channel, data

_LOGGED = (
    *(
        (f"stateEstimate.{name}", Kind.FLOAT)
        for name in ("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw", "yaw")
    ),
    *((f"kalman.varP{axis}", Kind.FLOAT) for axis in "XYZ"),
    ("pm.vbat", Kind.FLOAT),
    ("supervisor.info", Kind.UINT16),
)


class SimulatedCrazyflie:
    """A Crazyflie, and what it was told."""

    def __init__(self, settings: Settings, now_s: float) -> None:
        """Stand on the ground; it has just been switched on."""
        x, y, z = settings.start_m
        self.settings = settings
        self.airframe = Airframe((y, x, -z), math.pi / 2 - settings.yaw_rad, settings.handling)
        self.state, self.armed, self.battery = State.CHECKS_FAIL, False, settings.battery
        self.tumbled = settings.tumbled
        self.poses: list[
            tuple[float, ...]
        ] = []  #: that it was told from outside, x y z qx qy qz qw
        self.parameters = Parameters(
            [("kalman.resetEstimation", Kind.UINT8, 0), ("stabilizer.estimator", Kind.UINT8, 2)]
        )
        known = [(name, kind) for name, kind in _LOGGED if name not in settings.forgets]
        self.logs = Logs(known)
        self._now_s = self._boot_s = now_s
        self._said = Said(None, now_s)
        self._priority = Priority.LOWEST
        self._landing: Landing | None = None
        self._is_disabled = False  #: the high-level commander says nothing
        self._error_m: Vector = (0.0, 0.0, 0.0)  #: of its estimate: what it was told from outside
        self._pose_s = self._motors_s = -math.inf
        self._since_s = now_s  #: in this state
        self._out: list[Packet] = []

    # --- what it hears --------------------------------------------------------------------------

    def hear(self, packet: Packet) -> None:
        """Take note of a packet, and answer."""
        port, channel, data = packet
        match port, channel:
            case 15, 0:
                self._answer(15, 0, data)
            case 15, 1:
                self._answer(15, 1, b"Bitcraze Crazyflie\0".ljust(30, b"\0"))
            case 13, 1 if data[:1] == b"\0":
                self._answer(13, 1, struct.pack("<BI", 0, _PROTOCOL))
            case 4, 0 if data[:1] == b"\1":
                self._answer(4, 0, b"\1\0")  # no memories
            case 5, 0:
                self._answer(5, 0, self.logs.table.answer(data))
            case 5, 1:
                self._answer(5, 1, self.logs.control(data, self._now_s))
            case 2, 0:
                self._answer(2, 0, self.parameters.table.answer(data))
            case 2, 1:
                self._answer(2, 1, self.parameters.read(data))
            case 2, 2:
                self._answer(2, 2, self.parameters.write(data))
            case 2, 3 if data[:1] == b"\0":
                self._answer(2, 3, self.parameters.write_by_name(data))
            case 3, 0:
                self._say(None)  # roll, pitch, yaw and thrust, of which only zeros are sent here
            case 7, 0:
                self._hear_setpoint(data)
            case 7, 1 if data[:1] == b"\0":
                self._priority = Priority.LOWEST
            case 8, 0:
                self._answer(8, 0, data[:3] + bytes([self._command(data)]))
            case 9, _:
                self._supervise(channel, data)
            case 6, _:
                self._hear_pose(channel, data)

    def _answer(self, port: int, channel: int, data: bytes | None) -> None:
        if data is not None:
            self._out.append((port, channel, data))

    def _say(self, target: Target | None) -> None:
        """A set-point by radio. It makes the high-level commander forget what it was at."""
        self._said, self._priority = Said(target, self._now_s), Priority.RADIO
        self._landing, self._is_disabled = None, True

    def _hear_setpoint(self, data: bytes) -> None:
        match data[0]:
            case 0:
                self._say(None)
            case 6:
                x, y, z, vx, vy, vz, ax, ay, az, packed = struct.unpack_from("<9hI", data, 1)
                moving = (vy / 1000, vx / 1000, -vz / 1000), (ay / 1000, ax / 1000, -az / 1000)
                yaw = math.pi / 2 - yaw_of(unpacked(packed))
                self._say(Target((y / 1000, x / 1000, -z / 1000), *moving, yaw))
            case 7:
                x, y, z, degrees = struct.unpack_from("<4f", data, 1)
                self._say(Target((y, x, -z), yaw_rad=math.pi / 2 - math.radians(degrees)))
            case 8:
                x, y, z, degrees = struct.unpack_from("<4f", data, 1)
                self._say(Target(None, (y, x, -z), yaw_rate_radps=-math.radians(degrees)))

    def _command(self, data: bytes) -> int:
        """A command to the high-level commander; the answer is an `errno`, or that it cannot."""
        if self.state not in _MAY_FLY:
            return _EBUSY
        match data[0]:
            case 3:
                self._landing, self._is_disabled = None, False
            case 8 if self._landing is None:
                height, _, _, lasts_s = struct.unpack_from("<ff?f", data, 2)
                here = self.airframe.position_m
                self._landing = Landing(here, -height, self._now_s, lasts_s)
                self._is_disabled = False
            case 8:
                return 1
            case _:
                return 8  # ENOEXEC
        return 0

    def _supervise(self, channel: int, data: bytes) -> None:
        match channel, data[0]:
            case 0, 0x0C:
                self._answer(9, 0, b"\x8c" + struct.pack("<H", self.info))
            case 1, 1:
                wants = bool(data[1])
                may = wants == self.armed or not wants or self.state is State.CHECKS_PASS
                self.armed = wants if may else self.armed
                self._answer(9, 1, bytes([0x81, may, self.armed]))
            case 1, 3:
                self._lock("emergency stop")

    def _hear_pose(self, channel: int, data: bytes) -> None:
        match channel:
            case 0:
                pose = struct.unpack_from("<3f", data)
            case 1 if data[0] == 8:
                pose = struct.unpack_from("<7f", data, 1)
            case _:
                return
        self.poses.append(pose)
        x, y, z = self.position_m
        self._error_m = pose[0] - x, pose[1] - y, pose[2] - z
        self._pose_s = self._now_s

    # --- what it does ---------------------------------------------------------------------------

    @property
    def position_m(self) -> Vector:
        """Where it really is: east, north, up."""
        north, east, down = self.airframe.position_m
        return east, north, -down

    @property
    def locked_s(self) -> float:
        """For how long it has been locked."""
        return self._now_s - self._since_s if self.state is State.LOCKED else 0.0

    def switched_on(self, now_s: float) -> SimulatedCrazyflie:
        """The same one where it lies, switched off and on again."""
        x, y, _ = self.position_m
        start = x, y, self.settings.start_m[2]
        settings = replace(
            self.settings, start_m=start, yaw_rad=yaw_of(self.attitude), battery=self.battery
        )
        return SimulatedCrazyflie(settings, now_s)

    @property
    def runs(self) -> bool:
        """Whether its motors run."""
        return self._aim() is not None

    def advance(self, now_s: float) -> None:
        """Fly on until then."""
        while self._now_s + _STEP_S <= now_s:
            self._now_s += _STEP_S
            self._plan()
            aim = self._aim()
            if aim is not None:
                self._motors_s = self._now_s
                self.battery = max(0.0, self.battery - self.settings.drain_per_s * _STEP_S)
            self._watch()
            self.airframe.step(self._aim(), _STEP_S)

    def _plan(self) -> None:
        """What the high-level commander says by itself: that motors stop, or how it lands."""
        if self.state not in _MAY_FLY or self._is_disabled or self._priority is Priority.RADIO:
            return
        target = None
        if self._landing is not None:
            done = (self._now_s - self._landing.begun_s) / max(self._landing.lasts_s, _STEP_S)
            if done < 1.0:
                x, y, z = self._landing.start_m
                share = done**3 * (10 - 15 * done + 6 * done**2)  # at rest at both ends
                target = Target((x, y, z + (self._landing.end_down_m - z) * share))
            else:
                self._landing = None
        self._said, self._priority = Said(target, self._now_s), Priority.HIGH_LEVEL

    def _aim(self) -> Target | None:
        """What its controllers are to reach; None: motors are off."""
        target = self._said.target
        if self.state not in _MAY_FLY or target is None:
            return None
        if self.state is State.LEVEL_OUT:
            x, y, z = self.airframe.position_m
            north, east, _ = self.airframe.velocity_mps
            height = z if target.position_m is None else target.position_m[2]
            return Target((x, y, height), (north, east, 0.0))
        return target

    def _watch(self) -> None:
        """Let the supervisor go on to its next state."""
        flies = self._now_s - self._motors_s < _FLYING_S
        silent_s = self._now_s - self._said.at_s
        lasts_s = self._now_s - self._since_s
        match self.state:
            case State.CHECKS_FAIL if not self.tumbled:
                self._enter(State.CHECKS_PASS)
                self.armed = self.settings.arms_itself
            case State.CHECKS_PASS if self.tumbled:
                self._enter(State.CHECKS_FAIL)
            case State.CHECKS_PASS if self.armed:
                self._enter(State.READY)
            case State.READY if self.tumbled or not self.armed or lasts_s > _PREFLIGHT_S:
                self._enter(State.CHECKS_FAIL)
            case State.READY if flies:
                self._enter(State.FLYING)
            case State.FLYING | State.LEVEL_OUT if silent_s > _FALL_S:
                self._lock("no set-points")
            case State.FLYING if not self.armed:
                self._enter(State.CHECKS_FAIL)
            case State.FLYING if silent_s > _LEVEL_S:
                self._enter(State.LEVEL_OUT)
            case State.FLYING if not flies:
                self._enter(State.LANDED)
            case State.LEVEL_OUT if silent_s <= _LEVEL_S:
                self._enter(State.FLYING)
            case State.LANDED if flies:
                self._enter(State.FLYING)
            case State.LANDED if lasts_s > _LANDED_S or not self.armed:
                self._enter(State.CHECKS_FAIL)

    def _enter(self, state: State) -> None:
        self.state, self._since_s = state, self._now_s
        if state not in _MAY_FLY:
            self.armed = False

    def _lock(self, why: str) -> None:
        self._print(f"SUP: free falling! ({why})\n")
        self._print("SUP: Locked, reboot required\n")
        self._enter(State.LOCKED)

    # --- what it tells --------------------------------------------------------------------------

    def _print(self, text: str) -> None:
        data = text.encode()
        self._out += [(0, 0, data[k : k + 30]) for k in range(0, len(data), 30)]

    @property
    def info(self) -> int:
        """`supervisor.info`"""
        flies = self.state in (State.FLYING, State.LEVEL_OUT)
        bits = (
            self.state is State.CHECKS_PASS,
            self.armed,
            self.settings.arms_itself,
            self.state in _MAY_FLY,
            flies,
            self.tumbled,
            self.state is State.LOCKED,
            False,
            self._landing is not None,
            self._landing is None,
            self._is_disabled,
        )
        return sum(1 << number for number, bit in enumerate(bits) if bit)

    def tell(self) -> Iterator[Packet]:
        """What goes out by now."""
        found, self._out = self._out, []
        yield from found
        boot_ms = int((self._now_s - self._boot_s) * 1000) % 2**24
        for data in self.logs.due(self._now_s, boot_ms, self._values):
            yield 5, 2, data

    @property
    def _values(self) -> dict[str, float]:
        x, y, z = (here + error for here, error in zip(self.position_m, self._error_m, strict=True))
        north, east, down = self.airframe.velocity_mps
        qw, qx, qy, qz = self.attitude
        sure = not self.settings.wants_poses or self._now_s - self._pose_s <= _POSE_S
        variance = _SURE_M2 if sure else _UNSURE_M2
        return {
            **{"stateEstimate.x": x, "stateEstimate.y": y, "stateEstimate.z": z},
            **{"stateEstimate.vx": east, "stateEstimate.vy": north, "stateEstimate.vz": -down},
            **{"stateEstimate.qx": qx, "stateEstimate.qy": qy, "stateEstimate.qz": qz},
            **{"stateEstimate.qw": qw, "stateEstimate.yaw": math.degrees(yaw_of(self.attitude))},
            **{f"kalman.varP{axis}": variance for axis in "XYZ"},
            "pm.vbat": _EMPTY_V + (_FULL_V - _EMPTY_V) * self.battery,
            "supervisor.info": self.info,
        }

    @property
    def attitude(self) -> Quaternion:
        """The quaternion wxyz from forward, left, up to east, north, up."""
        half = math.sqrt(0.5)
        return product(
            product((0.0, half, half, 0.0), self.airframe.attitude), (0.0, 1.0, 0.0, 0.0)
        )
