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

    topic: Name  #: its name
    type: Name  #: of its messages: `PoseStamped`, `geometry_msgs.msg.PoseStamped`


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The motion fields of a device, in a form of their own that devices can share."""

    #: of the published middleware, that the vehicle has: `MoatTestCar`
    motion_automata: list[Name] | Name = []
    planner: Name | None = None  #: what finds its ways: the name of a planner, or of a plug-in
    ros_node_prefix: str | None = None  #: before names of topics that do not begin with `/`
    positioning_topic: Topic | None = None  #: where the vehicle is, of drivers that speak ROS
    reached_topic: Topic | None = None  #: its own controller's answer that it is there, by ROS
    waypoint_topic: Topic | None = None  #: places to which its own controller goes, by ROS
    queue_size: Natural | None = None  #: messages of ROS that are kept for who is slow


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

    beams: Annotated[int, Meta(ge=1, le=10_000)] = 180  #: all around, the first one straight ahead
    range: Positive = 4.0  #: m
    noise: NotNegative = 0.0  #: m


class EffortForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The effort of a planner, in steps."""

    steps: Annotated[int, Meta(ge=1)] = 1000  #: until a planner gives up
    star_steps: Annotated[int, Meta(ge=1)] = 120  #: of planners that go on improving a way


class PlanningForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The time that planning takes, whatever the computer that simulates it needs."""

    takes: NotNegative = 0.0  #: s, from asking a planner for a way until the way is there


class SimulationForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The simulation settings of a device."""

    #: of detail: `simple` touches nothing, `mujoco` has wheels and rotors
    level: Level = Level.FULL
    steering: Steering = Steering.PREDICTIVE  #: of cars
    noise: NoiseForm = NoiseForm()  #: of where it believes to be
    delay: NotNegative = 0.0  #: s, from a command to the actuator
    wind: WindForm = WindForm()  #: that drones feel
    visit: VisitForm = VisitForm()  #: when a place counts as reached
    effort: EffortForm = EffortForm()  #: how long its planner searches
    planning: PlanningForm = PlanningForm()  #: how long that takes in simulated time
    scanner: ScannerForm | None = None  #: on top of it; without, it sees nothing


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
    estop: EstopAction | None = None  #: what an e-stop does with a vehicle that is on its way
    start: Positive | None = None  #: m, from its `position` it is armed no further away
    watchdog: Positive | None = None  #: s, a robot that is silent for longer is stopped by it
    dead_man: DeadMan | None = None  #: what stops a vehicle whose robot is killed
    still: Positive | None = None  #: m/s, slower than this it stands
    landed: Positive | None = None  #: m, not higher above the ground it has landed


