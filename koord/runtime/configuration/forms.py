"""Forms of configuration files, from which their JSON Schema is generated.

There are three published forms: ``robot``, ``device`` and ``num_robots`` (one kind of robot, from
the paper's listing), ``agents`` and ``devices``, and ``agent``, ``device`` and ``num_agents`` (of
one agent, as the published launcher makes them). All else may stand in any.
"""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from koord.runtime.guardian.limits import DeadMan, EstopAction
from koord.runtime.motion.bodies import VEHICLES, Level, Steering
from koord.syntax.core import LEAST_DELTA_S, MOST_DELTA_S

Natural = Annotated[int, Meta(ge=0)]
Port = Annotated[int, Meta(ge=1, le=65535)]
Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
#: Seconds of a round: the same limits as everywhere (`specs/limits.md`).
RoundLength = Annotated[float, Meta(ge=float(LEAST_DELTA_S), le=float(MOST_DELTA_S))]
Share = Annotated[float, Meta(ge=0, le=1)]
Name = Annotated[str, Meta(min_length=1)]
#: A type of vehicle, by its name.
TypeName = Annotated[str, Meta(extra_json_schema={"enum": list(VEHICLES)})]

#: Two or three coordinates in metres; a missing z is 0.
Coordinates = Annotated[list[float], Meta(min_length=2, max_length=3)]
Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


class Carrier(Enum):
    """The ways to carry datagrams."""

    UNICAST = "unicast"
    MULTICAST = "multicast"
    BROADCAST = "broadcast"
    ZENOH = "zenoh"


class Agreement(Enum):
    """The robots that take part in agreeing on rounds."""

    EVERYWHERE = "everywhere"
    CONNECTED = "connected"


