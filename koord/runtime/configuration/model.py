"""Run configurations: robots by pid, vehicles, network and params."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any, ClassVar

from msgspec import Struct, field

from koord.runtime.configuration.forms import Carrier, MonitorForm, RadioForm, SimulationForm
from koord.runtime.configuration.reading import Document, Path, problem
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.motion.bodies import VEHICLES, Body, PlannerName, VehicleType
from koord.runtime.motion.world import Point, World
from koord.runtime.plugins.calls import PlugIn
from koord.syntax.content import ByContent
from koord.syntax.diagnostics import Diagnostic, KoordError
from koord.syntax.elaboration.settings import ParamValue
from koord.syntax.literals import NumberOutOfRangeError, is_number, read_number
from koord.syntax.source import Source, Span


class MotionAutomaton(Enum):
    """The motion automata of the published middleware. (P-ROS-PUBLISHED)"""

    CAR = "MoatTestCar"
    DRONE = "MoatTestDrone"
    #: It calls actions of Hector's quadrotor. Here it is the node beside that which does so, and
    #: hears way-points.
    HECTOR = "MoatHectorQuadrotor"


class Vehicle(Struct, frozen=True):
    """The vehicle that a robot runs on."""

    name: str
    type_name: str = "CAR"
    planner: PlannerName | PlugIn | None = None
    speed_mps: float | None = None
    automata: tuple[str, ...] = ()
    simulation: SimulationForm = field(default_factory=SimulationForm)
    path: Path = ()  #: where it stands in the file
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    driver: str | None = None
    options: bytes = b"{}"  #: of the driver, as JSON
    localiser: str | None = None  #: None: its driver says where it is
    localiser_options: bytes = b"{}"  #: as JSON
    controller: PlugIn | None = None  #: None: the vehicle's own law of motion
    modules: tuple[tuple[str, PlugIn], ...] = ()  #: of the program, by name, and what serves them

    @property
    def type(self) -> VehicleType:
        """The vehicle's row in the table of vehicles."""
        return VEHICLES[self.type_name]

    @property
    def body(self) -> Body:
        """Its body, at the speed that is configured."""
        body, speed = self.type.body, self.speed_mps
        return body if speed is None else body.cruising(speed)

    @property
    def ignores_height(self) -> bool:
        """True if it drives as published cars do: to the place below its goal. (P-PUBLISHED-CAR)"""
        return self.body.ON_GROUND and MotionAutomaton.CAR.value in self.automata


class RobotPlace(Struct, frozen=True):
    """A robot's place in a run: its vehicle, its start, and its network address."""

    pid: int
    vehicle: Vehicle
    kind: str | None
    position: Point | None
    address: tuple[str, int]
    heading_rad: float = 0.0
    path: Path = ()  #: where its position stands in the file, or it itself


class Scatter(Struct, frozen=True):
    """The parts of a simulated run that its seed decides: places of tasks and starts."""

    tasks: int = 0
    start: tuple[Point, Point] | None = None


class Talk(Struct, frozen=True):
    """The network settings of a run."""

    carrier: Carrier
    port: int
    shared: str | None = None  #: the group, or the broadcast address
    interface: str = "0.0.0.0"
    key: bytes | None = None
    key_file: str | None = None
    encrypts: bool = False
    run: str = "koord"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()


class RunConfiguration(ByContent, frozen=True):
    """The configuration of a run. ``robots[i]`` has pid i."""

    ASIDE: ClassVar[frozenset[str]] = frozenset({"document", "warnings"})

    name: str
    robots: tuple[RobotPlace, ...]
    talk: Talk
    world: World | None
    delta_s: float | None  #: None: as the program states
    seed: int
    leader: int
    params: Mapping[str, Any] = field(default_factory=dict)
    scatter: Scatter = Scatter()
    bounded: bool = False  #: whether it is said how large the world is
    monitor: MonitorForm = field(default_factory=MonitorForm)
    radio: RadioForm = field(default_factory=RadioForm)
    document: Document = field(default_factory=lambda: Document(Source("", ""), {}))
    warnings: tuple[Diagnostic, ...] = ()  #: of fields that have no effect

    def place(self, *path: str | int) -> Span:
        """The span of a field in the file."""
        return self.document.place(path)

    def word(self, *path: str | int) -> str | None:
        """The text of a scalar in the file; None if it is quoted."""
        return self.document.words.get(path)


def params(configuration: RunConfiguration) -> dict[str, ParamValue]:
    """The values of params in a configuration. Raises KoordError for invalid ones."""
    return {
        name: _value(configuration, value, ("params", name))
        for name, value in configuration.params.items()
    }


def _value(configuration: RunConfiguration, value: Any, path: tuple[str | int, ...]) -> ParamValue:
    word = configuration.word(*path)
    if isinstance(value, list):
        return tuple(_value(configuration, v, (*path, k)) for k, v in enumerate(value))
    if isinstance(value, bool) or (isinstance(value, str) and not is_number(word or "")):
        return value
    # YAML would round it to a double, to 0 for one, and does not see that 1e300 is a number.
    number, story = None, "this is no value of a param"
    try:
        number = None if word is None else read_number(word)
    except NumberOutOfRangeError as error:
        story = str(error)
    if number is None:
        hint = "a param is a number, a truth value, a text or a list of them"
        raise KoordError((problem(configuration.place(*path), story, hint),))
    return number
