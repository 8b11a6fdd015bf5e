"""The platform of a deployed robot: its program's host, on a driven vehicle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from koord.runtime.deploy.preflight import Check
from koord.runtime.drivers.frames import Quaternion
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.guardian.events import Condition, Order, Other
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.library import Library
from koord.runtime.motion.world import Point, World
from koord.runtime.orders.hearing import Obeyed
from koord.runtime.platform.checks import Stated, vehicle_checks
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.platform.world_host import WorldHost, asks_to_fly
from koord.runtime.plugins.calls import PlugInError
from koord.runtime.ports import GOALS, SENSED, TAKEOFF, port_name
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.messages import Beacon
from koord.runtime.robot import Forwarding, Host, Robot
from koord.runtime.shapes import ShapeError, from_plain, to_plain

_UNARMED = "the vehicle is not to be armed, and stays where it is"

#: Before the names of modules among the troubles of a pilot.
_MODULE = "module "

#: How often a robot says where it is; of more robots than this each says it less often.
BEACON_S = 0.1
_MANY = 16


class VehicleHost(WorldHost):
    """The host of the program of one robot on a vehicle."""

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        world: World,
        library: Library,
        vehicle: DrivenVehicle,
        seed: int = 0,
    ) -> None:
        super().__init__(classes, kinds, world, library, seed)
        self._vehicle = vehicle
        self._acted: dict[str, Any] = {}  #: what the driver was told for actuators last
        if any(map(asks_to_fly, {classes[kind] for kind in kinds})):
            vehicle.pilot.wait_for_takeoff()

    def sensors(self, robot: int) -> MotionSensors:
        return self._vehicle.sensors

    def scan(self, robot: int) -> tuple[Point, ...]:
        return tuple(self._vehicle.driver.ports().get("pscan", ()))

    def whereabouts(self, robot: int) -> tuple[Sensed, float]:
        return self._vehicle.sensed, self._vehicle.now_s

    def modules_fail(self, robot: int, troubles: Mapping[str, PlugInError]) -> None:
        """Let the vehicle hold for as long as a module fails. (P-OWN)"""
        kept = self._vehicle.pilot.troubles
        for name in [name for name in kept if name.startswith(_MODULE)]:
            del kept[name]
        kept.update({f"{_MODULE}{name}": error.told for name, error in troubles.items()})

    def served(self, robot: int) -> dict[str, Any]:
        """What plug-ins serve, and the driver itself. (P-DRIVER)"""
        program, found = self.classes[self.kinds[robot]], super().served(robot)
        ports = self._vehicle.driver.ports()
        for name in program.SENSORS if ports else ():
            port = port_name(name)
            if port in ports and port not in SENSED and name not in found:
                with suppress(ShapeError):  # it is of another type: the last reading stays
                    found[name] = from_plain(program.PORTS[name], ports[port], len(self.kinds))
        return found

    def order(self, robot: Robot) -> None:
        super().order(robot)
        modules, held = self.modules.get(robot.pid), vars(robot)
        for name, shape in robot.PORTS.items():
            port, value = port_name(name), held.get(name)
            if name in robot.SENSORS or value is None or port in (*GOALS, TAKEOFF):
                continue
            if (modules is None or name not in modules) and self._acted.get(name) != value:
                self._acted[name] = value
                self._vehicle.driver.act(port, to_plain(shape, value))

    def follow(self, robot: int, path: Sequence[Point]) -> None:
        self._vehicle.follow(path)

    def go_to(self, robot: int, target: Point) -> None:
        self._vehicle.go_to(target)

    def take_off(self, robot: int, up: bool) -> None:
        self._vehicle.pilot.take_off(up)


class VehiclePlatform(Forwarding):
    """A robot's platform: what its program asks, and the ticks of its vehicle between rounds."""

    def __init__(
        self,
        host: VehicleHost,
        vehicle: DrivenVehicle,
        supplied: Callable[[Host], Host] | None = None,
        *,
        arms: bool = True,
        stated: Stated,
    ) -> None:
        """Make a platform; ``arms``: people have said that the vehicle may move.

        ``stated`` is what the configuration says of where it is.

        ``supplied`` makes a host of this one that answers more than a vehicle knows.
        """
        super().__init__(host if supplied is None else supplied(host))
        self.holding = False
        self.vehicle = vehicle
        self._world = host
        self._due_s: float | None = None
        self._is_stopping = False
        self._arms = arms
        self._stated = stated
        self._robots = len(host.kinds)
        self._beacon_due_s = 0.0
        self._others: dict[int, tuple[Beacon, float]] = {}
        self._goes = True  #: people have not said otherwise since
        self._alive_at_s: float | None = None

    @property
    def position(self) -> Point:
        return self.vehicle.sensed.position_m

    @position.setter
    def position(self, position: Point) -> None:
        """Ignore where a journal says that the robot was: the vehicle is where it is. (P-READ)"""

    # --- time -----------------------------------------------------------------------------------

    def also_answer(self, program: type[Robot]) -> None:
        """Answer what another program asks as well."""
        self._world.also_answer(program)

    def acted(self, robot: Robot) -> None:
        """Carry out what the actuators say after a decision. (P-ORDER)"""
        self._world.order(robot)
        self._world.library.begin_round()

    def tick(self, now_s: float, round_age_s: float | None, reason: Reason | None) -> float:
        """Take a step of control if it is due; return when the next one is. (P-TICK)"""
        if self._due_s is None or now_s - self._due_s > TICK_S:
            self._due_s = now_s  # what was missed is not made up for
        if now_s < self._due_s:
            return self._due_s
        alive_s = None if self._alive_at_s is None else now_s - self._alive_at_s
        self.vehicle.tick(now_s, round_age_s, reason, self._seen(now_s), alive_s)
        self._begin(now_s, round_age_s)
        self._due_s += TICK_S
        return self._due_s

    def wait_with(self, meanwhile: Callable[[], float]) -> None:
        """Let ticks go on while a planner thinks. (P-PLAN)"""
        self.vehicle.pilot.asked.wait_with(meanwhile)

    def _begin(self, now_s: float, round_age_s: float | None) -> None:
        """Arm and start the vehicle once rounds are committed. (P-ARM) (P-START)"""
        if round_age_s is None or self._is_stopping or not (self._arms and self._goes):
            return
        if self.vehicle.mode is Mode.DISARMED:
            self.vehicle.order(Order.ARM, now_s)
        elif self.vehicle.mode is Mode.ARMED and self.vehicle.sensed.armed is not False:
            self.vehicle.order(Order.START, now_s)

    def beacon(self, now_s: float) -> Beacon | None:
        """What the others should know of the vehicle, a few times a second. (P-BEACON)"""
        if self._robots < 2 or now_s < self._beacon_due_s:
            return None
        self._beacon_due_s = now_s + BEACON_S * max(1.0, self._robots / _MANY)
        sensed = self.vehicle.sensed
        return Beacon(sensed.position_m, sensed.velocity_mps, now_s - sensed.measured_at_s)

    def hear(self, sender: int, beacon: Beacon, now_s: float) -> None:
        """Take note of where another robot is."""
        self._others[sender] = beacon, now_s

    def _seen(self, now_s: float) -> tuple[Other, ...]:
        """The other robots, as far as they have been heard of."""
        return tuple(
            Other(pid, b.position_m, b.velocity_mps, b.age_s + now_s - heard_at_s)
            for pid, (b, heard_at_s) in sorted(self._others.items())
        )

    # --- people ---------------------------------------------------------------------------------

    def order(self, order: Order, now_s: float) -> Obeyed:
        """Do what people say; after they stopped it, it goes on when they say start. (O-RESET)"""
        match order:
            case Order.ESTOP | Order.STOP | Order.LAND:
                self._goes = False
            case Order.START:
                return self._start(now_s)
            case Order.RESET if self.vehicle.mode is Mode.DISARMED:
                return Obeyed()
            case _:
                pass
        return self._told(order, now_s)

    def _start(self, now_s: float) -> Obeyed:
        if not self._arms:
            return Obeyed(_UNARMED)
        if self._is_stopping:
            return Obeyed("it is on its way out of the run")
        mode = self.vehicle.mode
        if mode is Mode.ESTOPPED:
            return Obeyed("it is e-stopped: reset it first")
        if mode is Mode.LANDING:
            return Obeyed("it comes to its last stop first")
        if mode is Mode.STOPPED and (told := self._told(Order.RESET, now_s)).refused:
            return told
        self._goes = True
        return self._told(Order.START, now_s) if mode is Mode.HOLDING else Obeyed()

    def _told(self, order: Order, now_s: float) -> Obeyed:
        """Pass an order on to the guardian; what it says to one that changes nothing is why."""
        before = self.vehicle.mode
        notes = self.vehicle.order(order, now_s)
        if self.vehicle.mode is not before or not notes:
            return Obeyed()
        return Obeyed("; ".join(note.text for note in notes))

    def alive(self, at_s: float) -> None:
        """Take note that people were there. (O-ALIVE) (G-HEARTBEAT)"""
        self._alive_at_s = at_s

    @property
    def state(self) -> str:
        """The mode, and whether the vehicle stands."""
        mode = self.vehicle.mode.value
        return f"{mode}, at rest" if self.vehicle.is_at_rest else mode

    def checks(self) -> tuple[Check, ...]:
        """What is found of the vehicle, before it is armed. (P-PREFLIGHT)"""
        return tuple(vehicle_checks(self.vehicle, self._stated))

    def stop(self, now_s: float) -> None:
        """Land, or come to the last stop. (P-START)"""
        self._is_stopping = self.vehicle.is_ending = True
        self.vehicle.order(Order.STOP, now_s)
        self.vehicle.order(Order.LAND, now_s)

    @property
    def attitude(self) -> Quaternion:
        return self.vehicle.sensed.attitude

    @property
    def path(self) -> tuple[Point, ...]:
        return self.vehicle.pilot.path

    @property
    def is_at_rest(self) -> bool:
        return self.vehicle.is_at_rest

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*self._of_people(), *self.vehicle.remarks)

    def _of_people(self) -> Iterator[str]:
        """What people have said, or have to say, before it moves."""
        mode = self.vehicle.mode
        if not self._arms and mode is Mode.DISARMED:
            yield _UNARMED
        elif mode is Mode.ESTOPPED:
            yield "e-stopped: `koord order CONFIG reset`, then `start`"
        elif mode is Mode.STOPPED and not self._is_stopping:
            yield "has stopped: `koord order CONFIG start` lets it go on"
        elif not self._goes:
            yield "told to stop: `koord order CONFIG start` lets it go on"
        if Condition.HEARTBEAT in self.vehicle.conditions:
            yield "it asks for a heartbeat of the e-stop: `koord heartbeat CONFIG`"

    def close(self) -> None:
        """Let go of the vehicle."""
        self.vehicle.close()