class Topic(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A ROS topic."""

    topic: Name
    type: Name


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The motion fields of a device, in a form of their own that devices can share."""

    motion_automata: list[Name] | Name = []
    planner: Name | None = None
    ros_node_prefix: str | None = None
    positioning_topic: Topic | None = None
    reached_topic: Topic | None = None
    waypoint_topic: Topic | None = None
    queue_size: Natural | None = None


class NoiseForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The noise of simulated positioning (standard deviations), and its rate."""

    position: NotNegative = 0.0  #: m
    heading: NotNegative = 0.0  #: rad
    rate: Positive | None = None  #: Hz; without: whenever a controller asks


class WindForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The wind that simulated drones feel."""

    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: m/s
    gust: NotNegative = 0.0  #: m/s, standard deviation along each axis
    calm: Positive = 1.5  #: s


class VisitForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The visit criterion: a robot has reached a place if it stayed this near for this long."""

    epsilon: Positive = 0.2  #: m
    dwell: NotNegative = 0.5  #: s


class ScannerForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A scanner that turns in the plane."""

    beams: Annotated[int, Meta(ge=1, le=10_000)] = 180
    range: Positive = 4.0  #: m
    noise: NotNegative = 0.0  #: m


class EffortForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The effort of a planner, in steps."""

    steps: Annotated[int, Meta(ge=1)] = 1000
    star_steps: Annotated[int, Meta(ge=1)] = 120


class PlanningForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The time that planning takes, whatever the computer that simulates it needs."""

    takes: NotNegative = 0.0  #: s, from asking a planner for a way until the way is there


class SimulationForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The simulation settings of a device."""

    level: Level = Level.FULL
    steering: Steering = Steering.PREDICTIVE  #: of cars
    noise: NoiseForm = NoiseForm()
    delay: NotNegative = 0.0  #: s, from a command to the actuator
    wind: WindForm = WindForm()
    visit: VisitForm = VisitForm()
    effort: EffortForm = EffortForm()
    planning: PlanningForm = PlanningForm()
    scanner: ScannerForm | None = None


class SafetyForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The limits of the guardian (specs/guardian); the vehicle has its own for what is left out.

    Those of a device count before those of all robots.
    """

    hold: Positive | None = None  #: s, T: who holds for as long lands or stops
    resume: Positive | None = None  #: s, for which all has been well before it moves (again)
    rounds: Annotated[float, Meta(ge=1)] | None = None  #: k: holds without a commit for k·δ
    pose_age: Positive | None = None  #: s
    jump: NotNegative | None = None  #: m, of a pose besides what it can have moved
    margin: Positive | None = None  #: m, between its position and walls and obstacles
    speed: Positive | None = None  #: m/s, the fastest that motion may wish for
    reaction: Positive | None = None  #: s, until the vehicle obeys
    braking: Positive | None = None  #: m/s², how hard it brakes at least
    separation: Positive | None = None  #: m, between positions of robots
    separation_more: NotNegative | None = None  #: m, so much more before it goes on
    battery_low: Share | None = None  #: of 1; holds below
    battery_critical: Share | None = None  #: of 1; lands or stops below
    battery_more: Share | None = None  #: of 1; so much more before it goes on
    heartbeat: Positive | None = None  #: s, greatest age of the e-stop's; else none is asked for
    estop: EstopAction | None = None
    start: Positive | None = None  #: m, from its `position` it is armed no further away
    watchdog: Positive | None = None  #: s, a robot that is silent for longer is stopped by it
    dead_man: DeadMan | None = None  #: what stops a vehicle whose robot is killed
    still: Positive | None = None  #: m/s, slower than this it stands
    landed: Positive | None = None  #: m, not higher above the ground it has landed


class Served(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A plug-in that serves a module of a program, with its options."""

    plug_in: Name
    options: dict[str, Any] = {}


class Device(Motion, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A vehicle."""

    bot_type: TypeName = "CAR"
    bot_name: Name | None = None
    ip: str | None = None
    port: Port | None = None
    speed: Positive | None = None  #: m/s, at which it follows paths
    motion: Motion | None = None
    safety: SafetyForm | None = None
    simulation: SimulationForm = SimulationForm()
    driver: Name | None = None  #: what drives it, by the name that `koord drivers` lists
    options: dict[str, Any] = {}  #: of the driver
    localiser: Name | None = None  #: what says where it is; `own`: its driver. Else as for all
    localiser_options: dict[str, Any] = {}
    planner_options: dict[str, Any] = {}  #: of a planner that is a plug-in
    controller: Name | None = None  #: a plug-in that follows ways, instead of the vehicle's own law
    controller_options: dict[str, Any] = {}
    modules: dict[Name, Name | Served] = {}  #: of the program, and the plug-ins that serve them


class Agent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot. ``kind`` is its ``agent`` block in a program for several kinds of robot."""

    pid: Natural
    on_device: Name | None = None
    motion_automaton: Name | None = None
    kind: Name | None = None
    position: Coordinates | None = None
    heading: float = 0.0  #: rad, counter-clockwise from the x axis
    plist: list[Port] = []
    nbr_pids: list[Natural] = []
    ip: str | None = None  #: instead of its device's
    port: Port | None = None


class Bounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two opposite corners of the world."""

    low: Coordinates
    high: Coordinates


class BoxForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright box between two opposite corners."""

    low: Coordinates
    high: Coordinates


class DiscForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright cylinder."""

    centre: Pair
    radius: Positive
    low_z: float = 0.0
    high_z: float | None = None


class PolygonForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright prism."""

    corners: Annotated[list[Pair], Meta(min_length=3)]
    low_z: float = 0.0
    high_z: float | None = None


class ObstacleForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An obstacle: one of the three forms."""

    box: BoxForm | None = None
    disc: DiscForm | None = None
    polygon: PolygonForm | None = None


class WorldForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The world: its bounds, obstacles and tasks."""

    bounds: Bounds | None = None
    obstacles: list[ObstacleForm] = []
    tasks: list[Coordinates] = []
    scattered: Annotated[int, Meta(ge=0, le=10_000)] = 0  #: so many tasks more, where the seed says
    start: Bounds | None = None  #: where simulated robots begin that have no position
    cell: Positive | None = None  #: m, of the cells of maps


class RadioForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The radios of simulated robots: how far they reach, and who agrees on rounds. [ENV-RANGE]"""

    range: Positive | None = None  #: m; without: everybody hears everybody
    agreement: Agreement = Agreement.EVERYWHERE


class MonitorForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The monitoring settings of a simulated run."""

    slack: NotNegative | None = None  #: by how much numbers may be off in properties and contracts
    safety: NotNegative | None = None  #: m, no two robots are to come nearer to each other


class NetworkForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The network of robots. ``key``, or that in ``key_file``, is their secret.

    With ``encrypt`` nobody without it can read what they say. The file stands beside this one.
    """

    transport: Carrier | None = None
    port: Port | None = None
    group: str | None = None
    interface: str | None = None
    key: Annotated[str, Meta(min_length=16)] | None = None
    key_file: Name | None = None
    encrypt: bool = False
    run: Name | None = None
    connect: list[Name] = []
    listen: list[Name] = []


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A configuration file of a Koord run."""

    robot: Agent | None = None
    device: Device | None = None
    num_robots: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    agents: list[Agent] = []
    devices: dict[Name, Device] | list[Device] = {}
    bots: dict[Name, Device] | list[Device] = {}  #: an old name of ``devices``
    agent: Agent | None = None  #: with ``num_agents``: the others are like it
    num_agents: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    leader_pid: Natural = 0
    mutex_handler: str | None = None  #: of the published middleware; lock classes need none
    udp_bcast_ip: str | None = None
    udp_port: Port | None = None
    delta: RoundLength | None = None  #: as the program states; else 0.1
    seed: Natural = 0
    positions: dict[int, Coordinates] = {}
    params: dict[Name, Any] = {}  #: values for the program's params
    monitor: MonitorForm = MonitorForm()
    radio: RadioForm = RadioForm()
    world: WorldForm | None = None
    network: NetworkForm | None = None
    safety: SafetyForm | None = None
    localiser: Name | None = None  #: of all driven robots whose device does not name another one
    localiser_options: dict[str, Any] = {}  #: those of a device count before these


def json_schema() -> dict[str, Any]:
    """The JSON Schema of configuration files, for editors."""
    schema = msgspec.json.schema(Form)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Configuration of a Koord run",
        **schema,
    }