class Served(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A plug-in that serves a module of a program, with its options."""

    plug_in: Name  #: by the name that `koord drivers` lists
    options: dict[str, Any] = {}  #: of the plug-in


class Device(Motion, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A vehicle."""

    bot_type: TypeName = "CAR"  #: what kind of vehicle it is
    bot_name: Name | None = None  #: its name, where devices are a list
    ip: str | None = None  #: of the computer on it, for `koord deploy`; else 127.0.0.1
    port: Port | None = None  #: that it listens on; else that of the network
    speed: Positive | None = None  #: m/s, at which it follows paths
    motion: Motion | None = None  #: its planner and topics, in a block of their own
    safety: SafetyForm | None = None  #: limits of its guardian, before those of all robots
    simulation: SimulationForm = SimulationForm()  #: how `koord sim` simulates it
    driver: Name | None = None  #: what drives it, by the name that `koord drivers` lists
    options: dict[str, Any] = {}  #: of the driver
    localiser: Name | None = None  #: what says where it is; `own`: its driver. Else as for all
    localiser_options: dict[str, Any] = {}  #: of its localiser, before those of all
    planner_options: dict[str, Any] = {}  #: of a planner that is a plug-in
    controller: Name | None = None  #: a plug-in that follows ways, instead of the vehicle's own law
    controller_options: dict[str, Any] = {}  #: of that plug-in
    modules: dict[Name, Name | Served] = {}  #: of the program, and the plug-ins that serve them


class Agent(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A robot. ``kind`` is its ``agent`` block in a program for several kinds of robot."""

    pid: Natural  #: its number, by which programs know it: 0, 1, ... without a gap
    on_device: Name | None = None  #: the name of its vehicle in `devices`
    motion_automaton: Name | None = None  #: of the published middleware: one that its device has
    #: the name of its `agent` block, in a program for several kinds of robot
    kind: Name | None = None
    position: Coordinates | None = None  #: m, where it begins
    heading: float = 0.0  #: rad, counter-clockwise from the x axis
    plist: list[Port] = []  #: of the published middleware, without effect: ports
    nbr_pids: list[Natural] = []  #: of the published middleware, without effect: its neighbours
    ip: str | None = None  #: instead of its device's
    port: Port | None = None  #: instead of its device's


class Bounds(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two opposite corners of the world."""

    low: Coordinates  #: m, the corner with the least x, y and z
    high: Coordinates  #: m, the corner with the greatest; without a z it is at 3 m


class BoxForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright box between two opposite corners."""

    low: Coordinates  #: m, the corner with the least x, y and z
    high: Coordinates  #: m, the corner with the greatest; without a z it is infinitely high


class DiscForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright cylinder."""

    centre: Pair  #: m, of its axis
    radius: Positive  #: m
    low_z: float = 0.0  #: m, its lower end
    high_z: float | None = None  #: m, its upper end; without, it is infinitely high


class PolygonForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An upright prism."""

    corners: Annotated[list[Pair], Meta(min_length=3)]  #: m, in their order around it
    low_z: float = 0.0  #: m, its lower end
    high_z: float | None = None  #: m, its upper end; without, it is infinitely high


class ObstacleForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An obstacle: one of the three forms."""

    box: BoxForm | None = None  #: an upright box
    disc: DiscForm | None = None  #: an upright cylinder
    polygon: PolygonForm | None = None  #: an upright prism


class WorldForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The world: its bounds, obstacles and tasks."""

    bounds: Bounds | None = None  #: that no robot leaves
    obstacles: list[ObstacleForm] = []  #: that nobody can go through
    tasks: list[Coordinates] = []  #: m, the places that programs ask for as tasks
    scattered: Annotated[int, Meta(ge=0, le=10_000)] = 0  #: so many tasks more, where the seed says
    start: Bounds | None = None  #: where simulated robots begin that have no position
    cell: Positive | None = None  #: m, of the cells of maps


class RadioForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The radios of simulated robots: how far they reach, and who agrees on rounds. [ENV-RANGE]"""

    range: Positive | None = None  #: m; without: everybody hears everybody
    #: who agrees on a round: all, or those who hear each other
    agreement: Agreement = Agreement.EVERYWHERE


class MonitorForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The monitoring settings of a simulated run."""

    slack: NotNegative | None = None  #: by how much numbers may be off in properties and contracts
    safety: NotNegative | None = None  #: m, no two robots are to come nearer to each other


class NetworkForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The network of robots. ``key``, or that in ``key_file``, is their secret.

    With ``encrypt`` nobody without it can read what they say. The file stands beside this one.
    """

    #: else `broadcast` where `udp_bcast_ip` is given, and `multicast`
    transport: Carrier | None = None
    port: Port | None = None  #: that all listen on; else `udp_port`, and 61820
    group: str | None = None  #: the address of multicast: 224.0.0.0 to 239.255.255.255
    interface: str | None = None  #: the address of the network card for multicast; else any
    #: the secret; `koord config key` makes one
    key: Annotated[str, Meta(min_length=16)] | None = None
    key_file: Name | None = None  #: the file with the secret, beside this one
    encrypt: bool = False  #: nobody without the secret can read what robots say
    run: Name | None = None  #: a name that tells runs apart in one network; else `koord`
    connect: list[Name] = []  #: endpoints that zenoh connects to: `tcp/192.168.1.2:7447`
    listen: list[Name] = []  #: endpoints that zenoh listens on


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A configuration file of a Koord run."""

    robot: Agent | None = None  #: what all robots are like, with `num_robots`
    device: Device | None = None  #: the vehicle of all robots, with `num_robots` or `num_agents`
    #: how many robots there are, all alike
    num_robots: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    agents: list[Agent] = []  #: the robots, each on one of `devices`
    devices: dict[Name, Device] | list[Device] = {}  #: the vehicles by their names
    bots: dict[Name, Device] | list[Device] = {}  #: an old name of ``devices``
    agent: Agent | None = None  #: with ``num_agents``: the others are like it
    #: how many robots there are, with `agent`
    num_agents: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    #: the robot that gathers the others, and coordinates first
    leader_pid: Natural = 0
    mutex_handler: str | None = None  #: of the published middleware; lock classes need none
    udp_bcast_ip: str | None = None  #: the address that robots broadcast to: 192.168.1.255
    udp_port: Port | None = None  #: that all robots listen on; `port` of `network` counts before it
    delta: RoundLength | None = None  #: as the program states; else 0.1
    seed: Natural = 0  #: what every random choice of a simulation hangs on
    #: m, where robots begin, by pid; they count before `position`
    positions: dict[int, Coordinates] = {}
    params: dict[Name, Any] = {}  #: values for the program's params
    monitor: MonitorForm = MonitorForm()  #: how claims are watched in simulations
    radio: RadioForm = RadioForm()  #: of simulated robots
    world: WorldForm | None = None  #: where they are: bounds, obstacles, tasks
    network: NetworkForm | None = None  #: how deployed robots talk
    safety: SafetyForm | None = None  #: limits of the guardians of all driven robots
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
