"""A configuration as the runtime wants it: robots by pid, with nothing left to look up."""

from __future__ import annotations

from dataclasses import dataclass

from koord.runtime.configuration.forms import BotType, Carrier, Topic
from koord.runtime.motion.world import Point, World


@dataclass(frozen=True, slots=True)
class Vehicle:
    """What a robot runs on."""

    name: str
    type: BotType = BotType.CAR
    planner: str | None = None
    speed_mps: float | None = None
    automata: tuple[str, ...] = ()
    ros_node_prefix: str | None = None
    positioning_topic: Topic | None = None
    reached_topic: Topic | None = None
    waypoint_topic: Topic | None = None


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """A robot: what it runs on, where it is, and where it listens."""

    pid: int
    vehicle: Vehicle
    automaton: str | None
    kind: str | None
    position: Point | None
    address: tuple[str, int]


@dataclass(frozen=True, slots=True)
class Talk:
    """How robots talk."""

    carrier: Carrier
    port: int
    shared: str | None = None  #: the group, or the broadcast address
    interface: str = "0.0.0.0"
    key: bytes | None = None
    run: str = "koord"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Configuration:
    """A run. ``robots[i]`` has pid i."""

    name: str
    robots: tuple[RobotPlace, ...]
    talk: Talk
    world: World | None
    delta_s: float
    seed: int
    leader: int
