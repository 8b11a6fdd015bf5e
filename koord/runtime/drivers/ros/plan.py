"""Which topics a vehicle has, from its options: what is heard, what is told, and to whom."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from koord.runtime.configuration.forms import Topic
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.ros.options import Names, RosOptions, Use, Wire
from koord.runtime.motion.bodies import Body, Car


class Plan(Struct, frozen=True):
    """The topics of one vehicle."""

    positioning: Wire | None  #: None: a localiser says where the vehicle is
    command: Wire  #: velocities, positions or way-points
    by_waypoints: bool  #: the vehicle's own controller goes to them
    velocity: Wire | None
    reached: Wire | None
    sensors: Mapping[str, Wire]
    actuators: Mapping[str, Wire]

    @property
    def by_targets(self) -> bool:
        """True if it is told positions rather than velocities."""
        return self.command.type_name == "PoseStamped"

    @property
    def battery(self) -> str | None:
        """The port of the vehicle's battery."""
        for port, wire in self.sensors.items():
            if wire.type_name == "BatteryState":
                return port
        return None


def plan(device: Device, options: RosOptions) -> Plan:
    """The topics of a vehicle. Raises DriverError for names and types that do not do."""
    names = Names(f"/{options.ros_node_prefix}", device.vehicle.name, device.pid)
    body = device.body
    by_waypoints = options.waypoint_topic is not None
    if by_waypoints and options.command_topic is not None:
        raise DriverError(
            "both `command_topic` and `waypoint_topic` say how the vehicle is moved", "leave one"
        )
    if options.waypoint_topic is not None:
        command = names.wire(Use.WAYPOINT, options.waypoint_topic)
    else:
        usual = Topic(topic="cmd_vel", type="Twist" if body.ON_GROUND else "TwistStamped")
        command = names.wire(Use.COMMAND, options.command_topic or usual)
        _check_fits(command, body)
    if options.reached_topic is not None and not by_waypoints:
        raise DriverError(
            "`reached_topic` is about way-points, and there is no `waypoint_topic`",
            "name that too, or leave both",
        )
    return Plan(
        _wire(names, Use.POSITIONING, options.positioning_topic),
        command,
        by_waypoints,
        _wire(names, Use.VELOCITY, options.velocity_topic),
        _wire(names, Use.REACHED, options.reached_topic),
        {port: names.wire(Use.SENSOR, topic) for port, topic in options.sensors.items()},
        {port: names.wire(Use.ACTUATOR, topic) for port, topic in options.actuators.items()},
    )


def _wire(names: Names, use: Use, topic: Topic | None) -> Wire | None:
    return None if topic is None else names.wire(use, topic)


def _check_fits(command: Wire, body: Body) -> None:
    """Check that a vehicle can be moved by what it is told. Raises DriverError."""
    hint = "take Twist or TwistStamped"
    if command.type_name == "AckermannDriveStamped" and not isinstance(body, Car):
        raise DriverError(f"`{command.told}` steers front wheels, and this vehicle has none", hint)
    if command.type_name == "PoseStamped" and body.ON_GROUND:
        raise DriverError(
            f"`{command.told}` tells positions to what drives",
            f"{hint}, or name it as `waypoint_topic` if the vehicle goes to positions by itself",
        )
