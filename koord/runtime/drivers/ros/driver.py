"""The driver of what nodes of ROS move: poses from a topic, commands to another, and sensors."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct

from koord.runtime.drivers.differences import Differences
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.ros.commands import Commander, Targets, Wheels, Wings
from koord.runtime.drivers.ros.graph import Graph, Latest, Sender
from koord.runtime.drivers.ros.options import RosOptions, Wire
from koord.runtime.drivers.ros.plan import plan
from koord.runtime.drivers.ros.poses import Fix, NotAPoseError, fix_of, velocity_of
from koord.runtime.drivers.ros.readings import is_reached, reading, written
from koord.runtime.drivers.setpoints import Capabilities, Located, Sensed, Setpoint, Stopper
from koord.runtime.motion.world import Point

#: Set-points a second that controllers of ROS expect.
_RATE_HZ = 20.0

#: The `frame_id` of way-points for published automata: no frame, but a wish to hear of arrivals.
_ASKS_FOR_AN_ANSWER = "1"

#: While it is waited for the vehicle, it is looked for after this.
_LOOK_S = 0.01

#: How long a watchdog tells vehicles to stop: what drives, and what has to come down first.
_STOPS_S, _SINKS_S = 5.0, 30.0


class _Links(Struct, frozen=True):
    """The topics of a vehicle, once they are open."""

    graph: Graph
    poses: Latest | None
    velocities: Latest | None
    arrivals: Latest | None
    sensors: dict[str, Latest]
    actuators: dict[str, Sender]
    commander: Commander

    @property
    def readers(self) -> list[Latest]:
        """All that is listened to."""
        some = (self.poses, self.velocities, self.arrivals, *self.sensors.values())
        return [reader for reader in some if reader is not None]


class RosDriver(ABC):
    """The driver of a vehicle that nodes of ROS move.

    A pose counts as measured at the tick that hears it: it is older by up to a tick, and by what it
    took to get here; its stamp is by another clock, and only tells velocities. (P-ROS-POSE)
    """

    def __init__(self, device: Device) -> None:
        """Find out which topics there are to be; nothing is opened. Raises DriverError."""
        assert isinstance(device.options, RosOptions)
        self.device, self.options = device, device.options
        self.plan = plan(device, self.options)
        self.capabilities = Capabilities(
            kinds=(device.vehicle.type_name,),
            wishes=self._kind.WISHES,
            rate_hz=_RATE_HZ,
            pose_age_s=self.options.pose_age,
            dead_man_s=self.options.dead_man,
            stopper=self._stopper(),
            tells_battery=self.plan.battery is not None,
            takeoff_height_m=None if device.body.ON_GROUND else self.options.takeoff,
        )
        #: what the vehicle says of the last way-point; programs are told by where it is
        self.reached: bool | None = None
        self._trouble: str | None = None  #: why the pose that was heard last does not count
        self._is_answering = True
        self._links: _Links | None = None
        self._heard: Fix | None = None
        self._heard_at_s = 0.0
        self._located: Located | None = None
        self._differences = Differences(self.options.smoothing)
        self._told: tuple[Point, float] | None = None  #: the velocity that was told, and when
        self._readings: dict[str, Any] = {}

    @classmethod
    def address(cls, device: Device) -> tuple[str, bool]:
        """The topic that moves a vehicle, and whether all computers mean the same by it."""
        return plan(device, device.options).command.told, True

    @property
    def _waypoint_frame(self) -> str | None:
        """The `frame_id` of way-points; None: that of poses."""
        is_published = self.options.motion_automaton is not None and self.plan.by_waypoints
        return _ASKS_FOR_AN_ANSWER if is_published else None

    @abstractmethod
    def graph(self) -> Graph:
        """Take part in the graph of topics. Raises DriverError."""

    def elsewhere(self) -> tuple[str, object] | None:
        """How another process takes part in this graph, if it can.

        The class (``module:name``), and its first argument, of which JSON can be made.
        """
        return None

    def _stopper(self) -> Stopper | None:
        """What a watchdog stops the vehicle with. (P-WATCHDOG)"""
        topics, elsewhere = self.plan, self.elsewhere()
        if elsewhere is None or (topics.by_targets and topics.positioning is None):
            return None
        graph, where = elsewhere
        flies = not self.device.body.ON_GROUND
        arguments = {
            "graph": graph,
            "where": where,
            "command": (topics.command.name, topics.command.type_name),
            "positions": _address(topics.positioning) if topics.by_targets else None,
            "ground_m": self.device.world.ground if flies else None,
        }
        target = "koord.runtime.drivers.ros.stopping:Stopping"
        return Stopper(target, json.dumps(arguments).encode(), _SINKS_S if flies else _STOPS_S)

    @property
    def _kind(self) -> type[Commander]:
        if self.plan.by_targets:
            return Targets
        return Wheels if self.device.body.ON_GROUND else Wings

    # --- the vehicle ----------------------------------------------------------------------------

    def locate(self, located: Located, now_s: float) -> None:
        """Take where the vehicle is, instead of its topic. (P-ROS-LOCATED)"""
        self._located = located

    @property
    def _fix(self) -> Fix | None:
        """Where the vehicle is: as a localiser says, if there is one, and else as its topic."""
        located, heard = self._located, self._heard
        if located is None:
            return heard
        attitude = located.attitude or (None if heard is None else heard.attitude)
        if attitude is None:
            return None
        return Fix(located.position_m, attitude, "", located.measured_at_s)

    def open(self, now_s: float) -> None:
        """Find the vehicle. Raises DriverError if it does not tell where it is within a while."""
        if self.plan.positioning is None and self._fix is None:
            raise DriverError(
                "nothing says where the vehicle is, and which way it looks",
                "name a `positioning_topic`, or a `localiser` that tells attitudes",
            )
        begun_s = time.monotonic()
        links = self._links = self._linked()
        try:
            self._wait_for_vehicle(links, now_s - begun_s)
        except DriverError:
            self._leave(links)
            raise

    def _linked(self) -> _Links:
        topics, device, graph = self.plan, self.device, self.graph()
        sender, body, ground_m = graph.publish(topics.command), device.body, device.world.ground
        return _Links(
            graph,
            None if topics.positioning is None else graph.listen(topics.positioning),
            None if topics.velocity is None else graph.listen(topics.velocity),
            None if topics.reached is None else graph.listen(topics.reached),
            {port: graph.listen(wire) for port, wire in topics.sensors.items()},
            {port: graph.publish(wire) for port, wire in topics.actuators.items()},
            Targets(
                sender, body, ground_m, streams=not topics.by_waypoints, frame=self._waypoint_frame
            )
            if self._kind is Targets
            else self._kind(sender, body, ground_m),
        )

    def _wait_for_vehicle(self, links: _Links, ahead_s: float) -> None:
        """Wait until it is known where the vehicle is, and that it hears. Raises DriverError.

        Times of ticks are so far ahead of the clock of this machine.
        """
        graph, topics = links.graph, self.plan
        begun_s, passed_s = time.monotonic(), 0.0
        while self.sense(ahead_s + time.monotonic()) is None or not links.commander.sender.is_heard:
            if self._fix is None and self._trouble is not None:
                raise DriverError(self.remarks[0], "see `frame` of the driver's options")
            _check_types(links)
            if passed_s > self.options.wait:
                raise DriverError(
                    graph.why_silent(topics.positioning)
                    if self._fix is None and topics.positioning is not None
                    else graph.why_unheard(topics.command),
                    graph.hint,
                )
            time.sleep(_LOOK_S)
            passed_s = time.monotonic() - begun_s
        _check_types(links)

    def sense(self, now_s: float) -> Sensed | None:
        if self._links is not None:
            self._hear_pose(self._links, now_s)
            self._hear_velocity(self._links, now_s)
            self._hear_others(self._links)
        fix = self._fix
        self._is_answering = self._answers(now_s)
        if fix is None:
            return None
        battery = self.plan.battery
        return Sensed(
            fix.position_m,
            fix.attitude,
            self._velocity(now_s),
            self._heard_at_s if self._located is None else fix.stamp_s,
            battery=None if battery is None else self._readings.get(battery),
            link=self._is_answering,
        )

    def _answers(self, now_s: float) -> bool:
        """Return whether the vehicle answers: it says where it is, or it listens at least."""
        if self.plan.positioning is None:
            return self._links is not None and self._links.commander.sender.is_heard
        return now_s - self._heard_at_s <= self.options.silent

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        fix = self._fix
        if self._links is None or fix is None:
            return
        commander = self._links.commander
        before = commander.aim
        commander.command(setpoint, fix, now_s)
        if commander.aim != before:
            self.reached = None  # what is said from now on is about the new one

    def ports(self) -> Mapping[str, Any]:
        return self._readings

    @property
    def remarks(self) -> tuple[str, ...]:
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[str]:
        """Yield why the vehicle does not do what it is told. (P-ROS-LOST)"""
        if self._trouble is not None and self.plan.positioning is not None:
            yield f"poses on `{self.plan.positioning.told}` do not count: {self._trouble}"
        if self._links is None:
            return
        if (trouble := self._links.graph.trouble) is not None:
            yield trouble
        if self._fix is None:
            return  # its start says what lacks
        if not self._is_answering and self.plan.positioning is not None:
            yield f"nothing is heard on `{self.plan.positioning.told}` any more"
        if not self._links.commander.sender.is_heard:
            yield f"nobody listens to `{self.plan.command.told}`"

    def act(self, port: str, value: Any) -> None:
        sender = None if self._links is None else self._links.actuators.get(port)
        if sender is not None:
            sender.send(written(sender.wire.type_name, value))

    def close(self) -> None:
        """Tell the vehicle to stop, and leave."""
        if self._links is not None:
            try:
                self._links.commander.stop()
            finally:
                self._leave(self._links)

    def _leave(self, links: _Links) -> None:
        self._links = None
        links.graph.close()

    # --- what is heard --------------------------------------------------------------------------

    def _hear_pose(self, links: _Links, now_s: float) -> None:
        message = None if links.poses is None else links.poses.take()
        if message is None:
            return
        try:
            fix = fix_of(message)
        except NotAPoseError as error:
            self._trouble = str(error)
            return
        wanted = self.options.frame if self._heard is None else self._heard.frame
        if wanted is not None and fix.frame != wanted:
            self._trouble = f"they are in the frame `{fix.frame}`, not in `{wanted}`"
            return
        self._trouble = None
        self._differences.hear(fix.position_m, fix.stamp_s, now_s)
        self._heard, self._heard_at_s = fix, now_s
        if hasattr(message, "twist"):
            self._told = velocity_of(message, fix), now_s

    def _hear_velocity(self, links: _Links, now_s: float) -> None:
        message = None if links.velocities is None else links.velocities.take()
        if message is not None and self._heard is not None:
            self._told = velocity_of(message, self._heard), now_s

    def _velocity(self, now_s: float) -> Point:
        """The velocity that was told, if it was lately, else that of poses."""
        if self._told is not None and now_s - self._told[1] <= self.options.silent:
            return self._told[0]
        return self._differences.velocity_mps

    def _hear_others(self, links: _Links) -> None:
        message = None if links.arrivals is None else links.arrivals.take()
        if message is not None:
            self.reached = is_reached(message)
        for port, reader in links.sensors.items():
            message = reader.take()
            if message is None:
                continue
            value = reading(message, self.options.sensors[port].at, self._fix)
            if value is not None:
                self._readings[port] = value


def _address(wire: Wire | None) -> tuple[str, str] | None:
    return None if wire is None else (wire.name, wire.type_name)


def _check_types(links: _Links) -> None:
    """Check that nothing that is listened to has another type. Raises DriverError."""
    for reader in links.readers:
        if wrong := links.graph.mistyped(reader.wire):
            raise DriverError(wrong, "name the type that it has in the configuration")
